//! Laws of the fit loop.

use std::ops::ControlFlow;

use bokashi_core::{Scalar, Tape, Tensor, Var, squared_error};

use super::*;
use crate::history::Vanished;
use crate::in_memory::on_ranks;
use crate::optimizer::Optimizer;
use crate::parameter::{Mapping, Parameter, Variables};
use crate::pipeline::from_fn;
use crate::schedule::Schedule;
use crate::views::views;

/// `sum (x - c)^2` with `c = (1, -2)`, which moves by `drift` each step.
struct Bowl {
    drift: f64,
    center: [f64; 2],
    prepared: Vec<u64>,
}

impl Bowl {
    fn new(drift: f64) -> Self {
        Self { drift, center: [1.0, -2.0], prepared: Vec::new() }
    }
}

impl<T: Scalar> Pipeline<T> for Bowl {
    type Measure = f64;

    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        self.prepared.push(step);
        self.center = [1.0 + self.drift * step as f64, -2.0];
        Ok(())
    }

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let center = Tensor::from_flat_fn([2], |k| T::from_f64(self.center[k]));
        Ok(squared_error(variables.get("x")?, tape.constant(&center))?)
    }

    fn measure(&self, parameters: &Parameters<T>) -> f64 {
        let x = parameters.get("x").unwrap().raw().data();
        (0..2).map(|k| (x[k].to_f64() - self.center[k]).abs()).sum()
    }
}

fn start<T: Scalar>(rate: f64) -> Parameters<T> {
    Parameters::new().with(Parameter::new("x", Tensor::zeros([2])).rate(rate)).unwrap()
}

fn descent(steps: u64) -> FitSettings {
    FitSettings { steps, optimizer: Optimizer::GradientDescent, ..FitSettings::default() }
}

#[test]
fn one_pipeline_runs_in_both_precisions() {
    let mut bowl = Bowl::new(0.0);
    let wide = Fit::<f64>::new(start(0.25), descent(40)).unwrap().run(&mut bowl).unwrap();
    let narrow = Fit::<f32>::new(start(0.25), descent(40)).unwrap().run(&mut bowl).unwrap();
    for (wide, narrow) in wide.steps.iter().zip(&narrow.steps) {
        assert!((wide.loss - narrow.loss).abs() <= 1e-6 * wide.loss + 1e-12);
    }
}

#[test]
fn a_history_holds_the_state_before_each_update_and_the_final_one() {
    let mut bowl = Bowl::new(0.0);
    // At a rate of 1/4 each update halves the distance, exactly.
    let history = Fit::<f64>::new(start(0.25), descent(10)).unwrap().run(&mut bowl).unwrap();
    assert_eq!(history.stop, Stop::Steps);
    assert_eq!(history.steps.len(), 11);
    assert_eq!((history.step_ms.len(), history.preparation_ms.len()), (10, 11));
    for (k, step) in history.steps.iter().enumerate() {
        assert_eq!(step.step, k as u64);
        assert_eq!(step.measure, 3.0 * 0.5_f64.powi(k as i32));
        assert_eq!(step.loss, 5.0 * 0.25_f64.powi(k as i32));
    }
    assert!(history.steps.windows(2).all(|pair| pair[0].seconds <= pair[1].seconds));
    assert_eq!(bowl.prepared, (0..=10).collect::<Vec<_>>());
}

#[test]
fn no_steps_leave_the_initial_state_alone() {
    let history =
        Fit::<f64>::new(start(0.25), descent(0)).unwrap().run(&mut Bowl::new(0.0)).unwrap();
    assert_eq!(history.steps.len(), 1);
    assert_eq!(history.initial(), history.last());
    assert_eq!(history.step_ms_median(), None);
}

#[test]
fn steps_by_hand_are_the_steps_of_a_run() {
    let mut by_hand = Fit::<f64>::new(start(0.1), FitSettings::default()).unwrap();
    let mut run = Fit::<f64>::new(start(0.1), FitSettings::default()).unwrap();
    let history = run.run(&mut Bowl::new(0.01)).unwrap();
    let mut bowl = Bowl::new(0.01);
    for step in &history.steps[..1_000] {
        let stepped = by_hand.step(&mut bowl).unwrap();
        assert_eq!((stepped.step, stepped.loss), (step.step, step.loss));
    }
    assert_eq!(by_hand.parameters().value("x"), run.parameters().value("x"));
}

