use bokashi_core::{Tape, Tensor, Var};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::optimizer::Optimizer;
use crate::parameter::{Mapping, Variables};
use crate::pipeline::{Pipeline, from_fn};
use crate::schedule::Schedule;
use crate::{FitSettings, History, Rules, Stop, before_update};
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
        &mut self,
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

/// The same file after a change of its text and tensors, with its right checksum.
fn sealed(file: &[u8], change: impl FnOnce(&mut String, &mut BTreeMap<String, Block>)) -> Vec<u8> {
    let (_, header) = SafeTensors::read_metadata(file).unwrap();
    let mut text = text_of(&header).unwrap().to_owned();
    let tensors = SafeTensors::deserialize(file).unwrap().tensors();
    let block = |view: TensorView<'_>| Block {
        dtype: view.dtype(),
        shape: view.shape().to_vec(),
        bytes: view.data().to_vec(),
    };
    let mut tensors = tensors.into_iter().map(|(name, view)| (name, block(view))).collect();
    change(&mut text, &mut tensors);
    let views =
        tensors.iter().map(|(name, block)| (&**name, block.dtype, &*block.shape, &*block.bytes));
    if let Some((_, rest)) =
        text.strip_prefix(BEFORE_CHECKSUM).and_then(|text| text.split_at_checked(DIGITS))
    {
        text = format!("{BEFORE_CHECKSUM}{}{rest}", checksum(rest, views));
    }
    safetensors::serialize(&tensors, Some(HashMap::from([(KEY.to_owned(), text)]))).unwrap()
}

fn refused<T: Stored>(bytes: &[u8]) -> String {
    Fit::<T>::from_bytes(bytes).unwrap_err().to_string()
}

