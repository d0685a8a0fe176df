//! Recording operations.
//!
//! An operation none of whose inputs needs a gradient is computed and forgotten: it leaves values
//! but no node. One that turns out to be the identity leaves neither.

use std::any::Any;
use std::ops::Range;
use std::time::Instant;

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::op::{Accumulators, Inputs, Keep, Kept, Op, Output, Outputs};
use crate::scalar::Scalar;
use crate::tape::{Inner, Tape};
use crate::value::Value;
use crate::var::Var;

/// The outputs of a recorded operation; up to four need no allocation.
pub type Variables<'t, T> = SmallVec<[Var<'t, T>; 4]>;

/// One operation that a backward pass can visit.
pub(crate) struct Node {
    /// Where the operation and what it saved are.
    pub(crate) place: u32,
    /// The operation's entry in the report.
    pub(crate) entry: u32,
    pub(crate) keep: Keep,
    first_input: u32,
    input_count: u32,
    first_output: u32,
    output_count: u32,
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
    entry: u32,
}

/// An operation of any type with what it saved.
pub(crate) trait Recorded<T>: Any + Send {
    fn backward(&mut self, kept: &Kept<'_, T>, gradients: &mut Accumulators<'_, T>);
    /// Drops the operation, and with it what it shares with others; keeps the memory of what it
    /// saved.
    fn retire(&mut self);
}

/// An operation of type `O`, where one is recorded, and the memory of what it saved.
struct Slot<O, S> {
    op: Option<O>,
    saved: S,
}

impl<T: Scalar, O: Op<T>> Recorded<T> for Slot<O, O::Saved> {
    fn backward(&mut self, kept: &Kept<'_, T>, gradients: &mut Accumulators<'_, T>) {
        let op = self.op.as_ref().expect("a node's place holds its operation");
        op.backward(kept, &mut self.saved, gradients);
    }

    fn retire(&mut self) {
        self.op = None;
    }
}

