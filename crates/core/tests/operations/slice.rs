use bokashi_core::{Tape, Tensor, Var};

#[test]
fn slices_along_every_axis_by_hand() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([3, 2], |k| k as f64));
    let rows = x.slice(0, 1..3).unwrap();
    assert_eq!(rows.value(), Tensor::new([2, 2], vec![2.0, 3.0, 4.0, 5.0]).unwrap());
    let column = x.slice(1, 1..2).unwrap();
    assert_eq!(column.value(), Tensor::new([3, 1], vec![1.0, 3.0, 5.0]).unwrap());
    let gradients = column.sum().backward().unwrap();
    assert_eq!(gradients.get(x).unwrap().data(), [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
}

#[test]
fn slices_joined_again_are_the_array() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2, 5, 2], |k| k as f64));
    for axis in 0..3 {
        let end = x.shape()[axis];
        let (head, tail) = (x.slice(axis, 0..1).unwrap(), x.slice(axis, 1..end).unwrap());
        let joined = Var::concat(&[head, tail], axis).unwrap();
        assert_eq!(joined.value(), x.value());
        let gradients = tape.vjp(&[(joined, &x.value())]).unwrap();
        assert_eq!(gradients.get(x), Some(&x.value()));
    }
}
