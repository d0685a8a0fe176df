use bokashi_core::{Tape, Tensor, Var};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::optimizer::Optimizer;
use crate::parameter::{Mapping, Variables};
use crate::pipeline::{Pipeline, from_fn};
use crate::schedule::Schedule;
use crate::{FitSettings, History, Stop};
use std::ops::ControlFlow;

/// A bowl around a centre that a sequential generator moves: how it goes on depends on all that
/// was drawn before.
struct Wandering {
    generator: ChaCha8Rng,
    center: [f64; 3],
}

impl Wandering {
    fn new(seed: u64) -> Self {
        Self { generator: ChaCha8Rng::seed_from_u64(seed), center: [0.0; 3] }
    }
}

impl<T: Scalar> Pipeline<T> for Wandering {
    type Measure = ();

    fn save_state(&self, state: &mut Vec<u8>) {
        state.extend(self.generator.get_seed());
        state.extend(self.generator.get_stream().to_le_bytes());
        state.extend(self.generator.get_word_pos().to_le_bytes());
    }

    fn restore_state(&mut self, state: &[u8]) -> Result<(), FitError> {
        let refused = || FitError::saved("32 + 8 + 16 bytes of a generator", state.len());
        let (seed, rest) = state.split_first_chunk().ok_or_else(refused)?;
        let (stream, rest) = rest.split_first_chunk().ok_or_else(refused)?;
        let word_pos = rest.try_into().map_err(|_| refused())?;
        self.generator = ChaCha8Rng::from_seed(*seed);
        self.generator.set_stream(u64::from_le_bytes(*stream));
        self.generator.set_word_pos(u128::from_le_bytes(word_pos));
        Ok(())
    }

    fn prepare(&mut self, _step: u64) -> Result<(), FitError> {
        // Now and then one number more, so that a step does not tell the position.
        let draws = 3 + self.generator.next_u32() as usize % 2;
        for k in 0..draws {
            self.center[k % 3] = f64::from(self.generator.next_u32()) / 4_294_967_296.0;
        }
        Ok(())
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let center = tape.constant(&Tensor::from_flat_fn([3], |k| T::from_f64(self.center[k])));
        let scale = variables.get("scale")?;
        Ok((variables.get("x")? * scale - center).square().sum() + variables.get("still")?)
    }
}

fn parameters<T: Scalar>() -> Parameters<T> {
    let start = Tensor::from_flat_fn([3], |k| T::from_f64(0.1 * k as f64 - 0.3));
    let scale = Parameter::new("scale", Tensor::scalar(T::from_f64(1.5)));
    Parameters::new()
        .with(Parameter::new("x", start).rate(0.02))
        .and_then(|list| list.with(scale.rate(0.01).mapping(Mapping::Softplus)))
        .and_then(|list| list.with(Parameter::new("still", Tensor::scalar(T::ONE)).frozen()))
        .unwrap()
}

fn settings(optimizer: Optimizer, schedule: Schedule) -> FitSettings {
    FitSettings { steps: 40, optimizer, schedule, ..FitSettings::default() }
}

const ADAM: Optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 };

/// The bits of every loss of `history`.
fn losses(history: &History<()>) -> Vec<u64> {
    history.steps.iter().map(|step| step.loss.to_bits()).collect()
}

/// The file of a fit of ten steps.
fn file<T: Stored>() -> Vec<u8> {
    let mut fit = Fit::<T>::new(parameters(), settings(ADAM, Schedule::Constant)).unwrap();
    for _ in 0..10 {
        fit.step(&mut Wandering::new(1)).unwrap();
    }
    fit.to_bytes().unwrap()
}

/// The same contents after a change, with their right length and checksum.
fn sealed(file: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let line = file.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    let mut contents = file[line + 8..file.len() - 4].to_vec();
    change(&mut contents);
    let mut sealed = Writer { bytes: file[..line].to_vec() };
    sealed.block(&contents);
    let checksum = crc32fast::hash(&sealed.bytes);
    sealed.bytes.extend(checksum.to_le_bytes());
    sealed.bytes
}

fn refused<T: Stored>(bytes: &[u8]) -> String {
    Fit::<T>::from_bytes(bytes).unwrap_err().to_string()
}

