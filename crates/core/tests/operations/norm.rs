use bokashi_core::{Scalar, Tape, Tensor};

#[test]
fn lengths_and_gradients_by_hand() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([[3.0, -4.0], [0.0, 0.0], [5.0, 12.0]]));
    let y = x.norm().unwrap();
    assert_eq!(y.value(), Tensor::from([5.0, 0.0, 13.0]));
    let gradients = tape.vjp(&[(y, &Tensor::from([1.0, 1.0, 2.0]))]).unwrap();
    let expected = [3.0 / 5.0, -4.0 / 5.0, 0.0, 0.0, 10.0 / 13.0, 24.0 / 13.0];
    for (x_bar, expected) in gradients.get_or_zeros(x).data().iter().zip(expected) {
        assert!((x_bar - expected).abs() < 1e-15, "{x_bar} {expected}");
    }
}

#[test]
fn lengths_are_roots_of_inner_products_at_every_extent() {
    for shape in [[2, 40_000], [40_000, 2], [9_000, 3], [40, 7], [40, 8]] {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| (k as f64).sin() + 0.1));
        let lengths = x.norm().unwrap();
        let roots = x.dot(x).unwrap().sqrt();
        let upstream = Tensor::from_flat_fn(lengths.shape(), |k| 1.0 + (k % 7) as f64);
        let [found, expected] = [lengths, roots].map(|y| {
            let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
            [y.value(), gradients.get_or_zeros(x)]
        });
        for (found, expected) in found.iter().zip(&expected) {
            let pairs = found.data().iter().zip(expected.data());
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-13 * b.abs().max(1.0)));
        }
    }
}

#[test]
fn neither_large_nor_small_entries_lose_the_length() {
    fn norm_and_gradient<T: Scalar, const N: usize>(vector: [f64; N]) -> (f64, [f64; N]) {
        let tape = Tape::<T>::new();
        let x = tape.leaf(&Tensor::from(vector.map(T::from_f64)));
        let y = x.norm().unwrap();
        let x_bar = y.backward().unwrap().get_or_zeros(x);
        (y.item().to_f64(), std::array::from_fn(|k| x_bar.data()[k].to_f64()))
    }
    for scale in [1e-300, 1e-200, 1.0, 1e200, 1e300] {
        let (length, x_bar) = norm_and_gradient::<f64, 3>([2.0 * scale, -3.0 * scale, 6.0 * scale]);
        assert!((length / scale - 7.0).abs() < 1e-14, "{scale}: {length}");
        assert!((x_bar[1] + 3.0 / 7.0).abs() < 1e-15, "{scale}: {x_bar:?}");
    }
    for scale in [1e-38_f32, 1e-20, 1e20, 4e37] {
        let scale = f64::from(scale);
        let (length, x_bar) = norm_and_gradient::<f32, 3>([2.0 * scale, -3.0 * scale, 6.0 * scale]);
        assert!((length / scale - 7.0).abs() < 1e-6, "{scale}: {length}");
        assert!((x_bar[1] + 3.0 / 7.0).abs() < 1e-7, "{scale}: {x_bar:?}");
    }
    // The gradient is right even where the length itself is beyond the largest number.
    assert_eq!(norm_and_gradient::<f64, 4>([f64::MAX; 4]), (f64::INFINITY, [0.5; 4]));
}

#[test]
fn a_nan_is_not_masked() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([[f64::NAN, 1.0], [0.0, 0.0]]));
    let y = x.norm().unwrap();
    assert!(y.value().data()[0].is_nan());
    let gradients = tape.vjp(&[(y, &Tensor::from([1.0, f64::NAN]))]).unwrap();
    assert!(gradients.get(x).unwrap().data().iter().all(|x_bar| x_bar.is_nan()));
}
