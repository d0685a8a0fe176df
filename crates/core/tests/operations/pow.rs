use bokashi_core::Tape;

use crate::slopes::value_and_slopes;

#[test]
fn value_and_slopes_by_hand() {
    let of = |x: f64, y| value_and_slopes(x, y, |x, y| x.pow(y).unwrap());
    assert_eq!(of(2.0, 3.0), [8.0, 12.0, 8.0 * 2.0_f64.ln()]);
    assert_eq!(of(1.0, -7.0), [1.0, -7.0, 0.0]);
    assert_eq!(of(4.0, 0.5)[..2], [2.0, 0.25]);
}

#[test]
fn zero_to_a_positive_power_is_zero_with_slope_zero_to_the_exponent() {
    let of = |y: f64| value_and_slopes(0.0, y, |x, y| x.pow(y).unwrap());
    assert_eq!(of(2.5), [0.0, 0.0, 0.0]);
    assert_eq!(of(1.0), [0.0, 1.0, 0.0]);
    assert_eq!(of(0.5), [0.0, f64::INFINITY, 0.0]);
    assert_eq!(of(0.0), [1.0, 0.0, 0.0]);
    let infinite = f64::INFINITY;
    assert_eq!(of(-1.0), [infinite, -infinite, -infinite]);
}

#[test]
fn a_constant_exponent_of_negative_numbers_does_no_harm() {
    let tape = Tape::new();
    let (x, three) = (tape.leaf_scalar(-2.0), tape.constant_scalar(3.0));
    let cube = x.pow(three).unwrap();
    assert_eq!(cube.item(), -8.0);
    assert_eq!(cube.backward().unwrap().get_or_zeros(x).item(), 12.0);
    assert!(value_and_slopes(-2.0, 3.0_f64, |x, y| x.pow(y).unwrap())[2].is_nan());
    assert!(value_and_slopes(-2.0, 0.5_f64, |x, y| x.pow(y).unwrap())[0].is_nan());
}
