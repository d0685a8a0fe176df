//! The one interface behind every operation on the tape, built in or a user's.
//!
//! An operation maps input tensors to output tensors and knows its adjoint: given the gradient of
//! a loss with respect to its outputs (*upstream*), it adds `J^T upstream` into the gradients of
//! those inputs that need one. Two masks save work: while recording, [`Inputs::needs`] says which
//! gradients could ever be asked for (it decides what is kept); in a backward pass,
//! [`Accumulators::needs`] says which are wanted now (it decides what is computed).

use crate::error::TensorError;
use crate::parallel::for_each_zipped_mut;
use crate::pool::Pool;
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::tensor::Tensor;

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

    /// Which inputs and outputs `backward` reads; it can read no others. Asked after `forward`,
    /// and only where some input needs a gradient.
    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep;

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
}

impl Keep {
    /// Nothing: the backward pass needs shapes alone.
    pub const NOTHING: Self = Self { inputs: 0, outputs: 0 };

    /// The value of input `i`, one of the first 64.
    #[must_use]
    pub const fn input(self, i: usize) -> Self {
        Self { inputs: self.inputs | 1 << i, ..self }
    }

    /// The value of output `j`, one of the first 64.
    #[must_use]
    pub const fn output(self, j: usize) -> Self {
        Self { outputs: self.outputs | 1 << j, ..self }
    }

    fn has_input(self, i: usize) -> bool {
        self.inputs.checked_shr(i as u32).is_some_and(|bits| bits & 1 == 1)
    }

    fn has_output(self, j: usize) -> bool {
        self.outputs.checked_shr(j as u32).is_some_and(|bits| bits & 1 == 1)
    }
}

/// A value on the tape.
#[derive(Debug)]
pub(crate) struct Value<T> {
    pub(crate) tensor: Tensor<T>,
    /// Whether some leaf below could need a gradient through it.
    pub(crate) needs: bool,
    /// Whether the buffer goes back to the pool: not for what a user handed in, nor for a second
    /// name of a buffer that another value returns.
    pub(crate) pooled: bool,
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

    /// The value of input `i`.
    pub fn tensor(&self, i: usize) -> &'a Tensor<T> {
        &self.values[self.indices[i] as usize].tensor
    }

    /// The entries of input `i`, row-major.
    pub fn data(&self, i: usize) -> &'a [T] {
        self.tensor(i).data()
    }

    /// The shape of input `i`.
    pub fn shape(&self, i: usize) -> &'a Shape {
        self.tensor(i).shape()
    }

    /// Whether a gradient with respect to input `i` could be asked for later.
    pub fn needs(&self, i: usize) -> bool {
        self.values[self.indices[i] as usize].needs
    }

    /// Whether a gradient with respect to any input could be asked for later.
    pub fn any_needs(&self) -> bool {
        (0..self.len()).any(|i| self.needs(i))
    }
}

/// The outputs that an operation computes.
#[derive(Debug)]
pub struct Outputs<'a, T> {
    pub(crate) pool: &'a mut Pool<T>,
    /// Each output, and whether its buffer is the pool's.
    pub(crate) tensors: &'a mut Vec<(Tensor<T>, bool)>,
}

impl<T: Scalar> Outputs<'_, T> {
    /// Adds an output of `shape` and gives its entries. They start as whatever an earlier use of
    /// the buffer left: the operation writes every one of them.
    pub fn push(&mut self, shape: impl Into<Shape>) -> &mut [T] {
        self.tensors.push((self.pool.take(shape.into()), true));
        let (tensor, _) = self.tensors.last_mut().expect("one was just pushed");
        tensor.own_data_mut()
    }

    /// Adds an output for each of `shapes`, as [`Outputs::push`] does, and gives the entries of
    /// all of them at once.
    pub fn push_all<const N: usize>(&mut self, shapes: [Shape; N]) -> [&mut [T]; N] {
        let first = self.tensors.len();
        for shape in shapes {
            self.tensors.push((self.pool.take(shape), true));
        }
        let mut new = self.tensors[first..].iter_mut();
        std::array::from_fn(|_| {
            let (tensor, _) = new.next().expect("one tensor was pushed per shape");
            tensor.own_data_mut()
        })
    }

    /// Adds an output that shares the buffer of `tensor`: an input under another shape.
    pub fn push_shared(&mut self, tensor: Tensor<T>) {
        self.tensors.push((tensor, false));
    }
}

