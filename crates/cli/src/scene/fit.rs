//! A fit of a scene: steps, saving, what is shown meanwhile, what is written at the end.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use bokashi_fit::{FitError, Given, Ranks, agree, agreed, check_alike};
use bokashi_report::{ReportError, add_page};
use bokashi_scene::{Scene, SceneError, SceneFit, SeenView, ViewScore, lens_note};
use bokashi_write::place_below;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::outcome::{Outcome, fall, mean_held_out, values};
use super::page::{self, Curves, PAGE};
use super::pictures::{KINDS, Pictures, block, data, path};
use crate::failure::{Failure, one_line};
use crate::interrupt::{Interrupt, Writing, end_when_interrupted};
use crate::live::{Ended, Live, Snapshot, View};
use crate::output::{is_standard_output, say, say_json};
use crate::places::Places;
use crate::plain::shell_word;
use crate::threads::start_threads;

/// The file in the folder of results that a fit goes on from.
const CHECKPOINT: &str = "checkpoint.safetensors";
/// Between two checkpoints.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(60);
/// How long the live page's server waits at the end: a page asks each second.
const LAST_LOOK: Duration = Duration::from_millis(1500);
/// Between two updates of the live page's pictures.
const BETWEEN_PICTURES: Duration = Duration::from_secs(2);
/// How often held-out views are measured over a fit.
const MEASUREMENTS: u64 = 20;
/// Views on the live page.
const LIVE_VIEWS: usize = 4;
/// Points of a curve at most: of more, every second is kept.
const MOST_POINTS: usize = 4000;

/// What a fit of a scene is asked to do.
#[derive(Debug, Clone)]
pub(crate) struct Asked {
    pub(crate) scene: PathBuf,
    pub(crate) out: PathBuf,
    /// Whether the user named it.
    pub(crate) is_out_named: bool,
    /// At most so many steps, those before included.
    pub(crate) steps: Option<u64>,
    pub(crate) seconds: Option<f64>,
    /// The file to go on from; by default the checkpoint among the results.
    pub(crate) resume: Option<Option<PathBuf>>,
    /// Saved after every so many steps, too.
    pub(crate) save_every: Option<u64>,
    pub(crate) json: Option<PathBuf>,
    pub(crate) threads: Option<usize>,
    /// The port of the live page.
    pub(crate) live: Option<u16>,
    pub(crate) quiet: bool,
}

fn failed(error: SceneError) -> Failure {
    Failure::Work(error.to_string())
}

fn not_reported(error: ReportError) -> Failure {
    Failure::Work(error.to_string())
}

/// Fits the scene that is asked for; `ranks` share it. Of several, the first speaks and writes, and each
/// failure but the first rank's own is one of all.
///
/// # Errors
/// [`Failure::Use`] for places that can't be written to; [`Failure::Work`] for what is wrong with the scene;
/// [`Failure::Interrupted`] by a signal, with how to go on.
pub(crate) fn run(asked: &Asked, ranks: &Ranks<f32>) -> Result<(), Failure> {
    let interrupt = Interrupt::default();
    let ended = run_until(asked, ranks, &interrupt);
    // Whoever ends the job meanwhile does not wait. The others do wait: the first may be writing yet.
    if ranks.rank() == 0 {
        interrupt.no_more_fits();
    }
    ended
}

