//! The tape: every value and operation of a step, in the order of recording.
//!
//! An operation is recorded after its inputs, so the order of recording is a topological order,
//! and a backward pass is one loop over the operations in reverse: no hashing, no locks, no
//! reference counts, no recursion.

use std::any::Any;
use std::cell::RefCell;
use std::fmt;
use std::ops::Range;
use std::time::Instant;

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::op::{Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs, Value};
use crate::pool::Pool;
use crate::report::Report;
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::tensor::Tensor;
use crate::var::Var;

/// A record of one step's values and operations.
///
/// A step records, runs any number of backward passes, and ends with [`Tape::reset`], which
/// recycles every buffer. The borrow checker refuses a variable that outlives the reset:
///
/// ```compile_fail
/// let mut tape = bokashi_core::Tape::<f64>::new();
/// let x = tape.scalar(1.0);
/// tape.reset();
/// let y = x + x; // x belongs to the step that ended
/// ```
pub struct Tape<T: Scalar> {
    pub(crate) inner: RefCell<Inner<T>>,
}

/// The outputs of a recorded operation; up to four need no allocation.
pub type Variables<'t, T> = SmallVec<[Var<'t, T>; 4]>;

/// What the tape holds.
pub(crate) struct Inner<T> {
    pub(crate) values: Vec<Value<T>>,
    /// The recorded operations; those from `live` on are of an earlier step and wait to be
    /// recorded over, so that their memory is used again.
    pub(crate) nodes: Vec<Node<T>>,
    pub(crate) live: usize,
    pub(crate) pool: Pool<T>,
    pub(crate) report: Report,
    pub(crate) timed: bool,
    // The rest is empty, or means nothing, between two calls, and is kept for its memory.
    /// The outputs of the operation that is being recorded, and whether each is the pool's.
    pub(crate) outputs: Vec<(Tensor<T>, bool)>,
    /// The gradients of a backward pass, by value.
    pub(crate) gradients: Vec<Option<Tensor<T>>>,
    /// Which values a backward pass is about.
    pub(crate) wanted: Vec<bool>,
    /// The gradients of the inputs of the operation that a backward pass is at.
    pub(crate) slots: Vec<Option<Accumulator<T>>>,
    /// Lists for the results of backward passes.
    pub(crate) results: Vec<Results<T>>,
}

/// The gradients that a backward pass was asked for, by value, in increasing order; `None` where
/// nothing that the pass started from depends on the value.
pub(crate) type Results<T> = Vec<(u32, Option<Tensor<T>>)>;

/// One recorded operation.
pub(crate) struct Node<T> {
    pub(crate) recorded: Box<dyn Recorded<T>>,
    pub(crate) inputs: SmallVec<[u32; 4]>,
    pub(crate) first_output: u32,
    pub(crate) output_count: u32,
    pub(crate) keep: Keep,
}

impl<T> Node<T> {
    /// The indices of the outputs.
    pub(crate) fn outputs(&self) -> Range<u32> {
        self.first_output..self.first_output + self.output_count
    }
}

/// An operation of any type with what it saved.
pub(crate) trait Recorded<T>: Any + Send {
    fn name(&self) -> &'static str;
    fn backward(&mut self, kept: &Kept<'_, T>, gradients: &mut Accumulators<'_, T>);
    /// Drops the operation, and with it what it shares with others; keeps the memory of what it
    /// saved.
    fn retire(&mut self);
}

/// The place on the tape of an operation of type `O`.
struct Slot<O, S> {
    op: Option<O>,
    saved: S,
}

impl<T: Scalar, O: Op<T>> Recorded<T> for Slot<O, O::Saved> {
    fn name(&self) -> &'static str {
        self.op.as_ref().map_or("retired", |op| op.name())
    }

    fn backward(&mut self, kept: &Kept<'_, T>, gradients: &mut Accumulators<'_, T>) {
        let op = self.op.as_ref().expect("a node within `live` holds its operation");
        op.backward(kept, &mut self.saved, gradients);
    }

    fn retire(&mut self) {
        self.op = None;
    }
}

impl<T: Scalar> Default for Tape<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Scalar> Tape<T> {
    /// An empty tape.
    pub fn new() -> Self {
        Self {
            inner: RefCell::new(Inner {
                values: Vec::new(),
                nodes: Vec::new(),
                live: 0,
                pool: Pool::default(),
                report: Report::default(),
                timed: false,
                outputs: Vec::new(),
                gradients: Vec::new(),
                wanted: Vec::new(),
                slots: Vec::new(),
                results: Vec::new(),
            }),
        }
    }

