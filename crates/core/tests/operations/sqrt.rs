use crate::slopes::value_and_slope;

#[test]
fn value_and_slope_by_hand() {
    assert_eq!(value_and_slope(4.0, |x| x.sqrt()), [2.0, 0.25]);
    assert_eq!(value_and_slope(0.0, |x| x.sqrt()), [0.0, f64::INFINITY]);
    assert!(value_and_slope(-1.0_f64, |x| x.sqrt()).into_iter().all(f64::is_nan));
    assert!(value_and_slope(0.0_f64, |x| x.sqrt() * 0.0)[1].is_nan());
    assert!(value_and_slope(0.0_f64, |x| x.square().sqrt())[1].is_nan());
}