/// [`run`], until `interrupt` asks for the end.
fn run_until(asked: &Asked, ranks: &Ranks<f32>, interrupt: &Interrupt) -> Result<(), Failure> {
    let is_first = ranks.rank() == 0;
    let writing = Writing::default();
    let checkpoint = asked.out.join(CHECKPOINT);
    let begun = begin(asked, is_first, &writing, interrupt);
    let scene = agreed(&**ranks, begun)?;
    check_alike(&**ranks, &settings_of(asked)).map_err(|error| failed(error.into()))?;
    let bent = lens_note(&scene).map_err(|error| failed(error.into()))?;
    let notes: Vec<_> = scene.notes.iter().cloned().chain(bent).collect();
    let fit = match &asked.resume {
        Some(file) => {
            let file = file.as_ref().unwrap_or(&checkpoint);
            SceneFit::resume_among(scene, file, Arc::clone(ranks))
        }
        None => SceneFit::among(scene, Arc::clone(ranks)),
    };
    let fit = fit.map_err(failed)?;
    if is_first {
        make_folder(&asked.out).map_err(failed)?;
    }
    let speaks = is_first && !asked.quiet && !asked.json.as_deref().is_some_and(is_standard_output);
    if speaks {
        let notes = notes.into_iter().chain(changed_in_words(fit.changed()));
        notes.into_iter().try_for_each(|note| say(&format!("note: {note}\n")))?;
        if let Some(rule) = fit.ended() {
            say(&format!("note: the fit had ended when it was saved: {rule}\n"))?;
        }
        let (most, size) = (fit.most_views_per_step(), ranks.size());
        if most > 0 && most < size {
            let views = if most == 1 { "1 view".to_owned() } else { format!("{most} views") };
            let waiting = size - most;
            say(&format!(
                "note: a step draws {views}, so at least {waiting} of {size} ranks have none: \
                 a higher `views_per_step` gives them work\n"
            ))?;
        }
    }
    let live = asked.live.filter(|_| is_first).map(Live::start).transpose();
    let live = live.map_err(|error| Failure::Use(format!("--live needs a free port: {error}")))?;
    if let (Some(live), true) = (&live, speaks) {
        say(&format!("Live: {}\n", live.url()))?;
    }
    let is_quiet = asked.quiet || !is_first;
    let mut running = Running {
        first: values(&fit),
        asked,
        ranks,
        checkpoint,
        live,
        bar: bar(is_quiet, asked.steps.map_or(fit.steps(), |most| most.min(fit.steps()))),
        started: Instant::now(),
        curves: Curves::default(),
        step_ms: Vec::new(),
        losses: None,
        stage_losses: Vec::new(),
        sent: 0,
        first_step: fit.steps_done(),
        fit,
        is_trusted: true,
    };
    let ended = running.steps(interrupt);
    if let (Err(failure), Some(live)) = (&ended, &running.live) {
        let ended = Some(Ended::Failed(failure.to_string()));
        live.publish(Snapshot { ended, ..running.snapshot(&[]) });
    }
    ended.map_err(|failure| match failure {
        // It is saved already.
        Failure::Interrupted { .. } => failure,
        other => running.saved_after(other),
    })?;
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    running.finish(speaks)
}

/// So many changes since a fit was saved are named; of more, how many they are.
const MOST_CHANGES: usize = 12;

fn changed_in_words(changed: &[String]) -> Vec<String> {
    let named = changed.iter().take(MOST_CHANGES).cloned();
    let more = changed.len().saturating_sub(MOST_CHANGES);
    named
        .chain((more > 0).then(|| format!("{more} more changes since the fit was saved")))
        .collect()
}

/// What all ranks are asked alike: else they would wait for each other for ever.
fn settings_of(asked: &Asked) -> Given {
    let Asked { steps, seconds, resume, save_every, .. } = asked;
    let all = [
        ("--steps", format!("{steps:?}")),
        ("--seconds", format!("{seconds:?}")),
        ("--resume", format!("{:?}", resume.is_some())),
        ("--save-every", format!("{save_every:?}")),
    ];
    all.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// What comes before the fit.
fn begin(
    asked: &Asked,
    is_first: bool,
    writing: &Writing,
    interrupt: &Interrupt,
) -> Result<Scene, Failure> {
    if is_first {
        let json = asked.json.as_deref().map(|file| ("--json", file));
        let files = json.into_iter().collect();
        let (out, is_out_named) = (Some(asked.out.as_path()), asked.is_out_named);
        let report = &[PAGE, CHECKPOINT];
        Places { out, is_out_named, report, files, read: Vec::new() }.check()?;
    }
    start_threads(asked.threads)?;
    end_when_interrupted(writing, Some(interrupt))?;
    let scene = Scene::load(&asked.scene).map_err(failed)?;
    if is_first {
        scene.check_results(&asked.out, &results(&scene)).map_err(failed)?;
    }
    Ok(scene)
}

/// Where the files of a fit lie in the folder of results.
fn results(scene: &Scene) -> Vec<PathBuf> {
    let own = [PAGE, CHECKPOINT].map(PathBuf::from).into_iter().chain(scene.result_names());
    let views = scene.views.iter();
    own.chain(views.flat_map(|view| KINDS.map(|what| path(&view.name, what)))).collect()
}

/// A bar on a terminal.
fn bar(quiet: bool, steps: u64) -> Option<ProgressBar> {
    (!quiet && std::io::stderr().is_terminal()).then(|| {
        let bar =
            ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr_with_hz(12));
        let style =
            ProgressStyle::with_template("{pos}/{len}  {wide_bar:.blue/8}  {eta} left\n{msg}");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.progress_chars("━━─"));
        bar
    })
}

