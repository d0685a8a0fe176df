use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var, mean_squared_error, squared_error};

type Loss<T> = for<'t> fn(Var<'t, T>, Var<'t, T>) -> Result<Var<'t, T>, TensorError>;

fn losses<T: Scalar>() -> [(Loss<T>, f64); 2] {
    [(squared_error, 1.0), (mean_squared_error, 0.25)]
}

#[test]
fn loss_and_gradients_are_exactly_zero_where_reference_equals_image() {
    for (loss, _) in losses::<f32>() {
        let image = Tensor::from_flat_fn([3, 5, 2], |k| (k as f32).sqrt());
        let tape = Tape::new();
        let (x, r) = (tape.leaf(&image), tape.leaf(&image));
        let loss = loss(x, r).unwrap();
        assert_eq!(loss.item(), 0.0);
        let gradients = loss.backward().unwrap();
        assert!(gradients.get(x).unwrap().data().iter().all(|&entry| entry == 0.0));
        assert!(gradients.get(r).unwrap().data().iter().all(|&entry| entry == 0.0));
    }
}

#[test]
fn value_and_gradients_are_those_worked_out_by_hand() {
    for (loss, scale) in losses::<f64>() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::new([2, 2], vec![1.0, 2.0, 3.0, 4.0]).unwrap());
        let r = tape.leaf(&Tensor::new([2, 2], vec![1.5, 2.0, 1.0, 5.0]).unwrap());
        let loss = loss(x, r).unwrap();
        assert_eq!(loss.item(), scale * (0.25 + 4.0 + 1.0));
        // Through a factor of 3, so that the upstream gradient counts.
        let gradients = (loss * 3.0).backward().unwrap();
        let expected = [-0.5, 0.0, 2.0, -1.0].map(|difference| 6.0 * scale * difference);
        assert_eq!(gradients.get(x).unwrap().data(), expected);
        assert_eq!(gradients.get(r).unwrap().data(), expected.map(|entry| -entry));
    }
}

#[test]
fn a_loss_of_an_image_with_itself_as_reference_has_no_gradient() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::full([4], 2.0));
    let gradients = squared_error(x, x).unwrap().backward().unwrap();
    assert_eq!(gradients.get(x).unwrap().data(), [0.0; 4]);
}

#[test]
fn long_sums_keep_their_digits_in_f32() {
    let n = 1_000_000;
    let tape = Tape::<f32>::new();
    let image = tape.constant_full([n], 0.1);
    let reference = tape.constant_full([n], 0.0);
    let exact = n as f64 * f64::from(0.1_f32) * f64::from(0.1_f32);
    assert_eq!(squared_error(image, reference).unwrap().item(), exact as f32);
}

#[test]
fn only_the_inputs_that_need_a_gradient_get_one() {
    let tape = Tape::<f64>::new();
    let leaf = tape.leaf(&Tensor::full([4], 2.0));
    let constant = tape.constant(&Tensor::full([4], 1.0));
    for loss in [squared_error(leaf, constant), squared_error(constant, leaf)] {
        let gradients = loss.unwrap().backward().unwrap();
        assert_eq!(gradients.get(leaf).unwrap().data(), [2.0; 4]);
        assert!(gradients.get(constant).is_none());
    }
}
