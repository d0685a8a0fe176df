use crate::slopes::value_and_slopes;

#[test]
fn the_smaller_side_gets_the_gradient_and_equal_sides_share_it() {
    let of = |x, y| value_and_slopes(x, y, |x, y| x.minimum(y).unwrap());
    assert_eq!(of(1.0, 2.0), [1.0, 1.0, 0.0]);
    assert_eq!(of(2.0, 1.0), [1.0, 0.0, 1.0]);
    assert_eq!(of(3.0, 3.0), [3.0, 0.5, 0.5]);
}

#[test]
fn a_nan_on_either_side_is_not_masked() {
    for (x, y) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
        let of = value_and_slopes(x, y, |x, y| x.minimum(y).unwrap());
        assert!(of.iter().all(|number| number.is_nan()));
    }
}

#[test]
fn negative_zero_is_smaller_than_zero() {
    let (plus, minus) = (0.0_f64.to_bits(), (-0.0_f64).to_bits());
    let pairs: [(f64, f64); 4] = [(-0.0, 0.0), (0.0, -0.0), (0.0, 0.0), (-0.0, -0.0)];
    let found =
        pairs.map(|(x, y)| value_and_slopes(x, y, |x, y| x.minimum(y).unwrap())[0].to_bits());
    assert_eq!(found, [minus, minus, plus, minus]);
}