#[test]
fn a_schedule_multiplies_the_rate() {
    let schedule = Schedule::Step { steps: 1, factor: 0.5 };
    let settings = FitSettings { schedule, ..descent(2) };
    let history = Fit::<f64>::new(start(0.25), settings).unwrap().run(&mut Bowl::new(0.0)).unwrap();
    // Rates 1/4 and 1/8: distances 1/2 and 1/2 * 3/4.
    assert_eq!(history.last().measure, 3.0 * 0.5 * 0.75);
}

#[test]
fn each_rule_stops_before_the_update_that_it_spares() {
    let run = |settings: FitSettings, drift: f64| {
        let mut fit = Fit::<f64>::new(start(0.25), settings).unwrap();
        let history = fit.run(&mut Bowl::new(drift)).unwrap();
        assert_eq!(fit.steps_done(), history.last().step);
        history
    };
    // The loss is 5 / 4^k and the largest gradient 4 / 2^k.
    let below = run(FitSettings { loss_below: Some(0.1), ..descent(100) }, 0.0);
    assert_eq!((below.stop, below.last().step), (Stop::LossBelow, 3));
    let flat = run(FitSettings { gradient_below: Some(0.3), ..descent(100) }, 0.0);
    assert_eq!((flat.stop, flat.last().step), (Stop::GradientBelow, 4));
    // The centre runs away at a constant speed: the distance settles at twice the speed, which
    // is more than the first loss.
    let stuck = run(FitSettings { patience: Some(5), ..descent(100) }, 10.0);
    assert_eq!((stuck.stop, stuck.last().step), (Stop::NoProgress, 5));
}

#[test]
fn a_listener_sees_every_state_and_can_stop() {
    let mut fit = Fit::<f64>::new(start(0.25), descent(10)).unwrap();
    let mut seen = Vec::new();
    let mut listener = before_update(|state: &StepState<'_, f64, f64>| {
        seen.push((state.step.step, state.parameters.get("x").unwrap().raw().data()[0]));
        if state.step.step == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let mut history = History::with_room_for(4);
    let mut bowl = Bowl::new(0.0);
    let stop = fit.drive(&mut bowl, &Rules::default(), &mut [&mut listener, &mut history]);
    assert_eq!(seen, [(0, 0.0), (1, 0.5), (2, 0.75), (3, 0.875)]);
    assert_eq!((stop, history.stop, history.steps.len()), (Ok(Stop::Callback), Stop::Callback, 4));
}

/// The calls of a drive, in order; `breaks` after so many updates.
struct Calls {
    names: Vec<String>,
    breaks: u64,
}

impl<S: Steps> Listener<S> for Calls {
    fn begin(&mut self, fit: &S) -> Answer<S::Error> {
        self.names.push(format!("begin {}", fit.steps_done()));
        Ok(ControlFlow::Continue(()))
    }

    fn before_update(&mut self, state: &StepState<'_, S::Number, S::Measure>) -> Answer<S::Error> {
        self.names.push(format!("before {}", state.step.step));
        Ok(ControlFlow::Continue(()))
    }

    fn after_step(&mut self, fit: &S, stepped: &Stepped) -> Answer<S::Error> {
        self.names.push(format!("after {}", stepped.step));
        match fit.steps_done() < self.breaks {
            true => Ok(ControlFlow::Continue(())),
            false => Ok(ControlFlow::Break(())),
        }
    }

    fn end(&mut self, fit: &S, stop: Stop) -> Result<(), S::Error> {
        self.names.push(format!("end {} {stop:?}", fit.steps_done()));
        Ok(())
    }
}

#[test]
fn a_drive_calls_its_listeners_in_order_and_looks_at_nothing_that_its_rules_spare() {
    let driven = |rules: Rules<'_>, breaks| {
        let mut fit = Fit::<f64>::new(start(0.25), descent(10)).unwrap();
        let mut calls = Calls { names: Vec::new(), breaks };
        let mut bowl = Bowl::new(0.0);
        let stop = fit.drive(&mut bowl, &rules, &mut [&mut calls]).unwrap();
        assert_eq!(bowl.prepared.len() as u64, fit.steps_done());
        (calls.names.join(", "), stop)
    };
    let step = "before 0, after 0, before 1, after 1";
    let signals = std::cell::Cell::new(0);
    let signal = || {
        signals.set(signals.get() + 1);
        (signals.get() == 3).then_some(15)
    };
    for (rules, breaks, stop) in [
        (Rules { steps: Some(2), ..Rules::default() }, 9, Stop::Steps),
        (Rules::default(), 2, Stop::Callback),
        (Rules { interrupt: Some(&signal), ..Rules::default() }, 9, Stop::Interrupted(15)),
    ] {
        let expected = format!("begin 0, {step}, end 2 {stop:?}");
        assert_eq!(driven(rules, breaks), (expected, stop));
    }
    let late = Rules { seconds: Some(0.0), ..Rules::default() };
    assert_eq!(driven(late, 9), ("begin 0, end 0 Time".to_owned(), Stop::Time));
}