#[test]
fn a_resumed_fit_goes_on_to_the_same_bits() {
    fn check<T: Stored>() {
        let cosine = Schedule::Cosine { steps: 40, floor: 0.1 };
        let falling = Schedule::Exponential { steps: 7, factor: 0.5 };
        for optimizer in [Optimizer::GradientDescent, ADAM, Optimizer::ams_grad()] {
            for schedule in [Schedule::Constant, cosine, falling] {
                let settings = settings(optimizer, schedule);
                let mut whole = Fit::<T>::new(parameters(), settings).unwrap();
                let all = losses(&whole.run(&mut Wandering::new(1)).unwrap());
                for stop in [0, 1, 17, 40] {
                    let mut first = Fit::<T>::new(parameters(), settings).unwrap();
                    let mut saved = Vec::new();
                    let run = first.run_with(&mut Wandering::new(1), |seen| {
                        if seen.step.step < stop {
                            return ControlFlow::Continue(());
                        }
                        saved = encode(&seen.loop_state, seen.parameters).unwrap();
                        ControlFlow::Break(())
                    });
                    assert_eq!(losses(&run.unwrap()), all[..=stop as usize]);
                    // While it runs, and once it has stopped, the same file.
                    assert_eq!(first.to_bytes().unwrap(), saved);
                    drop(first);
                    let mut second = Fit::<T>::from_bytes(&saved).unwrap();
                    assert_eq!((second.steps_done(), *second.settings()), (stop, settings));
                    // Of another seed: the file brings the generator back.
                    let rest = losses(&second.run(&mut Wandering::new(999)).unwrap());
                    assert_eq!(rest, all[stop as usize..], "{optimizer:?} {schedule:?} {stop}");
                    // Parameters, moments, counts, generator: all that there is.
                    assert_eq!(second.to_bytes().unwrap(), whole.to_bytes().unwrap());
                }
            }
        }
    }
    check::<f32>();
    check::<f64>();
}

#[test]
fn steps_by_hand_resume_as_a_run_does() {
    let mut pipeline = Wandering::new(5);
    let mut whole = Fit::<f64>::new(parameters(), settings(ADAM, Schedule::Constant)).unwrap();
    let mut files = Vec::new();
    for _ in 0..20 {
        files.push(whole.to_bytes().unwrap());
        whole.step(&mut pipeline).unwrap();
    }
    for (done, file) in files.iter().enumerate() {
        let mut resumed = Fit::<f64>::from_bytes(file).unwrap();
        // Before the first step there is no state to bring back.
        let mut pipeline = Wandering::new(if done == 0 { 5 } else { 0 });
        for _ in done..20 {
            resumed.step(&mut pipeline).unwrap();
        }
        assert_eq!(resumed.to_bytes().unwrap(), whole.to_bytes().unwrap(), "{done}");
    }
}

#[test]
fn patience_counts_on_where_it_was() {
    let settings = FitSettings {
        steps: 1_000,
        patience: Some(25),
        loss_below: Some(-1.0),
        gradient_below: Some(0.0),
        ..settings(ADAM, Schedule::Constant)
    };
    let run = |fit: &mut Fit<f64>, until: u64| {
        let on_step = |seen: &StepState<'_, f64, ()>| match seen.step.step >= until {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let history = fit.run_with(&mut Wandering::new(3), on_step).unwrap();
        (history.stop, fit.steps_done())
    };
    let (stop, end) = run(&mut Fit::new(parameters(), settings).unwrap(), u64::MAX);
    assert_eq!(stop, Stop::NoProgress);
    for until in [end - 24, end - 1] {
        let mut first = Fit::new(parameters(), settings).unwrap();
        assert_eq!(run(&mut first, until), (Stop::Callback, until));
        let mut second = Fit::from_bytes(&first.to_bytes().unwrap()).unwrap();
        assert_eq!(run(&mut second, u64::MAX), (stop, end));
    }
}

