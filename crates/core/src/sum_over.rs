//! Sums over parts that are computed apart: the views of a scene, say.
//!
//! # Forward
//! `s = sum_k f_k(x)`, with each `f_k` recorded on a tape of its own. Its backward pass runs at once,
//! and the part's tape is used for another part. So memory is that of the parts under way and of their
//! gradients, whatever the number of parts. Gradients that were added up wait beside the tapes: the next parts write
//! theirs there.
//!
//! # Backward
//! `x_bar += s_bar sum_k df_k/dx`: the sum is known from the forward pass.
//!
//! # The order of sums
//! Values and gradients are added in a tree over the parts' indices. A range of n parts is cut after
//! the largest power of two below n ([`halves`]). So the tree depends on the number of parts alone, and
//! the bits do not depend on the number of threads. Nor do they depend on who computes which parts:
//! [`Tape::partial_sums`] gives the sums of subtrees, for whoever adds them elsewhere.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::parallel::{alone, for_each_zipped_mut, join, threads};
use crate::report::TapeReport;
use crate::scalar::Scalar;
use crate::tape::{Spare, SpareTape, Tape};
use crate::tensor::Tensor;
use crate::var::Var;

const NAME: &str = "sum_over";

/// The two ranges that a range of the tree is the sum of; `None` for a single part, and for none.
pub fn halves(range: &Range<usize>) -> Option<[Range<usize>; 2]> {
    let half = 1 << range.len().checked_sub(1)?.checked_ilog2()?;
    let middle = range.start + half;
    Some([range.start..middle, middle..range.end])
}

/// The largest ranges of the tree over `range` that lie in `share`, in their order.
pub fn covered(range: Range<usize>, share: &Range<usize>) -> Vec<Range<usize>> {
    let is_apart = range.end <= share.start || share.end <= range.start;
    if is_apart || range.is_empty() {
        return Vec::new();
    }
    if share.start <= range.start && range.end <= share.end {
        return vec![range];
    }
    let halves = halves(&range).into_iter().flatten();
    halves.flat_map(|half| covered(half, share)).collect()
}

/// The sum over a range of the tree of parts: see [`Tape::partial_sums`].
#[derive(Debug, Clone)]
pub struct PartialSum<T: Scalar> {
    /// The value.
    pub value: T::Wide,
    /// By input: the gradient, or nothing where no part depends on the input.
    pub gradients: Vec<Option<Tensor<T>>>,
    report: TapeReport,
}

impl<T: Scalar> PartialSum<T> {
    /// The sum of this value, and with these gradients by input.
    pub fn new(value: T::Wide, gradients: Vec<Option<Tensor<T>>>) -> Self {
        Self { value, gradients, report: TapeReport::default() }
    }

    /// Adds the sum over the parts that come next; `recycle` is given the tensors that are done with.
    fn add(&mut self, next: Self, mut recycle: impl FnMut(Tensor<T>)) {
        self.value += next.value;
        for (sum, next) in self.gradients.iter_mut().zip(next.gradients) {
            match (sum.as_mut(), next) {
                (Some(sum), Some(next)) => {
                    for_each_zipped_mut(sum.data_mut(), [next.data()], |sum, [next]| *sum += next);
                    recycle(next);
                }
                (None, Some(next)) => *sum = Some(next),
                (_, None) => {}
            }
        }
        self.report.absorb(next.report);
    }
}

/// What computes a part. It is called once per part, so its type is forgotten, and what calls it is compiled
/// once for all.
type Part<'a, T, E> =
    dyn for<'p> Fn(usize, &'p Tape<T>, &[Var<'p, T>]) -> Result<Var<'p, T>, E> + Sync + 'a;

/// The inputs of all parts, and where their tapes come from.
struct Parts<'a, T: Scalar, E> {
    spare: &'a Mutex<Spare<T>>,
    /// Values, and whether a gradient could be asked for.
    inputs: &'a [(Tensor<T>, bool)],
    part: &'a Part<'a, T, E>,
    /// Whether a part shares its work among threads: where there are fewer parts than threads.
    is_shared: bool,
    is_timed: bool,
}

