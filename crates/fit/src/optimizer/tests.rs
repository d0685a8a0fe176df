use bokashi_core::{Tape, Tensor};

use super::*;
use crate::parameter::Mapping;

const ALL: [Optimizer; 3] = [
    Optimizer::GradientDescent,
    Optimizer::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 },
    Optimizer::ams_grad(),
];

fn parameters(start: [f64; 2]) -> Parameters<f64> {
    let one = |name, value| Parameter::new(name, Tensor::scalar(value)).rate(0.1);
    Parameters::new().with(one("x", start[0])).unwrap().with(one("y", start[1])).unwrap()
}

/// One update along the gradient `g` of `<g, (x, y)>`.
fn update(optimizer: Optimizer, list: &mut Parameters<f64>, g: [f64; 2]) -> Result<(), FitError> {
    let tape = Tape::new();
    let variables = list.record(&tape);
    let loss = variables[0] * g[0] + variables[1] * g[1];
    let gradients = loss.backward()?;
    optimizer.update(list, &variables, &gradients, 1.0)
}

fn values(list: &Parameters<f64>) -> [f64; 2] {
    ["x", "y"].map(|name| list.get(name).unwrap().item())
}

#[test]
fn descent_goes_the_rate_times_the_gradient() {
    let mut list = parameters([1.0, 2.0]);
    update(Optimizer::GradientDescent, &mut list, [4.0, -2.0]).unwrap();
    assert_eq!(values(&list), [1.0 - 0.1 * 4.0, 2.0 + 0.1 * 2.0]);
}

#[test]
fn the_first_step_of_adam_is_the_rate_whatever_the_gradient() {
    for scale in [1e-3, 1.0, 1e6] {
        let mut list = parameters([1.0, 2.0]);
        update(Optimizer::default(), &mut list, [scale, -3.0 * scale]).unwrap();
        let [x, y] = values(&list);
        // Off by epsilon / gradient.
        assert!((x - 0.9).abs() < 1e-6 && (y - 2.1).abs() < 1e-6, "{x} {y}");
    }
}

#[test]
fn the_first_step_of_a_thawed_parameter_is_its_rate() {
    let mut list = parameters([1.0, 2.0]);
    list.set_rate("y", 0.0).unwrap();
    for _ in 0..2000 {
        update(Optimizer::default(), &mut list, [1.0, 1.0]).unwrap();
    }
    list.set_rate("y", 0.1).unwrap();
    update(Optimizer::default(), &mut list, [1.0, 1.0]).unwrap();
    assert!((values(&list)[1] - 1.9).abs() < 1e-6, "{}", values(&list)[1]);
}

#[test]
fn constants_that_the_numbers_of_a_fit_cannot_hold_change_nothing() {
    let refused = |optimizer: Optimizer, rate: f64| {
        let x = Parameter::new("x", Tensor::scalar(1.0_f32)).rate(rate);
        let mut list = Parameters::new().with(x).unwrap();
        let tape = Tape::new();
        let variables = list.record(&tape);
        // A gradient of 0, which a denominator of 0 would make NaN.
        let gradients = (variables[0] * 0.0).backward().unwrap();
        let error = optimizer.update(&mut list, &variables, &gradients, 1.0).unwrap_err();
        assert_eq!(list.get("x").unwrap().item(), 1.0);
        error.to_string()
    };
    let tiny = Optimizer::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-50 };
    assert!(refused(tiny, 0.1).starts_with("Adam's epsilon needs a number above 0 in"));
    let rate = refused(Optimizer::GradientDescent, 1e300);
    assert!(rate.starts_with("learning rate needs a finite number in"), "{rate}");
}

#[test]
fn adam_follows_its_recurrence() {
    let mut list = parameters([1.0, 2.0]);
    let (mut x, mut m, mut v) = (1.0, 0.0, 0.0);
    for t in 1..=50 {
        let g = (t as f64).sin();
        update(Optimizer::default(), &mut list, [g, 0.0]).unwrap();
        m = 0.9 * m + 0.1 * g;
        v = 0.999 * v + 0.001 * g * g;
        let unbiased = (m / (1.0 - 0.9_f64.powi(t)), v / (1.0 - 0.999_f64.powi(t)));
        x -= 0.1 * unbiased.0 / (unbiased.1.sqrt() + 1e-8);
    }
    assert!((values(&list)[0] - x).abs() < 1e-12);
    assert_eq!(values(&list)[1], 2.0);
}

