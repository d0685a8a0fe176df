//! The angle of Helical valley.
//!
//! # Forward
//! `theta = atan(y / x) / 2 pi`, and `+ 1/2` where `x <= 0`: turns from -1/4 to 3/4. In numbers
//! without an arctangent the angle `a` of the value is taken in `f64`. It is corrected by the rest
//! that a rotation by `-a` leaves, `n / d = (y cos a - x sin a) / (x cos a + y sin a)`. The rest is
//! zero but for rounding, and has the right tangent.
//!
//! # Backward
//! `x_bar += -y / (2 pi (x^2 + y^2)) theta_bar`, `y_bar += x / (2 pi (x^2 + y^2)) theta_bar`.
//!
//! # Where it is not smooth
//! On the half-line `x = 0, y < 0`, where it jumps by a turn, and at the origin.
//!
//! # Source
//! More, Garbow and Hillstrom 1981, (7), with `x = x_1`, `y = x_2`.

use std::f64::consts::TAU;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

struct Turn;

impl<T: Scalar> Op<T> for Turn {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "turn"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (x_shape, y_shape) = (inputs.shape(0), inputs.shape(1));
        if x_shape != y_shape {
            return Err(TensorError::Mismatch {
                operation: "turn",
                rule: "two inputs of one shape".into(),
                shapes: Box::new([x_shape.clone(), y_shape.clone()]),
            });
        }
        let (x, y) = (inputs.data(0), inputs.data(1));
        let thetas = outputs.push(x_shape);
        for (k, theta) in thetas.iter_mut().enumerate() {
            let (x, y) = (x[k], y[k]);
            let angle = y.to_f64().atan2(x.to_f64());
            let (sin, cos) = (T::from_f64(angle.sin()), T::from_f64(angle.cos()));
            let rest = (y * cos - x * sin) / (x * cos + y * sin);
            // The quarter below the negative x axis is three quarters round.
            let whole = if x.to_f64() <= 0.0 && angle < 0.0 { 1.0 } else { 0.0 };
            *theta = T::from_f64(angle / TAU + whole) + rest * T::from_f64(1.0 / TAU);
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let (x, y, theta_bar) = (kept.input(0), kept.input(1), kept.only_upstream());
        let scale = |k: usize| theta_bar[k] * T::from_f64(1.0 / TAU) / (x[k] * x[k] + y[k] * y[k]);
        if let Some(x_bar) = gradients.get(0) {
            x_bar.add_each(|k| -(y[k] * scale(k)));
        }
        if let Some(y_bar) = gradients.get(1) {
            y_bar.add_each(|k| x[k] * scale(k));
        }
    }
}

/// The angle of `(x, y)` in turns, entry by entry, from -1/4 to 3/4.
///
/// # Errors
/// [`TensorError::Mismatch`] unless both have one shape.
pub(super) fn turn<'t, T: Scalar>(x: Var<'t, T>, y: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
    x.tape().apply(Turn, &[x, y])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Dual, Tape};

    use super::*;

    /// Angles in turns, all round.
    fn angles() -> impl Iterator<Item = f64> {
        (0..24).map(|k| -0.24 + k as f64 / 24.5)
    }

    #[test]
    fn the_turn_of_a_point_at_an_angle_is_that_angle() {
        for theta in angles() {
            let tape = Tape::new();
            let (sin, cos) = (TAU * theta).sin_cos();
            let (x, y) = (tape.leaf_scalar(3.0 * cos), tape.leaf_scalar(3.0 * sin));
            let z = turn(x, y).unwrap();
            assert!((z.item() - theta).abs() < 1e-15, "{theta} {}", z.item());
            let gradients = z.backward().unwrap();
            // Along the circle one turn per 2 pi r, along the radius none.
            let [gx, gy] = [x, y].map(|leaf| gradients.get(leaf).unwrap().item());
            assert!((gy * cos - gx * sin - 1.0 / (3.0 * TAU)).abs() < 1e-15);
            assert!((gx * cos + gy * sin).abs() < 1e-15);
        }
    }

    #[test]
    fn the_tangent_is_the_gradient_along_the_direction() {
        for theta in angles() {
            let (sin, cos) = (TAU * theta).sin_cos();
            let tape = Tape::new();
            let x = tape.leaf_scalar(Dual::new(cos, -sin));
            let y = tape.leaf_scalar(Dual::new(sin, cos));
            let tangent = turn(x, y).unwrap().item().tangent;
            assert!((tangent - 1.0 / TAU).abs() < 1e-15, "{theta} {tangent}");
        }
    }

    #[test]
    fn shapes_must_agree() {
        let tape = Tape::<f64>::new();
        let (x, y) = (tape.constant_full([2], 1.0), tape.constant_full([3], 1.0));
        let message = "turn needs two inputs of one shape, got shapes [2] and [3]";
        assert_eq!(turn(x, y).unwrap_err().to_string(), message);
    }
}
