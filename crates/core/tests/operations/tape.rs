use bokashi_core::{Tape, Tensor};

use crate::counted::{Counted, made};

/// A step on many kinds of operations: the loss and the gradient of each leaf.
fn step(tape: &Tape<f32>, x: &Tensor<f32>) -> [Tensor<f32>; 3] {
    let (leaf, copied) = (tape.leaf(x), tape.leaf_copied(x));
    let y = (leaf * copied.exp() + 1.0).reshape([6]).unwrap();
    let loss =
        (y / (y.square() + 2.0)).sum() + leaf.matmul(copied.transpose().unwrap()).unwrap().sum();
    let gradients = loss.backward().unwrap();
    [loss.value(), gradients.get_or_zeros(leaf), gradients.get_or_zeros(copied)]
}

#[test]
fn a_later_step_in_recycled_memory_gives_the_same_bits() {
    let mut tape = Tape::new();
    let x = Tensor::from_flat_fn([2, 3], |k| 0.3 * k as f32 - 0.7);
    let first = step(&tape, &x);
    for k in 0..4 {
        tape.reset();
        // Another pipeline in between, so that memory and nodes are found in other hands.
        if k % 2 == 0 {
            let _ = (tape.constant_full([k + 1], 5.0).exp() + 1.0).sum();
            tape.reset();
        }
        assert_eq!(step(&tape, &x), first);
    }
}

#[test]
fn a_value_that_is_still_held_keeps_its_numbers() {
    let mut tape = Tape::new();
    let x = tape.leaf(&Tensor::full([4], 2.0));
    let y = x.square();
    let (held, gradient) = (y.value(), y.sum().backward().unwrap().get_or_zeros(x));
    for _ in 0..3 {
        tape.reset();
        let x = tape.leaf_copied(&Tensor::full([4], 7.0));
        let _ = x.square().sum().backward().unwrap();
    }
    assert_eq!((held, gradient), (Tensor::full([4], 4.0), Tensor::full([4], 4.0)));
}

#[test]
fn a_copied_leaf_leaves_its_tensor_unshared() {
    let tape = Tape::new();
    let mut parameter = Tensor::full([2], 1.0);
    let address = parameter.data().as_ptr();
    let x = tape.leaf_copied(&parameter);
    parameter.data_mut()[0] = 5.0;
    assert_eq!(parameter.data().as_ptr(), address);
    assert_eq!(x.value().data(), [1.0, 1.0]);
}

#[test]
fn what_is_computed_aside_has_the_memory_of_the_step() {
    let mut tape = Tape::new();
    let x = Tensor::full([1 << 18], 0.5_f32);
    let mut addresses = Vec::new();
    let mut target: Option<Tensor<f32>> = None;
    for _ in 0..4 {
        if let Some(target) = target.take() {
            tape.recycle(target);
        }
        let found = tape.aside(|tape| (tape.constant(&x) * 2.0).exp().value());
        assert_eq!(found, x.map(|x| (2.0 * x).exp()));
        assert!(tape.is_empty());
        let y = (tape.leaf(&x).exp() - tape.constant(&found)).square();
        let gradients = y.sum().backward().unwrap();
        assert_eq!(y.value().data()[0], (0.5_f32.exp() - 1.0_f32.exp()).powi(2));
        drop(gradients);
        addresses.push(found.data().as_ptr());
        target = Some(found);
        tape.reset();
    }
    let known: std::collections::BTreeSet<_> = addresses.iter().collect();
    assert!(known.len() < 4, "no buffer was used again");
    let leaf = tape.leaf(&x);
    tape.aside(|other| assert!(leaf.try_add(other.leaf(&x)).is_err()));
}

#[test]
fn variables_of_another_tape_are_refused() {
    let (tape, other) = (Tape::<f64>::new(), Tape::new());
    let (x, foreign) = (tape.leaf_scalar(1.0), other.leaf_scalar(1.0));
    let message = "add needs variables of one tape, got one of another";
    assert_eq!(x.try_add(foreign).unwrap_err().to_string(), message);
    assert_eq!((tape.len(), other.len()), (1, 1));
}

#[test]
fn what_a_tape_holds_can_be_sent_to_another_thread() {
    let tape = Tape::new();
    let _ = tape.leaf_scalar(3.0).square();
    let squares = std::thread::spawn(move || tape.leaf_scalar(2.0).square().item());
    assert_eq!(squares.join().unwrap(), 4.0);
}

#[test]
fn memory_of_what_was_saved_is_used_again_by_the_same_kind_of_operation() {
    let mut tape = Tape::<f64>::new();
    let before = made();
    for _ in 0..3 {
        let x = tape.leaf_scalar(0.5);
        let y = tape.apply(Counted::<0>, &[x.exp()]).unwrap();
        let _ = tape.apply(Counted::<1>, &[y.sin()]).unwrap() + x;
        tape.reset();
    }
    assert_eq!(made() - before, 2, "one of each kind");
    assert!(tape.is_empty());
    assert_eq!(format!("{tape:?}"), "Tape { values: 0, nodes: [] }");
}
