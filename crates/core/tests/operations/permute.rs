use bokashi_core::{Shape, Tape, Tensor};

#[test]
fn the_transpose_swaps_rows_and_columns() {
    let tape = Tape::new();
    let x = tape.constant(&Tensor::from_flat_fn([2, 3], |k| k as f64));
    let y = x.transpose().unwrap().value();
    assert_eq!(y, Tensor::new([3, 2], vec![0.0, 3.0, 1.0, 4.0, 2.0, 5.0]).unwrap());
}

#[test]
fn the_inverse_order_undoes_a_permutation() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2, 3, 4], |k| k as f64));
    let y = x.permute(&[2, 0, 1]).unwrap();
    assert_eq!(y.shape(), Shape::from([4, 2, 3]));
    let back = y.permute(&[1, 2, 0]).unwrap();
    assert_eq!(back.value(), x.value());
    let gradients = tape.vjp(&[(back, &x.value())]).unwrap();
    assert_eq!(gradients.get(x), Some(&x.value()));
}
