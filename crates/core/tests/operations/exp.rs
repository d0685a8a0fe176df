use crate::slopes::value_and_slope;

#[test]
fn the_slope_is_the_value() {
    for x in [-800.0, -1.0, 0.0, 3.0, 800.0] {
        let [value, slope] = value_and_slope(x, |x| x.exp());
        assert_eq!(value, slope);
    }
    assert_eq!(value_and_slope(0.0, |x| x.exp()), [1.0, 1.0]);
}