impl<T: Scalar, E: From<TensorError> + Send> Parts<'_, T, E> {
    /// The sums over the parts of several ranges, each of which has at least one.
    fn all(&self, ranges: &[Range<usize>]) -> Result<Vec<PartialSum<T>>, E> {
        match ranges {
            [] => Ok(Vec::new()),
            [only] => Ok(vec![self.sum(only.clone())?]),
            more => {
                let (first, second) = more.split_at(more.len() / 2);
                let (first, second) = join(true, || self.all(first), || self.all(second));
                let mut sums = first?;
                sums.extend(second?);
                Ok(sums)
            }
        }
    }

    /// The sum over parts `range`, of which there is at least one.
    fn sum(&self, range: Range<usize>) -> Result<PartialSum<T>, E> {
        let Some([first, second]) = halves(&range) else {
            return if self.is_shared {
                self.one(range.start)
            } else {
                alone(|| self.one(range.start))
            };
        };
        let (first, second) = join(true, || self.sum(first), || self.sum(second));
        let mut first = first?;
        first.add(second?, |tensor| self.spare().done.push(tensor));
        Ok(first)
    }

    /// Part k alone.
    fn one(&self, k: usize) -> Result<PartialSum<T>, E> {
        let mut tape = self.take_tape();
        let partial = self.on(&tape, k);
        tape.reset();
        let report = tape.take_report();
        let taken = partial.as_ref().map_or(0, |sum| sum.gradients.iter().flatten().count());
        self.spare().tapes.push(SpareTape { tape, taken });
        partial.map(|partial| PartialSum { report, ..partial })
    }

    /// A tape that nobody uses, with memory for the gradients that a part takes with it.
    fn take_tape(&self) -> Tape<T> {
        let mut spare = self.spare();
        let Some(SpareTape { tape, taken }) = spare.tapes.pop() else { return Tape::default() };
        let first = spare.done.len().saturating_sub(taken);
        spare.done.drain(first..).for_each(|tensor| tape.recycle(tensor));
        tape
    }

    fn spare(&self) -> MutexGuard<'_, Spare<T>> {
        // A poisoned lock holds tapes that nothing was recorded on.
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Part k on a tape of its own.
    fn on(&self, tape: &Tape<T>, k: usize) -> Result<PartialSum<T>, E> {
        tape.set_timed(self.is_timed);
        let variable = |(value, needs): &(Tensor<T>, bool)| {
            if *needs { tape.leaf(value) } else { tape.constant(value) }
        };
        let inputs: Vec<_> = self.inputs.iter().map(variable).collect();
        let out = (self.part)(k, tape, &inputs)?;
        if !std::ptr::eq(out.tape(), tape) {
            return Err(TensorError::ForeignVariable { operation: NAME }.into());
        }
        if out.shape().size() != 1 {
            return Err(TensorError::NotScalar { shape: out.shape() }.into());
        }
        let wanted: Vec<_> = inputs.iter().copied().filter(|x| x.needs_gradient()).collect();
        // At once, while its values are there: then the tape is free for another part.
        let results = (!wanted.is_empty()).then(|| out.backward_to(&wanted)).transpose()?;
        let gradient = |&input: &Var<'_, T>| results.as_ref()?.get(input).cloned();
        let gradients = inputs.iter().map(gradient).collect();
        Ok(PartialSum::new(out.item().widen(), gradients))
    }
}

/// Inputs: those that some part depends on. Output: the sum.
struct SumOver<T> {
    value: T,
    /// By input.
    gradients: Vec<Tensor<T>>,
}

impl<T: Scalar> Op<T> for SumOver<T> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        _inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        outputs.push([])[0] = self.value;
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let s_bar = kept.only_upstream()[0];
        for (i, gradient) in self.gradients.iter().enumerate() {
            if let Some(x_bar) = gradients.get(i) {
                x_bar.add_zipped([gradient.data()], |[gradient]| s_bar * gradient);
            }
        }
    }

    fn saved_bytes(&self, _saved: &()) -> usize {
        self.gradients.iter().map(|gradient| size_of_val(gradient.data())).sum()
    }
}

impl<T: Scalar> Tape<T> {
    /// The sum of `count` scalars, which `part` computes from `inputs`, each on a tape of its own:
    /// the losses of the views of a scene, say. `part` is given the index of the part, its tape, and
    /// the inputs on that tape. A part's variables cannot leave it.
    ///
    /// Parts may be computed at the same time, and gradients of each are computed at once, where some
    /// input needs one. So memory is that of the parts under way. Where there are fewer parts than
    /// threads, the work of a part is shared among threads as well. The result is the same to the bit
    /// for any number of threads. What the parts' tapes did appears in the report of this tape.
    ///
    /// ```
    /// use bokashi_core::{Tape, Tensor, TensorError};
    ///
    /// let views = [1.0, 2.0, 4.0];
    /// let tape = Tape::<f64>::new();
    /// let x = tape.leaf(&Tensor::new([2], vec![1.0, 3.0])?);
    /// let loss = tape.sum_over(views.len(), &[x], |k, _tape, inputs| {
    ///     Ok::<_, TensorError>((inputs[0] * views[k]).square().sum())
    /// })?;
    /// assert_eq!(loss.item(), 210.0);
    /// assert_eq!(loss.backward()?.get(x).unwrap().data(), [42.0, 126.0]);
    /// # Ok::<(), TensorError>(())
    /// ```
    ///
    /// # Errors
    /// Whatever `part` refuses, of several parts the first; [`TensorError::NotScalar`] unless each
    /// part has exactly one entry; [`TensorError::ForeignVariable`] for variables of another tape.
    pub fn sum_over<'t, E: From<TensorError> + Send>(
        &'t self,
        count: usize,
        inputs: &[Var<'t, T>],
        part: impl for<'p> Fn(usize, &'p Tape<T>, &[Var<'p, T>]) -> Result<Var<'p, T>, E> + Sync,
    ) -> Result<Var<'t, T>, E> {
        if count == 0 {
            self.check_own(NAME, inputs)?;
            return Ok(self.constant_scalar(T::ZERO));
        }
        let mut all = self.partial_sums(count, 0..count, inputs, part)?;
        Ok(self.sum_of(inputs, all.swap_remove(0))?)
    }

