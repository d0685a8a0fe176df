use std::sync::Arc;

use bokashi_core::{Tape, Tensor};

#[test]
fn a_row_gathered_twice_collects_both_gradients() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([3, 2], |k| k as f64));
    let y = x.gather_rows(&Arc::from([2, 0, 2])).unwrap();
    assert_eq!(y.value().data(), [4.0, 5.0, 0.0, 1.0, 4.0, 5.0]);
    let upstream = Tensor::from_flat_fn([3, 2], |k| 1.0 + k as f64);
    let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
    assert_eq!(gradients.get(x).unwrap().data(), [3.0, 4.0, 0.0, 0.0, 6.0, 8.0]);
}

#[test]
fn rows_without_entries_and_no_rows_are_defined() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::zeros([3, 0]));
    let y = x.gather_rows(&Arc::from([1, 1])).unwrap();
    assert_eq!(y.value(), Tensor::zeros([2, 0]));
    assert_eq!(y.sum().backward().unwrap().get_or_zeros(x).size(), 0);
    let none = tape.leaf(&Tensor::zeros([3, 2])).gather_rows(&Arc::from([])).unwrap();
    assert_eq!(none.value(), Tensor::zeros([0, 2]));
}

#[test]
fn the_list_is_let_go_with_the_step() {
    let mut tape = Tape::new();
    let rows = Arc::from([0]);
    let _ = tape.leaf(&Tensor::full([1, 1], 1.0)).gather_rows(&rows).unwrap();
    assert_eq!(Arc::strong_count(&rows), 2);
    tape.reset();
    assert_eq!(Arc::strong_count(&rows), 1);
}
