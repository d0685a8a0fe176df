//! Recording operations.
//!
//! An operation none of whose inputs needs a gradient is computed and forgotten: it leaves values
//! but no node. One that turns out to be the identity leaves neither.

use std::ops::Range;
use std::time::Instant;

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::node::{Node, Place, slot_in, spare_place};
use crate::op::{Inputs, Keep, Op, Outputs, Renamed};
use crate::scalar::Scalar;
use crate::tape::{Inner, Tape};
use crate::value::{Parting, Value};
use crate::var::Var;

/// The outputs of a recorded operation; up to four need no allocation.
pub type OutputVars<'t, T> = SmallVec<[Var<'t, T>; 4]>;

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
    ) -> Result<OutputVars<'t, T>, O::Error> {
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
    ) -> Result<(OutputVars<'t, T>, R), O::Error> {
        let (mut look, mut result) = (Some(look), None);
        let indices = self.record_node(op, inputs, false, &mut |saved| {
            result = look.take().map(|look| look(saved));
        })?;
        let result = result.expect("a recorded operation is looked at once");
        Ok((indices.map(|index| Var { tape: self, index }).collect(), result))
    }

    /// Records `op`, which has one output, on `inputs` and returns the output.
    ///
    /// # Errors
    /// As [`Tape::record`].
    ///
    /// # Panics
    /// Where the operation has another number of outputs; nothing is recorded then.
    pub fn apply<'t, O: Op<T>>(
        &'t self,
        op: O,
        inputs: &[Var<'t, T>],
    ) -> Result<Var<'t, T>, O::Error> {
        let outputs = self.record_node(op, inputs, true, &mut |_| ())?;
        Ok(Var { tape: self, index: outputs.start })
    }

    /// Records `op` on `inputs`, one with a single output where `is_single` says so; returns the
    /// indices of its outputs.
    ///
    /// What the operation or the caller gets wrong panics before anything is recorded. Only what names
    /// the operation's type stands here: it is compiled for every operation.
    #[inline(never)]
    fn record_node<'t, O: Op<T>>(
        &'t self,
        op: O,
        inputs: &[Var<'t, T>],
        is_single: bool,
        look: &mut dyn FnMut(&O::Saved),
    ) -> Result<Range<u32>, O::Error> {
        let name = op.name();
        self.check_own(name, inputs)?;
        let inner = &mut *self.inner.borrow_mut();
        let (first_input, start) = inner.begin_record(inputs);
        let (view, mut outputs, places, used) = inner.parts(first_input);

        // From here until `used` and `live` grow, the places are spare: they may hold anything.
        let slot = slot_in::<T, O>(&mut *spare_place::<T, O>(places, used).recorded);
        if let Err(error) = op.forward(&view, &mut outputs, &mut slot.saved) {
            inner.abandon(first_input);
            return Err(error);
        }
        let (output_count, passed) = outputs.check(name, &view, is_single);
        look(&slot.saved);
        let saved_bytes = op.saved_bytes(&slot.saved) as u64;
        // The first mask: where no input leads to a leaf nothing is kept, and no node is left.
        let needs = passed.is_none() && view.any_needs();
        let keep = if needs { op.keeps(&view) } else { Keep::NOTHING };
        if needs {
            slot.op = Some(op);
        }
        let done =
            Done { name, first_input, output_count, passed, saved_bytes, needs, keep, start };
        Ok(inner.finish_record(done))
    }

    /// Checks that all of `inputs` are variables of this tape.
    pub(crate) fn check_own(
        &self,
        name: &'static str,
        inputs: &[Var<'_, T>],
    ) -> Result<(), TensorError> {
        match inputs.iter().all(|input| std::ptr::eq(input.tape, self)) {
            true => Ok(()),
            false => Err(TensorError::ForeignVariable { operation: name }),
        }
    }
}

/// An operation that ran, and what is known of it.
struct Done {
    name: &'static str,
    /// Where its inputs start among the links.
    first_input: usize,
    output_count: usize,
    /// The input that is its output, and why.
    passed: Option<(usize, &'static str)>,
    saved_bytes: u64,
    needs: bool,
    keep: Keep,
    /// When it began, where that is asked for.
    start: Option<Instant>,
}

impl<T: Scalar> Outputs<'_, T> {
    /// How many outputs the operation `name` gave, and which input it passed on instead.
    ///
    /// # Panics
    /// Where the operation passes an input on and has outputs as well, or passes on an input that it lacks;
    /// where `apply` gets another number of outputs than one; where an output under another shape has
    /// another size than its input.
    fn check(
        &self,
        name: &'static str,
        view: &Inputs<'_, T>,
        is_single: bool,
    ) -> (usize, Option<(usize, &'static str)>) {
        let Self { count, passed, .. } = *self;
        if let Some((input, _)) = passed {
            let inputs = view.indices.len();
            assert!(count == 0, "{name} passes an input on and has outputs as well");
            assert!(input < inputs, "{name} passes input {input} on and has no such input");
        } else if is_single {
            assert_eq!(count, 1, "`apply` is for operations of one output");
        }
        for Renamed { shape, input, .. } in self.renamed.iter() {
            let input_shape =
                view.indices.get(*input).map(|&index| &view.values[index as usize].shape);
            let is_fit = input_shape.is_some_and(|input_shape| input_shape.size() == shape.size());
            assert!(
                is_fit,
                "{name} renames input {input} to {shape}, and that input is {input_shape:?}"
            );
        }
        (count, passed)
    }
}

/// What an operation reads, what it writes, the places of operations, and how many of them are used.
type Parts<'a, T> = (Inputs<'a, T>, Outputs<'a, T>, &'a mut Vec<Place<T>>, usize);

