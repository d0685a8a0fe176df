use crate::slopes::value_and_slope;

#[test]
fn a_parameter_on_its_bound_can_leave_it_and_one_beyond_cannot() {
    let cases = [(-1.5, -1.0, 0.0), (-1.0, -1.0, 1.0), (0.3, 0.3, 1.0), (2.0, 2.0, 1.0)];
    for (x, value, slope) in cases.into_iter().chain([(2.1, 2.0, 0.0)]) {
        assert_eq!(value_and_slope(x, |x| x.clamp(-1.0, 2.0).unwrap()), [value, slope]);
    }
}

#[test]
fn a_nan_is_not_masked() {
    assert!(value_and_slope(f64::NAN, |x| x.clamp(-1.0, 2.0).unwrap())[0].is_nan());
    assert_eq!(value_and_slope(f64::NAN, |x| x.clamp(-1.0, 2.0).unwrap())[1], 1.0);
}
