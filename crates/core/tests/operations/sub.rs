use bokashi_core::Tape;

use crate::slopes::{value_and_slope, value_and_slopes};

#[test]
fn value_and_slopes_by_hand() {
    assert_eq!(value_and_slopes(2.0, 3.0, |x, y| x - y), [-1.0, 1.0, -1.0]);
}

#[test]
fn a_variable_less_itself_is_zero_with_zero_slope() {
    assert_eq!(value_and_slope(0.1, |x| x - x), [0.0, 0.0]);
}

#[test]
#[should_panic(expected = "sub needs shapes that broadcast, got [2] and [3]")]
fn the_operator_panics_with_both_shapes() {
    let tape = Tape::<f64>::new();
    let _ = tape.constant_full([2], 0.0) - tape.constant_full([3], 0.0);
}
