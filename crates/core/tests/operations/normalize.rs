use bokashi_core::{Tape, Tensor};

#[test]
fn value_and_gradient_by_hand_and_nothing_of_a_vector_of_zeros() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([[3.0, 4.0], [0.0, 0.0], [0.0, -7.0]]));
    let y = x.normalize().unwrap();
    assert_eq!(y.value(), Tensor::from([[3.0 / 5.0, 4.0 / 5.0], [0.0, 0.0], [0.0, -1.0]]));
    let upstream = Tensor::from([[1.0, 0.0], [1.0, 2.0], [14.0, 3.0]]);
    let x_bar = tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x);
    // Across (3, 4) / 5 the upstream gradient is 4/5 of (4, -3) / 5.
    let expected = [16.0_f64 / 125.0, -12.0 / 125.0, 0.0, 0.0, 2.0, 0.0];
    for (x_bar, expected) in x_bar.data().iter().zip(expected) {
        assert!((x_bar - expected).abs() < 1e-15, "{x_bar} {expected}");
    }
}

#[test]
fn long_vectors_are_those_of_a_quotient_by_the_length() {
    let tape = Tape::new();
    for shape in [[3, 5], [2, 40], [70, 4], [1, 1], [2, 20_000]] {
        let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| (k as f64 * 0.7 + 0.1).sin()));
        let quotient = x / x.norm().unwrap().keepdim(1).unwrap();
        let upstream = x.value().map(|x| (3.0 * x).cos());
        let [a, b] = [x.normalize().unwrap(), quotient]
            .map(|y| (y.value(), tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x)));
        for (a, b) in [(&a.0, &b.0), (&a.1, &b.1)] {
            let pairs = a.data().iter().zip(b.data());
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{a} {b}"));
        }
    }
}

#[test]
fn a_multiple_of_a_vector_has_the_same_direction_down_to_the_smallest_numbers() {
    let tape = Tape::new();
    let vector = [2.0, -3.0, 6.0];
    let of = |scale: f64| {
        let x = tape.leaf(&Tensor::from(vector.map(|x| x * scale)));
        let y = x.normalize().unwrap();
        let upstream = Tensor::from([1.0, 0.0, 0.0]);
        let x_bar = tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x);
        (y.value(), x_bar.map(|x_bar| x_bar * scale))
    };
    let plain = of(1.0);
    for exponent in [-1000, -600, -480, 0, 480, 600, 1000] {
        assert_eq!(of(2.0_f64.powi(exponent)), plain, "2^{exponent}");
    }
    let largest = tape.leaf(&Tensor::from([f64::MAX; 4])).normalize().unwrap();
    assert_eq!(largest.value(), Tensor::full([4], 0.5));
    let single = Tape::<f32>::new();
    let tiny = single.leaf(&Tensor::from([3e-45_f32, 0.0])).normalize().unwrap();
    assert_eq!(tiny.value(), Tensor::from([1.0, 0.0]));
}

#[test]
fn a_nan_is_not_masked() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([[f64::NAN, 0.0], [0.0, 0.0]]));
    let y = x.normalize().unwrap();
    assert!(y.value()[[0, 0]].is_nan());
    let upstream = Tensor::from([[0.0, 0.0], [0.0, f64::NAN]]);
    assert!(tape.vjp(&[(y, &upstream)]).unwrap().get(x).unwrap()[[1, 1]].is_nan());
}