#[test]
fn a_gradient_that_is_not_finite_changes_nothing_and_is_named() {
    for optimizer in ALL {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut list = parameters([1.0, 2.0]);
            update(optimizer, &mut list, [0.5, 0.5]).unwrap();
            let before = list.clone();
            // The first parameter's gradient is fine: it must not have moved either.
            let error = update(optimizer, &mut list, [0.5, bad]).unwrap_err();
            let quantity = Quantity::Gradient("y".into());
            assert!(matches!(
                error,
                FitError::NotFinite { quantity: found, step: 1, .. } if found == quantity
            ));
            assert_eq!(list.updates, before.updates);
            for (after, before) in list.iter().zip(before.iter()) {
                assert_eq!(after.raw, before.raw);
                assert_eq!(after.first, before.first);
                assert_eq!(after.second, before.second);
                assert_eq!(after.greatest, before.greatest);
            }
        }
    }
}

#[test]
fn a_gradient_whose_square_overflows_is_refused_by_adam_alone() {
    let mut list = parameters([1.0, 2.0]);
    assert!(update(Optimizer::GradientDescent, &mut list, [1e200, 0.0]).is_ok());
    let error = update(Optimizer::default(), &mut list, [1e200, 0.0]).unwrap_err();
    let message = "the squared gradient of \"x\" needs to be finite, got inf at step 1";
    assert_eq!(error.to_string(), message);
}

#[test]
fn frozen_parameters_stay() {
    for optimizer in ALL {
        let mut list = parameters([1.0, 2.0]);
        list.set_rate("x", 0.0).unwrap();
        update(optimizer, &mut list, [1.0, 1.0]).unwrap();
        let [x, y] = values(&list);
        assert_eq!(x, 1.0);
        assert!(y < 2.0);
    }
}

#[test]
fn a_parameter_that_the_loss_ignores_coasts_on_its_moments() {
    let mut list = parameters([1.0, 2.0]);
    let optimizer = Optimizer::default();
    update(optimizer, &mut list, [1.0, 1.0]).unwrap();
    let mut zeros = list.clone();
    update(optimizer, &mut zeros, [0.0, 1.0]).unwrap();

    let tape = Tape::new();
    let variables = list.record(&tape);
    let gradients = variables[1].backward().unwrap();
    assert!(gradients.get(variables[0]).is_none());
    optimizer.update(&mut list, &variables, &gradients, 1.0).unwrap();
    assert_eq!(values(&list), values(&zeros));
}

#[test]
fn constants_outside_their_range_are_refused() {
    let adam = |beta1, beta2, epsilon| Optimizer::Adam { beta1, beta2, epsilon }.check();
    assert!(adam(0.0, 0.0, 1e-8).is_ok());
    let message = |result: Result<(), FitError>| result.unwrap_err().to_string();
    let rule = "needs a number from 0 to below 1, got 1";
    assert_eq!(message(adam(1.0, 0.9, 1e-8)), format!("Adam's beta1 {rule}"));
    assert_eq!(message(adam(0.9, 1.0, 1e-8)), format!("Adam's beta2 {rule}"));
    let epsilon = "Adam's epsilon needs a finite number above 0, got 0";
    assert_eq!(message(adam(0.9, 0.9, 0.0)), epsilon);
    let ams_grad = Optimizer::AmsGrad { beta1: 0.9, beta2: -0.1, epsilon: 1e-8 }.check();
    let rule = "AMSGrad's beta2 needs a number from 0 to below 1, got -0.1";
    assert_eq!(message(ams_grad), rule);
}

/// One parameter "x", in numbers of type `T`.
fn single<T: Scalar>(value: T, rate: f64, mapping: Mapping) -> Parameters<T> {
    let x = Parameter::new("x", Tensor::scalar(value)).rate(rate).mapping(mapping);
    Parameters::new().with(x).unwrap()
}

