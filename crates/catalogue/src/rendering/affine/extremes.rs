//! Matrices of any size.

use bokashi_core::{Scalar, Tape};
use bokashi_render_ops::affine_inverse;
use bokashi_render_ops::camera::to_tensor;
use bokashi_render_ops::glam::{DMat4, DQuat, DVec3};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, has_finite_gradients, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    125 "inverses from 1e-12 to 1e12", "times the matrix the identity", inverses_any_size;
};

fn inverses_any_size<T: Scalar>() -> Outcome {
    let (mut error, mut finite) = (0.0_f64, true);
    let turn = DMat4::from_quat(DQuat::from_xyzw(0.1, 0.7, -0.5, 0.3).normalize());
    for scale in [1e-12, 1e-6, 1.0, 1e6, 1e12] {
        let tape = Tape::<T>::new();
        let matrix = tape.leaf(&to_tensor::<T>(&(turn * DMat4::from_scale(DVec3::splat(scale)))));
        let inverse = affine_inverse(matrix)?;
        let product = numbers(&inverse.matmul(matrix)?.value());
        error = error
            .maximum_or_nan(difference(&product, &numbers(&to_tensor::<f64>(&DMat4::IDENTITY))));
        finite &= has_finite_gradients(inverse, &[matrix])?;
    }
    let outcome = "times the matrix it is the identity, finite gradients";
    Ok(Verdict::within(outcome, error, 8.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}
