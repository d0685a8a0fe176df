//! Matrices that mirror, flatten and squeeze.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, face_normals, transform_normals};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, numbers, rounding};
use crate::surfaces::sheet;

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    146 "normals: singular, mirrored", "the faces' normals, or zero", transformed;
};

fn transformed<T: Scalar>() -> Outcome {
    let (positions, faces) = sheet::<T>();
    let mesh = Mesh::new(faces, 49)?;
    // A mirror; onto a plane; onto a line; onto a point; and one that squeezes by 2^-40.
    let squeeze = f64::powi(2.0, -40);
    let matrices = [
        [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        [0.5, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0],
        [1.0, 2.0, 3.0, 2.0, 4.0, 6.0, -1.0, -2.0, -3.0],
        [0.0; 9],
        [1.0, 0.0, 0.0, 0.0, squeeze, 0.0, 0.0, 0.0, 1.0],
    ];
    let (mut error, mut finite) = (0.0_f64, true);
    for (matrix, power) in matrices.iter().flat_map(|matrix| [-60, 0, 60].map(|k| (matrix, k))) {
        let tape = Tape::<T>::new();
        let at = tape.leaf(&Tensor::from_flat_fn([49, 3], |k| T::from_f64(positions[k])));
        // In f64, as the images of points are not points that f32 has.
        let there = Tape::<f64>::new();
        let image = |k: usize| -> f64 {
            (0..3).map(|j| matrix[k % 3 * 3 + j] * positions[k / 3 * 3 + j]).sum()
        };
        let image = there.leaf(&Tensor::from_flat_fn([49, 3], image));
        let expected = numbers(&face_normals(image, &mesh)?.value());
        let scale = f64::powi(2.0, power);
        let matrix = tape.leaf(&Tensor::from_flat_fn([3, 3], |k| T::from_f64(scale * matrix[k])));
        let found = transform_normals(face_normals(at, &mesh)?, matrix)?;
        error = error.maximum_or_nan(difference(&numbers(&found.value()), &expected));
        let gradients = found.sum().backward()?;
        finite &= [at, matrix].iter().all(|&leaf| gradients.get_or_zeros(leaf).is_finite());
    }
    // The normals before are rounded.
    Ok(Verdict::within("the normals of the transformed faces", error, 32.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}
