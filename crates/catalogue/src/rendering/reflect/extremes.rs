//! Mirrors of any normal, and of none.

use bokashi_core::{Scalar, Tape};
use bokashi_render_ops::reflect;

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, numbers, rounding, rows};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    167 "mirrored: any normal, or none", "mirrored, or as it was", mirrored;
};

fn mirrored<T: Scalar>() -> Outcome {
    let direction = [0.5, -1.0, 2.0];
    let mut error = 0.0_f64;
    let mut is_zero = true;
    for scale in [1e-30, 1.0, 1e30] {
        let tape = Tape::<T>::new();
        let normals = rows(&tape, &[[0.0, scale, 0.0], [0.0; 3], [scale, scale, 0.0]]);
        let out = reflect(rows(&tape, &[direction; 3]), normals)?;
        let expected = [[0.5, 1.0, 2.0], direction, [1.0, -0.5, 2.0]];
        error = error.maximum_or_nan(difference(&numbers(&out.value()), expected.as_flattened()));
        let bars = numbers(&out.square().sum().backward()?.get_or_zeros(normals));
        is_zero &= bars[3..6] == [0.0; 3] && bars.iter().all(|bar| bar.is_finite());
    }
    Ok(Verdict::within("the mirror image, or what was given", error, 4.0 * rounding::<T>())
        .and(is_zero, "a gradient is not finite, or not zero"))
}
