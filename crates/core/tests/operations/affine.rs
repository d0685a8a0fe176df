use crate::slopes::value_and_slope;

#[test]
fn operators_with_numbers_are_what_they_say() {
    let x = 0.7;
    assert_eq!(value_and_slope(x, |x| -x), [-x, -1.0]);
    assert_eq!(value_and_slope(x, |x| x + 2.0), [x + 2.0, 1.0]);
    assert_eq!(value_and_slope(x, |x| x - 2.0), [x - 2.0, 1.0]);
    assert_eq!(value_and_slope(x, |x| x * 3.0), [x * 3.0, 3.0]);
    assert_eq!(value_and_slope(x, |x| 2.0 + x), [2.0 + x, 1.0]);
    assert_eq!(value_and_slope(x, |x| 2.0 - x), [2.0 - x, -1.0]);
    assert_eq!(value_and_slope(x, |x| 3.0 * x), [3.0 * x, 3.0]);
    assert_eq!(value_and_slope(x, |x| x.affine(3.0, 0.5)), [3.0 * x + 0.5, 3.0]);
}

#[test]
fn the_sign_of_zero_is_that_of_the_number() {
    for x in [0.0_f64, -0.0] {
        assert_eq!(value_and_slope(x, |x| -x)[0].to_bits(), (-x).to_bits());
        assert_eq!(value_and_slope(x, |x| x * 2.0)[0].to_bits(), (x * 2.0).to_bits());
        assert_eq!(value_and_slope(x, |x| 2.0 * x)[0].to_bits(), (2.0 * x).to_bits());
    }
}