    /// Ends a step: forgets every value and operation and keeps their memory for the next step.
    pub fn reset(&mut self) {
        let Inner { values, nodes, live, pool, .. } = self.inner.get_mut();
        for node in &mut nodes[..*live] {
            node.recorded.retire();
        }
        *live = 0;
        // Backwards: a second name of a buffer goes before the value that returns it.
        while let Some(value) = values.pop() {
            if value.pooled {
                pool.give(value.tensor);
            }
        }
    }

    /// A variable with a gradient. Shares the buffer of `tensor`.
    pub fn leaf(&self, tensor: &Tensor<T>) -> Var<'_, T> {
        self.push(tensor.clone(), true, false)
    }

    /// A variable with a gradient that starts as a copy of `tensor`, in recycled memory: `tensor`
    /// can then be written to without a copy of its own.
    pub fn leaf_copied(&self, tensor: &Tensor<T>) -> Var<'_, T> {
        let copy = self.inner.borrow_mut().pool.copy(tensor);
        self.push(copy, true, true)
    }

    /// A value without a gradient. Shares the buffer of `tensor`.
    pub fn constant(&self, tensor: &Tensor<T>) -> Var<'_, T> {
        self.push(tensor.clone(), false, false)
    }

    /// A scalar variable with a gradient.
    pub fn scalar(&self, value: T) -> Var<'_, T> {
        self.push_full(Shape::default(), value, true)
    }

    /// A value of `shape` without a gradient, every entry `value`.
    pub fn constant_full(&self, shape: impl Into<Shape>, value: T) -> Var<'_, T> {
        self.push_full(shape.into(), value, false)
    }

    fn push_full(&self, shape: Shape, value: T, needs: bool) -> Var<'_, T> {
        let mut tensor = self.inner.borrow_mut().pool.take(shape);
        tensor.own_data_mut().fill(value);
        self.push(tensor, needs, true)
    }

    fn push(&self, tensor: Tensor<T>, needs: bool, pooled: bool) -> Var<'_, T> {
        let values = &mut self.inner.borrow_mut().values;
        values.push(Value { tensor, needs, pooled });
        Var { tape: self, index: values.len() as u32 - 1 }
    }

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
        let Inner { values, nodes, live, pool, report, timed, outputs, .. } = &mut *inner;
        let start = timed.then(Instant::now);

        // From here until `live` grows, the node is a spare one: it may hold anything.
        let node = spare_node::<T, O>(nodes, *live);
        node.inputs.clear();
        node.inputs.extend(inputs.iter().map(|input| input.index));
        let slot = slot_in::<T, O>(&mut *node.recorded);
        let view = Inputs { values, indices: &node.inputs };
        let mut tensors = std::mem::take(outputs);
        let mut computed = Outputs { pool, tensors: &mut tensors };
        if let Err(error) = op.forward(&view, &mut computed, &mut slot.saved) {
            let pooled = tensors.drain(..).filter(|&(_, pooled)| pooled);
            pooled.for_each(|(tensor, _)| pool.give(tensor));
            *outputs = tensors;
            return Err(error);
        }
        let needs = view.any_needs();
        node.keep = if needs { op.keeps(&view) } else { Keep::NOTHING };
        node.first_output = values.len() as u32;
        node.output_count = tensors.len() as u32;
        let seen = look(&slot.saved);

        let entry = report.operation(name);
        entry.calls += 1;
        if let Some(start) = start {
            entry.forward += start.elapsed();
        }
        entry.bytes += op.saved_bytes(&slot.saved) as u64;
        slot.op = Some(op);
        *live += 1;

        for (tensor, pooled) in tensors.drain(..) {
            if pooled {
                entry.bytes += std::mem::size_of_val(tensor.data()) as u64;
            }
            values.push(Value { tensor, needs, pooled });
        }
        *outputs = tensors;
        Ok((node.outputs(), seen))
    }

    /// Notes in the report that work of the operation `name` was not needed, and why.
    pub fn leave_out(&self, name: &'static str, reason: &'static str) {
        self.inner.borrow_mut().report.leave_out(name, reason);
    }

    /// Whether operations are timed from now on. Off at first: a look at the clock costs as much
    /// as a small operation.
    pub fn set_timed(&self, timed: bool) {
        self.inner.borrow_mut().timed = timed;
    }

    /// What the tape did since the report was last taken.
    pub fn take_report(&self) -> Report {
        std::mem::take(&mut self.inner.borrow_mut().report)
    }

    /// How many values the current step holds.
    pub fn len(&self) -> usize {
        self.inner.borrow().values.len()
    }

    /// Whether the current step holds no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Node `live`, with a slot of the right type: the one that the last step left there where it
