use bokashi_core::{Tape, Tensor, Var};

fn backward_calls(tape: &Tape<f64>) -> u64 {
    tape.take_report().operations.iter().map(|entry| entry.backward_calls).sum()
}

#[test]
fn several_passes_over_one_recording_give_the_same_bits() {
    let tape = Tape::<f32>::new();
    let [x, y] = [0.3, 0.9].map(|number| tape.leaf(&Tensor::full([5], number)));
    let loss = ((x * y).sin() / (x.exp() + y)).sum();
    let first = loss.backward().unwrap();
    let second = loss.backward().unwrap();
    drop(loss.backward());
    let fourth = loss.backward().unwrap();
    for pass in [&second, &fourth] {
        assert_eq!([pass.get(x), pass.get(y)], [first.get(x), first.get(y)]);
    }
}

#[test]
fn a_variable_used_many_times_collects_all_its_terms() {
    let tape = Tape::new();
    let x = tape.leaf_scalar(3.0);
    let cube_and_more =
        x * x * x + x + Var::concat(&[x.reshape([1]).unwrap(); 4], 0).unwrap().sum();
    assert_eq!(cube_and_more.item(), 27.0 + 3.0 + 12.0);
    assert_eq!(cube_and_more.backward().unwrap().get_or_zeros(x).item(), 27.0 + 1.0 + 4.0);
}

#[test]
fn a_gradient_that_was_taken_is_the_takers_alone() {
    let mut tape = Tape::new();
    for _ in 0..2 {
        let x = tape.leaf_full([3], 2.0);
        let mut gradients = x.square().sum().backward().unwrap();
        let address = gradients.get(x).unwrap().data().as_ptr();
        let taken = Vec::from(gradients.take(x).unwrap());
        assert_eq!((taken.as_ptr(), &taken[..]), (address, &[4.0; 3][..]));
        assert_eq!((gradients.take(x), gradients.get(x)), (None, None));
        drop(gradients);
        tape.reset();
    }
}

#[test]
fn a_pass_to_some_leaves_gives_the_same_bits_and_skips_what_leads_to_none() {
    let tape = Tape::new();
    let [x, y] = [0.3, 0.9].map(|number| tape.leaf(&Tensor::full([5], number)));
    let loss = (x.exp().sin() * y.cos()).sum();
    let all = loss.backward().unwrap();
    assert_eq!(backward_calls(&tape), 5);
    for (leaf, other, calls) in [(x, y, 4), (y, x, 3)] {
        let one = loss.backward_to(&[leaf]).unwrap();
        assert_eq!(one.get(leaf), all.get(leaf));
        assert_eq!(one.get(other), None);
        assert_eq!(backward_calls(&tape), calls);
    }
    assert!(loss.backward_to(&[]).unwrap().get(x).is_none());
    assert_eq!(backward_calls(&tape), 0);
}

#[test]
fn inner_variables_can_be_asked_for() {
    let tape = Tape::new();
    let x = tape.leaf_scalar(2.0);
    let y = x.square();
    let z = y.square();
    let gradients = z.backward_to(&[y, x, y, z]).unwrap();
    let of = |variable| gradients.get(variable).map(Tensor::item);
    assert_eq!([of(x), of(y), of(z)], [Some(32.0), Some(8.0), Some(1.0)]);
    drop(gradients);
    let _ = tape.take_report();
    assert_eq!(z.backward_to(&[y]).unwrap().get_or_zeros(y).item(), 8.0);
    assert_eq!(backward_calls(&tape), 1);
}

#[test]
fn a_leaf_is_its_own_gradient_of_one() {
    let tape = Tape::new();
    let x = tape.leaf_scalar(5.0);
    assert_eq!(x.backward().unwrap().get_or_zeros(x).item(), 1.0);
}

#[test]
fn what_the_loss_does_not_depend_on_has_no_gradient() {
    let tape = Tape::new();
    let [x, unused] = [1.0, 2.0].map(|number| tape.leaf(&Tensor::full([2], number)));
    let constant = tape.constant_full([2], 3.0);
    let _ = unused.exp();
    let gradients = (x * constant).sum().backward().unwrap();
    assert_eq!([gradients.get(unused), gradients.get(constant)], [None, None]);
    assert_eq!(gradients.get_or_zeros(unused), Tensor::zeros([2]));
    let gradients = constant.sum().backward().unwrap();
    assert_eq!(gradients.get(x), None);
    assert_eq!(backward_calls(&tape), 2);
}