    /// The sums over the parts `share` of `count`, where others compute the other parts: those of the
    /// largest ranges of the tree that lie in `share`, in their order. Parts are as in [`Tape::sum_over`].
    ///
    /// ```
    /// use bokashi_core::{Tape, TensorError, covered};
    ///
    /// let tape = Tape::<f64>::new();
    /// let x = tape.leaf_scalar(2.0);
    /// let sums = tape.partial_sums(6, 1..6, &[x], |k, _tape, inputs| {
    ///     Ok::<_, TensorError>(inputs[0] * k as f64)
    /// })?;
    /// assert_eq!(covered(0..6, &(1..6)), [1..2, 2..4, 4..6]);
    /// assert_eq!(sums.iter().map(|sum| sum.value).collect::<Vec<_>>(), [2.0, 10.0, 18.0]);
    /// # Ok::<(), TensorError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Tape::sum_over`].
    pub fn partial_sums<'t, E: From<TensorError> + Send>(
        &'t self,
        count: usize,
        share: Range<usize>,
        inputs: &[Var<'t, T>],
        part: impl for<'p> Fn(usize, &'p Tape<T>, &[Var<'p, T>]) -> Result<Var<'p, T>, E> + Sync,
    ) -> Result<Vec<PartialSum<T>>, E> {
        self.check_own(NAME, inputs)?;
        let values: Vec<_> =
            inputs.iter().map(|input| (input.value(), input.needs_gradient())).collect();
        let parts = Parts {
            spare: &self.spare,
            inputs: &values,
            part: &part,
            is_shared: share.len() < threads(),
            is_timed: self.inner.borrow().timed,
        };
        // Ranges are of different lengths: threads that are done with one go on with the next.
        let mut sums = parts.all(&covered(0..count, &share))?;
        let mut inner = self.inner.borrow_mut();
        sums.iter_mut().for_each(|sum| inner.tally.absorb(std::mem::take(&mut sum.report)));
        Ok(sums)
    }

    /// The sum of all parts, known already: [`Tape::sum_over`] of what others computed too.
    ///
    /// # Errors
    /// [`TensorError::ForeignVariable`] for variables of another tape.
    pub fn sum_of<'t>(
        &'t self,
        inputs: &[Var<'t, T>],
        sum: PartialSum<T>,
    ) -> Result<Var<'t, T>, TensorError> {
        self.check_own(NAME, inputs)?;
        let PartialSum { value, gradients, .. } = sum;
        // An input that no part depends on is none of the sum's.
        let used: Vec<_> =
            inputs.iter().zip(&gradients).filter(|(_, g)| g.is_some()).map(|(&x, _)| x).collect();
        let gradients = gradients.into_iter().flatten().collect();
        self.apply(SumOver { value: T::narrow(value), gradients }, &used)
    }
}

#[cfg(all(test, feature = "parallel"))]
mod tests {
    use std::thread::sleep;
    use std::time::Duration;

    use super::*;

    /// Buffers and tensors that wait.
    fn waiting(tape: &mut Tape<f64>) -> usize {
        let Spare { tapes, done } = tape.spare.get_mut().unwrap();
        let counts = tapes.iter_mut().map(|spare| spare.tape.inner.get_mut().pool.count());
        counts.sum::<usize>() + done.len()
    }

    // One tape would get what the others had, where it gets whatever is added up last.
    #[test]
    fn memory_does_not_gather_where_one_part_takes_longer_than_the_others() {
        let mut tape = Tape::<f64>::new();
        let x = Tensor::full([1000], 0.5);
        let threads = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let mut early = 0;
        for step in 0..60 {
            // Whole, since only so it goes to another thread.
            let (tape_there, x) = (&mut tape, &x);
            threads.install(move || {
                let x = tape_there.leaf(x);
                let sum = tape_there.sum_over(4, &[x], |k, _, x| {
                    sleep(Duration::from_micros(if k == 0 { 500 } else { 0 }));
                    Ok::<_, TensorError>(x[0].square().sum())
                });
                sum.unwrap().backward().unwrap();
            });
            tape.reset();
            match step {
                0..20 => early = early.max(waiting(&mut tape)),
                _ => assert!(waiting(&mut tape) <= early + 8, "step {step}: {early} before"),
            }
        }
    }
}