/// recorded the same kind of operation, a new one otherwise.
fn spare_node<T: Scalar, O: Op<T>>(nodes: &mut Vec<Node<T>>, live: usize) -> &mut Node<T> {
    let new_slot = || Box::new(Slot::<O, O::Saved> { op: None, saved: O::Saved::default() });
    match nodes.get_mut(live) {
        Some(node) => {
            let any: &dyn Any = &*node.recorded;
            if !any.is::<Slot<O, O::Saved>>() {
                node.recorded = new_slot();
            }
        }
        None => nodes.push(Node {
            recorded: new_slot(),
            inputs: SmallVec::new(),
            first_output: 0,
            output_count: 0,
            keep: Keep::NOTHING,
        }),
    }
    &mut nodes[live]
}

/// The slot of an operation of type `O`.
fn slot_in<T: Scalar, O: Op<T>>(recorded: &mut dyn Recorded<T>) -> &mut Slot<O, O::Saved> {
    let any: &mut dyn Any = recorded;
    any.downcast_mut().expect("the slot was made for this type")
}

impl<T: Scalar> fmt::Debug for Tape<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inner = self.inner.borrow();
        let names: Vec<_> = inner.nodes[..inner.live].iter().map(|n| n.recorded.name()).collect();
        f.debug_struct("Tape").field("values", &inner.values.len()).field("nodes", &names).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step on many kinds of operations: the loss and the gradient of each leaf.
    fn step(tape: &Tape<f32>, x: &Tensor<f32>) -> [Tensor<f32>; 3] {
        let (leaf, copied) = (tape.leaf(x), tape.leaf_copied(x));
        let y = (leaf * copied.exp() + 1.0).reshape([6]).unwrap();
        let loss = (y / (y.square() + 2.0)).sum()
            + leaf.matmul(copied.transpose().unwrap()).unwrap().sum();
        let gradients = loss.backward().unwrap();
        [loss.value(), gradients.get_or_zeros(leaf), gradients.get_or_zeros(copied)]
    }

    #[test]
    fn a_later_step_in_recycled_memory_gives_the_same_bits() {
        let mut tape = Tape::new();
        let x = Tensor::from_fn([2, 3], |k| 0.3 * k as f32 - 0.7);
        let first = step(&tape, &x);
        for k in 0..4 {
            tape.reset();
            // Another pipeline in between, so that memory and nodes are found in other hands.
            if k % 2 == 0 {
                let _ = (tape.constant_full([k + 1], 5.0).exp() + 1.0).sum();
                tape.reset();
            }
            assert_eq!(step(&tape, &x), first);
        }
    }

    #[test]
    fn a_value_that_is_still_held_keeps_its_numbers() {
        let mut tape = Tape::new();
        let x = tape.leaf(&Tensor::full([4], 2.0));
        let y = x.square();
        let (held, gradient) = (y.value(), y.sum().backward().unwrap().get_or_zeros(x));
        for _ in 0..3 {
            tape.reset();
            let x = tape.leaf_copied(&Tensor::full([4], 7.0));
            let _ = x.square().sum().backward().unwrap();
        }
        assert_eq!((held, gradient), (Tensor::full([4], 4.0), Tensor::full([4], 4.0)));
    }

    #[test]
    fn a_copied_leaf_leaves_its_tensor_unshared() {
        let tape = Tape::new();
        let mut parameter = Tensor::full([2], 1.0);
        let address = parameter.data().as_ptr();
        let x = tape.leaf_copied(&parameter);
        parameter.data_mut()[0] = 5.0;
        assert_eq!(parameter.data().as_ptr(), address);
        assert_eq!(x.value().data(), [1.0, 1.0]);
    }

    #[test]
    fn variables_of_another_tape_are_refused() {
        let (tape, other) = (Tape::<f64>::new(), Tape::new());
        let (x, foreign) = (tape.scalar(1.0), other.scalar(1.0));
        let message = "add needs variables of one tape, got one of another";
        assert_eq!(x.try_add(foreign).unwrap_err().to_string(), message);
        assert_eq!((tape.len(), other.len()), (1, 1));
    }

    #[test]
    fn what_a_tape_holds_can_be_sent_to_another_thread() {
        let tape = Tape::new();
        let _ = tape.scalar(3.0).square();
        let squares = std::thread::spawn(move || tape.scalar(2.0).square().item());
        assert_eq!(squares.join().unwrap(), 4.0);
    }

    #[test]
    fn memory_of_what_was_saved_is_used_again_by_the_same_kind_of_operation() {
        let mut tape = Tape::<f64>::new();
        for _ in 0..3 {
            let x = tape.scalar(0.5);
            let _ = x.exp().sin() + x;
            tape.reset();
        }
        assert!(tape.is_empty());
        assert_eq!(tape.inner.borrow().nodes.len(), 3);
        assert_eq!(format!("{tape:?}"), "Tape { values: 0, nodes: [] }");
    }
}