/// What a backward pass sees: the upstream gradients, and the values that the operation kept.
#[derive(Debug)]
pub struct Kept<'a, T> {
    pub(crate) operation: &'static str,
    pub(crate) keep: Keep,
    pub(crate) inputs: Inputs<'a, T>,
    pub(crate) outputs: &'a [Value<T>],
    pub(crate) upstream: &'a [Option<Tensor<T>>],
}

impl<T: Scalar> Kept<'_, T> {
    /// The gradient of the loss with respect to output `j`; `None` where it is zero because
    /// nothing after this operation used the output.
    pub fn upstream(&self, j: usize) -> Option<&[T]> {
        self.upstream[j].as_ref().map(Tensor::data)
    }

    /// The gradient with respect to the only output of an operation that has one.
    pub fn only_upstream(&self) -> &[T] {
        self.upstream(0).expect("backward runs where some output has an upstream gradient")
    }

    /// The entries of input `i`.
    ///
    /// # Panics
    /// Where the operation did not ask to keep it.
    pub fn input(&self, i: usize) -> &[T] {
        assert!(self.keep.has_input(i), "{} did not keep its input {i}", self.operation);
        self.inputs.data(i)
    }

    /// The entries of output `j`.
    ///
    /// # Panics
    /// Where the operation did not ask to keep it.
    pub fn output(&self, j: usize) -> &[T] {
        assert!(self.keep.has_output(j), "{} did not keep its output {j}", self.operation);
        self.outputs[j].tensor.data()
    }

    /// How many inputs there are.
    pub fn input_count(&self) -> usize {
        self.inputs.len()
    }

    /// The shape of input `i`, kept or not.
    pub fn input_shape(&self, i: usize) -> &Shape {
        self.inputs.shape(i)
    }

    /// The shape of output `j`, kept or not.
    pub fn output_shape(&self, j: usize) -> &Shape {
        self.outputs[j].tensor.shape()
    }
}

/// The gradients of an operation's inputs, to be added to.
#[derive(Debug)]
pub struct Accumulators<'a, T> {
    pub(crate) slots: &'a mut [Option<Accumulator<T>>],
}

impl<T: Scalar> Accumulators<'_, T> {
    /// Whether the gradient of input `i` is wanted now.
    pub fn needs(&self, i: usize) -> bool {
        self.slots[i].is_some()
    }

    /// The gradient of input `i`, where it is wanted.
    pub fn get(&mut self, i: usize) -> Option<&mut Accumulator<T>> {
        self.slots[i].as_mut()
    }

    /// The gradients of the first `N` inputs at once, each where it is wanted.
    pub fn first<const N: usize>(&mut self) -> [Option<&mut Accumulator<T>>; N] {
        let mut slots = self.slots.iter_mut();
        std::array::from_fn(|_| slots.next().expect("an operation has these inputs").as_mut())
    }
}

/// The gradient of one input. Everything adds to what is already there; nothing overwrites it.
#[derive(Debug)]
pub struct Accumulator<T> {
    pub(crate) tensor: Tensor<T>,
    /// Whether nothing has been added yet: the buffer then holds no meaningful numbers.
    pub(crate) fresh: bool,
}

impl<T: Scalar> Accumulator<T> {
    /// Adds `entry(k)` to the k-th entry, for every k.
    #[inline]
    pub fn add_each(&mut self, mut entry: impl FnMut(usize) -> T) {
        let fresh = std::mem::replace(&mut self.fresh, false);
        let sum = self.tensor.own_data_mut();
        if fresh {
            sum.iter_mut().enumerate().for_each(|(k, sum)| *sum = entry(k));
        } else {
            sum.iter_mut().enumerate().for_each(|(k, sum)| *sum += entry(k));
        }
    }

