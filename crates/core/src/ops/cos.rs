//! Cosine: `y = cos x`, `x` in radians; `x_bar -= sin x y_bar`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Cosine;

impl<T: Scalar> Unary<T> for Cosine {
    const NAME: &'static str = "cos";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.cos()
    }
    fn slope(self, x: T) -> T {
        -x.sin()
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The cosine of each entry, in radians.
    #[must_use]
    pub fn cos(self) -> Self {
        self.each(Cosine)
    }
}
