//! Normals, tangents and map values without a direction.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::perturbed_normals;

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    149 "perturbed: no tangent, zeros", "the normal, or zero", perturbed;
};

fn perturbed<T: Scalar>() -> Outcome {
    let normal = [0.5, -0.25, 2.0];
    let along = normal.map(|entry| -3.0 * entry);
    let unit = 1.0 / (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
    let upright = normal.map(|entry| unit * entry);
    let down = upright.map(|entry| -entry);
    let (zero, across) = ([0.0; 3], [1.0, 0.0, 0.0]);
    // Normal, tangent and map value; what comes out.
    let table = [
        (normal, zero, [0.3, -0.5, 0.7], upright),
        (normal, along, [0.3, -0.5, -0.7], upright),
        (normal, along, zero, upright),
        (normal, across, [0.0, 0.0, 1e-30], upright),
        (normal, across, [0.0, 0.0, -1.0], down),
        (normal, across, zero, zero),
        (zero, across, [0.3, -0.5, 0.7], zero),
        (zero, zero, zero, zero),
    ];
    let mut error = 0.0_f64;
    let mut finite = true;
    for (normal, [x, y, z], value, expected) in table {
        for (scale, sign) in [(1.0, 1.0), (1e-30, -1.0), (1e30, -0.0)] {
            let tape = Tape::<T>::new();
            let leaf = |of: &[f64]| {
                tape.leaf(&Tensor::from_flat_fn([1, of.len()], |k| T::from_f64(of[k])))
            };
            let normal = leaf(&normal.map(|entry| scale * entry));
            let (tangent, value) = (leaf(&[scale * x, scale * y, scale * z, sign]), leaf(&value));
            let out = perturbed_normals(normal, tangent, value)?;
            error = error.maximum_or_nan(difference(&numbers(&out.value()), &expected));
            let gradients = out.sum().backward()?;
            let leaves = [normal, tangent, value];
            finite &= leaves.iter().all(|&leaf| gradients.get_or_zeros(leaf).is_finite());
            let is_zero = expected == zero;
            let bars = leaves.iter().flat_map(|&leaf| numbers(&gradients.get_or_zeros(leaf)));
            finite &= !is_zero || bars.into_iter().all(|bar| bar == 0.0);
        }
    }
    Ok(Verdict::within("the unit normal, its opposite, or zero", error, 4.0 * rounding::<T>())
        .and(finite, "a gradient is not finite, or not zero"))
}
