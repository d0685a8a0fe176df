use crate::slopes::value_and_slope;

#[test]
fn far_out_it_is_zero_and_the_identity() {
    assert_eq!(value_and_slope(1000.0, |x| x.softplus()), [1000.0, 1.0]);
    assert_eq!(value_and_slope(-1000.0, |x| x.softplus()), [0.0, 0.0]);
    assert_eq!(value_and_slope(0.0, |x| x.softplus()), [2.0_f64.ln(), 0.5]);
}

#[test]
fn the_left_tail_is_the_exponential() {
    let [value, slope] = value_and_slope(-50.0_f64, |x| x.softplus());
    assert_eq!(value, (-50.0_f64).exp());
    assert!((slope / value - 1.0).abs() < 1e-15);
}

#[test]
fn a_nan_is_not_masked() {
    assert!(value_and_slope(f64::NAN, |x| x.softplus()).iter().all(|x| x.is_nan()));
}
