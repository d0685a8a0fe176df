//! A fit of a scene: what comes before it, its rules and listeners, and how it ends.

use std::cell::RefCell;
use std::path::Path;
use std::sync::PoisonError;

use bokashi_fit::{FitError, Given, Listener, Ranks, Rules, Stop, drive};
use bokashi_scene::{Scene, SceneError, SceneFit, capped_note, lens_note};

use super::checkpoint::{CHECKPOINT, Checkpoint, save};
use super::film::Film;
use super::live_page::LivePage;
use super::outcome::values;
use super::progress_bar::Bar;
use super::record::{Record, Recorder, held_out};
use super::results::{Results, files, save_views};
use crate::arguments::FitArguments;
use crate::failure::Failure;
use crate::interrupt::{Interrupt, Writing, end_when_interrupted};
use crate::live::{Ended, Live};
use crate::output::{is_standard_output, say};
use crate::places::Places;
use crate::plain::shell_word;
use crate::threads::start_threads;

/// Fits a scene; `ranks` share it. Of several, the first speaks and writes, and each failure but the first rank's
/// own is one of all.
///
/// # Errors
/// [`Failure::Use`] for places that can't be written to; [`Failure::Work`] for what is wrong with the scene;
/// [`Failure::Interrupted`] by a signal, with how to go on.
pub(crate) fn run(options: &FitArguments, ranks: &Ranks<f32>) -> Result<(), Failure> {
    let interrupt = Interrupt::default();
    let ended = run_until(options, ranks, &interrupt);
    // Whoever ends the job meanwhile does not wait. The others do wait: the first may be writing yet.
    if ranks.rank() == 0 {
        interrupt.no_more_fits();
    }
    ended
}

/// [`run`], until `interrupt` asks for the end.
fn run_until(
    options: &FitArguments,
    ranks: &Ranks<f32>,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let writing = Writing::default();
    let checkpoint = options.out().join(CHECKPOINT);
    let resume = options.resume.as_ref().map(|file| file.as_deref().unwrap_or(&checkpoint));
    let load = |is_first| begin(options, is_first, &writing, interrupt);
    let mut fit = SceneFit::begin_among(ranks, &settings_of(options), resume, load)?;
    let is_quiet = options.quiet || options.json.as_deref().is_some_and(is_standard_output);
    let speaks = fit.is_first() && !is_quiet;
    let notes = if speaks { notes(&fit)? } else { Vec::new() };
    if fit.is_first() {
        make_folder(options.out())?;
    }
    notes.into_iter().try_for_each(|note| say(&format!("note: {note}\n")))?;
    let live = options.live.filter(|_| fit.is_first()).map(Live::start).transpose();
    let live = live.map_err(|error| Failure::Use(format!("--live needs a free port: {error}")))?;
    if let (Some(live), true) = (&live, speaks) {
        say(&format!("Live: {}\n", live.url()))?;
    }
    let first = values(&fit);
    let steps = options.steps.map_or(fit.steps(), |most| most.min(fit.steps()));
    let record = RefCell::new(Record::new(&fit));
    let film = Film::default();
    let mut page = live.map(|live| LivePage::new(live, steps, &record));
    let stop = steps_of(&mut fit, options, steps, interrupt, (&record, &film), page.as_mut());
    // Of parameters that differ, nobody knows which are right: the last checkpoint stays.
    let is_trusted = !matches!(stop, Err(SceneError::Fit(FitError::Apart { .. })));
    let failure = match stop {
        Ok(Stop::Interrupted(signal)) => Some(interrupted(&fit, options, signal)),
        Ok(_) => None,
        Err(error) => Some(Failure::from(error)),
    };
    if let Some(failure) = failure {
        if let Some(page) = &page {
            page.show(&fit, Some(Ended::Failed(failure.to_string())))?;
        }
        let is_saved = matches!(failure, Failure::Interrupted { .. });
        // What was learnt till then is kept.
        let is_worth = !is_saved && is_trusted && fit.steps_done() > 0;
        return Err(match is_worth && save(&fit, options.out()).is_ok() {
            true => with_how_to_go_on(failure, &fit, options),
            false => failure,
        });
    }
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    fit.on_first(|| Ok::<_, Failure>(save(&fit, options.out())?))?;
    let (out, json, page) = (options.out(), options.json.as_deref(), page.as_ref());
    let record = record.borrow();
    let time = record.started.elapsed();
    let has_turntable = options.turntable;
    let results = Results { out, json, page, film: &film, has_turntable, speaks, time };
    // What is saved knows nothing of it: a fit that goes on ends with the same bits.
    let written = fit.align().and_then(|()| save_views(&fit, out)).map_err(Failure::from);
    let written =
        written.and_then(|scores| fit.on_first(|| results.write(&fit, &record, &first, scores)));
    written.map_err(|failure| with_how_to_go_on(failure, &fit, options))
}

