//! Meshes of any size, of needles, of faces without an area.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Mesh, RenderError, Weighting, face_normals, vertex_normals};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, numbers, rounding};
use crate::surfaces::sheet;

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    141 "normals: faces without an area", "zero, no gradient, no part", without_an_area;
    142 "normals: a mesh times 2^k", "the same bits, gradients / 2^k", any_size;
    143 "normals: none, or they cancel", "zero, no gradient", no_normal;
    144 "normals: needles and caps", "the plane's normal", needles;
};

/// Normals as an operation on positions.
type Normals<T> = for<'t> fn(Var<'t, T>, &Mesh) -> Result<Var<'t, T>, RenderError>;

/// Every kind of normal, and its name on the tape.
fn kinds<T: Scalar>() -> [(&'static str, Normals<T>); 3] {
    [
        ("face_normals", |positions, mesh| face_normals(positions, mesh)),
        ("vertex_normals", |positions, mesh| vertex_normals(positions, mesh, Weighting::Area)),
        ("vertex_normals", |positions, mesh| vertex_normals(positions, mesh, Weighting::Angle)),
    ]
}

/// Normals, and gradients for motley upstream.
fn run<T: Scalar>(
    normals: Normals<T>,
    positions: &[f64],
    faces: &[[u32; 3]],
) -> Result<[Vec<f64>; 2], Failure> {
    let tape = Tape::<T>::new();
    let count = positions.len() / 3;
    let mesh = Mesh::new(faces.to_vec(), count)?;
    let positions = tape.leaf(&Tensor::from_flat_fn([count, 3], |k| T::from_f64(positions[k])));
    let out = normals(positions, &mesh)?;
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(motley(3 * k + 1)));
    let gradients = tape.vjp(&[(out, &upstream)])?;
    Ok([numbers(&out.value()), numbers(&gradients.get_or_zeros(positions))])
}

fn without_an_area<T: Scalar>() -> Outcome {
    let (mut positions, mut faces) = sheet::<T>();
    // Four vertices more, on a line and in one place; each degenerate face also touches the sheet or
    // names a vertex twice.
    positions.extend([3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 9.0, 12.0, 15.0, 9.0, 12.0, 15.0]);
    let flat = [[49, 50, 51], [51, 50, 49], [0, 51, 52], [0, 0, 7], [8, 8, 8], [49, 52, 52]];
    let mut wrong = 0;
    for size in [-50, 0, 50].map(|power| f64::powi(2.0, power)) {
        let scaled: Vec<f64> = positions.iter().map(|x| size * x).collect();
        let (proper, mut all) = (faces.clone(), flat.to_vec());
        all.extend(&faces);
        for (k, (_, normals)) in kinds::<T>().into_iter().enumerate() {
            let [expected, _] = run(normals, &scaled, &proper)?;
            let [found, bars] = run(normals, &scaled, &all)?;
            let zeros = if k == 0 { flat.len() * 3 } else { 0 };
            let (none, rest) = found.split_at(zeros);
            wrong += none.iter().filter(|&&entry| entry != 0.0).count();
            wrong += usize::from(rest != expected);
            // The vertices that no proper face has.
            wrong += bars[147..].iter().filter(|&&bar| bar != 0.0).count();
        }
    }
    faces.clear();
    for (_, normals) in kinds::<T>() {
        let [found, bars] = run(normals, &positions, &faces)?;
        wrong += found.iter().chain(&bars).filter(|&&entry| entry != 0.0).count();
    }
    Ok(Verdict::exactly("zero vectors, zero gradients, the other normals as without", wrong))
}

fn any_size<T: Scalar>() -> Outcome {
    let (positions, faces) = sheet::<T>();
    // Far beyond 1e-30 to 1e30, and 1e-15 to 1e15 in f32.
    let most = if rounding::<T>() < 1e-10 { 900 } else { 80 };
    let mut wrong = 0;
    for (_, normals) in kinds::<T>() {
        let [expected, expected_bars] = run(normals, &positions, &faces)?;
        for power in [-most, -50, 1, 50, most] {
            let scale = f64::powi(2.0, power);
            let scaled: Vec<f64> = positions.iter().map(|x| scale * x).collect();
            let [found, bars] = run(normals, &scaled, &faces)?;
            let is_same = bars.iter().zip(&expected_bars).all(|(bar, other)| scale * bar == *other);
            wrong += usize::from(found != expected) + usize::from(!is_same);
        }
    }
    Ok(Verdict::exactly("the same normals, gradients times 2^-k", wrong))
}

fn no_normal<T: Scalar>() -> Outcome {
    let (positions, mut faces) = sheet::<T>();
    // The back of every face, with the corners in another order.
    let back: Vec<[u32; 3]> = faces.iter().rev().map(|&[a, b, c]| [a, c, b]).collect();
    faces.extend(back);
    let mut wrong = 0;
    for (_, normals) in &kinds::<T>()[1..] {
        for faces in [&faces[..], &[]] {
            let [found, bars] = run(*normals, &positions, faces)?;
            wrong += found.iter().chain(&bars).filter(|&&entry| entry != 0.0).count();
        }
    }
    Ok(Verdict::exactly("zero vectors, zero gradients", wrong))
}

fn needles<T: Scalar>() -> Outcome {
    // In the plane through the origin with normal (1, 2, 2) / 3, on whole numbers and halves: exact.
    let (u, v, plane) = ([2.0, -2.0, 1.0], [2.0, 1.0, -2.0], [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0]);
    let mut error = 0.0_f64;
    for power in [-10, -20, -23] {
        let width = f64::powi(2.0, power);
        let at = |s: f64, t: f64| [0, 1, 2].map(|i| s * u[i] + t * v[i]);
        // A needle whose tip is the first, the second, the third corner; a cap; and a fan of both.
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, width), at(0.5, -width)];
        let positions = corners.concat();
        for faces in
            [&[[0, 1, 2]][..], &[[2, 0, 1]], &[[1, 2, 0]], &[[0, 3, 1]], &[[0, 1, 2], [0, 3, 1]]]
        {
            for (_, normals) in kinds::<T>() {
                let [found, bars] = run(normals, &positions, faces)?;
                for normal in found.chunks(3).filter(|normal| normal.iter().any(|&x| x != 0.0)) {
                    error = error.maximum_or_nan(difference(normal, &plane));
                }
                // The true gradient of a width of 1e-7 is 1e7.
                error = error.maximum_or_nan(0.0 * largest(bars));
            }
        }
    }
    Ok(Verdict::within("the normal of the plane they lie in", error, 4.0 * rounding::<T>()))
}
