use bokashi_core::{Tape, Tensor};

#[test]
fn a_dot_is_the_sum_of_a_product_whichever_axes_broadcast() {
    let shapes: [&[usize]; 6] = [&[4, 2, 3], &[2, 3], &[3], &[4, 1, 3], &[1, 2, 3], &[1, 3]];
    for (left, right) in shapes.iter().flat_map(|&l| shapes.iter().map(move |&r| (l, r))) {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn(left, |k| (k % 7) as f64 - 3.0));
        let y = tape.leaf(&Tensor::from_flat_fn(right, |k| (k % 5) as f64 - 1.0));
        let fused = x.dot(y).unwrap();
        let apart = (x * y).sum_axis(left.len().max(right.len()) - 1).unwrap();
        let upstream = Tensor::from_flat_fn(apart.shape(), |k| 1.0 + k as f64);
        let results = |z| {
            let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
            (z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y))
        };
        assert_eq!(results(fused), results(apart), "{left:?} {right:?}");
    }
}

#[test]
fn long_sums_keep_their_digits_in_f32() {
    let n = 1 << 18;
    let tape = Tape::<f32>::new();
    let (tenths, ones) = (tape.leaf(&Tensor::full([2, n], 0.1)), tape.leaf_full([n], 1.0));
    let exact = (f64::from(0.1_f32) * n as f64) as f32;
    assert_eq!(tenths.dot(ones).unwrap().value(), Tensor::full([2], exact));
    let (columns, pair) = (tape.leaf(&Tensor::full([n, 2], 0.1)), tape.leaf_full([2], 1.0));
    let gradients = columns.dot(pair).unwrap().sum().backward().unwrap();
    assert_eq!(gradients.get(pair), Some(&Tensor::full([2], exact)));
    // 2^60 and -2^60 cancel, and what is between them stays.
    let terms = tape.constant(&Tensor::from([1.0, 1.0, -1.0]));
    let large = 2.0_f32.powi(40);
    let sum = tape.constant(&Tensor::from([large, 0.25, large])).dot(terms).unwrap();
    assert_eq!(sum.item(), 0.25);
}

#[test]
fn an_empty_axis_gives_zeros() {
    let tape = Tape::<f64>::new();
    let [x, y] = [[2, 0], [1, 0]].map(|shape| tape.leaf(&Tensor::zeros(shape)));
    let z = x.dot(y).unwrap();
    assert_eq!(z.value(), Tensor::zeros([2]));
    assert_eq!(z.sum().backward().unwrap().get_or_zeros(y), Tensor::zeros([1, 0]));
    let none = tape.leaf(&Tensor::zeros([0, 2]));
    assert_eq!(none.dot(none).unwrap().value(), Tensor::zeros([0]));
}

#[test]
fn a_nan_is_not_masked_by_a_zero() {
    let tape = Tape::new();
    let x = tape.constant(&Tensor::from([0.0, 1.0]));
    let y = tape.constant(&Tensor::from([f64::NAN, 1.0]));
    assert!(x.dot(y).unwrap().item().is_nan());
}