#[test]
fn what_is_called_every_so_many_steps_is_called_once_at_the_end() {
    let called = |steps, rules: Rules<'_>, before| {
        let mut fit = Fit::<f64>::new(start(0.25), descent(10)).unwrap();
        let mut bowl = Bowl::new(0.0);
        (0..before).for_each(|_| assert!(fit.step(&mut bowl).is_ok()));
        let mut calls = Vec::new();
        let mut listener = every(steps, |fit: &Fitting<'_, f64, Bowl>| {
            calls.push(fit.steps_done());
            Ok(())
        });
        fit.drive(&mut bowl, &rules, &mut [&mut listener]).unwrap();
        calls
    };
    let rules = Rules { steps: Some(6), ..Rules::default() };
    assert_eq!(called(4, rules, 0), [0, 4, 6]);
    assert_eq!(called(3, rules, 0), [0, 3, 6]);
    assert_eq!(called(3, rules, 2), [3, 6]);
    assert_eq!(called(4, rules, 6), [6]);
    let rules = Rules { interrupt: Some(&|| Some(2)), ..Rules::default() };
    assert_eq!(called(4, rules, 5), [0; 0]);
}

#[test]
fn ranks_stop_together_by_the_first_ones_clock_and_listeners_and_by_any_ones_signal_and_error() {
    /// A listener of one rank alone that fails or breaks after its second step.
    struct Moody(Result<(), FitError>, bool);
    impl<S: Steps<Error = FitError>> Listener<S> for Moody {
        fn is_shared(&self) -> bool {
            self.1
        }
        fn after_step(&mut self, fit: &S, _stepped: &Stepped) -> Answer<FitError> {
            match fit.steps_done() {
                2 => self.0.clone().map(ControlFlow::Break),
                _ => Ok(ControlFlow::Continue(())),
            }
        }
    }
    type Rig<'a> = dyn Fn(usize, &mut Rules<'_>) -> Option<Moody> + Sync + 'a;
    let ends = |rig: &Rig<'_>| {
        on_ranks::<f64, _>(3, |ranks| {
            let rank = ranks.rank();
            let mut fit = Fit::<f64>::new(start(0.25), descent(10)).unwrap();
            let mut pipeline =
                views(3, |_, _, variables| Ok(variables.get("x")?.square().sum())).among(ranks);
            let mut rules = Rules { steps: Some(5), ..Rules::default() };
            let mut moody = rig(rank, &mut rules);
            let mut all: Vec<&mut dyn Listener<_>> = Vec::new();
            all.extend(moody.as_mut().map(|own| own as &mut dyn Listener<_>));
            let stop = fit.drive(&mut pipeline, &rules, &mut all);
            (stop.map_err(|error| error.to_string()), fit.steps_done())
        })
    };
    assert_eq!(ends(&|_, _| None), vec![(Ok(Stop::Steps), 5); 3]);
    let clock = |of: usize| {
        ends(&move |rank, rules: &mut Rules<'_>| {
            rules.seconds = Some(if rank == of { 0.0 } else { 1e9 });
            None
        })
    };
    assert_eq!(clock(0), vec![(Ok(Stop::Time), 0); 3]);
    assert_eq!(clock(1), vec![(Ok(Stop::Steps), 5); 3]);
    let signal = ends(&|rank, rules| {
        if rank == 2 {
            rules.interrupt = Some(&|| Some(2));
        }
        None
    });
    assert_eq!(signal, vec![(Ok(Stop::Interrupted(2)), 0); 3]);
    // Not shared: only the first is asked.
    let asked = ends(&|_, _| Some(Moody(Ok(()), false)));
    assert_eq!(asked, vec![(Ok(Stop::Callback), 2); 3]);
    let error = FitError::setting("disk", "room", 0);
    let failed = ends(&|rank, _| (rank == 1).then(|| Moody(Err(error.clone()), true)));
    let message = "disk needs room, got 0".to_owned();
    let elsewhere = (Err(format!("rank 1: {message}")), 2);
    assert_eq!(failed, [elsewhere.clone(), (Err(message), 2), elsewhere]);
}

