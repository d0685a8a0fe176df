use crate::slopes::value_and_slope;

#[test]
fn far_out_the_value_saturates_and_the_slope_keeps_its_digits() {
    assert_eq!(value_and_slope(0.0, |x| x.tanh()), [0.0, 1.0]);
    assert_eq!(value_and_slope(-1000.0, |x| x.tanh()), [-1.0, 0.0]);
    let [value, slope] = value_and_slope(25.0_f64, |x| x.tanh());
    assert_eq!(value, 1.0);
    assert!((slope / (4.0 * (-50.0_f64).exp()) - 1.0).abs() < 1e-14);
}
