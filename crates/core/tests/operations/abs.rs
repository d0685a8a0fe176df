use crate::slopes::value_and_slope;

#[test]
fn the_slope_is_the_sign_and_zero_at_zero() {
    let inf = f64::INFINITY;
    let cases = [(-2.5, 2.5, -1.0), (0.0, 0.0, 0.0), (1e300, 1e300, 1.0), (-inf, inf, -1.0)];
    for (x, value, slope) in cases {
        assert_eq!(value_and_slope(x, |x| x.abs()), [value, slope]);
    }
}

#[test]
fn a_nan_is_not_masked() {
    assert!(value_and_slope(f64::NAN, |x| x.abs()).iter().all(|x| x.is_nan()));
}