/// One update of the only parameter along `g`.
fn update_single<T: Scalar>(
    optimizer: Optimizer,
    list: &mut Parameters<T>,
    g: T,
) -> Result<(), FitError> {
    let tape = Tape::new();
    let variables = list.record(&tape);
    let upstream = Tensor::scalar(g);
    let raw = variables.raw("x")?;
    // The sum gives the tape a node: a leaf alone has none.
    let gradients = tape.vjp(&[(raw.sum(), &upstream)])?;
    optimizer.update(list, &variables, &gradients, 1.0)
}

#[test]
fn ams_grad_follows_its_recurrence() {
    let mut list = parameters([1.0, 2.0]);
    let (mut x, mut m, mut v, mut u) = (1.0, 0.0, 0.0, 0.0_f64);
    for t in 1..=200 {
        // Gradients that shrink: the maximum is not the newest average.
        let g = (t as f64).sin() / t as f64;
        update(Optimizer::ams_grad(), &mut list, [g, 0.0]).unwrap();
        m = 0.9 * m + 0.1 * g;
        v = 0.999 * v + 0.001 * g * g;
        u = u.max(v / (1.0 - 0.999_f64.powi(t)));
        x -= 0.1 * m / (1.0 - 0.9_f64.powi(t)) / (u.sqrt() + 1e-8);
    }
    assert!((values(&list)[0] - x).abs() < 1e-12);
    assert_eq!(values(&list)[1], 2.0);
}

#[test]
fn the_denominators_of_ams_grad_never_fall_and_those_of_adam_do() {
    // A large gradient, then small ones until the average gradient has forgotten it: a step is then
    // as long as its denominator is short.
    let late_steps = |optimizer: Optimizer| {
        let mut list = single(0.0_f64, 1.0, Mapping::Identity);
        update_single(optimizer, &mut list, 1e3).unwrap();
        let mut positions = Vec::new();
        for _ in 0..5_000 {
            update_single(optimizer, &mut list, 1.0).unwrap();
            positions.push(list.list[0].raw.item());
        }
        let step = |k: usize| positions[k - 1] - positions[k];
        [step(2_000), step(4_999)]
    };
    let [before, after] = late_steps(Optimizer::default());
    assert!(after > 2.0 * before, "Adam: {before:e} {after:e}");
    let [before, after] = late_steps(Optimizer::ams_grad());
    // 1e-3: the first corrected average square is that of the large gradient alone.
    assert!((before - 1e-3).abs() < 1e-9 && (after - 1e-3).abs() < 1e-9, "{before:e} {after:e}");
}

#[test]
fn the_first_step_of_ams_grad_is_the_rate_whatever_the_gradient() {
    for scale in [1e-3, 1.0, 1e6] {
        let mut list = single(1.0, 0.1, Mapping::Identity);
        update_single(Optimizer::ams_grad(), &mut list, scale).unwrap();
        let x = list.list[0].raw.item();
        assert!((x - 0.9).abs() < 1e-6, "{x}");
    }
}

#[test]
fn bias_correction_is_right_beyond_ten_million_updates() {
    fn check<T: Scalar>(rounding: f64) {
        // The usual constants, whose powers are gone by then, and such whose powers are not.
        for [beta1, beta2] in [[0.9, 0.999], [1.0 - 1e-7, 1.0 - 1e-9], [0.5, 1.0 - 1e-15]] {
            for t in [10_000_000, (1 << 24) + 1, 1 << 32, 1 << 53, (1 << 53) + 1, 1 << 63] {
                let optimizer = Optimizer::Adam { beta1, beta2, epsilon: 1e-30 };
                let mut list = single(T::ZERO, 1.0, Mapping::Identity);
                let (m, v) = (T::from_f64(0.25), T::from_f64(0.0625));
                list.list[0].first = vec![m];
                list.list[0].second = vec![v];
                list.list[0].updates = t - 1;
                update_single(optimizer, &mut list, T::from_f64(0.5)).unwrap();
                assert_eq!(list.list[0].updates, t);
                let [m, v] = [&list.list[0].first, &list.list[0].second].map(|all| all[0].to_f64());
                let unbiased = |moment: f64, beta: f64| moment / -(t as f64 * beta.ln()).exp_m1();
                let expected = -unbiased(m, beta1) / unbiased(v, beta2).sqrt();
                let found = list.list[0].raw.item().to_f64();
                let error = (found / expected - 1.0).abs();
                // What rounding to one unit leaves of 1 - beta^t, which may be small.
                let lost = |beta: f64| f64::EPSILON / -(t as f64 * beta.ln()).exp_m1();
                let tolerance = rounding + lost(beta1) + lost(beta2);
                assert!(error < tolerance, "{beta1} {beta2} {t}: {found} {expected} {error:e}");
            }
        }
    }
    check::<f64>(1e-14);
    check::<f32>(3e-7);
}

