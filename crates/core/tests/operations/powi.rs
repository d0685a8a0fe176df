use crate::slopes::value_and_slope;

#[test]
fn at_zero_value_and_slope_are_the_limits() {
    assert_eq!(value_and_slope(0.0, |x| x.powi(0)), [1.0, 0.0]);
    assert_eq!(value_and_slope(0.0, |x| x.powi(1)), [0.0, 1.0]);
    assert_eq!(value_and_slope(0.0, |x| x.powi(2)), [0.0, 0.0]);
    assert_eq!(value_and_slope(0.0, |x| x.powi(3)), [0.0, 0.0]);
    let poles = [f64::INFINITY, f64::NEG_INFINITY];
    assert_eq!(value_and_slope(0.0, |x| x.powi(-1)), poles);
}

#[test]
fn value_and_slope_by_hand() {
    assert_eq!(value_and_slope(-2.0, |x| x.powi(3)), [-8.0, 12.0]);
    assert_eq!(value_and_slope(2.0, |x| x.powi(-2)), [0.25, -0.25]);
    assert_eq!(value_and_slope(-3.0, |x| x.square()), [9.0, -6.0]);
    assert_eq!(value_and_slope(1.0, |x| x.powi(i32::MIN)), [1.0, f64::from(i32::MIN)]);
}
