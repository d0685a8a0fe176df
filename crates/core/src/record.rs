//! Recording operations.
//!
//! An operation none of whose inputs needs a gradient is computed and forgotten: it leaves values
//! but no node. One that turns out to be the identity leaves neither.

use std::any::Any;
use std::ops::Range;
use std::time::Instant;

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs, Renamed};
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
        let inner = &mut *self.inner.borrow_mut();
        let Inner { values, live, links, nodes, places, used, pool, tally, .. } = inner;
        let (further, renamed) = (&mut inner.further, &mut inner.renamed);
        let start = inner.timed.then(Instant::now);

        // From here until `used` and `live` grow, the places are spare: they may hold anything.
        let place = spare_place::<T, O>(places, *used);
        let slot = slot_in::<T, O>(&mut *place.recorded);
        if values.len() == *live {
            values.push(Value::vacant());
        }
        let (recorded, spare) = values.split_at_mut(*live);
        let first_input = links.len();
        links.extend(inputs.iter().map(|input| input.index));
        let view = Inputs { values: recorded, indices: &links[first_input..] };
        let mut outputs = Outputs { pool, places: spare, further, count: 0, renamed, passed: None };
        if let Err(error) = op.forward(&view, &mut outputs, &mut slot.saved) {
            links.truncate(first_input);
            values.append(further);
            renamed.clear();
            return Err(error);
        }
        let Outputs { count: output_count, passed, .. } = outputs;
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
            assert!(output_count == 0, "{name} passes an input on and has outputs as well");
            let index = view.indices[input];
            links.truncate(first_input);
            tally.leave_out(name, reason);
            return Ok((index..index + 1, seen));
        }

        let needs = view.any_needs();
        if needs {
            nodes.push(Node {
                place: place_index,
                entry: place.entry,
                keep: op.keeps(&view),
                first_input: first_input as u32,
                input_count: inputs.len() as u32,
                first_output: *live as u32,
                output_count: output_count as u32,
            });
            slot.op = Some(op);
        } else {
            count.unrecorded += 1;
            links.truncate(first_input);
        }
        if !further.is_empty() {
            values.append(further);
        }
        let first_output = *live;
        *live += output_count;
        for value in &mut values[first_output..*live] {
            value.needs = needs;
            value.entry = Some(place.entry);
            count.operation.bytes += size_of_val(value.data()) as u64;
        }
        while let Some(Renamed { output, shape, input }) = renamed.pop() {
            let data = values[inputs[input].index as usize].share(pool);
            values[first_output + output].rename(shape, data, pool);
        }
        Ok((first_output as u32..*live as u32, seen))
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
