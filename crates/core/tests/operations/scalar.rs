use bokashi_core::{Dual, Scalar};

#[test]
fn minimum_and_maximum_never_mask_a_nan_and_a_number_may() {
    for (a, b) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
        assert!(a.minimum_or_nan(b).is_nan());
        assert!(a.maximum_or_nan(b).is_nan());
        assert_eq!(a.minimum_number(b), 1.0);
    }
    assert!(f64::NAN.minimum_number(f64::NAN).is_nan());
    let wide = |a: f64, b: f64| Dual::new(a, 0.0).minimum_number(Dual::new(b, 0.0)).value;
    assert_eq!([wide(f64::NAN, 1.0), wide(1.0, f64::NAN), wide(2.0, 1.0)], [1.0; 3]);
}
