//! Power with a constant exponent: `y = x^a`; `x_bar += a x^(a-1) y_bar`.
//!
//! # Where it is not smooth
//! At `x = 0` for `a < 1`, where the slope is infinite; `x^0` is 1 with slope 0 everywhere. Below 0
//! value and slope are NaN unless `a` is whole.

use crate::elementwise::{SlopeFrom, Unary};
use crate::power::slope_to_base;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Power<T> {
    exponent: T,
}

impl<T: Scalar> Unary<T> for Power<T> {
    const NAME: &'static str = "powf";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn is_identity(self) -> Option<&'static str> {
        self.exponent.is_same(T::ONE).then_some("the exponent is 1")
    }
    fn value(self, x: T) -> T {
        x.powf(self.exponent)
    }
    fn slope(self, x: T) -> T {
        slope_to_base(x, self.exponent)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Each entry to the power of `exponent`, a constant: a tone curve, say. NaN below 0 unless the
    /// exponent is whole. For an exponent with a gradient see [`Var::pow`].
    ///
    /// Where the exponent lies between 0 and 1 the slope at 0 is infinite, so the gradient is infinite,
    /// or NaN where the upstream gradient is 0.
    #[must_use]
    pub fn powf(self, exponent: T) -> Self {
        self.each(Power { exponent })
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;
    use crate::tape::Tape;

    #[test]
    fn value_and_slope_by_hand() {
        assert_eq!(value_and_slope(4.0, |x| x.powf(0.5)), [2.0, 0.25]);
        assert_eq!(value_and_slope(-2.0, |x| x.powf(3.0)), [-8.0, 12.0]);
        assert_eq!(value_and_slope(0.0, |x| x.powf(0.5)), [0.0, f64::INFINITY]);
        assert_eq!(value_and_slope(0.0, |x| x.powf(2.0)), [0.0, 0.0]);
        assert_eq!(value_and_slope(0.0, |x| x.powf(0.0)), [1.0, 0.0]);
        assert!(value_and_slope(-2.0_f64, |x| x.powf(0.5)).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn an_exponent_of_one_is_the_identity() {
        let tape = Tape::new();
        let x = tape.leaf_scalar(-3.0);
        assert_eq!((x.powf(1.0).item(), tape.len()), (-3.0, 1));
    }
}
