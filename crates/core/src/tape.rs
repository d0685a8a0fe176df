//! The tape: every value and operation of a step, in the order of recording.
//!
//! An operation is recorded after its inputs, so the order of recording is a topological order. A
//! backward pass is a loop over the operations in reverse: no hashing, no locks, no reference counts,
//! no recursion.

use std::cell::RefCell;
use std::fmt;
use std::sync::Mutex;

use crate::gradient::{Accumulator, Wanted};
use crate::node::{Node, Place};
use crate::op::Renamed;
use crate::pool::Pool;
use crate::report::{Tally, TapeReport};
use crate::scalar::Scalar;
use crate::tensor::Tensor;
use crate::value::Value;

/// A record of one step's values and operations.
///
/// A step records, runs any number of backward passes, and ends with [`Tape::reset`], which
/// recycles every buffer. The borrow checker refuses a variable that outlives the reset:
///
/// ```compile_fail
/// let mut tape = bokashi_core::Tape::<f64>::new();
/// let x = tape.leaf_scalar(1.0);
/// tape.reset();
/// let y = x + x; // x belongs to the step that ended
/// ```
pub struct Tape<T: Scalar> {
    pub(crate) inner: RefCell<Inner<T>>,
    /// Tapes and gradients of parts that are computed apart ([`Tape::sum_over`]), to be used again.
    pub(crate) spare: Mutex<Spare<T>>,
    /// Tapes of what is computed beside a step ([`Tape::aside`]), to be used again.
    aside: RefCell<Vec<Tape<T>>>,
}

/// What the tape holds.
pub(crate) struct Inner<T> {
    /// The values of the step; those from `live` on are of an earlier step and wait to be used
    /// again.
    pub(crate) values: Vec<Value<T>>,
    pub(crate) live: usize,
    /// The indices of the inputs of all nodes, one node after another.
    pub(crate) links: Vec<u32>,
    /// The operations that a backward pass can visit.
    pub(crate) nodes: Vec<Node>,
    /// The places of the step's operations; those from `used` on are of an earlier step and wait
    /// to be used again.
    pub(crate) places: Vec<Place<T>>,
    pub(crate) used: usize,
    pub(crate) pool: Pool<T>,
    pub(crate) tally: Tally,
    pub(crate) timed: bool,
    // The rest is empty, or means nothing, between two calls, and is kept for its memory.
    /// Places for the outputs of the operation that is being recorded, where those among `values`
    /// are too few.
    pub(crate) further: Vec<Value<T>>,
    /// Its outputs that are inputs under another shape.
    pub(crate) renamed: Vec<Renamed>,
    /// The gradients of a backward pass, by value.
    pub(crate) gradients: Vec<Accumulator<T>>,
    /// What a backward pass wants of each value.
    pub(crate) wanted: Vec<Wanted>,
    /// Lists for the results of backward passes.
    pub(crate) results: Vec<Results<T>>,
    /// Whether a call is under way. A call that finds it set comes after one that a panic ended.
    pub(crate) is_call_under_way: bool,
    /// Whether a panic ended a call of this step: what operations saved may be incomplete.
    pub(crate) is_memory_doubtful: bool,
}

impl<T: Scalar> Inner<T> {
    /// Begins to record, or a backward pass; clears up first after a call that a panic ended.
    #[inline]
    pub(crate) fn begin_call(&mut self) {
        if std::mem::replace(&mut self.is_call_under_way, true) {
            self.forget_unfinished_call();
        }
    }

    /// Forgets whatever a call had under way when a panic ended it.
    #[cold]
    fn forget_unfinished_call(&mut self) {
        self.is_memory_doubtful = true;
        self.places.truncate(self.used);
        self.links.truncate(self.nodes.last().map_or(0, |node| node.links().end));
        self.values.append(&mut self.further);
        self.renamed.clear();
        self.gradients.clear();
        self.wanted.clear();
    }

    /// The name of the operation that computed value `index`, `Some(None)` for a leaf or a
    /// constant; `None` where there is no such value.
    pub(crate) fn operation(&self, index: usize) -> Option<Option<&'static str>> {
        let value = self.values[..self.live].get(index)?;
        Some(value.entry.map(|entry| self.tally.name(entry)))
    }
}

/// The gradients that a backward pass was asked for, by value, in increasing order; `None` where
/// nothing that the pass started from depends on the value.
pub(crate) type Results<T> = Vec<(u32, Option<Tensor<T>>)>;