#[test]
fn upstream_gradients_add_up_and_scale_exactly() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([3], |k| 0.4 * k as f64));
    let (y, z) = (x.sin(), x.exp());
    let u = Tensor::from_flat_fn([3], |k| 1.0 - 0.3 * k as f64);
    let of = |seeds: &[_]| tape.vjp(seeds).unwrap().get_or_zeros(x);
    let (once, both) = (of(&[(y, &u)]), of(&[(y, &u), (z, &u)]));
    let (twice, z_alone) = (of(&[(y, &u), (y, &u)]), of(&[(z, &u)]));
    for k in 0..3 {
        assert_eq!(twice.data()[k], 2.0 * once.data()[k]);
        let sum = once.data()[k] + z_alone.data()[k];
        assert!((both.data()[k] - sum).abs() < 1e-15);
    }
    assert_eq!(of(&[(y, &u.map(|u| 8.0 * u))]), once.map(|entry| 8.0 * entry));
    assert_eq!(tape.vjp_to(&[(y, &u)], &[x]).unwrap().get(x), Some(&once));
}

#[test]
fn an_upstream_gradient_stays_the_callers() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([3], |k| 0.4 * k as f64));
    let y = x.exp();
    let z = y.square();
    let mut u = Tensor::from_flat_fn([3], |k| 1.0 + k as f64);
    let gradients = tape.vjp_to(&[(y, &u), (z, &u), (x, &u)], &[x, y, z]).unwrap();
    let (of_x, of_y) = (gradients.get(x).unwrap(), gradients.get(y).unwrap());
    for k in 0..3 {
        let (y, u) = (y.value().data()[k], u.data()[k]);
        assert_eq!(of_y.data()[k], u + 2.0 * y * u);
        assert_eq!(of_x.data()[k], u + y * of_y.data()[k]);
    }
    assert_eq!(gradients.get(z), Some(&u));
    drop(gradients);
    // Nor does the tape hold it: writing to a shared buffer would copy it first.
    let place = u.data().as_ptr();
    assert_eq!(u.data_mut().as_ptr(), place);
}

#[test]
fn a_nan_upstream_is_not_masked() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2], |k| k as f64));
    let upstream = Tensor::new([2], vec![f64::NAN, 1.0]).unwrap();
    let gradient = tape.vjp(&[(x.abs() * 0.0, &upstream)]).unwrap().get_or_zeros(x);
    assert!(gradient.data()[0].is_nan() && gradient.data()[1] == 0.0);
}

#[test]
fn a_pass_must_start_at_a_scalar_or_with_fitting_gradients_of_its_own_tape() {
    let (tape, other) = (Tape::new(), Tape::new());
    let x = tape.leaf(&Tensor::full([2], 1.0));
    let message = "a backward pass without an upstream gradient needs a scalar, got shape [2]";
    assert_eq!(x.backward().unwrap_err().to_string(), message);
    let message = "backward needs an upstream gradient of its variable's shape, \
                   got shapes [3] and [2]";
    let error = tape.vjp(&[(x, &Tensor::zeros([3]))]).unwrap_err();
    assert_eq!(error.to_string(), message);

    let foreign = other.leaf_scalar(1.0);
    let refused = [
        x.sum().backward_to(&[foreign]).map(drop),
        tape.vjp(&[(foreign, &Tensor::scalar(1.0))]).map(drop),
    ];
    let message = "backward needs variables of one tape, got one of another";
    assert!(refused.into_iter().all(|result| result.unwrap_err().to_string() == message));
}

#[test]
fn gradients_asked_of_another_tape_are_no_zeros() {
    let (tape, other) = (Tape::new(), Tape::new());
    // Both are the first values of their tapes.
    let (x, foreign) = (tape.leaf_scalar(2.0), other.leaf_scalar(1.0));
    let gradients = x.backward().unwrap();
    assert_eq!(gradients.get_or_zeros(x).item(), 1.0);
    let asked: [&dyn Fn() -> bool; 2] =
        [&|| gradients.get(foreign).is_some(), &|| gradients.get_or_zeros(foreign).item() > 0.0];
    for ask in asked {
        let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(ask)).unwrap_err();
        let message = "gradients need a variable of their own tape, got one of another tape";
        assert_eq!(panic.downcast_ref::<&str>(), Some(&message));
    }
}
