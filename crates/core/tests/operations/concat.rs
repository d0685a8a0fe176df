use bokashi_core::{Tape, Tensor, Var};

#[test]
fn each_part_gets_its_own_gradient() {
    let tape = Tape::new();
    let [x, y] =
        [[2, 1], [2, 2]].map(|shape| tape.leaf(&Tensor::from_flat_fn(shape, |k| k as f64)));
    let z = Var::concat(&[x, y], 1).unwrap();
    assert_eq!(z.value().data(), [0.0, 0.0, 1.0, 1.0, 2.0, 3.0]);
    let upstream = Tensor::from_flat_fn([2, 3], |k| 10.0 * k as f64);
    let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
    assert_eq!(gradients.get(x).unwrap().data(), [0.0, 30.0]);
    assert_eq!(gradients.get(y).unwrap().data(), [10.0, 20.0, 40.0, 50.0]);
}

#[test]
fn more_than_64_parts_are_joined() {
    let tape = Tape::new();
    let parts: Vec<_> = (0..100).map(|k| tape.leaf(&Tensor::full([1], k as f64))).collect();
    let joined = Var::concat(&parts, 0).unwrap();
    assert_eq!(joined.value(), Tensor::from_flat_fn([100], |k| k as f64));
    assert_eq!(joined.sum().backward().unwrap().get_or_zeros(parts[99]).item(), 1.0);
}
