use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::over;

#[test]
fn over_is_associative_and_nothing_changes_nothing() {
    let tape = Tape::<f64>::new();
    let image = |seed: usize| {
        tape.leaf(&Tensor::from_flat_fn([30, 20, 4], |k| ((k + seed) as f64 * 0.7).sin().abs()))
    };
    let [a, b, c] = [1, 5, 9].map(image);
    let left = over(over(a, b).unwrap(), c).unwrap().value();
    let right = over(a, over(b, c).unwrap()).unwrap().value();
    for (left, right) in left.data().iter().zip(right.data()) {
        approx::assert_relative_eq!(left, right, epsilon = 1e-14);
    }
    let nothing = tape.constant_full([30, 20, 4], 0.0);
    assert_eq!(over(nothing, a).unwrap().value(), a.value());
    assert_eq!(over(a, nothing).unwrap().value(), a.value());
    let opaque = a.value().map(|_| 1.0);
    let opaque = tape.constant(&opaque);
    assert_eq!(over(opaque, b).unwrap().value(), opaque.value());
}

/// Radiance is above 1, and alpha is beyond [0, 1] where a filter has overshot or something is learnt: nothing
/// is clamped.
#[test]
fn numbers_beyond_0_and_1_are_numbers_like_others() {
    let tape = Tape::<f64>::new();
    let front = tape.leaf(&Tensor::from([[7.0, -2.0, 1.5], [0.5, 3.0, -0.25]]));
    let behind = tape.leaf(&Tensor::from([[4.0, 6.0, 2.0], [-8.0, 16.0, -1.0]]));
    let out = over(front, behind).unwrap();
    // By hand: f - b / 2, and f + 1.25 b.
    assert_eq!(out.value(), Tensor::from([[5.0, -5.0, 0.5], [-9.5, 23.0, -1.5]]));
    let upstream = Tensor::from([[1.0, 2.0, 3.0], [4.0, -5.0, 6.0]]);
    let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
    // The alphas get 3 - (4 + 12 + 6) and 6 - (-32 - 80 - 6) on top of nothing else.
    let expected = Tensor::from([[1.0, 2.0, -19.0], [4.0, -5.0, 124.0]]);
    assert_eq!(gradients.get_or_zeros(front), expected);
    let expected = Tensor::from([[-0.5, -1.0, -1.5], [5.0, -6.25, 7.5]]);
    assert_eq!(gradients.get_or_zeros(behind), expected);
}
