use crate::slopes::value_and_slope;

#[test]
fn far_out_the_value_saturates_and_nothing_is_nan() {
    assert_eq!(value_and_slope(1000.0, |x| x.sigmoid()), [1.0, 0.0]);
    assert_eq!(value_and_slope(-1000.0, |x| x.sigmoid()), [0.0, 0.0]);
    assert_eq!(value_and_slope(0.0, |x| x.sigmoid()), [0.5, 0.25]);
}

#[test]
fn a_saturated_value_still_has_its_slope() {
    for x in [20.0_f32, 40.0] {
        let [value, slope] = value_and_slope(x, |x| x.sigmoid());
        assert_eq!(value, 1.0);
        assert!((slope / (-x).exp() - 1.0).abs() < 1e-6);
    }
}