/// A fit of a scene under way, and what is known of it.
struct Running<'a> {
    asked: &'a Asked,
    ranks: &'a Ranks<f32>,
    checkpoint: PathBuf,
    live: Option<Live>,
    bar: Option<ProgressBar>,
    started: Instant,
    curves: Curves,
    step_ms: Vec<f64>,
    /// The first and the last.
    losses: Option<[f64; 2]>,
    /// Those of the stage.
    stage_losses: Vec<f64>,
    /// What all ranks together sent for gradients, in bytes.
    sent: u64,
    first: Vec<(String, bokashi_scene::Tensor<f32>)>,
    first_step: u64,
    fit: SceneFit,
    /// Whether all ranks have the same parameters, as far as is known.
    is_trusted: bool,
}

/// Why a fit ends between two steps.
enum Call {
    Signal(i32),
    Time,
}

impl Running<'_> {
    fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Steps until a rule says stop.
    fn steps(&mut self, interrupt: &Interrupt) -> Result<(), Failure> {
        let last = self.asked.steps.map_or(self.fit.steps(), |most| most.min(self.fit.steps()));
        let budget = self.asked.seconds.unwrap_or(f64::INFINITY);
        let every = (last / MEASUREMENTS).max(1);
        let (mut saved, mut shown) = (Instant::now(), None::<Instant>);
        while self.fit.steps_done() < last && self.fit.ended().is_none() {
            // No fit ends before its first step.
            let is_up = self.fit.steps_done() > 0 && self.fit.time_is_up();
            match self.call(interrupt, is_up || self.seconds() >= budget)? {
                Some(Call::Signal(signal)) => {
                    self.check_same()?;
                    return Err(self.interrupted(signal));
                }
                Some(Call::Time) => break,
                None => {}
            }
            if self.fit.steps_done().is_multiple_of(every) {
                self.measure()?;
            }
            let stage = self.fit.stage();
            let stepped = self.fit.step();
            let Some(stepped) = stepped.map_err(|error| self.failed_step(error))? else { break };
            self.sent += self.fit.bytes_sent();
            let loss = stepped.loss;
            self.step_ms.push(stepped.ms);
            if self.fit.stage() != stage {
                self.stage_losses.clear();
            }
            self.stage_losses.push(loss);
            self.losses = Some([self.losses.map_or(loss, |[first, _]| first), loss]);
            keep(&mut self.curves.losses, (self.started.elapsed().as_secs_f64(), loss));
            if let Some(bar) = &self.bar {
                let held_out = self.curves.held_out.last();
                let held_out =
                    held_out.map_or(String::new(), |(_, psnr)| format!("  held out {psnr:.1} dB"));
                bar.set_message(format!("loss {loss:.2e}{held_out}  {:.1} ms/step", stepped.ms));
                bar.set_position(self.fit.steps_done());
            }
            let every = self.asked.save_every;
            let is_asked = every.is_some_and(|every| self.fit.steps_done().is_multiple_of(every));
            if is_asked {
                self.check_same()?;
            }
            if self.is_first() && (is_asked || saved.elapsed() > BETWEEN_CHECKPOINTS) {
                // Steps are worth more than a checkpoint: there may be room again before the end.
                if let Err(error) = self.save() {
                    self.warn(&format!("the fit goes on, and was not saved: {error}"));
                }
                saved = Instant::now();
            }
            if self.live.is_some() && shown.is_none_or(|shown| shown.elapsed() > BETWEEN_PICTURES) {
                let seen = self.live_views()?;
                if let Some(live) = &self.live {
                    live.publish(self.snapshot(&seen));
                }
                shown = Some(Instant::now());
            }
        }
        self.check_same()?;
        self.measure()
    }

    /// Checks, on all ranks, that they have the same parameters: only these are worth a checkpoint.
    fn check_same(&mut self) -> Result<(), Failure> {
        self.fit.check_same().map_err(|error| self.failed_step(error))
    }

    fn is_first(&self) -> bool {
        self.ranks.rank() == 0
    }

    /// Whether the fit ends before its next step, by a signal to any rank, or where time is up on the first.
    /// All ranks are told the same.
    fn call(&self, interrupt: &Interrupt, is_up: bool) -> Result<Option<Call>, Failure> {
        let signal = interrupt.signal().map_or(0, |signal| signal.unsigned_abs() as u8);
        let all = agree::<_, Failure>(&**self.ranks, Ok(vec![signal, u8::from(is_up)]))?;
        let signal = all.iter().find_map(|said| said.first().filter(|&&signal| signal != 0));
        let is_up = all.first().is_some_and(|said| said.get(1) == Some(&1));
        Ok(signal.map(|&signal| Call::Signal(signal.into())).or(is_up.then_some(Call::Time)))
    }

    fn failed_step(&mut self, error: SceneError) -> Failure {
        self.is_trusted &= !matches!(error, SceneError::Fit(FitError::Apart { .. }));
        failed(error)
    }

    /// Saves the fit; the folder may be gone meanwhile.
    fn save(&self) -> Result<(), SceneError> {
        let failed = |error| SceneError::Write { path: self.checkpoint.clone(), error };
        self.fit.save(place_below(&self.asked.out, CHECKPOINT).map_err(failed)?)
    }

    /// Says on standard error what is wrong, above the bar.
    fn warn(&self, said: &str) {
        let said = format!("bokashi: {}", one_line(said));
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{said}")),
            None => eprintln!("{said}"),
        }
    }

    /// The command that goes on from the checkpoint.
    fn how_to_go_on(&self) -> String {
        let (scene, out) = (shell_word(&self.asked.scene), shell_word(&self.asked.out));
        let program = match self.ranks.size() {
            1 => "bokashi".to_owned(),
            size => format!("mpirun -n {size} bokashi-mpi"),
        };
        format!("go on with: {program} fit {scene} --out {out} --resume")
    }

    /// Saves the fit after something went wrong: what was learnt till then is kept.
    fn saved_after(&self, failure: Failure) -> Failure {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        // Of parameters that differ, nobody knows which are right: the last checkpoint stays.
        let is_worth = self.is_first() && self.is_trusted && self.fit.steps_done() > 0;
        match is_worth && self.save().is_ok() {
            true => self.with_how_to_go_on(failure),
            false => failure,
        }
    }

    /// What went wrong after the fit was saved.
    fn with_how_to_go_on(&self, failure: Failure) -> Failure {
        match failure {
            Failure::Work(said) => {
                Failure::Work(format!("{said}; the fit is saved, {}", self.how_to_go_on()))
            }
            other => other,
        }
    }

    /// Saves the fit, and says how to go on.
    fn interrupted(&self, signal: i32) -> Failure {
        if !self.is_first() {
            // A rank that ends may take the others with it.
            self.ranks.barrier();
            return Failure::Interrupted { signal, said: String::new() };
        }
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        let said = match self.save() {
            Ok(()) => {
                let steps = self.fit.steps_done();
                format!("interrupted after {steps} steps; {}", self.how_to_go_on())
            }
            Err(error) => format!("interrupted, and not saved: {error}"),
        };
        self.ranks.barrier();
        Failure::Interrupted { signal, said }
    }

    /// Adds a point to the curve of held-out views.
    fn measure(&mut self) -> Result<(), Failure> {
        let held_out: Vec<_> = self.views(true, usize::MAX).collect();
        let held_out = self.fit.scores(&held_out).map_err(failed)?;
        if let Some(psnr) = mean_held_out(&self.fit, &held_out) {
            let seconds = self.seconds();
            self.curves.held_out.push((seconds, psnr));
        }
        Ok(())
    }

    /// The first views of a kind that have an image, by their numbers.
    fn views(&self, is_held_out: bool, most: usize) -> impl Iterator<Item = usize> {
        let views = self.fit.scene().views.iter().enumerate();
        let asked = views.filter(move |(_, view)| view.held_out == is_held_out);
        asked.filter(|(_, view)| view.image.is_some()).map(|(at, _)| at).take(most)
    }

    fn live_views(&self) -> Result<Vec<SeenView>, Failure> {
        let held_out: Vec<_> = self.views(true, LIVE_VIEWS / 2).collect();
        let more = LIVE_VIEWS - held_out.len();
        let all = held_out.into_iter().chain(self.views(false, more));
        all.map(|view| self.fit.seen(view).map_err(failed)).collect()
    }

    /// Writes the pictures of all views. Each rank draws and writes some, of which it has one at a time in
    /// memory.
    fn save_views(&self) -> Result<Vec<ViewScore>, SceneError> {
        let scene = self.fit.scene();
        let views: Vec<_> = (0..scene.views.len()).collect();
        self.fit.scores_with(&views, |seen| {
            Pictures::of(scene, seen)?.save(&scene.views[seen.score.view].name, &self.asked.out)
        })
    }

    fn snapshot(&self, seen: &[SeenView]) -> Snapshot {
        let scene = self.fit.scene();
        let views = seen.iter().filter_map(|seen| {
            let own = &scene.views[seen.score.view];
            let Pictures { picture, target, difference } = Pictures::of(scene, seen).ok()?;
            let (target, difference) = (target?, difference?);
            let (name, held_out, psnr) = (own.name.clone(), own.held_out, seen.score.psnr);
            Some(View { name, held_out, psnr, picture, target, difference })
        });
        let model = self.fit.learnt().and_then(|learnt| learnt.model()).ok();
        let mesh = model.and_then(|model| data(&model).ok());
        Snapshot {
            title: scene.path.display().to_string(),
            step: self.fit.steps_done(),
            first_step: self.first_step,
            steps: self.asked.steps.map_or(self.fit.steps(), |most| most.min(self.fit.steps())),
            seconds: self.seconds(),
            loss: self.losses.map_or(f64::NAN, |[_, last]| last),
            losses: self.curves.losses.clone(),
            held_out: self.curves.held_out.clone(),
            views: views.collect(),
            mesh: mesh.map(|mesh| Arc::from(mesh.into_bytes())),
            ended: None,
        }
    }

    /// Saves the fit, then writes all that came out: pictures on all ranks, the rest on the first.
    fn finish(&self, speaks: bool) -> Result<(), Failure> {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        let saved = if self.is_first() { self.save().map_err(failed) } else { Ok(()) };
        agreed(&**self.ranks, saved)?;
        let time = self.started.elapsed();
        let scores = self.save_views().map_err(failed);
        let written = match self.is_first() {
            true => scores.and_then(|scores| self.write(time, scores, speaks)),
            false => scores.map(drop),
        };
        let written = written.map_err(|failure| self.with_how_to_go_on(failure));
        agreed(&**self.ranks, written)
    }

    fn write(&self, time: Duration, scores: Vec<ViewScore>, speaks: bool) -> Result<(), Failure> {
        let [loss_initial, loss_final] = self.losses.unwrap_or([f64::NAN; 2]);
        let left_out = match scores.first() {
            Some(score) => self.fit.left_out(score.view).map_err(failed)?,
            None => Vec::new(),
        };
        let outcome = Outcome {
            loss_initial,
            loss_final,
            steps: self.fit.steps_done(),
            steps_before: self.first_step,
            time,
            step_ms: self.step_ms.clone(),
            first: self.first.clone(),
            scores,
            left_out,
            fell: fall(&self.stage_losses),
        };
        if let Some(live) = &self.live {
            let said = outcome.said();
            live.publish(Snapshot {
                ended: Some(Ended::Done(said)),
                ..self.snapshot(&self.live_views()?)
            });
        }
        let learnt = self.fit.learnt().map_err(failed)?;
        learnt.save_results(&self.asked.out).map_err(failed)?;
        let model = learnt.model().map_err(failed)?;
        let viewer = match model.geometries.is_empty() {
            true => None,
            false => Some(block(&model, "Drag to turn, roll to zoom.").map_err(not_reported)?),
        };
        let html = page::render(&self.fit, &outcome, &self.curves, viewer);
        let page = add_page(&self.asked.out, PAGE, &html.map_err(not_reported)?);
        let page = page.map_err(not_reported)?;
        if let Some(file) = &self.asked.json {
            say_json(file, &outcome.json(&self.fit).to_string())?;
        }
        if speaks {
            let loss = self.losses.map_or(String::new(), |[initial, last]| {
                format!(": loss {initial:.2e} to {last:.2e}")
            });
            let held_out = outcome
                .psnr_held_out(&self.fit)
                .map_or(String::new(), |psnr| format!(", held-out views {psnr:.1} dB"));
            let ranks = match self.ranks.size() {
                1 => String::new(),
                size => {
                    let steps = (self.step_ms.len() as u64).max(1);
                    format!(", {size} ranks sent {} bytes per step", self.sent / steps)
                }
            };
            let said = outcome.said();
            say(&format!("{said}{loss}{held_out}{ranks}\n"))?;
            let ended = self.fit.ended().map(|rule| format!("It ended by a rule: {rule}."));
            let held_out = outcome.held_out_in_words(&self.fit).map(str::to_owned);
            let more = [ended, outcome.fell_in_words(), outcome.worst_in_words(&self.fit)];
            for words in more.into_iter().chain([held_out]).flatten() {
                say(&format!("{words}\n"))?;
            }
            say(&format!("Report: {}\n", page.display()))?;
        }
        if self.live.is_some() {
            std::thread::sleep(LAST_LOOK);
        }
        Ok(())
    }
}

fn make_folder(path: &Path) -> Result<(), SceneError> {
    let failed = |error| SceneError::Write { path: path.to_owned(), error };
    std::fs::create_dir_all(path).map_err(failed)
}

/// Adds a point to a curve, which stays short.
fn keep(curve: &mut Vec<(f64, f64)>, point: (f64, f64)) {
    if curve.len() >= MOST_POINTS {
        let mut at = 0;
        curve.retain(|_| {
            at += 1;
            at % 2 == 1
        });
    }
    curve.push(point);
}
