//! Operations that a backward pass can visit, and the memory that each place on the tape keeps for
//! the next step.

use std::any::Any;
use std::ops::Range;

use crate::gradient::Accumulators;
use crate::op::{Keep, Kept, Op};
use crate::scalar::Scalar;

/// One operation that a backward pass can visit.
pub(crate) struct Node {
    /// Where the operation and what it saved are.
    pub(crate) place: u32,
    /// The operation's entry in the report.
    pub(crate) entry: u32,
    pub(crate) keep: Keep,
    pub(crate) first_input: u32,
    pub(crate) input_count: u32,
    pub(crate) first_output: u32,
    pub(crate) output_count: u32,
}

impl Node {
    /// Where in the tape's list of links the indices of the inputs are.
    #[inline]
    pub(crate) fn links(&self) -> Range<usize> {
        self.first_input as usize..(self.first_input + self.input_count) as usize
    }

    /// The indices of the outputs.
    #[inline]
    pub(crate) fn outputs(&self) -> Range<usize> {
        self.first_output as usize..(self.first_output + self.output_count) as usize
    }
}

/// What the k-th operation of a step has on the tape. It stays when the step ends, so that the
/// k-th operation of the next one finds its memory.
pub(crate) struct Place<T> {
    pub(crate) recorded: Box<dyn Recorded<T>>,
    /// The operation's entry in the report, if it still has the same name.
    pub(crate) entry: u32,
}

/// An operation of any type with what it saved.
pub(crate) trait Recorded<T>: Any + Send {
    fn backward(&mut self, kept: &Kept<'_, T>, gradients: &mut Accumulators<'_, T>);
    /// Drops the operation, and with it what it shares with others; keeps the memory of what it
    /// saved.
    fn retire(&mut self);
}

/// An operation of type `O`, where one is recorded, and the memory of what it saved.
pub(crate) struct Slot<O, S> {
    pub(crate) op: Option<O>,
    pub(crate) saved: S,
}

impl<T: Scalar, O: Op<T>> Recorded<T> for Slot<O, O::Saved> {
    fn backward(&mut self, kept: &Kept<'_, T>, gradients: &mut Accumulators<'_, T>) {
        // Where the constant is false the compiler does not even generate `O::backward`.
        if T::HAS_BACKWARD {
            let op = self.op.as_ref().expect("a node's place holds its operation");
            op.backward(kept, &mut self.saved, gradients);
        }
    }

    fn retire(&mut self) {
        self.op = None;
    }
}

/// Place `index`, with a slot of the right type: the one that the last step left there where its
/// operation was of the same kind, a new one otherwise.
#[inline]
pub(crate) fn spare_place<T: Scalar, O: Op<T>>(
    places: &mut Vec<Place<T>>,
    index: usize,
) -> &mut Place<T> {
    let new_slot = || Box::new(Slot::<O, O::Saved> { op: None, saved: O::Saved::default() });
    match places.get_mut(index) {
        Some(place) => {
            let any: &dyn Any = &*place.recorded;
            if !any.is::<Slot<O, O::Saved>>() {
                place.recorded = new_slot();
            }
        }
        None => places.push(Place { recorded: new_slot(), entry: 0 }),
    }
    &mut places[index]
}

/// The slot of an operation of type `O`.
#[inline]
pub(crate) fn slot_in<T: Scalar, O: Op<T>>(
    recorded: &mut dyn Recorded<T>,
) -> &mut Slot<O, O::Saved> {
    let any: &mut dyn Any = recorded;
    any.downcast_mut().expect("the slot was made for this type")
}
