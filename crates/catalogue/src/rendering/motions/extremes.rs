//! Motions of any angle.

use bokashi_core::{Scalar, Tape};
use bokashi_render_ops::camera::{look_at, to_tensor};
use bokashi_render_ops::glam::{DMat4, DQuat, DVec3};
use bokashi_render_ops::se3;

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, has_finite_gradients, numbers, rounding, vector};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    124 "motions of any angle", "the rotation, finite gradients", motions_of_any_angle;
};

fn motions_of_any_angle<T: Scalar>() -> Outcome {
    let (axis, fixed) = (DVec3::new(0.6, -0.48, 0.64), look_at(DVec3::ONE, DVec3::ZERO, DVec3::Y));
    let (mut error, mut finite) = (0.0_f64, true);
    // At 0, far below it, where half a turn is not single-valued, and many turns on.
    for angle in [0.0, 1e-30, 1e-9, 1e-4, 0.5, 2.0, std::f64::consts::PI, 6.5, 100.0] {
        let tape = Tape::<T>::new();
        let entries = [0.5, -1.25, 0.75, axis.x * angle, axis.y * angle, axis.z * angle];
        let increment = vector(&tape, entries);
        let moved = se3(increment, &fixed)?;
        // The angle as the precision has it.
        let seen: Vec<_> = numbers(&increment.value());
        let turn = DVec3::new(seen[3], seen[4], seen[5]);
        let expected = DMat4::from_quat(DQuat::from_scaled_axis(turn)) * fixed;
        let (found, expected) = (numbers(&moved.value()), numbers(&to_tensor::<f64>(&expected)));
        for row in 0..3 {
            let columns = 4 * row..4 * row + 3;
            error = error.maximum_or_nan(difference(&found[columns.clone()], &expected[columns]));
        }
        finite &= has_finite_gradients(moved, &[increment])?;
    }
    let outcome = "the rotation of that axis and angle, finite gradients";
    Ok(Verdict::within(outcome, error, 16.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}