    /// Adds `entry([from[0][k], from[1][k], ...])` to the k-th entry, for every k; entries of a
    /// large array are worked on at the same time.
    ///
    /// # Panics
    /// Where one of `from` is shorter than the input.
    #[inline]
    pub fn add_zipped<const N: usize>(
        &mut self,
        from: [&[T]; N],
        entry: impl Fn([T; N]) -> T + Send + Sync,
    ) {
        let fresh = std::mem::replace(&mut self.fresh, false);
        let sum = self.tensor.own_data_mut();
        if fresh {
            for_each_zipped_mut(sum, from, |sum, from| *sum = entry(from));
        } else {
            for_each_zipped_mut(sum, from, |sum, from| *sum += entry(from));
        }
    }

    /// Adds `entries[k]` to the k-th entry, for every k.
    ///
    /// # Panics
    /// Unless there are as many entries as the input has.
    pub fn add(&mut self, entries: &[T]) {
        let size = self.tensor.size();
        assert_eq!(size, entries.len(), "a gradient has as many entries as its input");
        self.add_zipped([entries], |[entry]| entry);
    }

    /// The entries, where nothing has been added yet: whoever takes them writes every one of them.
    /// `None` where there is a sum to add to.
    pub fn unwritten(&mut self) -> Option<&mut [T]> {
        let fresh = std::mem::replace(&mut self.fresh, false);
        fresh.then(|| self.tensor.own_data_mut())
    }

