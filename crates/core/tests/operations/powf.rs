use bokashi_core::Tape;

use crate::slopes::value_and_slope;

#[test]
fn value_and_slope_by_hand() {
    assert_eq!(value_and_slope(4.0, |x| x.powf(0.5)), [2.0, 0.25]);
    assert_eq!(value_and_slope(-2.0, |x| x.powf(3.0)), [-8.0, 12.0]);
    assert_eq!(value_and_slope(0.0, |x| x.powf(0.5)), [0.0, f64::INFINITY]);
    assert_eq!(value_and_slope(0.0, |x| x.powf(2.0)), [0.0, 0.0]);
    assert_eq!(value_and_slope(0.0, |x| x.powf(0.0)), [1.0, 0.0]);
    assert!(value_and_slope(-2.0_f64, |x| x.powf(0.5)).iter().all(|x| x.is_nan()));
}

#[test]
fn an_exponent_of_one_is_the_identity() {
    let tape = Tape::new();
    let x = tape.leaf_scalar(-3.0);
    assert_eq!((x.powf(1.0).item(), tape.len()), (-3.0, 1));
}