#[test]
fn what_is_not_finite_is_named_and_changes_nothing() {
    let x = || Parameter::new("x", Tensor::scalar(1.0_f64));
    let error_of = |parameter: Parameter<f64>, raw: Option<f64>, power: i32| {
        let mut list = Parameters::new().with(parameter).unwrap();
        if let Some(raw) = raw {
            list.list[0].raw = Tensor::scalar(raw);
        }
        let before = list.list[0].raw.clone();
        let mut fit = Fit::new(list, FitSettings::default()).unwrap();
        let mut pipeline = from_fn(move |_, variables| {
            let x = variables.get("x")?;
            Ok(x.powi(power))
        });
        let error = fit.step(&mut pipeline).unwrap_err();
        assert_eq!(fit.parameters().list[0].raw.data(), before.data());
        assert_eq!(fit.steps_done(), 0);
        error.to_string()
    };
    let value = error_of(x().mapping(Mapping::Exp), Some(800.0), 1);
    assert_eq!(value, "the value of \"x\" needs to be finite, got inf at step 0");
    let loss = error_of(x(), Some(1e200), 2);
    let of = "first in the output of powi of \"x\"";
    assert_eq!(loss, format!("the loss needs to be finite, got inf at step 0, {of}"));
    let gradient = error_of(x(), Some(0.0), -1);
    assert_eq!(gradient, format!("the loss needs to be finite, got inf at step 0, {of}"));
}

/// The message of the first step of a fit of `a` and `b`, by the loss that `record` makes.
fn refusal(
    [a, b]: [f64; 2],
    record: impl for<'t> Fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>,
) -> Option<String> {
    let mapped = Parameter::new("b", Tensor::scalar(b)).mapping(Mapping::Softplus);
    let list = Parameters::new()
        .with(Parameter::new("a", Tensor::scalar(a)))
        .and_then(|list| list.with(mapped))
        .unwrap();
    let before = list.value("a").unwrap();
    let mut fit = Fit::new(list, FitSettings { steps: 3, ..FitSettings::default() }).unwrap();
    let mut pipeline = from_fn(|_, variables| Ok(record(variables.get("a")?, variables.get("b")?)));
    let error = fit.run(&mut pipeline).err()?.to_string();
    assert_eq!((fit.parameters().value("a").unwrap(), fit.steps_done()), (before, 0));
    Some(error)
}

#[test]
fn what_is_not_finite_is_laid_to_the_first_operation() {
    let of = |start, record: for<'t> fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>| {
        refusal(start, record).unwrap()
    };
    let loss = of([-3.0, 2.0], |a, b| ((a * b).ln() + b).exp());
    let rule = "the loss needs to be finite, got NaN at step 0";
    assert_eq!(loss, format!("{rule}, first in the output of ln"));
    let loss = of([-3.0, 2.0], |a, b| a.sqrt() * b);
    assert_eq!(loss, format!("{rule}, first in the output of sqrt of \"a\""));
    let both = of([1e308, 1e308], |a, b| a.square().exp() - (a * b) * b);
    let rule = "the loss needs to be finite, got NaN at step 0";
    assert_eq!(both, format!("{rule}, first in the output of powi of \"a\""));
    let input =
        of([1.0, 2.0], |a, b| a * b + a.tape().constant(&Tensor::full([2], f64::NAN)).sum());
    assert_eq!(input, format!("{rule}, first in an input of shape [2]"));
    let gradient = of([0.0, 2.0], |a, b| (a.square().sqrt() + b).exp());
    let rule = "the gradient of \"a\" needs to be finite, got NaN at step 0";
    assert_eq!(gradient, format!("{rule}, first in the backward pass of sqrt"));
}