    /// The sum so far, zeros at first, for an operation that adds to some entries.
    pub fn entries(&mut self) -> &mut [T] {
        let fresh = std::mem::replace(&mut self.fresh, false);
        let sum = self.tensor.own_data_mut();
        if fresh {
            sum.fill(T::ZERO);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;

    /// `[x, 2 x]`; keeps its input only if told to, and reads it in any case.
    struct Doubles {
        keeps_input: bool,
        refuses: bool,
    }

    const HONEST: Doubles = Doubles { keeps_input: true, refuses: false };

    impl Op<f64> for Doubles {
        type Saved = Vec<f64>;
        type Error = TensorError;

        fn name(&self) -> &'static str {
            "doubles"
        }

        fn forward(
            &self,
            inputs: &Inputs<'_, f64>,
            outputs: &mut Outputs<'_, f64>,
            saved: &mut Vec<f64>,
        ) -> Result<(), TensorError> {
            saved.clear();
            saved.extend(inputs.data(0));
            let shape = inputs.shape(0);
            let [once, twice] = outputs.push_all([shape.clone(), shape.clone()]);
            for (k, &x) in inputs.data(0).iter().enumerate() {
                (once[k], twice[k]) = (x, 2.0 * x);
            }
            if self.refuses {
                return Err(TensorError::NotScalar { shape: shape.clone() });
            }
            Ok(())
        }

        fn keeps(&self, _inputs: &Inputs<'_, f64>) -> Keep {
            if self.keeps_input { Keep::NOTHING.input(0) } else { Keep::NOTHING }
        }

        fn backward(
            &self,
            kept: &Kept<'_, f64>,
            saved: &mut Vec<f64>,
            gradients: &mut Accumulators<'_, f64>,
        ) {
            assert_eq!(kept.input(0), saved);
            let Some(x_bar) = gradients.get(0) else { return };
            for (j, factor) in [(0, 1.0), (1, 2.0)] {
                if let Some(y_bar) = kept.upstream(j) {
                    x_bar.add_zipped([y_bar], |[y_bar]| factor * y_bar);
                }
            }
        }

        fn saved_bytes(&self, saved: &Vec<f64>) -> usize {
            std::mem::size_of_val(&saved[..])
        }
    }

    #[test]
    fn an_output_that_nothing_uses_has_no_upstream_gradient() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::full([3], 1.5));
        let outputs = tape.record(HONEST, &[x]).unwrap();
        let (once, twice) = (outputs[0], outputs[1]);
        for (loss, expected) in [(once, 1.0), (twice, 2.0), (once + twice, 3.0)] {
            let gradients = loss.sum().backward().unwrap();
            assert_eq!(gradients.get(x), Some(&Tensor::full([3], expected)));
        }
    }

    #[test]
    #[should_panic(expected = "doubles did not keep its input 0")]
    fn what_was_not_kept_cannot_be_read() {
        let tape = Tape::new();
        let op = Doubles { keeps_input: false, refuses: false };
        let outputs = tape.record(op, &[tape.scalar(1.0)]).unwrap();
        let _ = outputs[0].backward();
    }

    #[test]
    fn what_is_kept_is_told_apart() {
        let keep = Keep::NOTHING.input(0).input(63).output(2);
        let inputs: Vec<_> = (0..130).filter(|&i| keep.has_input(i)).collect();
        let outputs: Vec<_> = (0..130).filter(|&j| keep.has_output(j)).collect();
        assert_eq!((inputs, outputs), (vec![0, 63], vec![2]));
    }

    #[test]
    #[should_panic(expected = "`apply` is for operations of one output")]
    fn several_outputs_need_record() {
        let tape = Tape::new();
        let _ = tape.apply(HONEST, &[tape.scalar(1.0)]);
    }

    #[test]
    fn a_refusal_leaves_the_tape_as_it_was() {
        let run = |refusals: usize| {
            let tape = Tape::new();
            let x = tape.leaf(&Tensor::from_fn([3], |k| k as f64));
            let y = x.square();
            for _ in 0..refusals {
                assert!(tape.record(Doubles { refuses: true, ..HONEST }, &[y]).is_err());
                assert_eq!(tape.len(), 2);
                // Its two outputs, for the next one to take.
                assert_eq!(tape.inner.borrow().pool.count(), 2);
            }
            let z = (y.exp() * x).sum();
            (z.value(), z.backward().unwrap().get_or_zeros(x), tape.take_report())
        };
        assert_eq!(run(0), run(2));
    }

    #[test]
    fn what_is_saved_is_counted_and_shown() {
        let tape = Tape::new();
        let x = tape.constant(&Tensor::full([3], 1.0));
        let (_, seen) = tape.record_with(HONEST, &[x], |saved| saved.clone()).unwrap();
        assert_eq!(seen, [1.0; 3]);
        // Two outputs and what was saved, three numbers each.
        assert_eq!(tape.take_report().operations[0].bytes, 9 * 8);
    }

    fn accumulator(fresh: bool) -> Accumulator<f64> {
        // NaN: what a fresh buffer holds means nothing.
        let entry = if fresh { f64::NAN } else { 10.0 };
        Accumulator { tensor: Tensor::full([2], entry), fresh }
    }

    #[test]
    fn every_way_to_add_adds_once_to_what_is_there() {
        for (fresh, before) in [(true, 0.0), (false, 10.0)] {
            let ways: [fn(&mut Accumulator<f64>); 5] = [
                |sum| sum.add_each(|k| 1.0 + k as f64),
                |sum| sum.add(&[1.0, 2.0]),
                |sum| sum.add_zipped([&[3.0, 5.0], &[2.0, 3.0]], |[a, b]| a - b),
                |sum| sum.entries().iter_mut().zip([1.0, 2.0]).for_each(|(s, x)| *s += x),
                |sum| match sum.unwritten() {
                    Some(entries) => entries.copy_from_slice(&[1.0, 2.0]),
                    None => sum.add(&[1.0, 2.0]),
                },
            ];
            for way in ways {
                let mut sum = accumulator(fresh);
                way(&mut sum);
                assert_eq!(sum.tensor.data(), [before + 1.0, before + 2.0]);
                way(&mut sum);
                assert_eq!(sum.tensor.data(), [before + 2.0, before + 4.0]);
            }
        }
    }

    #[test]
    #[should_panic(expected = "a gradient has as many entries as its input")]
    fn a_gradient_of_another_length_is_refused() {
        accumulator(true).add(&[1.0]);
    }
}
