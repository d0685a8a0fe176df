//! Variables: small handles to values on a tape, and how values come onto it.

use std::fmt;

use crate::error::TensorError;
use crate::pool::Pool;
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::tape::{Inner, Tape};
use crate::tensor::{Tensor, only};
use crate::value::{Parting, Value};

/// A value on a tape: a reference to the tape and an index.
///
/// Operators and methods record operations. What can be refused returns a `Result`; operators panic
/// instead, at the caller's line (see the crate's first page).
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

    /// The only entry: the value of a scalar, whatever its rank.
    ///
    /// # Panics
    /// Unless the value has exactly one entry.
    #[track_caller]
    pub fn item(self) -> T {
        let value = &self.tape.inner.borrow().values[self.index as usize];
        only(&value.shape, value.data())
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

    /// Whether the operation of that name computed the value from `input`, so that a gradient can go there.
    pub fn is_computed_from(self, operation: &str, input: Self) -> bool {
        let Inner { nodes, links, .. } = &*self.tape.inner.borrow();
        let after = nodes.partition_point(|node| node.first_output <= self.index);
        let Some(node) = after.checked_sub(1).map(|index| &nodes[index]) else { return false };
        node.outputs().contains(&(self.index as usize))
            && links[node.links()].contains(&input.index)
            && self.operation() == Some(operation)
    }

    /// The same value without a gradient: what lies below it is held constant.
    #[must_use]
    pub fn detach(self) -> Self {
        let value = self.value();
        self.tape.inner.borrow_mut().values[self.index as usize].parting = Parting::Detached;
        self.tape.constant(&value)
    }
}

/// Values that no operation computes.
impl<T: Scalar> Tape<T> {
    /// A variable with a gradient. Shares the buffer of `tensor`.
    pub fn leaf(&self, tensor: &Tensor<T>) -> Var<'_, T> {
        self.push(true, |value, pool| value.hold(tensor, pool))
    }

    /// A variable with a gradient that starts as a copy of `tensor`, in recycled memory: `tensor`
    /// can then be written to without a copy of its own.
    pub fn leaf_copied(&self, tensor: &Tensor<T>) -> Var<'_, T> {
        self.push_copy(true, tensor.shape(), tensor.data())
    }

    /// [`Tape::leaf_copied`] of the entries of an array of `shape`, row-major, that is no tensor.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless there are as many entries as the shape has.
    pub fn leaf_of(
        &self,
        shape: impl Into<Shape>,
        entries: &[T],
    ) -> Result<Var<'_, T>, TensorError> {
        Ok(self.push_copy(true, &checked(shape, entries)?, entries))
    }

    /// A value without a gradient. Shares the buffer of `tensor`.
    pub fn constant(&self, tensor: &Tensor<T>) -> Var<'_, T> {
        self.push(false, |value, pool| value.hold(tensor, pool))
    }

    /// A value without a gradient: a copy of the entries of an array of `shape`, row-major, in recycled memory.
    ///
    /// # Errors
    /// As [`Tape::leaf_of`].
    pub fn constant_of(
        &self,
        shape: impl Into<Shape>,
        entries: &[T],
    ) -> Result<Var<'_, T>, TensorError> {
        Ok(self.push_copy(false, &checked(shape, entries)?, entries))
    }

    /// A scalar variable with a gradient.
    pub fn leaf_scalar(&self, number: T) -> Var<'_, T> {
        self.leaf_full([], number)
    }

    /// A scalar without a gradient.
    pub fn constant_scalar(&self, number: T) -> Var<'_, T> {
        self.constant_full([], number)
    }

    /// A variable of `shape` with a gradient, every entry `number`.
    pub fn leaf_full(&self, shape: impl Into<Shape>, number: T) -> Var<'_, T> {
        self.push_full(true, shape.into(), number)
    }

    /// A value of `shape` without a gradient, every entry `number`.
    pub fn constant_full(&self, shape: impl Into<Shape>, number: T) -> Var<'_, T> {
        self.push_full(false, shape.into(), number)
    }

    fn push_copy(&self, needs: bool, shape: &Shape, entries: &[T]) -> Var<'_, T> {
        self.push(needs, |value, pool| value.renew(shape, pool).copy_from_slice(entries))
    }

    fn push_full(&self, needs: bool, shape: Shape, number: T) -> Var<'_, T> {
        if shape.size_in_memory::<T>().is_none() {
            panic!("a shape needs fewer entries than fit into memory, got {shape}");
        }
        self.push(needs, |value, pool| value.renew(&shape, pool).fill(number))
    }

    /// Adds a value that no operation computes, as `fill` makes it.
    fn push(&self, needs: bool, fill: impl FnOnce(&mut Value<T>, &mut Pool<T>)) -> Var<'_, T> {
        let Inner { values, live, pool, .. } = &mut *self.inner.borrow_mut();
        if values.len() == *live {
            values.push(Value::vacant());
        }
        let value = &mut values[*live];
        fill(value, pool);
        let needs = T::HAS_BACKWARD && needs;
        (value.needs, value.entry, value.parting) = (needs, None, Parting::None);
        *live += 1;
        Var { tape: self, index: *live as u32 - 1 }
    }

    /// Every value of the step so far, in the order of recording. A backward pass to all of them
    /// ([`Var::backward_to`]) shows the gradient at each.
    pub fn variables(&self) -> impl ExactSizeIterator<Item = Var<'_, T>> {
        (0..self.len()).map(|index| Var { tape: self, index: index as u32 })
    }
}

/// The shape of an array, which has to have as many entries.
fn checked<T>(shape: impl Into<Shape>, entries: &[T]) -> Result<Shape, TensorError> {
    let shape = shape.into();
    match shape.checked_size() {
        Some(size) if size == entries.len() => Ok(shape),
        _ => Err(TensorError::Length { shape, entries: entries.len() }),
    }
}

impl<T: Scalar> fmt::Debug for Var<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Var {} = {:?}", self.index, self.value())
    }
}
