//! Sums over parts that are computed apart: the views of a scene, say.
//!
//! # Forward
//! `s = sum_k f_k(x)`, with each `f_k` recorded on a tape of its own. Its backward pass runs at once,
//! and the part's tape is used for another part. So memory is that of the parts under way and of their
//! gradients, whatever the number of parts.
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

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::parallel::{alone, for_each_zipped_mut, join, threads};
use crate::report::TapeReport;
use crate::scalar::Scalar;
use crate::tape::Tape;
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

    /// Adds the sum over the parts that come next.
    fn add(&mut self, next: Self) {
        self.value += next.value;
        for (sum, next) in self.gradients.iter_mut().zip(next.gradients) {
            match (sum.as_mut(), next) {
                (Some(sum), Some(next)) => {
                    for_each_zipped_mut(sum.data_mut(), [next.data()], |sum, [next]| *sum += next);
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
    tape: &'a SpareTapes<T>,
    /// Values, and whether a gradient could be asked for.
    inputs: &'a [(Tensor<T>, bool)],
    part: &'a Part<'a, T, E>,
    /// Whether a part shares its work among threads: where there are fewer parts than threads.
    is_shared: bool,
    is_timed: bool,
}

type SpareTapes<T> = std::sync::Mutex<Vec<Tape<T>>>;

impl<T: Scalar, E: From<TensorError> + Send> Parts<'_, T, E> {
    /// The sums over the parts of several ranges, each of which has at least one.
    fn all(&self, ranges: &[Range<usize>]) -> Result<Vec<PartialSum<T>>, E> {
        match ranges {
            [] => Ok(Vec::new()),
            [only] => Ok(vec![self.sum(only.clone())?]),
            more => {
                let (first, second) = more.split_at(more.len() / 2);
                let (first, second) = join(|| self.all(first), || self.all(second));
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
        let (first, second) = join(|| self.sum(first), || self.sum(second));
        let mut first = first?;
        first.add(second?);
        Ok(first)
    }

    /// Part k alone.
    fn one(&self, k: usize) -> Result<PartialSum<T>, E> {
        // A poisoned lock holds tapes that nothing was recorded on.
        let spare = || self.tape.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let mut tape = spare().pop().unwrap_or_default();
        let partial = self.on(&tape, k);
        tape.reset();
        let report = tape.take_report();
        spare().push(tape);
        partial.map(|partial| PartialSum { report, ..partial })
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
        let results = out.backward_to(&wanted)?;
        let gradients = inputs.iter().map(|&input| results.get(input).cloned()).collect();
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
            tape: &self.spare,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dependence::Dependence;

    /// A sum of parts that differ in size by far.
    fn run(count: usize) -> (f32, Tensor<f32>) {
        let tape = Tape::<f32>::new();
        let x = tape.leaf(&Tensor::from_flat_fn([300], |k| 0.3 + k as f32 / 300.0));
        let sum = tape.sum_over(count, &[x], |k, _, inputs| {
            Ok::<_, TensorError>((inputs[0] * (1.0 + (k % 17) as f32)).exp().sum())
        });
        let sum = sum.unwrap();
        (sum.item(), sum.backward().unwrap().get_or_zeros(x))
    }

    fn term<'t>(k: usize, x: Var<'t, f64>, y: Var<'t, f64>) -> Var<'t, f64> {
        (x * y * k as f64).sin().sum()
    }

    #[test]
    fn value_and_gradient_are_those_of_the_parts_on_one_tape() {
        for count in [0, 1, 2, 3, 5, 8, 13] {
            let tape = Tape::<f64>::new();
            let (x, y) = (tape.leaf_full([3], 0.4), tape.leaf_scalar(2.0));
            let apart = tape.sum_over(count, &[x, y], |k, _, inputs| {
                Ok::<_, TensorError>(term(k, inputs[0], inputs[1]))
            });
            let apart = apart.unwrap().square();
            let terms = (0..count).map(|k| term(k, x, y));
            let together = terms.fold(tape.constant_scalar(0.0), |sum, term| sum + term).square();
            assert!((apart.item() - together.item()).abs() < 1e-12);
            let (apart, together) = (apart.backward().unwrap(), together.backward().unwrap());
            for v in [x, y] {
                let (apart, together) = (apart.get_or_zeros(v), together.get_or_zeros(v));
                for (a, b) in apart.data().iter().zip(together.data()) {
                    assert!((a - b).abs() < 1e-12, "{a} and not {b}");
                }
            }
        }
    }

    #[cfg(feature = "parallel")]
    #[test]
    fn the_bits_are_the_same_on_any_number_of_threads() {
        for count in [1, 2, 7, 30] {
            let on = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| run(count))
            };
            let alone = on(1);
            for threads in [2, 3, 8] {
                assert_eq!(on(threads), alone, "{count} parts on {threads} threads");
            }
        }
    }

    #[test]
    fn sums_of_subtrees_add_up_to_the_bits_of_the_whole() {
        /// The sum over a range of the tree, of which `known` has the parts.
        fn whole(
            range: Range<usize>,
            known: &mut Vec<(Range<usize>, PartialSum<f32>)>,
        ) -> PartialSum<f32> {
            if let Some(at) = known.iter().position(|(part, _)| *part == range) {
                return known.swap_remove(at).1;
            }
            let [first, second] = halves(&range).unwrap().map(|half| whole(half, known));
            let mut sum = first;
            sum.add(second);
            sum
        }
        for (count, cuts) in [(5, &[2][..]), (30, &[7, 7, 21]), (13, &[1, 12]), (3, &[0, 3])] {
            let tape = Tape::<f32>::new();
            let x = tape.leaf(&Tensor::from_flat_fn([300], |k| 0.3 + k as f32 / 300.0));
            let bounds: Vec<_> = [0].iter().chain(cuts).chain([&count]).copied().collect();
            let mut known = Vec::new();
            for share in bounds.windows(2).map(|pair| pair[0]..pair[1]) {
                let sums = tape.partial_sums(count, share.clone(), &[x], |k, _, inputs| {
                    Ok::<_, TensorError>((inputs[0] * (1.0 + (k % 17) as f32)).exp().sum())
                });
                known.extend(covered(0..count, &share).into_iter().zip(sums.unwrap()));
            }
            let sum = tape.sum_of(&[x], whole(0..count, &mut known)).unwrap();
            assert!(known.is_empty());
            assert_eq!((sum.item(), sum.backward().unwrap().get_or_zeros(x)), run(count));
        }
    }

    #[test]
    fn what_needs_no_gradient_gets_none_and_what_no_part_uses_has_no_way() {
        let tape = Tape::<f64>::new();
        let [x, unused, constant] =
            [tape.leaf_scalar(1.0), tape.leaf_scalar(2.0), tape.constant_scalar(3.0)];
        let sum = tape.sum_over(4, &[x, unused, constant], |_, _, inputs| {
            assert!(inputs[0].needs_gradient() && !inputs[2].needs_gradient());
            Ok::<_, TensorError>(inputs[0] * inputs[2])
        });
        let sum = sum.unwrap();
        assert_eq!(sum.dependence_on(x).unwrap(), Dependence::Recorded);
        assert_ne!(sum.dependence_on(unused).unwrap(), Dependence::Recorded);
        assert_eq!(sum.backward().unwrap().get_or_zeros(x).item(), 12.0);
        // Constants alone: nothing is recorded.
        let constants =
            tape.sum_over(2, &[constant], |_, _, inputs| Ok::<_, TensorError>(inputs[0]));
        assert!(!constants.unwrap().needs_gradient());
    }

    #[test]
    fn the_first_part_that_refuses_is_heard_and_the_tape_stays_as_it_was() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf_full([2], 1.0);
        let before = tape.len();
        let refuse = |from: usize| {
            let sum = tape.sum_over(8, &[x], |k, _, inputs| {
                if k < from { Ok(inputs[0].sum()) } else { inputs[0].sum_axis(k) }
            });
            sum.unwrap_err()
        };
        assert_eq!(refuse(3), TensorError::Axis { operation: "sum", axis: 3, shape: [2].into() });
        assert_eq!(tape.len(), before);
        let vector = tape.sum_over(2, &[x], |_, _, inputs| Ok::<_, TensorError>(inputs[0]));
        assert_eq!(vector.unwrap_err(), TensorError::NotScalar { shape: [2].into() });
        let other = Tape::new();
        let foreign = other.leaf_scalar(1.0);
        let sum = tape.sum_over(1, &[foreign], |_, _, inputs| Ok::<_, TensorError>(inputs[0]));
        assert_eq!(sum.unwrap_err(), TensorError::ForeignVariable { operation: "sum_over" });
    }

    #[test]
    fn tapes_of_parts_are_used_again_and_their_work_is_reported() {
        let mut tape = Tape::<f64>::new();
        for _ in 0..3 {
            let x = tape.leaf_scalar(0.5);
            let sum = alone(|| {
                tape.sum_over(5, &[x], |_, _, inputs| Ok::<_, TensorError>(inputs[0].exp()))
            });
            sum.unwrap();
            let report = tape.take_report();
            let calls: Vec<_> = report.operations.iter().map(|of| (of.name, of.calls)).collect();
            assert_eq!(calls, [("exp", 5), ("sum_over", 1)]);
            tape.reset();
        }
        assert_eq!(tape.spare.lock().unwrap().len(), 1);
    }
}