impl<T: Scalar> Inner<T> {
    /// Begins to record an operation on `inputs`: where they start among the links, and the time.
    fn begin_record(&mut self, inputs: &[Var<'_, T>]) -> (usize, Option<Instant>) {
        self.begin_call();
        let start = self.timed.then(Instant::now);
        if self.values.len() == self.live {
            self.values.push(Value::vacant());
        }
        let first_input = self.links.len();
        self.links.extend(inputs.iter().map(|input| input.index));
        (first_input, start)
    }

    /// What an operation is given.
    fn parts(&mut self, first_input: usize) -> Parts<'_, T> {
        let (recorded, spare) = self.values.split_at_mut(self.live);
        let view = Inputs { values: recorded, indices: &self.links[first_input..] };
        let outputs = Outputs {
            pool: &mut self.pool,
            places: spare,
            further: &mut self.further,
            count: 0,
            renamed: &mut self.renamed,
            passed: None,
        };
        (view, outputs, &mut self.places, self.used)
    }

    /// Leaves the tape as it was before an operation that ended in an error.
    #[cold]
    fn abandon(&mut self, first_input: usize) {
        self.links.truncate(first_input);
        self.values.append(&mut self.further);
        self.renamed.clear();
        self.is_call_under_way = false;
    }

    /// Records what the operation has given. The operation has said what it has to say: no panic can
    /// come from here.
    fn finish_record(&mut self, done: Done) -> Range<u32> {
        let Done { name, first_input, output_count, passed, saved_bytes, needs, keep, start } =
            done;
        let Self { values, live, links, nodes, places, used, pool, tally, further, .. } = self;
        let place = &mut places[*used];
        place.entry = tally.entry(name, place.entry);
        let count = tally.count(place.entry);
        count.operation.calls += 1;
        count.operation.bytes += saved_bytes;
        if let Some(start) = start {
            count.operation.forward += start.elapsed();
        }
        let place_index = *used as u32;
        *used += 1;
        self.is_call_under_way = false;
        if let Some((input, reason)) = passed {
            let index = links[first_input + input];
            for &other in links[first_input..].iter().filter(|&&other| other != index) {
                values[other as usize].parting = Parting::Idle(place.entry);
            }
            links.truncate(first_input);
            tally.leave_out(name, reason);
            return index..index + 1;
        }

        let first_output = *live;
        if !further.is_empty() {
            values.append(further);
        }
        *live += output_count;
        for value in &mut values[first_output..*live] {
            value.needs = needs;
            value.entry = Some(place.entry);
            value.parting = Parting::None;
            count.operation.bytes += size_of_val(value.data()) as u64;
        }
        // An output that only has another shape shares its input's buffer.
        while let Some(Renamed { output, shape, input }) = self.renamed.pop() {
            let data = values[links[first_input + input] as usize].share(pool);
            values[first_output + output].rename(shape, data, pool);
        }
        if needs {
            nodes.push(Node {
                place: place_index,
                entry: place.entry,
                keep,
                first_input: first_input as u32,
                input_count: (links.len() - first_input) as u32,
                first_output: first_output as u32,
                output_count: output_count as u32,
            });
        } else {
            count.unrecorded += 1;
            links.truncate(first_input);
        }
        first_output as u32..*live as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many values, nodes and links a tape has, how many places are used, and what is left of calls.
    fn traces(inner: &Inner<f64>) -> [usize; 6] {
        let (nodes, links) = (inner.nodes.len(), inner.links.len());
        [inner.live, nodes, links, inner.used, inner.further.len(), inner.renamed.len()]
    }

    /// Begins an operation on `x: [1]` that gives two outputs and a second name of `x`.
    fn begin(inner: &mut Inner<f64>, x: Var<'_, f64>) -> usize {
        let (first_input, _) = inner.begin_record(&[x]);
        let (_, mut outputs, ..) = inner.parts(first_input);
        outputs.push([3]).fill(1.0);
        outputs.push([3]).fill(2.0);
        outputs.push_renamed([1], 0);
        first_input
    }

    #[test]
    fn outputs_of_a_refused_operation_are_for_the_next_one_to_use() {
        let tape = Tape::new();
        let x = tape.leaf_full([1], 1.0);
        let mut inner = tape.inner.borrow_mut();
        for _ in 0..3 {
            let first_input = begin(&mut inner, x);
            assert_ne!(traces(&inner), [1, 0, 0, 0, 0, 0]);
            inner.abandon(first_input);
            assert_eq!(traces(&inner), [1, 0, 0, 0, 0, 0]);
            // `x` and the three outputs.
            assert_eq!(inner.values.len(), 4);
        }
    }

    #[test]
    fn a_call_that_never_ended_leaves_no_traces() {
        let mut tape = Tape::new();
        for ends_the_step in [false, true, false] {
            let x = tape.leaf_full([1], 1.0);
            let mut inner = tape.inner.borrow_mut();
            begin(&mut inner, x);
            if !ends_the_step {
                inner.begin_call();
                assert_eq!(traces(&inner), [1, 0, 0, 0, 0, 0]);
                assert_eq!(inner.values.len(), 4);
            }
            drop(inner);
            tape.reset();
            assert_eq!(traces(&tape.inner.borrow()), [0; 6]);
        }
    }

    #[test]
    fn what_needs_no_gradient_leaves_no_links() {
        let tape = Tape::new();
        let _ = tape.constant_full([1], 1.0).exp();
        assert_eq!(traces(&tape.inner.borrow()), [2, 0, 0, 1, 0, 0]);
    }
}
