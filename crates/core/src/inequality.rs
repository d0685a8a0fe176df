//! Truth values from comparisons of variables. They go by value, and have no gradient.

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::mask::Mask;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::parallel::for_each_zipped_mut;
use crate::scalar::Scalar;
use crate::var::Var;
use crate::walk::{Walk, axes};

/// What holds of each pair of entries. It has no output: its result is what it saves.
struct Comparison<F> {
    name: &'static str,
    holds: F,
}

impl<T: Scalar, F: Fn(T, T) -> bool + Copy + Send + Sync + 'static> Op<T> for Comparison<F> {
    type Saved = Mask;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        self.name
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        _outputs: &mut Outputs<'_, T>,
        saved: &mut Mask,
    ) -> Result<(), TensorError> {
        let (left, right) = (inputs.shape(0), inputs.shape(1));
        let (x, y) = (inputs.data(0), inputs.data(1));
        let shape = left.broadcast(right).ok_or_else(|| TensorError::Broadcast {
            operation: self.name,
            shapes: Box::new([left.clone(), right.clone()]),
        })?;
        let walk = Walk::new(axes([&shape, left, right]).map(|(n, [_, i, j])| (n, [i, j])));
        let is_whole = left == right;
        let truth = saved.renew(shape, self.name)?;
        let holds = |truth: &mut bool, [x, y]: [T; 2]| *truth = (self.holds)(x, y);
        if is_whole {
            for_each_zipped_mut(truth, [x, y], holds);
        } else {
            walk.zip_mut(truth, [x, y], holds);
        }
        Ok(())
    }

    fn backward(&self, _: &Kept<'_, T>, _: &mut Mask, _: &mut Accumulators<'_, T>) {}

    fn saved_bytes(&self, saved: &Mask) -> usize {
        saved.data().len()
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Records where `holds` of each pair of entries.
    fn compare(
        self,
        other: Self,
        name: &'static str,
        holds: impl Fn(T, T) -> bool + Copy + Send + Sync + 'static,
    ) -> Result<Mask, TensorError> {
        let op = Comparison { name, holds };
        Ok(self.tape.record_with(op, &[self, other], Mask::clone)?.1)
    }

    /// Where `self < other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_less(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_less", |x, y| x < y)
    }

    /// Where `self <= other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_at_most(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_at_most", |x, y| x <= y)
    }

    /// Where `self > other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_greater(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_greater", |x, y| x > y)
    }

    /// Where `self >= other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_at_least(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_at_least", |x, y| x >= y)
    }

    /// Where an entry is neither infinite nor NaN.
    pub fn is_finite(self) -> Mask {
        self.compare(self, "is_finite", |x, _| x.is_finite()).expect("a shape is its own")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dependence::Dependence;
    use crate::dual::Dual;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn comparisons_hold_as_those_of_numbers_and_nowhere_beside_a_nan() {
        let tape = Tape::new();
        let numbers = [-1.0, -0.0, 0.0, 2.0, f64::INFINITY, f64::NAN];
        let row = tape.leaf(&Tensor::from(numbers));
        let column = row.reshape([6, 1]).unwrap();
        let of = |holds: fn(&f64, &f64) -> bool| {
            Mask::from_fn([6, 6], |[i, j]| holds(&numbers[i], &numbers[j]))
        };
        assert_eq!(column.is_less(row), Ok(of(|a, b| a < b)));
        assert_eq!(column.is_at_most(row), Ok(of(|a, b| a <= b)));
        assert_eq!(column.is_greater(row), Ok(of(|a, b| a > b)));
        assert_eq!(column.is_at_least(row), Ok(of(|a, b| a >= b)));
        assert_eq!(row.is_finite(), Mask::from([true, true, true, true, false, false]));
        assert_eq!(row.is_less(row).unwrap().count(), 0);
        let message = "is_less needs shapes that broadcast, got [6] and [2]";
        let pair = tape.constant_full([2], 0.0);
        assert_eq!(row.is_less(pair).unwrap_err().to_string(), message);
    }

    #[test]
    fn large_arrays_are_compared_whole() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([40_000, 3], |k| (k % 11) as f64));
        let bound = tape.constant(&Tensor::from([2.0, 5.0, 8.0]));
        let expected = Mask::from_fn([40_000, 3], |[i, j]| (3 * i + j) % 11 < 3 * j + 2);
        assert_eq!(x.is_less(bound), Ok(expected));
        let all = Mask::full([40_000, 3], true);
        assert_eq!(x.is_at_most(x), Ok(all));
    }

    #[test]
    fn a_comparison_is_in_the_report_and_no_backward_pass_looks_at_it() {
        let tape = Tape::new();
        let x = tape.leaf_scalar(2.0);
        let mask = x.is_less(tape.constant_scalar(3.0)).unwrap();
        assert_eq!((mask.count(), tape.len()), (1, 2));
        // Who asks where the way from x ended is told.
        let end = Dependence::None { end: Some("is_less"), is_detached: false };
        assert_eq!(tape.constant_scalar(1.0).dependence_on(x), Ok(end));
        let gradients = x.exp().backward().unwrap();
        assert_eq!(gradients.get_or_zeros(x).item(), 2.0_f64.exp());
        drop(gradients);
        let report = tape.take_report();
        assert_eq!((report.operations[0].name, report.operations[0].calls), ("is_less", 1));
        assert!(report.left_out.is_empty(), "{report}");
    }

    #[test]
    fn the_memory_of_a_mask_is_used_again_unless_somebody_holds_it() {
        let mut tape = Tape::new();
        let mut address = |held: &mut Vec<Mask>| {
            let x = tape.leaf_full([100], 1.0);
            let mask = x.is_less(x).unwrap();
            let address = mask.data().as_ptr();
            held.push(mask);
            tape.reset();
            address
        };
        let mut held = Vec::new();
        let first = address(&mut held);
        held.clear();
        assert_eq!(address(&mut held), first);
        assert_ne!(address(&mut held), first);
    }

    #[test]
    fn comparisons_go_by_value() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([Dual::new(1.0, 9.0), Dual::new(1.0, -9.0)]));
        assert_eq!(x.is_less(x.slice(0, 1..2).unwrap()).unwrap().count(), 0);
    }
}
