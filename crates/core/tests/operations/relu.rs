use crate::slopes::value_and_slope;

#[test]
fn the_slope_is_one_above_zero_and_zero_elsewhere() {
    let infinite = f64::INFINITY;
    for (x, value, slope) in [
        (2.5, 2.5, 1.0),
        (f64::MIN_POSITIVE, f64::MIN_POSITIVE, 1.0),
        (0.0, 0.0, 0.0),
        (-0.0, 0.0, 0.0),
        (-1.0, 0.0, 0.0),
        (infinite, infinite, 1.0),
        (-infinite, 0.0, 0.0),
    ] {
        assert_eq!(value_and_slope(x, |x| x.relu()), [value, slope]);
    }
    assert_eq!(value_and_slope(-0.0_f64, |x| x.relu())[0].to_bits(), 0);
}

#[test]
fn a_nan_is_not_masked() {
    assert!(value_and_slope(f64::NAN, |x| x.relu()).iter().all(|x| x.is_nan()));
}
