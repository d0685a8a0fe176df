//! Doing what was asked: the fits, the report, the JSON, the last words.

use std::ops::ControlFlow;
use std::sync::{Arc, PoisonError};

use bokashi_fit::{Alone, Ranks};
use bokashi_paper::page::Report;
use bokashi_paper::{CubeSettings, Outcome, Saving, run_cube_saving};
use bokashi_report::ReportError;
use bokashi_scene::limit_memory;

use crate::about::about;
use crate::arguments::{Command, CubeRequest, Request};
use crate::failure::Failure;
use crate::inspect;
use crate::interrupt::{Interrupt, Writing, end_when_interrupted};
use crate::manual;
use crate::new;
use crate::output::{is_standard_output, say, say_json};
use crate::places::Places;
use crate::plain::shell_word;
use crate::plan::{Planned, plan};
use crate::progress::{Bar, name};
use crate::samples;
use crate::scene;
use crate::threads::start_threads;

/// The files that every report has.
const REPORT: [&str; 3] = ["index.html", "fits.csv", "histories.csv"];

/// Does all that `request` asks for.
pub fn run(request: &Request) -> Result<(), Failure> {
    request.memory().into_iter().for_each(limit_memory);
    match &request.command {
        Some(Command::Samples(arguments)) => return samples::run(arguments),
        Some(Command::Render(arguments)) => return scene::render(arguments),
        Some(Command::Fit(_)) => return run_among(request, &(Arc::new(Alone) as Ranks<f32>)),
        Some(Command::Inspect(arguments)) => return inspect::run(arguments),
        Some(Command::New(arguments)) => return new::run(arguments),
        Some(Command::Completions(arguments)) => return manual::completions(arguments),
        Some(Command::Man(arguments)) => return manual::man(arguments),
        Some(Command::Paper(_)) | None => {}
    }
    request.cube().map_or(Ok(()), |cube| fit_cubes(&cube))
}

/// Does fits of the cube.
fn fit_cubes(request: &CubeRequest<'_>) -> Result<(), Failure> {
    let saving = request.saving();
    let json = request.json().map(|file| ("--json", file));
    let save = saving.save.as_deref().map(|file| ("--save", file));
    Places {
        out: request.out(),
        is_out_named: request.common.out.is_some(),
        report: &REPORT,
        files: json.into_iter().chain(save).collect(),
        read: saving.resume.as_deref().map(|file| ("--resume", file)).into_iter().collect(),
    }
    .check()?;
    let plan = plan(request)?;
    start_threads(request.common.threads)?;
    let (writing, interrupt) = (Writing::default(), Interrupt::default());
    end_when_interrupted(&writing, saving.save.is_some().then_some(&interrupt))?;
    fit_all(request, &plan, &writing, &interrupt)
}

/// Does what `request` asks for where that is a fit of a scene, which `ranks` share. Of several, the first
/// speaks and writes; a failure of another one is a failure of all, which the first tells.
///
/// # Errors
/// As [`run`]; [`Failure::Use`] for a request that ranks do not share.
pub fn run_among(request: &Request, ranks: &Ranks<f32>) -> Result<(), Failure> {
    request.memory().into_iter().for_each(limit_memory);
    match &request.command {
        Some(Command::Fit(arguments)) => scene::run(arguments, ranks),
        _ => Err(Failure::Use("ranks share a fit of a scene: fit SCENE.TOML".to_owned())),
    }
}

/// Every fit, one after the other, so that none disturbs another's times.
fn fit_all(
    request: &CubeRequest<'_>,
    plan: &[Planned],
    writing: &Writing,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let saving = request.saving();
    let quiet = request.common.quiet;
    let mut report = Report::new(about("bokashi"));
    let (mut json, mut failures) = (None, Vec::new());
    let mut bar = Bar::new(plan, quiet);
    for (index, planned) in plan.iter().enumerate() {
        let (settings, name) = (&planned.settings, name(planned, index + 1, plan.len()));
        bar.begin(settings, &name);
        let outcome = run_cube_saving(settings, &saving, &mut |progress| {
            bar.step(&progress);
            match interrupt.signal() {
                Some(_) => ControlFlow::Break(()),
                None => ControlFlow::Continue(()),
            }
        });
        bar.end(settings.steps);
        if let (Some(signal), Ok(outcome)) = (interrupt.signal(), &outcome)
            && let Some(failure) = interrupted(&saving, settings, outcome, signal)
        {
            bar.clear();
            return Err(failure);
        }
        if let Some(alternative) = planned.alternative {
            // An error is what such a fit may be there to show.
            report.add_alternative(alternative, settings, outcome);
            continue;
        }
        match outcome {
            Ok(outcome) => {
                if request.json().is_some() {
                    let text = serde_json::to_string(&outcome);
                    json = Some(text.map_err(|error| Failure::Work(format!("no JSON: {error}")))?);
                }
                report.add(settings, outcome);
            }
            Err(error) => {
                report.add_failure(settings, &error);
                failures.push(format!("{name}: {error}"));
            }
        }
    }
    bar.say("writing");
    let written = write(request, &report, json.as_deref(), writing);
    bar.clear();
    let page = written?;
    if !quiet && !request.json().is_some_and(is_standard_output) {
        let page = page.map(|page| format!("\nReport: {page}\n")).unwrap_or_default();
        say(&format!("{}{page}", report.summary()))?;
    }
    first_of(&failures, plan.len())
}

/// What `failures` of `all` fits mean for the run.
fn first_of(failures: &[String], all: usize) -> Result<(), Failure> {
    match failures {
        [] => Ok(()),
        [only] if all == 1 => Err(Failure::Work(only.clone())),
        [first, ..] => {
            let count = failures.len();
            Err(Failure::Work(format!("{count} of {all} fits failed, the first: {first}")))
        }
    }
}

/// How a saved fit goes on that a signal has ended before its last step.
fn interrupted(
    saving: &Saving,
    settings: &CubeSettings,
    outcome: &Outcome,
    signal: i32,
) -> Option<Failure> {
    let file = saving.save.as_ref().filter(|_| outcome.steps < settings.steps)?;
    let (step, steps, file) = (outcome.steps, settings.steps, shell_word(file));
    let how = format!("it goes on with: bokashi paper fit --resume {file}");
    let message = format!("interrupted at step {step} of {steps}; {how}");
    Some(Failure::Interrupted { signal, message })
}

/// Writes what was asked for; returns the path of the report's page.
fn write(
    request: &CubeRequest<'_>,
    report: &Report,
    json: Option<&str>,
    writing: &Writing,
) -> Result<Option<String>, Failure> {
    let failed = |error: ReportError| Failure::Work(error.to_string());
    let out = request.out().filter(|_| !report.is_empty());
    let rendered = out.map(|_| report.render()).transpose().map_err(failed)?;
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    if let (Some(file), Some(json)) = (request.json(), json) {
        say_json(file, json)?;
    }
    let (Some(rendered), Some(out)) = (rendered, out) else { return Ok(None) };
    let page = rendered.write(out).map_err(failed)?;
    Ok(Some(page.display().to_string()))
}
