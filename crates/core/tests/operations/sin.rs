use crate::slopes::value_and_slope;

#[test]
fn the_slope_is_the_sine_a_quarter_turn_ahead() {
    for x in [-4.0_f64, 0.0, 0.5, 3.0, 100.0] {
        let [value, slope] = value_and_slope(x, |x| x.sin());
        assert!((value * value + slope * slope - 1.0).abs() < 1e-15);
        assert!((slope - (x + std::f64::consts::FRAC_PI_2).sin()).abs() < 1e-13);
    }
}
