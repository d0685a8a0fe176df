//! Sine: `y = sin x`, `x` in radians; `x_bar += cos x y_bar`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Sine;

impl<T: Scalar> Unary<T> for Sine {
    const NAME: &'static str = "sin";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.sin()
    }
    fn slope(self, x: T) -> T {
        x.cos()
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The sine of each entry, in radians.
    #[must_use]
    pub fn sin(self) -> Self {
        self.each(Sine)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn the_slope_is_the_sine_a_quarter_turn_ahead() {
        for x in [-4.0_f64, 0.0, 0.5, 3.0, 100.0] {
            let [value, slope] = value_and_slope(x, |x| x.sin());
            assert!((value * value + slope * slope - 1.0).abs() < 1e-15);
            assert!((slope - (x + std::f64::consts::FRAC_PI_2).sin()).abs() < 1e-13);
        }
    }
}