#[test]
fn every_bit_of_a_number_comes_back() {
    fn check<T: Stored>(numbers: Vec<T>) {
        let count = numbers.len();
        let x = Parameter::new("x", Tensor::new([count], numbers).unwrap()).rate(5e-324);
        let list = Parameters::new().with(x).unwrap();
        let fit = Fit::new(list, FitSettings::default()).unwrap();
        let back = Fit::<T>::from_bytes(&fit.to_bytes().unwrap()).unwrap();
        let bits = |fit: &Fit<T>| {
            let data = fit.parameters().get("x").unwrap().raw().data();
            data.iter().map(|x| x.to_f64().to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(&back), bits(&fit));
        assert_eq!(back.parameters().list[0].rate.to_bits(), 5e-324_f64.to_bits());
    }
    check(vec![0.0_f32, -0.0, f32::MIN_POSITIVE, 1e-45, f32::MAX, 1.0 / 3.0]);
    check(vec![0.0_f64, -0.0, f64::MIN_POSITIVE, 5e-324, f64::MAX, 1.0 / 3.0]);
}

#[test]
fn settings_of_every_kind_come_back() {
    let adam = Optimizer::Adam { beta1: 0.5, beta2: 0.25, epsilon: 0.125 };
    let ams_grad = Optimizer::AmsGrad { beta1: 0.0, beta2: 0.75, epsilon: 1e-3 };
    let optimizers = [Optimizer::GradientDescent, adam, ams_grad];
    let schedules = [
        Schedule::Constant,
        Schedule::Cosine { steps: 3, floor: 0.25 },
        Schedule::Polynomial { steps: 4, power: 2.5 },
        Schedule::Exponential { steps: u64::MAX, factor: 0.1 },
        Schedule::Step { steps: 6, factor: 1.0 },
    ];
    for (k, schedule) in schedules.into_iter().enumerate() {
        let settings = FitSettings {
            steps: u64::MAX - k as u64,
            optimizer: optimizers[k % 3],
            schedule,
            loss_below: (k % 2 == 0).then_some(-0.5),
            patience: (k % 3 == 0).then_some(7),
            gradient_below: (k % 2 == 1).then_some(f64::INFINITY),
        };
        let fit = Fit::<f32>::new(parameters(), settings).unwrap();
        assert_eq!(*Fit::<f32>::from_bytes(&fit.to_bytes().unwrap()).unwrap().settings(), settings);
    }
}

#[test]
fn a_count_beyond_two_to_the_53_is_exact_and_counts_on() {
    let done = (1 << 53) + 1;
    let mut fit = Fit::<f64>::new(parameters(), settings(ADAM, Schedule::Constant)).unwrap();
    fit.step(&mut Wandering::new(1)).unwrap();
    let file = sealed(&fit.to_bytes().unwrap(), |contents| {
        // The count of the updates of "x": after its name, shape, entries, rate and two bytes.
        let name = contents.windows(9).position(|w| w == [1, 0, 0, 0, 0, 0, 0, 0, b'x']).unwrap();
        let at = name + 9 + 1 + 8 + 3 * 8 + 8 + 2;
        assert_eq!(contents[at..at + 8], 1_u64.to_le_bytes());
        contents[at..at + 8].copy_from_slice(&u64::to_le_bytes(done));
    });
    let mut fit = Fit::<f64>::from_bytes(&file).unwrap();
    let Parameter { raw, first, second, .. } = fit.parameters().get("x").unwrap().clone();
    fit.step(&mut Wandering::new(1)).unwrap();
    let x = fit.parameters().get("x").unwrap();
    assert_eq!(x.updates, done + 1);
    // No power of beta is left: the step is m / sqrt(v) without a correction.
    for k in 0..3 {
        assert_ne!((x.first[k], x.second[k]), (first[k], second[k]));
        let expected = raw.data()[k] - 0.02 * x.first[k] / (x.second[k].sqrt() + 1e-8);
        approx::assert_relative_eq!(x.raw.data()[k], expected, max_relative = 1e-14);
    }
}

#[test]
fn a_file_that_is_something_else_is_refused_with_rule_and_value() {
    let file = file::<f64>();
    let table: [(&[u8], &str); 8] = [
        (b"", "a saved fit needs to begin with \"bokashi-fit\", got \"\""),
        (b"\x89PNG\r\n\x1a\n", "to begin with \"bokashi-fit\", got \"\\x89PNG\\r\\n\\x1a\\n\""),
        (b"bokashi-fitting 1 f64\n", "to begin with \"bokashi-fit\", got \"bokashi-fit\""),
        (b"bokashi-fit 1", "needs a whole first line, got \"bokashi-fit 1\""),
        (b"bokashi-fit 2 f64\n", "a saved fit needs version 1, got version \"2\""),
        (b"bokashi-fit 1 f16\n", "needs f32 or f64 after its version, got \"bokashi-fit 1 f16\""),
        (b"bokashi-fit 1 f64\n\x01", "needs the length of its contents, got 19 bytes"),
        (
            b"bokashi-fit 1 f32\n\0\0\0\0\0\0\0\0\0\0\0\0",
            "a saved fit needs numbers in f64, as the fit that resumes it, got f32",
        ),
    ];
    for (bytes, message) in table {
        let said = refused::<f64>(bytes);
        assert!(said.ends_with(message), "{said}");
    }
    assert!(Fit::<f64>::from_bytes(&file).is_ok());
    let said = refused::<f32>(&file);
    assert_eq!(said, "a saved fit needs numbers in f32, as the fit that resumes it, got f64");
}

#[test]
fn a_file_that_is_cut_short_too_long_or_changed_is_refused() {
    let file = file::<f32>();
    for length in 0..file.len() {
        assert!(Fit::<f32>::from_bytes(&file[..length]).is_err(), "{length}");
    }
    let longer = [&file[..], &[0]].concat();
    let rule = format!("a saved fit needs {} bytes, got {}", file.len(), file.len() + 1);
    assert_eq!(refused::<f32>(&longer), rule);
    for at in 0..file.len() {
        for bit in [0, 3, 7] {
            let mut changed = file.clone();
            changed[at] ^= 1 << bit;
            assert!(Fit::<f32>::from_bytes(&changed).is_err(), "bit {bit} of byte {at}");
        }
    }
    let mut changed = file.clone();
    changed[file.len() / 2] ^= 1;
    let said = refused::<f32>(&changed);
    assert!(said.starts_with("a saved fit needs contents with the checksum "), "{said}");
}

#[test]
fn contents_with_a_right_checksum_are_not_believed_either() {
    let file = file::<f64>();
    let changed = |at: usize, bytes: &[u8]| {
        refused::<f64>(&sealed(&file, |contents| {
            contents[at..at + bytes.len()].copy_from_slice(bytes);
        }))
    };
    let name = file.windows(9).position(|w| w == [1, 0, 0, 0, 0, 0, 0, 0, b'x']).unwrap() - 26;
    let huge = [0xff; 8];
    // The name's length, the rank, the extent, an entry, the rate, the mapping.
    let table: [(usize, &[u8], &str); 9] = [
        (name, &huge, "a saved fit needs 18446744073709551615 bytes for a parameter's name, got"),
        (name + 8, &[0xff], "a saved fit needs UTF-8 for a parameter's name, got \"\\xff\""),
        (name + 9, &[200], "a saved fit needs at most 8 axes for a parameter, got 200"),
        (name + 10, &huge, "a saved fit needs 18446744073709551615 bytes for a parameter, got"),
        (name + 18, &huge, "a saved fit needs finite numbers for a parameter, got NaN"),
        (name + 42, &huge, "learning rate needs a finite number from 0 up, got NaN for \"x\""),
        (name + 50, &[3], "a saved fit needs a byte below 3 for a mapping, got 3"),
        (
            name + 51,
            &[2],
            "a saved fit needs a byte below 2 for whether a parameter is frozen, got 2",
        ),
        (name - 8, &huge, "a saved fit needs"),
    ];
    for (at, bytes, message) in table {
        let said = changed(at, bytes);
        assert!(said.starts_with(message), "{said}");
    }
    let longer = sealed(&file, |contents| contents.push(0));
    assert_eq!(
        refused::<f64>(&longer),
        "a saved fit needs to end with its last field, got 1 bytes more"
    );
    // Whatever single byte is changed to whatever: a fit or an error, no panic.
    let contents = file.len() - 26 - 4;
    for at in 0..contents {
        for byte in [0, 1, 0x7f, 0x80, 0xff] {
            let _ = Fit::<f64>::from_bytes(&sealed(&file, |contents| contents[at] = byte));
        }
        let _ = Fit::<f64>::from_bytes(&sealed(&file, |contents| contents.truncate(at)));
    }
}

#[test]
fn a_pipeline_without_a_state_refuses_that_of_another() {
    let mut fit = Fit::<f64>::from_bytes(&file::<f64>()).unwrap();
    let before = fit.to_bytes().unwrap();
    let mut other = from_fn(|_, variables| Ok(variables.get("x")?.sum()));
    let error = fit.step(&mut other).unwrap_err().to_string();
    let rule = "a saved fit needs a pipeline that takes its state back, got one that has none";
    assert_eq!(error, rule);
    // And nothing has happened: the right one goes on.
    assert_eq!(fit.to_bytes().unwrap(), before);
    assert!(fit.step(&mut Wandering::new(0)).is_ok());
}

#[test]
fn a_file_is_saved_whole_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fit");
    let mut fit = Fit::<f32>::new(parameters(), settings(ADAM, Schedule::Constant)).unwrap();
    fit.run_with(&mut Wandering::new(1), |seen| {
        if seen.step.step % 16 == 0 {
            seen.save(&path).unwrap();
        }
        ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!(Fit::<f32>::resume(&path).unwrap().steps_done(), 32);
    fit.save(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), fit.to_bytes().unwrap());
    assert_eq!(Fit::<f32>::resume(&path).unwrap().to_bytes(), fit.to_bytes());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);

    let missing = folder.path().join("no/such/file");
    let error = fit.save(&missing).unwrap_err().to_string();
    assert!(error.contains("no/such/file could not be written: "), "{error}");
    let error = Fit::<f32>::resume(&missing).unwrap_err().to_string();
    assert!(error.contains("no/such/file could not be read: "), "{error}");

    // A file that says to be longer than it is takes no more memory than it is long.
    let mut claims = fit.to_bytes().unwrap();
    claims[18..26].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    std::fs::write(&path, &claims).unwrap();
    let error = Fit::<f32>::resume(&path).unwrap_err().to_string();
    assert!(error.starts_with("a saved fit needs 1152921504606847006 bytes, got "), "{error}");
}
