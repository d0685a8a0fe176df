use std::ops::Range;

use bokashi_core::parallel::alone;
use bokashi_core::{Dependence, PartialSum, Tape, Tensor, TensorError, Var, covered, halves};

use crate::counted::{Counted, made};

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
        let [mut sum, next] = halves(&range).unwrap().map(|half| whole(half, known));
        sum.value += next.value;
        for (sum, next) in sum.gradients.iter_mut().zip(next.gradients) {
            let (sum, next) = (sum.as_mut().unwrap(), next.unwrap());
            sum.data_mut().iter_mut().zip(next.data()).for_each(|(sum, next)| *sum += next);
        }
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
    let constants = tape.sum_over(2, &[constant], |_, _, inputs| Ok::<_, TensorError>(inputs[0]));
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
    let before = made();
    for _ in 0..3 {
        let x = tape.leaf_scalar(0.5);
        let sum = alone(|| {
            tape.sum_over(5, &[x], |_, tape, inputs| tape.apply(Counted::<0>, &[inputs[0].exp()]))
        });
        sum.unwrap();
        let report = tape.take_report();
        let calls: Vec<_> = report.operations.iter().map(|of| (of.name, of.calls)).collect();
        assert_eq!(calls, [("exp", 5), ("counted", 5), ("sum_over", 1)]);
        tape.reset();
    }
    assert_eq!(made() - before, 1, "one tape served all parts of all steps");
}
