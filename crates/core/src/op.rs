//! The one interface behind every operation on the tape, built in or a user's.
//!
//! An operation maps input tensors to output tensors and knows its adjoint. Given the gradient of a
//! loss with respect to its outputs (*upstream*), it adds `J^T upstream` into the gradients of those
//! inputs that need one.
//!
//! Two masks save work. While recording, [`Inputs::needs`] says which gradients could ever be asked
//! for, and so decides what is kept. In a backward pass, [`Accumulators::needs`] says which gradients
//! are wanted now, and so decides what is computed.

use crate::error::TensorError;
use crate::gradient::{Accumulator, Accumulators};
use crate::pool::Pool;
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::value::Value;

/// A differentiable operation with a hand-written backward pass.
///
/// Used through [`Tape::apply`](crate::Tape::apply) and [`Tape::record`](crate::Tape::record).
pub trait Op<T: Scalar>: Send + 'static {
    /// What `forward` computes beside its outputs and `backward` reads. Where a step repeats the
    /// last one, `forward` finds here what the last step left: it overwrites the contents and
    /// reuses the memory.
    type Saved: Default + Send + 'static;

    /// What `forward` can refuse.
    type Error: From<TensorError>;

    /// The name in reports and messages.
    fn name(&self) -> &'static str;

    /// Computes the outputs, in [`Outputs`], from the inputs.
    ///
    /// # Errors
    /// Inputs that the operation is not defined for; the tape then stays as it was.
    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), Self::Error>;

    /// Which inputs and outputs `backward` reads; it can read no others. None, unless an operation says so.
    /// Asked after `forward`, and only where some input needs a gradient.
    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    /// Adds `J^T upstream` into the gradients of the inputs that need one.
    ///
    /// It may use memory in `saved`, but leaves there what another backward pass will read.
    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    );

    /// The size of what is saved, in bytes, for reports.
    fn saved_bytes(&self, _saved: &Self::Saved) -> usize {
        0
    }
}

/// What a backward pass reads of the inputs and outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Keep {
    inputs: u64,
    outputs: u64,
    takes_upstream: bool,
}

impl Keep {
    /// Nothing: the backward pass needs shapes alone.
    pub const NOTHING: Self = Self { inputs: 0, outputs: 0, takes_upstream: false };

    /// The value of input `i`, one of the first 64.
    #[must_use]
    pub const fn input(self, i: usize) -> Self {
        Self { inputs: self.inputs | 1 << i, ..self }
    }

    /// The value of input `i`, one of the first 64, where `is_read`.
    #[must_use]
    pub const fn input_if(self, i: usize, is_read: bool) -> Self {
        if is_read { self.input(i) } else { self }
    }

    /// The value of output `j`, one of the first 64.
    #[must_use]
    pub const fn output(self, j: usize) -> Self {
        Self { outputs: self.outputs | 1 << j, ..self }
    }

    /// Beside these, the gradient of the only output as memory: the backward pass looks for it in
    /// [`Accumulators::take_upstream`] first, and only then in [`Kept::only_upstream`]. For an operation
    /// that changes few entries, so that an input's gradient is mostly that of the output.
    #[must_use]
    pub const fn upstream(self) -> Self {
        Self { takes_upstream: true, ..self }
    }

    /// Whether the gradient of the only output of an operation may be taken over.
    #[inline]
    pub(crate) fn takes_upstream(self) -> bool {
        self.takes_upstream
    }

    #[inline]
    fn has_input(self, i: usize) -> bool {
        self.inputs.checked_shr(i as u32).is_some_and(|bits| bits & 1 == 1)
    }

    #[inline]
    fn has_output(self, j: usize) -> bool {
        self.outputs.checked_shr(j as u32).is_some_and(|bits| bits & 1 == 1)
    }
}

/// The inputs of an operation while it is recorded.
#[derive(Debug)]
pub struct Inputs<'a, T> {
    pub(crate) values: &'a [Value<T>],
    pub(crate) indices: &'a [u32],
}

impl<'a, T: Scalar> Inputs<'a, T> {
    /// How many inputs there are.
    #[allow(clippy::len_without_is_empty, reason = "an operation knows how many inputs it takes")]
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// The entries of input `i`, row-major.
    #[inline]
    pub fn data(&self, i: usize) -> &'a [T] {
        self.values[self.indices[i] as usize].data()
    }

    /// The shape of input `i`.
    #[inline]
    pub fn shape(&self, i: usize) -> &'a Shape {
        &self.values[self.indices[i] as usize].shape
    }

    /// Whether a gradient with respect to input `i` could be asked for later.
    pub fn needs(&self, i: usize) -> bool {
        self.values[self.indices[i] as usize].needs
    }

    /// Whether a gradient with respect to any input could be asked for later.
    pub fn any_needs(&self) -> bool {
        self.indices.iter().any(|&index| self.values[index as usize].needs)
    }
}

/// An output that is an input under another shape.
#[derive(Debug)]
pub(crate) struct Renamed {
    pub(crate) output: usize,
    pub(crate) shape: Shape,
    pub(crate) input: usize,
}

/// The outputs that an operation computes.
#[derive(Debug)]
pub struct Outputs<'a, T> {
    pub(crate) pool: &'a mut Pool<T>,
    /// The places of the next values on the tape.
    pub(crate) places: &'a mut [Value<T>],
    /// Further ones, where there are more outputs than places.
    pub(crate) further: &'a mut Vec<Value<T>>,
    pub(crate) count: usize,
    pub(crate) renamed: &'a mut Vec<Renamed>,
    /// The input that is the output, and why.
    pub(crate) passed: Option<(usize, &'static str)>,
}

