use bokashi_core::Tape;

use crate::slopes::{value_and_slope, value_and_slopes};

#[test]
fn value_and_slopes_by_hand() {
    assert_eq!(value_and_slopes(3.0, 4.0, |x, y| x / y), [0.75, 0.25, -3.0 / 16.0]);
}

#[test]
fn the_slopes_neither_overflow_nor_underflow_before_the_quotient_does() {
    let [z, x_bar, y_bar] = value_and_slopes(1e-200, 1e-200, |x, y| x / y);
    assert_eq!([z, x_bar / 1e200, y_bar / 1e200], [1.0, 1.0, -1.0]);
    let [z, x_bar, y_bar] = value_and_slopes(1e200_f64, 1e200, |x, y| x / y);
    assert_eq!([z, x_bar * 1e200, y_bar * 1e200], [1.0, 1.0, -1.0]);
}

#[test]
fn numbers_divide_exactly() {
    assert_eq!(value_and_slope(7.0, |x| x / 3.0), [7.0 / 3.0, 1.0 / 3.0]);
    assert_eq!(value_and_slope(4.0, |x| 2.0 / x), [0.5, -0.125]);
    assert_eq!(value_and_slope(1e-310_f64, |x| x / 1e-310)[0], 1.0);
}

#[test]
#[should_panic(expected = "div needs shapes that broadcast, got [2] and [3]")]
fn the_operator_panics_with_both_shapes() {
    let tape = Tape::<f64>::new();
    let _ = tape.constant_full([2], 0.0) / tape.constant_full([3], 0.0);
}