#[test]
fn a_parameter_without_a_way_to_the_loss_is_refused_before_the_first_update() {
    let of = |record: for<'t> fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>| {
        refusal([1.0, 2.0], record)
    };
    let unused = of(|_, b| b.square()).unwrap();
    assert_eq!(unused, "\"a\" needs a way to the loss, got a loss that does not use it");
    let mapped = of(|a, _| a.square()).unwrap();
    assert_eq!(mapped, "\"b\" needs a way to the loss, got a loss that does not use it");
    let rule = "\"a\" needs a way to the loss, got one that ends";
    let cut = of(|a, b| (b * a.tape().leaf_scalar(a.sin().item())).square()).unwrap();
    assert_eq!(cut, format!("{rule} at sin"));
    let detached = of(|a, b| b * a.exp().detach()).unwrap();
    assert_eq!(detached, format!("{rule} at exp, whose output is detached"));
    let detached = of(|a, b| b * a.detach()).unwrap();
    assert_eq!(detached, format!("{rule} where it is detached"));
    let constant = of(|a, _| a.tape().constant_scalar(1.0)).unwrap();
    assert_eq!(constant, "\"a\" needs a way to the loss, got a loss that does not use it");
}

#[test]
fn a_gradient_of_zero_is_no_reason_to_refuse() {
    for record in [
        (|a, b| a * 0.0 + b) as for<'t> fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>,
        |a, b| (a - 1.0).square() + b,
        |a, b| a.clamp(5.0, 6.0).unwrap() + b,
    ] {
        assert_eq!(refusal([1.0, 2.0], record), None);
    }
}

#[test]
fn what_is_optional_or_frozen_may_go_unused() {
    let parameter = |name| Parameter::new(name, Tensor::scalar(1.0_f64)).rate(0.1);
    let list = Parameters::new()
        .with(parameter("coarse"))
        .and_then(|list| list.with(parameter("fine").optional()))
        .and_then(|list| list.with(parameter("still").frozen()))
        .unwrap();
    /// Coarse at first, then fine.
    struct Refines(u64);
    impl Pipeline<f64> for Refines {
        type Measure = ();
        fn prepare(&mut self, step: u64) -> Result<(), FitError> {
            self.0 = step;
            Ok(())
        }
        fn loss<'t>(
            &mut self,
            _tape: &'t Tape<f64>,
            variables: &Variables<'t, f64>,
        ) -> Result<Var<'t, f64>, FitError> {
            Ok(variables.get(if self.0 < 3 { "coarse" } else { "fine" })?.square())
        }
    }
    let settings = FitSettings { steps: 6, ..FitSettings::default() };
    let mut fit = Fit::new(list, settings).unwrap();
    fit.run(&mut Refines(0)).unwrap();
    assert!(fit.parameters().value("fine").unwrap().item() < 1.0);
}

#[test]
fn updates_that_vanish_are_in_the_history_by_step_and_parameter() {
    let parameter = |name, rate| Parameter::new(name, Tensor::full([3], 1.0_f32)).rate(rate);
    let list = Parameters::new()
        .with(parameter("moves", 0.25))
        .and_then(|list| list.with(parameter("stays", 1e-9)))
        .unwrap();
    let sum =
        || from_fn(|_, variables| Ok((variables.get("moves")? + variables.get("stays")?).sum()));
    let mut fit = Fit::new(list, descent(2)).unwrap();
    let history = fit.run(&mut sum()).unwrap();
    let expected = [0, 1].map(|step| Vanished { step, parameter: 1, entries: 3 });
    assert_eq!(history.vanished, expected);
    assert_eq!(fit.step(&mut sum()).unwrap().vanished, 3);
}

#[test]
fn a_loss_that_is_no_scalar_is_refused() {
    let mut fit = Fit::<f64>::new(start(0.1), FitSettings::default()).unwrap();
    let error = fit.run(&mut from_fn(|_, variables| variables.get("x"))).unwrap_err();
    assert!(error.to_string().ends_with("needs a scalar, got shape [2]"), "{error}");
}

#[test]
fn settings_outside_their_range_are_refused() {
    for settings in [
        FitSettings { patience: Some(0), ..FitSettings::default() },
        FitSettings { loss_below: Some(f64::NAN), ..FitSettings::default() },
        FitSettings {
            schedule: Schedule::Step { steps: 0, factor: 0.5 },
            ..FitSettings::default()
        },
    ] {
        assert!(matches!(Fit::<f64>::new(start(0.1), settings), Err(FitError::Setting { .. })));
    }
}
