use std::sync::Arc;

use bokashi_core::{Mask, Padding, Shape, SparseMatrix, Tape, Tensor};

/// `x y` and both gradients, where everything is summed with the upstream gradient 1, 2, ...
fn product(x: &[usize], y: &[usize]) -> [Tensor<f64>; 3] {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn(x, |k| 1.0 + k as f64));
    let y = tape.leaf(&Tensor::from_flat_fn(y, |k| 10.0 * (1.0 + k as f64)));
    let z = x.try_mul(y).unwrap();
    let upstream = Tensor::from_flat_fn(z.shape(), |k| 1.0 + k as f64);
    let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
    [z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y)]
}

#[test]
fn a_repeated_entry_collects_the_terms_of_all_its_copies() {
    let [z, x_bar, y_bar] = product(&[2, 1], &[3]);
    assert_eq!(z.data(), [10.0, 20.0, 30.0, 20.0, 40.0, 60.0]);
    assert_eq!(x_bar.data(), [10.0 + 40.0 + 90.0, 40.0 + 100.0 + 180.0]);
    assert_eq!(y_bar.data(), [1.0 + 8.0, 2.0 + 10.0, 3.0 + 12.0]);
    assert_eq!(x_bar.shape(), &Shape::from([2, 1]));
}

#[test]
fn both_sides_mirror_each_other() {
    let shapes: [&[usize]; 6] = [&[], &[1], &[3], &[2, 1], &[4, 1, 3], &[1, 2, 1]];
    for (left, right) in shapes.iter().flat_map(|&l| shapes.iter().map(move |&r| (l, r))) {
        let tape = Tape::new();
        let x = Tensor::from_flat_fn(left, |k| 0.3 + k as f64);
        let y = Tensor::from_flat_fn(right, |k| 0.7 - k as f64);
        let [a, b] = [tape.leaf(&x), tape.leaf(&y)];
        let (ab, ba) = ((a * b).sum(), (b * a).sum());
        let (one, other) = (ab.backward().unwrap(), ba.backward().unwrap());
        assert_eq!(ab.value(), ba.value());
        assert_eq!(one.get(a), other.get(a), "{left:?} {right:?}");
        assert_eq!(one.get(b), other.get(b), "{left:?} {right:?}");
    }
}

#[test]
fn long_sums_of_copies_keep_their_digits_in_f32() {
    // In f32, 1 + 2^-24 is 1: summed so, the small terms would all be lost.
    let (rows, columns) = (1 << 16, 2);
    let tape = Tape::<f32>::new();
    let x = tape.leaf(&Tensor::zeros([columns]));
    let small = 2.0_f32.powi(-24);
    let terms = Tensor::from_flat_fn([rows, columns], |k| if k < columns { 1.0 } else { small });
    let z = x + tape.constant(&Tensor::zeros([rows, columns]));
    let gradients = tape.vjp(&[(z, &terms)]).unwrap();
    let expected = (1.0 + (rows - 1) as f64 * f64::from(small)) as f32;
    assert_eq!(gradients.get(x).unwrap().data(), [expected, expected]);
}

#[test]
fn one_entry_and_none_broadcast_to_none() {
    let [z, x_bar, y_bar] = product(&[1], &[0]);
    assert_eq!((z.size(), y_bar.size()), (0, 0));
    assert_eq!(x_bar.data(), [0.0]);
}

#[test]
fn what_no_memory_holds_is_refused_and_the_tape_goes_on() {
    let tape = Tape::<f32>::new();
    let (column, row) = (tape.leaf_full([1 << 20, 1], 2.0), tape.leaf_full([1 << 20], 3.0));
    let count = tape.len();
    let error = column.try_mul(row).unwrap_err();
    let message = "mul needs memory for its output, got shape [1048576, 1048576]";
    assert_eq!(error.to_string(), message);
    // Others whose outputs outgrow their inputs.
    let wide = row.reshape([1, 1 << 20]).unwrap();
    let hollow = tape.leaf(&Tensor::zeros([0, 1 << 20, 1 << 20]));
    let rows: Arc<[u32]> = Arc::from(vec![0; 1 << 20]);
    let (mask, flat) = (Mask::full([1 << 20, 1], true), Mask::full([1 << 20], true));
    let stacked = |axes: &[usize]| wide.reshape(axes).unwrap();
    let results = [
        column.is_less(row).map(|_| row),
        mask.select(row, row),
        column.matmul(wide),
        wide.gather_rows(&rows),
        wide.scatter_add_rows(&Arc::from([7]), 1 << 20),
        SparseMatrix::new(1 << 20, 1, []).unwrap().product(wide),
        row.pad(0, [1 << 40, 0], Padding::Wrap),
        stacked(&[1 << 20, 1, 1]).dot(stacked(&[1, 1 << 20, 1])),
        hollow.sum_axis(0),
        hollow.permute(&[1, 2, 0]).unwrap().norm(),
    ];
    for result in results {
        let message = result.unwrap_err().to_string();
        assert!(message.contains(" needs memory for its output, got shape ["), "{message}");
    }
    let message = "and needs memory for its output, got shape [1048576, 1048576]";
    assert_eq!(mask.and(&flat).unwrap_err().to_string(), message);
    // Since then there are a leaf, a permutation of it, and three reshapes of another.
    assert_eq!(tape.len(), count + 5);
    assert_eq!((row + row).sum().item(), 6.0 * (1 << 20) as f32);
}