#[test]
fn an_update_that_leaves_the_range_changes_nothing_and_is_named() {
    fn refused<T: Scalar>(optimizer: Optimizer, start: T, rate: f64, mapping: Mapping, g: T) {
        // The first parameter's update is fine: it must not be made either.
        let x = Parameter::new("fine", Tensor::scalar(T::ONE)).rate(rate);
        let y = Parameter::new("y", Tensor::scalar(T::ONE)).rate(rate).mapping(mapping);
        let mut list = Parameters::new().with(x).and_then(|list| list.with(y)).unwrap();
        list.list[1].raw = Tensor::scalar(start);
        list.list.iter_mut().for_each(|parameter| {
            let moments = [&mut parameter.first, &mut parameter.second, &mut parameter.greatest];
            moments.into_iter().for_each(|moment| *moment = vec![T::ZERO]);
        });
        let before = list.clone();
        let tape = Tape::new();
        let variables = list.record(&tape);
        let loss = variables.raw("fine").unwrap() + variables.raw("y").unwrap() * g;
        let gradients = loss.backward().unwrap();
        let error = optimizer.update(&mut list, &variables, &gradients, 1.0).unwrap_err();
        let quantity = Quantity::Update("y".into());
        assert!(
            matches!(&error, FitError::NotFinite { quantity: found, .. } if *found == quantity),
            "{optimizer:?}: {error}"
        );
        assert_eq!(list.updates, before.updates);
        for (after, before) in list.iter().zip(before.iter()) {
            assert_eq!((&after.raw, after.updates), (&before.raw, before.updates));
            assert_eq!((&after.first, &after.second), (&before.first, &before.second));
            assert_eq!(after.greatest, before.greatest);
        }
    }
    for optimizer in ALL {
        refused(optimizer, -3.4e38_f32, 3e37, Mapping::Identity, 1.0);
        refused(optimizer, -1.79e308_f64, 1e307, Mapping::Identity, 1.0);
        // e^709 is finite and e^710 is not.
        refused(optimizer, 709.0_f64, 1.0, Mapping::Exp, -1.0);
        refused(optimizer, 88.0_f32, 1.0, Mapping::Exp, -1.0);
    }
    let quantity = Quantity::Update("x".into());
    let error = FitError::NotFinite { quantity, value: f64::INFINITY, step: 3, origin: None };
    assert_eq!(error.to_string(), "the update of \"x\" needs to be finite, got inf at step 3");
}

#[test]
fn updates_below_half_an_ulp_are_counted_where_they_were_not_zero() {
    let counted = |optimizer: Optimizer, rate: f64, g: f32| {
        let mut list = single(1.0_f32, rate, Mapping::Identity);
        update_single(optimizer, &mut list, g).unwrap();
        let x = &list.list[0];
        (x.vanished(), x.raw.item())
    };
    for optimizer in ALL {
        // Below 1 the spacing is 2^-24: half of it is 3e-8.
        assert_eq!(counted(optimizer, 2e-8, 1.0), (1, 1.0), "{optimizer:?}");
        assert_eq!(counted(optimizer, 2e-8, 0.0), (0, 1.0), "{optimizer:?}");
        let (vanished, x) = counted(optimizer, 4e-8, 1.0);
        assert!(vanished == 0 && x < 1.0, "{optimizer:?}");
    }
    // Not even a number any more, but it was not zero.
    assert_eq!(counted(Optimizer::GradientDescent, 1e-20, 1e-30), (1, 1.0));

    let mut list = single(1.0_f32, 1e-9, Mapping::Identity);
    update_single(Optimizer::GradientDescent, &mut list, 1.0).unwrap();
    assert_eq!(list.list[0].vanished(), 1);
    // The count is that of the last update, and a schedule at 0 moves nothing.
    let tape = Tape::new();
    let variables = list.record(&tape);
    let gradients = variables[0].sum().backward().unwrap();
    Optimizer::GradientDescent.update(&mut list, &variables, &gradients, 0.0).unwrap();
    assert_eq!(list.list[0].vanished(), 0);
    // Nor does a frozen parameter.
    update_single(Optimizer::GradientDescent, &mut list, 1.0).unwrap();
    assert_eq!(list.list[0].vanished(), 1);
    list.set_rate("x", 0.0).unwrap();
    let tape = Tape::new();
    let variables = list.record(&tape);
    let gradients = tape.leaf(&Tensor::scalar(1.0)).sum().backward().unwrap();
    Optimizer::GradientDescent.update(&mut list, &variables, &gradients, 1.0).unwrap();
    assert_eq!(list.list[0].vanished(), 0);
}

