use bokashi_core::{Mask, Tape, Tensor};

#[test]
fn each_side_gets_the_gradient_of_what_was_taken_of_it() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([1.0, 2.0, 3.0]));
    let y = tape.leaf(&Tensor::from([[10.0], [20.0]]));
    let mask = Mask::new([2, 3], [true, false, true, false, false, true]).unwrap();
    let z = mask.select(x, y).unwrap();
    assert_eq!(z.value(), Tensor::from([[1.0, 10.0, 3.0], [20.0, 20.0, 3.0]]));
    let upstream = Tensor::from_flat_fn([2, 3], |k| 1.0 + k as f64);
    let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
    assert_eq!(gradients.get(x), Some(&Tensor::from([1.0, 0.0, 9.0])));
    assert_eq!(gradients.get(y), Some(&Tensor::from([[2.0], [9.0]])));
}

#[test]
fn swapped_sides_of_the_opposite_mask_are_the_same() {
    let shapes: [&[usize]; 7] = [&[4, 2, 3], &[2, 3], &[4, 1, 3], &[3], &[2, 1], &[], &[4, 2, 1]];
    for (k, &left) in shapes.iter().enumerate() {
        for (&right, &mask_shape) in shapes.iter().flat_map(|r| shapes.iter().map(move |m| (r, m)))
        {
            let tape = Tape::new();
            let x = tape.leaf(&Tensor::from_flat_fn(left, |k| k as f64));
            let y = tape.leaf(&Tensor::from_flat_fn(right, |k| 0.5 - k as f64));
            let mask = Mask::from_flat_fn(mask_shape, |at| (at + k) % 3 > 0);
            let z = mask.select(x, y).unwrap();
            let numbers = mask.data().iter().map(|&truth| f64::from(truth)).collect();
            let numbers = tape.constant(&Tensor::new(mask_shape, numbers).unwrap());
            let mixed = numbers * x + (1.0 - numbers) * y;
            let upstream = Tensor::from_flat_fn(mixed.shape(), |k| 1.0 + k as f64);
            let of = |z| {
                let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
                (z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y))
            };
            let expected = of(mixed);
            assert_eq!(of(z), expected, "{left:?} {right:?} {mask_shape:?}");
            assert_eq!(of((!mask).select(y, x).unwrap()), expected);
        }
    }
}

#[test]
fn neither_value_nor_gradient_of_one_side_reaches_the_other() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let tape = Tape::new();
        let (x, y) = (tape.leaf(&Tensor::from([1.0, bad])), tape.leaf(&Tensor::from([bad, 2.0])));
        let z = Mask::from([true, false]).select(x, y).unwrap();
        assert_eq!(z.value(), Tensor::from([1.0, 2.0]));
        let gradients = tape.vjp(&[(z, &Tensor::from([bad, 3.0]))]).unwrap();
        assert_eq!(gradients.get(y), Some(&Tensor::from([0.0, 3.0])));
        let gradients = tape.vjp(&[(z, &Tensor::from([3.0, bad]))]).unwrap();
        assert_eq!(gradients.get(x), Some(&Tensor::from([3.0, 0.0])));
    }
}

#[test]
fn a_side_that_is_taken_whole_is_passed_on() {
    let tape = Tape::new();
    let [x, y] = [1.0, 2.0].map(|number| tape.leaf_full([2], number));
    let yes = Mask::full([2], true);
    assert_eq!(yes.select(x, y).unwrap().value(), x.value());
    assert_eq!((!yes).select(x, y).unwrap().value(), y.value());
    assert_eq!(tape.len(), 2);
    let one = tape.leaf_scalar(3.0);
    assert_eq!(Mask::full([2], true).select(one, y).unwrap().value(), Tensor::full([2], 3.0));
}

#[test]
fn the_mask_is_let_go_with_the_step_and_shapes_must_broadcast() {
    let mut tape = Tape::<f64>::new();
    let mut step = || {
        let x = tape.leaf(&Tensor::from([1.0, 2.0]));
        let mask = x.is_less(tape.constant_scalar(1.5)).unwrap();
        let _ = mask.select(x, tape.constant_scalar(0.0)).unwrap();
        let address = mask.data().as_ptr();
        drop(mask);
        tape.reset();
        address
    };
    // A comparison writes where it wrote in the last step, unless somebody holds that.
    let first = step();
    assert_eq!([step(), step()], [first; 2]);
    let (mask, x) = (Mask::from([true, false]), tape.leaf_full([2], 1.0));
    let three = tape.constant_full([3], 0.0);
    let message = "select needs shapes that broadcast, got [2] and [3]";
    assert_eq!(mask.select(three, x).unwrap_err().to_string(), message);
    assert_eq!(mask.select(x, three).unwrap_err().to_string(), message);
}