impl<T: Scalar> Default for Tape<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// What the parts of [`Tape::sum_over`] use again.
#[derive(Debug, Default)]
pub(crate) struct Spare<T: Scalar> {
    pub(crate) tapes: Vec<SpareTape<T>>,
    /// Gradients of parts that were added up.
    pub(crate) done: Vec<Tensor<T>>,
}

#[derive(Debug)]
pub(crate) struct SpareTape<T: Scalar> {
    pub(crate) tape: Tape<T>,
    /// How many gradients its last part took with it. It gets no more than these back, so that no tape gathers what
    /// others lack.
    pub(crate) taken: usize,
}

impl<T: Scalar> Tape<T> {
    /// An empty tape.
    pub fn new() -> Self {
        Self {
            inner: RefCell::new(Inner {
                values: Vec::new(),
                live: 0,
                links: Vec::new(),
                nodes: Vec::new(),
                places: Vec::new(),
                used: 0,
                pool: Pool::default(),
                tally: Tally::default(),
                timed: false,
                further: Vec::new(),
                renamed: Vec::new(),
                gradients: Vec::new(),
                wanted: Vec::new(),
                results: Vec::new(),
                is_call_under_way: false,
                is_memory_doubtful: false,
            }),
            spare: Mutex::default(),
            aside: RefCell::new(Vec::new()),
        }
    }

    /// Ends a step: forgets every value and operation and keeps their memory for the next step.
    #[inline(never)]
    pub fn reset(&mut self) {
        let inner = self.inner.get_mut();
        if std::mem::take(&mut inner.is_call_under_way) {
            inner.forget_unfinished_call();
        }
        let Inner { values, live, links, nodes, places, used, pool, .. } = inner;
        links.clear();
        *used = 0;
        // What this step had no use for, another value can have.
        values.drain(*live..).for_each(|mut value| value.release(pool));
        // Backwards: a second name of a buffer goes before the value that returns it.
        values.iter_mut().rev().for_each(|value| value.end_step(pool));
        *live = 0;
        // Last, since what an operation drops is the user's, and may panic.
        for node in nodes.drain(..) {
            places[node.place as usize].recorded.retire();
        }
        if std::mem::take(&mut inner.is_memory_doubtful) {
            places.clear();
        }
    }

    /// Runs `work` on another tape, which ends its step when `work` does: for tensors that a step
    /// needs and no gradient passes, such as a reference image. That tape takes its buffers from
    /// those of this one and gives them back, so that what is computed before a step takes no memory
    /// beside that of the step. Its variables cannot leave `work`, and its report is not part of this
    /// tape's.
    ///
    /// [`Tape::recycle`] takes back the buffers of tensors that `work` returns.
    pub fn aside<R>(&self, work: impl FnOnce(&Tape<T>) -> R) -> R {
        let mut tape = self.aside.borrow_mut().pop().unwrap_or_default();
        self.exchange_pools(&mut tape);
        let result = work(&tape);
        tape.reset();
        self.exchange_pools(&mut tape);
        self.aside.borrow_mut().push(tape);
        result
    }

    fn exchange_pools(&self, other: &mut Self) {
        std::mem::swap(&mut self.inner.borrow_mut().pool, &mut other.inner.get_mut().pool);
    }

    /// Takes the buffer of `tensor`, to use it again; nothing happens where somebody else holds it.
    pub fn recycle(&self, tensor: Tensor<T>) {
        self.inner.borrow_mut().pool.give_shared(tensor.into_parts().1);
    }

    /// Notes in the report that work of the operation `name` was not needed, and why.
    pub fn leave_out(&self, name: &'static str, reason: &'static str) {
        self.inner.borrow_mut().tally.leave_out(name, reason);
    }

    /// Whether operations are timed from now on. Off at first: a look at the clock costs as much
    /// as a small operation.
    pub fn set_timed(&self, timed: bool) {
        self.inner.borrow_mut().timed = timed;
    }

    /// What the tape did since the report was last taken.
    pub fn take_report(&self) -> TapeReport {
        self.inner.borrow_mut().tally.take()
    }

    /// How many values the current step holds.
    pub fn len(&self) -> usize {
        self.inner.borrow().live
    }

    /// Whether the current step holds no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<T: Scalar> fmt::Debug for Tape<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inner = self.inner.borrow();
        let names: Vec<_> = inner.nodes.iter().map(|node| inner.tally.name(node.entry)).collect();
        f.debug_struct("Tape").field("values", &inner.live).field("nodes", &names).finish()
    }
}