/// What one gradient of 1e10 among ones of 1 does to `f32` numbers, as documented at
/// [`Optimizer::Adam`].
#[test]
fn a_spike_freezes_adam_until_it_is_forgotten_and_ams_grad_for_good_and_both_show_it() {
    let run = |optimizer: Optimizer| {
        let mut list = single(1.0_f32, 1e-3, Mapping::Identity);
        let step = |list: &mut Parameters<f32>, g: f32| {
            update_single(optimizer, list, g).unwrap();
            (list.list[0].raw.item(), list.list[0].vanished())
        };
        for _ in 0..100 {
            step(&mut list, 1.0);
        }
        // The spike itself moves the entry on by some rates and no further.
        let before = list.list[0].raw.item();
        let (at_spike, _) = step(&mut list, 1e10);
        assert!((before - at_spike).abs() < 0.02, "{before} {at_spike}");
        for _ in 0..300 {
            step(&mut list, 1.0);
        }
        let frozen_at = list.list[0].raw.item();
        assert!((before - frozen_at).abs() < 0.1, "{before} {frozen_at}");
        for _ in 300..5_000 {
            assert_eq!(step(&mut list, 1.0), (frozen_at, 1));
        }
        for _ in 5_000..45_000 {
            step(&mut list, 1.0);
        }
        let (x, vanished) = step(&mut list, 1.0);
        (x != frozen_at, vanished, list)
    };
    let (moves_again, vanished, _) = run(Optimizer::default());
    assert!(moves_again && vanished == 0);
    let (moves_again, vanished, mut list) = run(Optimizer::ams_grad());
    assert!(!moves_again && vanished == 1);

    // The way on that the documents name: the next step is the rate again.
    let stuck_at = list.list[0].raw.item();
    list.forget_moments();
    update_single(Optimizer::ams_grad(), &mut list, 1.0).unwrap();
    assert!((stuck_at - list.list[0].raw.item() - 1e-3).abs() < 1e-6);
}

#[test]
fn a_uniform_parameter_steps_along_its_average_gradient() {
    let gradient = [3.0, -1.0, 0.0, 0.5];
    let run = |optimizer: Optimizer, steps: usize, is_uniform: bool| {
        let x = Parameter::new("x", Tensor::zeros([4])).rate(0.1);
        let x = if is_uniform { x.uniform() } else { x };
        let mut list = Parameters::new().with(x).unwrap();
        for step in 0..steps {
            let tape = Tape::<f64>::new();
            let variables = list.record(&tape);
            let factor = 1.0 + step as f64;
            let upstream = tape.constant(&Tensor::from(gradient.map(|g| factor * g)));
            let gradients = (variables[0] * upstream).sum().backward().unwrap();
            optimizer.update(&mut list, &variables, &gradients, 1.0).unwrap();
        }
        list.value("x").unwrap().data().to_vec()
    };
    for optimizer in [Optimizer::default(), Optimizer::ams_grad()] {
        for steps in [1, 2, 7] {
            let moved = run(optimizer, steps, true);
            // The largest entry moves as it would without the others, and all in one direction.
            let alone = run(optimizer, steps, false)[0];
            approx::assert_relative_eq!(moved[0], alone, max_relative = 1e-14);
            for (moved, g) in moved.iter().zip(gradient) {
                approx::assert_relative_eq!(*moved, alone * g / 3.0, max_relative = 1e-7);
            }
        }
        assert!((run(optimizer, 1, true)[0] + 0.1).abs() < 1e-8);
    }
}