/// The history of a run that `on_step` may stop.
fn stopped<T: Stored>(
    fit: &mut Fit<T>,
    pipeline: &mut Wandering,
    on_step: impl FnMut(&StepState<'_, T, ()>) -> ControlFlow<()>,
) -> History<()> {
    let mut history = History::with_room_for(0);
    let mut listener = before_update(on_step);
    fit.drive(pipeline, &Rules::default(), &mut [&mut history, &mut listener]).unwrap();
    history
}

#[test]
fn a_resumed_fit_goes_on_to_the_same_bits() {
    fn check<T: Stored>() {
        let cosine = Schedule::Cosine { steps: 40, floor: 0.1 };
        let falling = Schedule::Exponential { steps: 7, factor: 0.5, floor: 0.0 };
        for optimizer in [Optimizer::GradientDescent, ADAM, Optimizer::ams_grad()] {
            for schedule in [Schedule::Constant, cosine, falling] {
                let settings = settings(optimizer, schedule);
                let mut whole = Fit::<T>::new(parameters(), settings).unwrap();
                let all = losses(&whole.run(&mut Wandering::new(1)).unwrap());
                for stop in [0, 1, 17, 40] {
                    let mut first = Fit::<T>::new(parameters(), settings).unwrap();
                    let mut saved = Vec::new();
                    let history = stopped(&mut first, &mut Wandering::new(1), |seen| {
                        if seen.step.step < stop {
                            return ControlFlow::Continue(());
                        }
                        saved = encode(&seen.loop_state.unwrap(), seen.parameters).unwrap();
                        ControlFlow::Break(())
                    });
                    assert_eq!(losses(&history), all[..=stop as usize]);
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
        let history = stopped(fit, &mut Wandering::new(3), on_step);
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
        Schedule::Exponential { steps: u64::MAX, factor: 0.1, floor: 0.0 },
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
    let file = sealed(&fit.to_bytes().unwrap(), |text, _| {
        // The updates of the first parameter, "x".
        let before = "\"frozen\":false,\"updates\":";
        assert!(text.contains(&format!("{before}1")));
        *text = text.replacen(&format!("{before}1"), &format!("{before}{done}"), 1);
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
    let foreign = safetensors::serialize(&BTreeMap::<String, Block>::new(), None).unwrap();
    let table: [(&[u8], &str); 4] = [
        (b"", "a saved fit needs a safetensors file, got header too small"),
        (b"\x89PNG\r\n\x1a\n", "a saved fit needs a safetensors file, got header too large"),
        (
            b"\x02\0\0\0\0\0\0\0[]",
            "a saved fit needs a safetensors file, got invalid JSON in header",
        ),
        (&foreign, "a safetensors file with \"bokashi_fit\" in its metadata, got one without"),
    ];
    for (bytes, message) in table {
        let said = refused::<f64>(bytes);
        assert!(said.contains(message), "{said}");
    }
    let file = file::<f64>();
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
    assert!(Fit::<f32>::from_bytes(&[&file[..], &[0]].concat()).is_err());
    let header = 8 + u64::from_le_bytes(file[..8].try_into().unwrap()) as usize;
    let padding = file[..header].iter().rposition(|&byte| byte != b' ').unwrap() + 1;
    for at in (0..padding).chain(header..file.len()) {
        for bit in 0..8 {
            let mut changed = file.clone();
            changed[at] ^= 1 << bit;
            assert!(Fit::<f32>::from_bytes(&changed).is_err(), "bit {bit} of byte {at}");
        }
    }
    let mut changed = file.clone();
    *changed.last_mut().unwrap() ^= 1;
    let said = refused::<f32>(&changed);
    assert!(said.starts_with("a saved fit needs contents with the checksum "), "{said}");
}

#[test]
fn the_checksum_is_of_shapes_as_well() {
    let matrix = Parameter::new("m", Tensor::from_flat_fn([2, 3], |k| k as f64));
    let list = Parameters::new().with(matrix).unwrap();
    let file = Fit::new(list, FitSettings::default()).unwrap().to_bytes().unwrap();
    let at = file.windows(5).position(|bytes| bytes == b"[2,3]").unwrap();
    let mut changed = file.clone();
    changed[at..at + 5].copy_from_slice(b"[3,2]");
    let said = refused::<f64>(&changed);
    assert!(said.starts_with("a saved fit needs contents with the checksum "), "{said}");
}

#[test]
fn contents_with_a_right_checksum_are_not_believed_either() {
    let file = file::<f64>();
    let texts = [
        ("\"version\":2", "\"version\":3", "a saved fit needs version 2, got version 3"),
        (
            "\"precision\":\"f64\"",
            "\"precision\":\"f16\"",
            "a saved fit needs numbers in f32 or f64, got f16",
        ),
        ("\"step\":10", "\"step\":-1", "a saved fit needs contents that are those of a fit, got "),
        ("\"step\":10", "\"stop\":10", "a saved fit needs contents that are those of a fit, got "),
        (
            "\"updates\":10",
            "\"updates\":9223372036854775809",
            "a saved fit needs at most 2^63 updates",
        ),
        (
            "\"least_loss_step\":10",
            "\"least_loss_step\":11",
            "a saved fit needs a least loss of a step",
        ),
        (
            "\"beta1\":0.9",
            "\"beta1\":1.5",
            "Adam's beta1 needs a number from 0 to below 1, got 1.5",
        ),
        (
            "\"rate\":0.02",
            "\"rate\":-0.02",
            "learning rate needs a finite number from 0 up, got -0.02",
        ),
        (
            "\"rate\":0.02",
            "\"rate\":1e999",
            "a saved fit needs contents that are those of a fit, got ",
        ),
        (
            "\"name\":\"still\"",
            "\"name\":\"x\"",
            "a saved fit needs a tensor \"raw/x\", and one alone",
        ),
        ("\"name\":\"still\"", "\"name\":\"steal\"", "a saved fit needs a tensor \"raw/steal\""),
        ("\"softplus\"", "\"tanh\"", "a saved fit needs contents that are those of a fit, got "),
        ("\"loss_below\":null", "\"loss_below\":\"low\"", "a saved fit needs numbers as limits"),
        ("\"loss_below\":null", "\"loss_below\":\"NaN\"", "loss limit needs a number, got NaN"),
        (
            "{\"checksum\":",
            "{ \"checksum\":",
            "a saved fit needs contents that begin with a checksum",
        ),
    ];
    for (right, wrong, message) in texts {
        let said = refused::<f64>(&sealed(&file, |text, _| {
            assert!(text.contains(right), "{right} in {text}");
            *text = text.replacen(right, wrong, 1);
        }));
        assert!(said.starts_with(message), "{said}");
    }
    type Change = fn(&mut BTreeMap<String, Block>);
    let tensors: [(Change, &str); 8] = [
        (|all| drop(all.remove("raw/x")), "a saved fit needs a tensor \"raw/x\", and one alone"),
        (
            |all| all.get_mut("raw/x").unwrap().bytes[..8].fill(0xff),
            "a saved fit needs finite numbers for \"raw/x\", got NaN",
        ),
        (
            |all| all.get_mut("raw/x").unwrap().shape = vec![1, 1, 1, 1, 1, 1, 1, 1, 3],
            "a saved fit needs at most 8 axes for \"raw/x\", got 9",
        ),
        (
            |all| all.get_mut("second_moment/x").unwrap().shape = vec![3, 1],
            "a saved fit needs the shape [3] of \"raw/x\" for \"second_moment/x\", got [3, 1]",
        ),
        (
            |all| all.get_mut("second_moment/x").unwrap().bytes[7] = 0xbf,
            "a saved fit needs average squares from 0 up, got -",
        ),
        (
            |all| all.get_mut("raw/scale").unwrap().dtype = Dtype::I64,
            "a saved fit needs F64 for \"raw/scale\", got I64",
        ),
        (
            |all| all.get_mut("pipeline").unwrap().dtype = Dtype::I8,
            "a saved fit needs U8 for \"pipeline\", got I8",
        ),
        (
            |all| drop(all.insert("raw/y".into(), Block::new(&Shape::from([1]), &[1.0_f64]))),
            "a saved fit needs no tensor but those of its parameters, got \"raw/y\"",
        ),
    ];
    for (change, message) in tensors {
        let said = refused::<f64>(&sealed(&file, |_, tensors| change(tensors)));
        assert!(said.starts_with(message), "{said}");
    }
    // Whatever single byte of the text is changed to whatever: a fit or an error, no panic.
    let mut length = 0;
    sealed(&file, |text, _| length = text.len());
    for at in 0..length {
        for byte in *b"\0 0\"{}[]:,-e9" {
            let changed = sealed(&file, |text, _| {
                text.replace_range(at..=at, char::from(byte).encode_utf8(&mut [0]));
            });
            let _ = Fit::<f64>::from_bytes(&changed);
        }
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
    stopped(&mut fit, &mut Wandering::new(1), |seen| {
        if seen.step.step % 16 == 0 {
            seen.save(&path).unwrap();
        }
        ControlFlow::Continue(())
    });
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
    for (claim, rule) in
        [(1_u64 << 60, "a header of 1152921504606846976 bytes"), (90_000_000, "EOF")]
    {
        let mut claims = fit.to_bytes().unwrap();
        claims[..8].copy_from_slice(&claim.to_le_bytes());
        std::fs::write(&path, &claims).unwrap();
        let error = Fit::<f32>::resume(&path).unwrap_err().to_string();
        assert!(error.starts_with("a saved fit needs a safetensors file, got "), "{error}");
        assert!(error.contains(rule) || error.contains("trailing"), "{error}");
    }
    // Of a large file of something else the header alone is read.
    let other = safetensors::serialize(&BTreeMap::<String, Block>::new(), None).unwrap();
    let large = std::fs::File::create(&path).unwrap();
    std::io::Write::write_all(&mut &large, &other).unwrap();
    large.set_len(1 << 40).unwrap();
    let error = Fit::<f32>::resume(&path).unwrap_err().to_string();
    assert!(error.ends_with("in its metadata, got one without"), "{error}");
}

#[test]
fn a_uniform_parameter_comes_back_as_one_and_others_are_saved_as_before() {
    let text = |file: &[u8]| {
        let (_, header) = SafeTensors::read_metadata(file).unwrap();
        text_of(&header).unwrap().to_owned()
    };
    assert!(!text(&file::<f64>()).contains("uniform"));
    let x = Parameter::new("x", Tensor::<f64>::zeros([2])).uniform();
    let list = Parameters::new().with(x).unwrap();
    let saved = Fit::new(list, FitSettings::default()).unwrap().to_bytes().unwrap();
    assert!(text(&saved).contains("\"uniform\":true"));
    let back = Fit::<f64>::from_bytes(&saved).unwrap();
    assert!(back.parameters().get("x").unwrap().is_uniform);
}

#[cfg(feature = "precondition")]
mod preconditioned {
    use super::*;
    use crate::topology::Topology;

    fn preconditioner(lambda: f64) -> Preconditioner {
        let topology = Topology::new(&[[0, 1, 2], [0, 2, 3]], 4).unwrap();
        Preconditioner::new(&topology, lambda).unwrap()
    }

    fn fit<T: Stored>(lambda: f64) -> Fit<T> {
        let start = Tensor::from_flat_fn([4, 3], |k| T::from_f64((k * k % 7) as f64));
        let v = Parameter::new("v", start).rate(0.1).preconditioned(&preconditioner(lambda));
        let list = Parameters::new().with(v).unwrap();
        Fit::new(list, FitSettings { steps: 20, ..FitSettings::default() }).unwrap()
    }

    /// A bowl around 1, 2, 3, ...
    fn bowl<T: Scalar>() -> impl Pipeline<T, Measure = ()> {
        from_fn(|tape: &Tape<T>, variables: &Variables<'_, T>| {
            let v = variables.get("v")?;
            let center = Tensor::from_flat_fn(v.shape(), |k| T::from_f64(1.0 + k as f64));
            Ok((v - tape.constant(&center)).square().sum())
        })
    }

    #[test]
    fn a_fit_resumes_to_the_same_bits_with_its_preconditioner_alone() {
        fn check<T: Stored>() {
            let mut whole = fit::<T>(2.0);
            for _ in 0..5 {
                whole.step(&mut bowl()).unwrap();
            }
            let saved = whole.to_bytes().unwrap();
            let given = preconditioner(2.0);
            let mut back = Fit::<T>::from_bytes_with(&saved, &[("v", &given)]).unwrap();
            assert_eq!(back.to_bytes().unwrap(), saved);
            // What is saved is what is learnt.
            let file = SafeTensors::deserialize(&saved).unwrap();
            let raw = whole.parameters().get("v").unwrap().raw().data();
            assert_eq!(file.tensor("raw/v").unwrap().data(), T::bytes(raw));
            for _ in 0..5 {
                let pair = [&mut whole, &mut back].map(|fit| fit.step(&mut bowl()).unwrap().loss);
                assert_eq!(pair[0].to_bits(), pair[1].to_bits());
            }
            let values = [&whole, &back].map(|fit| fit.parameters().value("v").unwrap());
            assert_eq!(values[0], values[1]);
        }
        check::<f32>();
        check::<f64>();
    }

    #[test]
    fn another_preconditioner_or_none_is_refused() {
        let saved = fit::<f64>(2.0).to_bytes().unwrap();
        let said = |given: &[(&str, &Preconditioner)]| {
            Fit::<f64>::from_bytes_with(&saved, given).unwrap_err().to_string()
        };
        let is = "a saved fit needs \"v\" with the preconditioner of lambda 2.0, edges";
        assert!(said(&[]).starts_with(is), "{}", said(&[]));
        assert!(said(&[]).ends_with("got \"v\" without a preconditioner"), "{}", said(&[]));
        let other = preconditioner(3.0);
        assert!(said(&[("v", &other)]).contains("got \"v\" with the preconditioner of lambda 3.0"));
        let right = preconditioner(2.0);
        let message = "a saved fit needs a parameter for each preconditioner, \
                       got none for that of \"w\"";
        assert_eq!(said(&[("v", &right), ("w", &right)]), message);
        let plain = file::<f64>();
        let error = Fit::<f64>::from_bytes_with(&plain, &[("x", &right)]).unwrap_err().to_string();
        assert!(error.starts_with("a saved fit needs \"x\" without a preconditioner"), "{error}");
        assert_eq!(precision_and_state(&saved).unwrap().0, "f64");
    }
}
