use bokashi_core::{Scalar, Tape, Tensor, Var, gradient_errors, value_errors};

/// A loss and what it is made of, in any precision.
fn pipeline<T: Scalar>(tape: &Tape<T>) -> Var<'_, T> {
    let x = tape.leaf(&Tensor::from_flat_fn([50], |k| T::from_f64(0.1 + k as f64 / 64.0)));
    let c = tape.constant_full([50], T::from_f64(0.3));
    ((x * c).exp().reshape([5, 10]).unwrap().sin() - T::from_f64(0.5)).square().sum()
}

#[test]
fn the_errors_are_those_of_the_tensors_that_a_caller_sees() {
    let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
    let (rough_loss, exact_loss) = (pipeline(&rough), pipeline(&exact));
    let errors = value_errors(&rough, &exact).unwrap();
    assert_eq!(errors.len(), rough.len());
    let pairs = rough.variables().zip(exact.variables());
    for (error, (rough, exact)) in errors.iter().zip(pairs) {
        assert_eq!(error.operation, rough.operation());
        let (rough, exact) = (rough.value().cast::<f64>(), exact.value());
        let largest = |x: &Tensor<f64>| x.data().iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let pairs = rough.data().iter().zip(exact.data());
        let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert_eq!(error.error, Some(difference / largest(&exact)));
    }
    let [of_rough, of_exact] = [rough_loss.item() as f64, exact_loss.item()];
    let last = (of_rough - of_exact).abs() / of_exact;
    assert_eq!(errors.last().unwrap().error, Some(last));
    assert!(0.0 < last && last < 1e-6);
}

#[test]
fn gradients_are_compared_at_every_value_of_a_pass_to_all() {
    let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
    let (rough_loss, exact_loss) = (pipeline(&rough), pipeline(&exact));
    let (all, all_exact): (Vec<_>, Vec<_>) =
        (rough.variables().collect(), exact.variables().collect());
    let gradients = rough_loss.backward_to(&all).unwrap();
    let exact_gradients = exact_loss.backward_to(&all_exact).unwrap();
    let errors = gradient_errors(&gradients, &exact_gradients).unwrap();
    // All but the constants have one.
    let indices: Vec<_> = errors.iter().map(|error| error.index).collect();
    let needed = (0..rough.len()).filter(|&k| all[k].needs_gradient());
    assert_eq!(indices, needed.collect::<Vec<_>>());
    assert_eq!(errors.last().unwrap().error, Some(0.0));
    assert!(errors.iter().all(|error| error.error.is_some_and(|error| error < 1e-5)));
    assert!(errors[0].error > Some(0.0));
    // Another number of gradients is another pass.
    let fewer = exact_loss.backward().unwrap();
    assert!(gradient_errors(&gradients, &fewer).is_err());
    assert!(gradient_errors(&rough_loss.backward().unwrap(), &exact_gradients).is_err());
}

#[test]
fn another_pipeline_is_refused_and_another_shape_is_not_compared() {
    let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
    let [x, y] = [rough.constant_full([2], 1.0), rough.constant_full([3], 1.0)];
    let (x_exact, y_exact) = (exact.constant_full([2], 1.0), exact.constant_full([2], 1.0));
    let errors = value_errors(&rough, &exact).unwrap();
    assert_eq!(errors.iter().map(|of| of.error).collect::<Vec<_>>(), [Some(0.0), None]);
    let _ = (x.exp(), x_exact.sin());
    let message = "a comparison needs two recordings of one pipeline, got exp and sin as value 2";
    assert_eq!(value_errors(&rough, &exact).unwrap_err().to_string(), message);
    let _ = (y, y_exact);
    let message =
        "a comparison needs two recordings of one pipeline, got exp and nothing as value 2";
    let shorter = Tape::<f64>::new();
    let _ = [shorter.leaf_scalar(1.0), shorter.leaf_scalar(1.0)];
    assert_eq!(value_errors(&rough, &shorter).unwrap_err().to_string(), message);
}

#[test]
fn what_only_one_recording_gets_wrong_is_an_infinite_error() {
    let error = |rough: f64, exact: f64| {
        let [one, other] = [Tape::new(), Tape::new()];
        let _ = (one.leaf_scalar(rough), other.leaf_scalar(exact));
        value_errors(&one, &other).unwrap()[0].error.unwrap()
    };
    let (nan, infinite) = (f64::NAN, f64::INFINITY);
    for (rough, exact) in [(nan, 1.0), (1.0, nan), (infinite, 1.0), (1.0, infinite), (1.0, 0.0)] {
        assert_eq!(error(rough, exact), infinite);
    }
    for same in [0.0, 1.0, nan, infinite] {
        assert_eq!(error(same, same), 0.0);
    }
    assert_eq!(error(3.0, 2.0), 0.5);
}
