use crate::slopes::value_and_slope;

#[test]
fn the_logarithm_undoes_the_exponential() {
    for x in [-20.0_f64, -1.0, 0.5, 30.0] {
        let [value, slope] = value_and_slope(x, |x| x.exp().ln());
        assert!((value - x).abs() < 1e-14 * x.abs() && (slope - 1.0).abs() < 1e-15);
    }
}

#[test]
fn zero_and_below_are_infinite_and_nan() {
    assert_eq!(value_and_slope(0.0, |x| x.ln()), [f64::NEG_INFINITY, f64::INFINITY]);
    assert!(value_and_slope(0.0_f64, |x| x.ln() * 0.0)[1].is_nan());
    let [value, slope] = value_and_slope(-2.0_f64, |x| x.ln());
    assert!(value.is_nan() && slope == -0.5);
}