/// Steps until a rule says stop, with `steps` in all.
fn steps_of(
    fit: &mut SceneFit,
    options: &FitArguments,
    steps: u64,
    interrupt: &Interrupt,
    (record, film): (&RefCell<Record>, &Film),
    page: Option<&mut LivePage<'_>>,
) -> Result<Stop, SceneError> {
    let mut recorder = Recorder(record);
    let mut bar = Bar::new(options.quiet || !fit.is_first(), steps, record);
    let mut checkpoint = Checkpoint::new(options.out(), options.save_every, bar.warner());
    let (mut held_out, mut film) = (held_out(steps, record), film.listener(steps));
    let mut listeners: Vec<&mut dyn Listener<SceneFit>> =
        vec![&mut recorder, &mut bar, &mut checkpoint];
    listeners.extend(page.map(|page| page as &mut dyn Listener<SceneFit>));
    listeners.extend([&mut held_out as &mut dyn Listener<SceneFit>, &mut film]);
    let signal = || interrupt.signal();
    let rules = Rules { steps: Some(steps), seconds: options.time, interrupt: Some(&signal) };
    drive(fit, &rules, &mut listeners)
}

/// What to know of a fit before its first step.
fn notes(fit: &SceneFit) -> Result<Vec<String>, Failure> {
    let scene = fit.scene();
    let bent = lens_note(scene).map_err(SceneError::from)?;
    let mut notes: Vec<_> = scene.notes.iter().cloned().chain(bent).collect();
    notes.extend(capped_note(scene)?);
    notes.extend(fit.starts().iter().cloned());
    notes.extend(changes(fit.changed()));
    let ended = fit.ended();
    notes.extend(ended.map(|rule| format!("the fit had ended when it was saved: {rule}")));
    let (most, size) = (fit.most_views_per_step(), fit.size());
    if most > 0 && most < size {
        let views = if most == 1 { "1 view".to_owned() } else { format!("{most} views") };
        let waiting = size - most;
        notes.push(format!(
            "a step draws {views}, so at least {waiting} of {size} ranks have none: a higher \
             `views_per_step` gives them work"
        ));
    }
    Ok(notes)
}

/// So many changes since a fit was saved are named; of more, how many they are.
const MOST_CHANGES: usize = 12;

fn changes(changed: &[String]) -> Vec<String> {
    let named = changed.iter().take(MOST_CHANGES).cloned();
    let more = changed.len().saturating_sub(MOST_CHANGES);
    named
        .chain((more > 0).then(|| format!("{more} more changes since the fit was saved")))
        .collect()
}

/// What has to be the same on all ranks.
fn settings_of(options: &FitArguments) -> Given {
    let FitArguments { steps, time, resume, save_every, .. } = options;
    let all = [
        ("--steps", format!("{steps:?}")),
        ("--time", format!("{time:?}")),
        ("--resume", format!("{:?}", resume.is_some())),
        ("--save-every", format!("{save_every:?}")),
    ];
    all.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// What comes before the fit.
fn begin(
    options: &FitArguments,
    is_first: bool,
    writing: &Writing,
    interrupt: &Interrupt,
) -> Result<Scene, Failure> {
    if is_first {
        let json = options.json.as_deref().map(|file| ("--json", file));
        let named = json.into_iter().collect();
        let (out, is_out_named) = (Some(options.out()), options.out.is_some());
        let report = &["index.html", CHECKPOINT];
        Places { out, is_out_named, report, files: named, read: Vec::new() }.check()?;
    }
    start_threads(options.threads)?;
    end_when_interrupted(writing, Some(interrupt))?;
    let scene = Scene::load(&options.scene)?;
    if is_first {
        scene.check_results(options.out(), &files(&scene, options.turntable))?;
    }
    Ok(scene)
}

/// Saves the fit on a signal, and says how to go on. No rank ends before: it may take the others with it.
fn interrupted(fit: &SceneFit, options: &FitArguments, signal: i32) -> Failure {
    let saved = fit.on_first(|| Ok::<_, Failure>(save(fit, options.out())?));
    let message = match saved {
        Ok(()) => {
            let steps = fit.steps_done();
            format!("interrupted after {steps} steps; {}", how_to_go_on(fit, options))
        }
        Err(error) => format!("interrupted, and not saved: {error}"),
    };
    Failure::Interrupted { signal, message }
}

/// The command that goes on from the checkpoint.
fn how_to_go_on(fit: &SceneFit, options: &FitArguments) -> String {
    let (scene, out) = (shell_word(&options.scene), shell_word(options.out()));
    let program = match fit.size() {
        1 => "bokashi".to_owned(),
        size => format!("mpirun -n {size} bokashi-mpi"),
    };
    format!("go on with: {program} fit {scene} --out {out} --resume")
}

/// What went wrong after the fit was saved.
fn with_how_to_go_on(failure: Failure, fit: &SceneFit, options: &FitArguments) -> Failure {
    match failure {
        Failure::Work(message) => {
            let how = how_to_go_on(fit, options);
            Failure::Work(format!("{message}; the fit is saved, {how}"))
        }
        other => other,
    }
}

fn make_folder(path: &Path) -> Result<(), SceneError> {
    let failed = |error| SceneError::Write { path: path.to_owned(), error };
    std::fs::create_dir_all(path).map_err(failed)
}
