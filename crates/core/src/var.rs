//! Variables: small handles to values on a tape.

use std::fmt;

use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::tape::{Inner, Tape};
use crate::tensor::Tensor;

/// A value on a tape: a reference to the tape and an index.
///
/// Operators and methods record operations. Operators panic on shapes that do not fit, at the
/// caller's line; methods whose other parameters can be wrong return a `Result`.
pub struct Var<'t, T: Scalar> {
    pub(crate) tape: &'t Tape<T>,
    pub(crate) index: u32,
}

impl<T: Scalar> Clone for Var<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: Scalar> Copy for Var<'_, T> {}

impl<'t, T: Scalar> Var<'t, T> {
    /// The tape that holds the value.
    pub fn tape(self) -> &'t Tape<T> {
        self.tape
    }

    /// The value; shares the buffer on the tape.
    pub fn value(self) -> Tensor<T> {
        let Inner { values, pool, .. } = &mut *self.tape.inner.borrow_mut();
        let value = &mut values[self.index as usize];
        Tensor::from_parts(value.shape.clone(), value.share(pool))
    }

    /// The shape of the value.
    pub fn shape(self) -> Shape {
        self.tape.inner.borrow().values[self.index as usize].shape.clone()
    }

    /// The first entry: the value of a scalar.
    ///
    /// # Panics
    /// Where the value has no entry.
    pub fn item(self) -> T {
        self.tape.inner.borrow().values[self.index as usize].data()[0]
    }

    /// Whether a gradient with respect to the variable could be asked for: whether a leaf lies
    /// below it.
    pub fn needs_gradient(self) -> bool {
        self.tape.inner.borrow().values[self.index as usize].needs
    }

    /// The name of the operation that computed the value; `None` for a leaf or a constant.
    pub fn operation(self) -> Option<&'static str> {
        self.tape.inner.borrow().operation(self.index as usize).flatten()
    }

    /// The same value without a gradient: what lies below it is held constant.
    #[must_use]
    pub fn detach(self) -> Self {
        self.tape.constant(&self.value())
    }
}

impl<T: Scalar> fmt::Debug for Var<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Var {} = {:?}", self.index, self.value())
    }
}

#[cfg(test)]
mod tests {
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn a_detached_variable_is_a_constant_of_the_same_value() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::full([2], 3.0));
        let frozen = x.square().detach();
        assert_eq!(frozen.value(), Tensor::full([2], 9.0));
        assert!(x.needs_gradient() && !frozen.needs_gradient());
        let gradients = (frozen * x).sum().backward().unwrap();
        assert_eq!(gradients.get(x), Some(&Tensor::full([2], 9.0)));
        assert_eq!(gradients.get(frozen), None);
    }
}
