use bokashi_core::{Dependence, Dual, Mask, Tape, Tensor};

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
    let one = tape.leaf(&Tensor::from([Dual::new(1.0, -9.0)]));
    assert_eq!(x.is_less(one).unwrap().count(), 0);
}