impl<T: Scalar> Tape<T> {
    /// Records `op` on `inputs` and returns its outputs.
    ///
    /// # Errors
    /// Whatever the operation refuses, and [`TensorError::ForeignVariable`] for a variable of
    /// another tape. The tape then stays as it was.
    pub fn record<'t, O: Op<T>>(
        &'t self,
        op: O,
        inputs: &[Var<'t, T>],
    ) -> Result<Variables<'t, T>, O::Error> {
        Ok(self.record_with(op, inputs, |_| ())?.0)
    }

    /// [`Tape::record`], with a look at what the operation saved: results that are not numbers,
    /// such as indices, are shared with the caller that way. `look` must not use the tape.
    ///
    /// # Errors
    /// As [`Tape::record`].
    pub fn record_with<'t, O: Op<T>, R>(
        &'t self,
        op: O,
        inputs: &[Var<'t, T>],
        look: impl FnOnce(&O::Saved) -> R,
    ) -> Result<(Variables<'t, T>, R), O::Error> {
        let (indices, seen) = self.record_node(op, inputs, look)?;
        Ok((indices.map(|index| Var { tape: self, index }).collect(), seen))
    }

    /// Records `op`, which has one output, on `inputs` and returns the output.
    ///
    /// # Errors
    /// As [`Tape::record`].
    ///
    /// # Panics
    /// Where the operation has another number of outputs.
    pub fn apply<'t, O: Op<T>>(
        &'t self,
        op: O,
        inputs: &[Var<'t, T>],
    ) -> Result<Var<'t, T>, O::Error> {
        let (outputs, ()) = self.record_node(op, inputs, |_| ())?;
        assert_eq!(outputs.len(), 1, "`apply` is for operations of one output");
        Ok(Var { tape: self, index: outputs.start })
    }

    /// Records `op` on `inputs`; returns the indices of its outputs, and what `look` saw.
    fn record_node<'t, O: Op<T>, R>(
        &'t self,
        op: O,
        inputs: &[Var<'t, T>],
        look: impl FnOnce(&O::Saved) -> R,
    ) -> Result<(Range<u32>, R), O::Error> {
        let name = op.name();
        if inputs.iter().any(|input| !std::ptr::eq(input.tape, self)) {
            return Err(TensorError::ForeignVariable { operation: name }.into());
        }
        let mut inner = self.inner.borrow_mut();
        let Inner { values, links, nodes, places, used, pool, tally, timed, outputs, .. } =
            &mut *inner;
        let start = timed.then(Instant::now);

        // From here until `used` grows, the place is a spare one: it may hold anything.
        let place = spare_place::<T, O>(places, *used);
        let slot = slot_in::<T, O>(&mut *place.recorded);
        let first_input = links.len();
        links.extend(inputs.iter().map(|input| input.index));
        let view = Inputs { values, indices: &links[first_input..] };
        let mut computed = Outputs { pool, list: outputs, passed: None };
        let refused = op.forward(&view, &mut computed, &mut slot.saved).err();
        let passed = computed.passed;
        if let Some(error) = refused {
            outputs.drain(..).for_each(|output| output.recycle(pool));
            links.truncate(first_input);
            return Err(error);
        }
        let seen = look(&slot.saved);

        place.entry = tally.entry(name, place.entry);
        let count = tally.count(place.entry);
        count.operation.calls += 1;
        count.operation.bytes += op.saved_bytes(&slot.saved) as u64;
        if let Some(start) = start {
            count.operation.forward += start.elapsed();
        }
        let place_index = *used as u32;
        *used += 1;
        if let Some((input, reason)) = passed {
            assert!(outputs.is_empty(), "{name} passes its input on and has outputs as well");
            let index = view.indices[input];
            links.truncate(first_input);
            tally.leave_out(name, reason);
            return Ok((index..index + 1, seen));
        }

        let (first_output, output_count) = (values.len() as u32, outputs.len() as u32);
        let needs = view.any_needs();
        if needs {
            nodes.push(Node {
                place: place_index,
                entry: place.entry,
                keep: op.keeps(&view),
                first_input: first_input as u32,
                input_count: inputs.len() as u32,
                first_output,
                output_count,
            });
            slot.op = Some(op);
        } else {
            count.unrecorded += 1;
        }
        let entry = Some(place.entry);
        for output in outputs.drain(..) {
            let value = match output {
                Output::Computed(shape, entries) => {
                    count.operation.bytes += size_of_val(&entries[..]) as u64;
                    Value::own(shape, entries, needs, entry)
                }
                Output::Renamed(shape, input) => {
                    let whole = values[inputs[input].index as usize].tensor(pool);
                    let (_, data) = whole.into_parts();
                    Value::shared(crate::tensor::Tensor::from_parts(shape, data), needs, entry)
                }
            };
            values.push(value);
        }
        if !needs {
            links.truncate(first_input);
        }
        Ok((first_output..first_output + output_count, seen))
    }
}

/// Place `at`, with a slot of the right type: the one that the last step left there where its
/// operation was of the same kind, a new one otherwise.
#[inline]
fn spare_place<T: Scalar, O: Op<T>>(places: &mut Vec<Place<T>>, at: usize) -> &mut Place<T> {
    let new_slot = || Box::new(Slot::<O, O::Saved> { op: None, saved: O::Saved::default() });
    match places.get_mut(at) {
        Some(place) => {
            let any: &dyn Any = &*place.recorded;
            if !any.is::<Slot<O, O::Saved>>() {
                place.recorded = new_slot();
            }
        }
        None => places.push(Place { recorded: new_slot(), entry: 0 }),
    }
    &mut places[at]
}

/// The slot of an operation of type `O`.
#[inline]
fn slot_in<T: Scalar, O: Op<T>>(recorded: &mut dyn Recorded<T>) -> &mut Slot<O, O::Saved> {
    let any: &mut dyn Any = recorded;
    any.downcast_mut().expect("the slot was made for this type")
}
