use bokashi_core::{Tape, Tensor, Var};

#[test]
fn leaves_and_constants_come_as_tensors_as_scalars_and_full() {
    let tape = Tape::new();
    let leaves = [
        tape.leaf(&Tensor::full([], 2.0)),
        tape.leaf_copied(&Tensor::full([], 2.0)),
        tape.leaf_of([], &[2.0]).unwrap(),
        tape.leaf_scalar(2.0),
        tape.leaf_full([], 2.0),
    ];
    let constants = [
        tape.constant(&Tensor::full([], 2.0)),
        tape.constant_of([], &[2.0]).unwrap(),
        tape.constant_scalar(2.0),
        tape.constant_full([], 2.0),
    ];
    let same = |variable: &Var<'_, f64>| variable.value() == Tensor::scalar(2.0);
    assert!(leaves.iter().chain(&constants).all(same));
    assert!(leaves.iter().all(|leaf| leaf.needs_gradient()));
    assert!(!constants.iter().any(|constant| constant.needs_gradient()));
    assert_eq!(*tape.leaf_full([2, 1], 3.0).value().shape(), [2, 1].into());
    for refused in [tape.leaf_of([2, 1], &[1.0; 3]), tape.constant_of([2, 1], &[1.0; 3])] {
        assert_eq!(refused.unwrap_err().to_string(), "shape [2, 1] needs 2 entries, got 3");
    }
}

#[test]
fn a_variable_knows_the_operation_and_an_input_that_it_was_computed_from() {
    let tape = Tape::<f64>::new();
    let [x, y] = [1.0, 2.0].map(|value| tape.leaf(&Tensor::full([2], value)));
    let (product, sum) = (x * y, x + x);
    let name = product.operation().unwrap();
    assert!(product.is_computed_from(name, x) && product.is_computed_from(name, y));
    assert!(
        !product.is_computed_from("sin", x) && !sum.is_computed_from(sum.operation().unwrap(), y)
    );
    assert!(!x.is_computed_from(name, x) && !product.detach().is_computed_from(name, x));
    assert!(!product.square().is_computed_from(name, x));
    let constant = tape.constant(&Tensor::full([2], 3.0));
    assert!(!(constant * constant).is_computed_from(name, constant));
}

#[test]
fn a_detached_variable_is_a_constant_of_the_same_value() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::full([2], 3.0));
    let frozen = x.square().detach();
    assert_eq!(frozen.value(), Tensor::full([2], 9.0));
    assert!(x.needs_gradient() && !frozen.needs_gradient());
    let gradients = (frozen * x).sum().backward().unwrap();
    assert_eq!(gradients.get(x), Some(&Tensor::full([2], 9.0)));
    assert_eq!(gradients.get(frozen), None);
}