impl<T: Scalar> Outputs<'_, T> {
    /// Adds an output of `shape` and gives its entries. They start as whatever an earlier use of
    /// the buffer left: the operation writes every one of them.
    #[inline]
    pub fn push(&mut self, shape: impl AsRef<[usize]>) -> &mut [T] {
        let place = match self.places.get_mut(self.count) {
            Some(place) => place,
            None => another(self.further),
        };
        self.count += 1;
        place.renew(shape.as_ref(), self.pool)
    }

    /// [`Outputs::push`], for an output that can be far larger than the inputs: refused before memory is taken
    /// that there is not.
    ///
    /// # Errors
    /// [`TensorError::Memory`] where no index counts the entries, or the allocator has no room for them.
    pub fn try_push(
        &mut self,
        operation: &'static str,
        shape: impl AsRef<[usize]>,
    ) -> Result<&mut [T], TensorError> {
        let shape = shape.as_ref();
        if !self.pool.has_room(shape) {
            return Err(TensorError::Memory { operation, shape: shape.into() });
        }
        Ok(self.push(shape))
    }

    /// Adds an output for each of `shapes`, as [`Outputs::push`] does, and gives the entries of
    /// all of them at once.
    pub fn push_all<const N: usize>(&mut self, shapes: [Shape; N]) -> [&mut [T]; N] {
        let first = self.count;
        for shape in shapes {
            self.push(shape);
        }
        let mut new = self.places.iter_mut().chain(&mut *self.further).skip(first);
        std::array::from_fn(|_| new.next().expect("one was pushed per shape").data_mut())
    }

    /// Adds an output that is input `input` under another shape of as many entries; the buffer is
    /// shared.
    pub fn push_renamed(&mut self, shape: impl Into<Shape>, input: usize) {
        // Its place stays vacant until the operation is recorded.
        match self.places.get_mut(self.count) {
            Some(place) => place.release(self.pool),
            None => {
                another(self.further);
            }
        }
        self.renamed.push(Renamed { output: self.count, shape: shape.into(), input });
        self.count += 1;
    }

    /// A buffer of `length` entries for what the operation saves, of those that wait to be used again. They
    /// are whatever an earlier use left. It comes back where the backward pass gives it to a gradient
    /// ([`Accumulators::give`]).
    pub fn buffer(&mut self, length: usize) -> Vec<T> {
        self.pool.take(length)
    }

    /// Says that the operation is the identity: its one output is input `input` itself. Then
    /// nothing is recorded, the caller gets the input's variable back, and the tape's report says
    /// that the operation was left out, and why. An operation that passes an input on pushes no
    /// output.
    pub fn pass(&mut self, input: usize, reason: &'static str) {
        self.passed = Some((input, reason));
    }
}

/// One more place for a value.
#[cold]
fn another<T: Scalar>(places: &mut Vec<Value<T>>) -> &mut Value<T> {
    places.push(Value::vacant());
    places.last_mut().expect("one was just pushed")
}

/// What a backward pass sees: the upstream gradients, and the values that the operation kept.
#[derive(Debug)]
pub struct Kept<'a, T> {
    pub(crate) operation: &'static str,
    pub(crate) keep: Keep,
    pub(crate) inputs: Inputs<'a, T>,
    pub(crate) outputs: &'a [Value<T>],
    pub(crate) upstream: &'a [Accumulator<T>],
}

impl<T: Scalar> Kept<'_, T> {
    /// The gradient of the loss with respect to output `j`; `None` where it is zero because
    /// nothing after this operation used the output.
    #[inline]
    pub fn upstream(&self, j: usize) -> Option<&[T]> {
        self.upstream[j].sum()
    }

    /// The gradient with respect to the only output of an operation that has one.
    #[inline]
    pub fn only_upstream(&self) -> &[T] {
        self.upstream(0).expect("backward runs where some output has an upstream gradient")
    }

    /// The entries of input `i`.
    ///
    /// # Panics
    /// Where the operation did not ask to keep it.
    #[inline]
    pub fn input(&self, i: usize) -> &[T] {
        assert!(self.keep.has_input(i), "{} did not keep its input {i}", self.operation);
        self.inputs.data(i)
    }

    /// The entries of output `j`.
    ///
    /// # Panics
    /// Where the operation did not ask to keep it.
    #[inline]
    pub fn output(&self, j: usize) -> &[T] {
        assert!(self.keep.has_output(j), "{} did not keep its output {j}", self.operation);
        self.outputs[j].data()
    }

    /// How many inputs there are.
    pub fn input_count(&self) -> usize {
        self.inputs.len()
    }

    /// The shape of input `i`, kept or not.
    #[inline]
    pub fn input_shape(&self, i: usize) -> &Shape {
        self.inputs.shape(i)
    }

    /// The shape of output `j`, kept or not.
    #[inline]
    pub fn output_shape(&self, j: usize) -> &Shape {
        &self.outputs[j].shape
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_told_apart() {
        let keep = Keep::NOTHING.input(0).input(63).output(2);
        let inputs: Vec<_> = (0..130).filter(|&i| keep.has_input(i)).collect();
        let outputs: Vec<_> = (0..130).filter(|&j| keep.has_output(j)).collect();
        assert_eq!((inputs, outputs), (vec![0, 63], vec![2]));
    }
}
