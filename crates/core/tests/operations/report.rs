use std::time::Duration;

use bokashi_core::{Tape, Tensor, ValueError, gradient_errors, value_errors};

#[test]
fn a_report_counts_calls_passes_and_bytes_and_starts_anew_when_taken() {
    let tape = Tape::<f32>::new();
    let x = tape.leaf(&Tensor::full([10], 0.5));
    let y = x.exp().exp().sum();
    let _ = y.backward().unwrap();
    let _ = y.backward().unwrap();
    let report = tape.take_report();
    let counts = report.operations.iter().map(|o| (o.name, o.calls, o.backward_calls, o.bytes));
    let counts: Vec<_> = counts.collect();
    assert_eq!(counts, [("exp", 2, 4, 2 * 10 * 4), ("sum", 1, 2, 4)]);
    assert!(report.operations.iter().all(|o| o.forward + o.backward == Duration::ZERO));
    assert!(tape.take_report().operations.is_empty());
}

#[test]
fn time_is_taken_where_it_is_asked_for() {
    let tape = Tape::<f64>::new();
    tape.set_timed(true);
    let x = tape.leaf(&Tensor::full([10_000], 0.5));
    let _ = x.exp().sum().backward().unwrap();
    let report = tape.take_report();
    assert!(report.operations[0].forward > Duration::ZERO);
    assert!(report.operations[0].backward > Duration::ZERO);
}

#[test]
fn what_was_left_out_is_counted_by_name_and_reason() {
    let tape = Tape::<f64>::new();
    tape.leave_out("blur", "sigma is 0");
    tape.leave_out("blur", "the image is constant");
    tape.leave_out("blur", "sigma is 0");
    let report = tape.take_report();
    assert_eq!(report.left_out.iter().map(|entry| entry.count).collect::<Vec<_>>(), [2, 1]);
    assert!(report.to_string().contains("left out: blur (sigma is 0), 2 times"));
}

#[test]
fn gradients_that_were_not_needed_are_named() {
    let tape = Tape::<f64>::new();
    let (x, y) = (tape.leaf_scalar(2.0), tape.leaf_scalar(3.0));
    let frozen = tape.constant_scalar(5.0);
    let product = x * frozen;
    let (loss, _unused) = (product.exp() + y, product.sin());
    let left_out = || {
        let entries = tape.take_report().left_out.into_iter();
        let entries = entries.map(|of| format!("{} {} {}", of.name, of.reason, of.count));
        entries.collect::<Vec<_>>()
    };
    assert!(left_out().is_empty());
    let frozen_input = "mul gradient of input 1: not asked for 1";
    let unused = "sin backward: no gradient reaches its outputs 1";
    let _ = loss.backward().unwrap();
    assert_eq!(left_out(), [frozen_input, unused]);
    let _ = loss.backward_to(&[x]).unwrap();
    assert_eq!(left_out(), [frozen_input, "add gradient of input 1: not asked for 1", unused]);
    let _ = loss.backward_to(&[y]).unwrap();
    // In the order in which the tape met the operations; what lies below x is not reached.
    let add = "add gradient of input 0: not asked for 1";
    let unused =
        ["mul", "exp", "sin"].map(|n| format!("{n} backward: no gradient reaches its outputs 1"));
    assert_eq!(left_out(), [&*unused[0], &*unused[1], add, &*unused[2]]);
}

#[test]
fn errors_fill_their_columns_with_the_largest_of_each_operation() {
    let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
    let x = rough.leaf_scalar(0.3);
    let loss = x.exp().exp() + x;
    let x_exact = exact.leaf_scalar(0.3);
    let loss_exact = x_exact.exp().exp() + x_exact;
    let all: Vec<_> = rough.variables().collect();
    let all_exact: Vec<_> = exact.variables().collect();
    let gradients = loss.backward_to(&all).unwrap();
    let exact_gradients = loss_exact.backward_to(&all_exact).unwrap();
    let values = value_errors(&rough, &exact).unwrap();
    let slopes = gradient_errors(&gradients, &exact_gradients).unwrap();
    let report = rough.take_report();
    assert!(report.operations.iter().all(|of| (of.error, of.gradient_error) == (None, None)));
    let report = report.with_errors(&values).with_gradient_errors(&slopes);
    for of in &report.operations {
        let largest = |errors: &[ValueError]| {
            let matching = errors.iter().filter(|error| error.operation == Some(of.name));
            matching.map(|error| error.error.unwrap()).fold(0.0, f64::max)
        };
        assert_eq!(of.error, Some(largest(&values)));
        assert_eq!(of.gradient_error, Some(largest(&slopes)));
    }
    assert!(report.operations[0].error > Some(0.0));
    let shown = format!("{:.1e}", report.operations[0].error.unwrap());
    assert!(report.to_string().contains(&shown));
}
