//! Doing what was asked: the fits, the report, the JSON, the last words.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Arc, PoisonError};

use bokashi_fit::{Alone, Ranks};
use bokashi_paper::page::Report;
use bokashi_paper::run_cube_saving;
use bokashi_report::ReportError;
use bokashi_scene::limit_memory;

use crate::about::about;
use crate::arguments::{Command, CubeRequest, FitArguments, Request, USUAL_OUT};
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
use crate::summary::Summary;
use crate::threads::start_threads;

/// The files that every report has.
const REPORT: [&str; 3] = ["index.html", "fits.csv", "histories.csv"];

/// Does all that `request` asks for.
pub fn run(request: &Request) -> Result<(), Failure> {
    request.memory().into_iter().for_each(limit_memory);
    match &request.command {
        Some(Command::Samples(arguments)) => return samples::run(arguments),
        Some(Command::Render(own)) => {
            let (view, threads) = (own.view.as_deref(), own.threads);
            let out = own.out.as_deref().unwrap_or(Path::new(USUAL_OUT));
            let is_named = own.out.is_some();
            return scene::render(&own.scene, view, out, is_named, threads, own.quiet);
        }
        Some(Command::Fit(own)) => {
            let alone: Ranks<f32> = Arc::new(Alone);
            return scene::run(&scene_fit(own), &alone);
        }
        Some(Command::Inspect(arguments)) => return inspect::run(arguments),
        Some(Command::New(arguments)) => return new::run(arguments),
        Some(Command::Completions(own)) => return manual::completions(own),
        Some(Command::Man(own)) => return manual::man(own),
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
        Some(Command::Fit(own)) => scene::run(&scene_fit(own), ranks),
        _ => Err(Failure::Use("ranks share a fit of a scene: fit SCENE.TOML".to_owned())),
    }
}

/// The fit of a scene that is asked for.
fn scene_fit(own: &FitArguments) -> scene::FitOptions {
    scene::FitOptions {
        scene: own.scene.clone(),
        out: own.out.clone().unwrap_or_else(|| USUAL_OUT.into()),
        is_out_named: own.out.is_some(),
        steps: own.steps,
        seconds: own.time,
        resume: own.resume.clone(),
        save_every: own.save_every,
        json: own.json.clone(),
        threads: own.threads,
        live: own.live,
        quiet: own.quiet,
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
    let mut report = request.out().map(|_| Report::new(about("bokashi")));
    let (mut summary, mut json, mut failures) = (Summary::default(), None, Vec::new());
    let mut bar = Bar::new(plan, quiet);
    for (at, planned) in plan.iter().enumerate() {
        let (settings, name) = (&planned.settings, name(planned, at + 1, plan.len()));
        bar.begin(settings, &name);
        let outcome = run_cube_saving(settings, &saving, &mut |progress| {
            bar.step(&progress);
            match interrupt.signal() {
                Some(_) => ControlFlow::Break(()),
                None => ControlFlow::Continue(()),
            }
        });
        bar.end(settings.steps);
        if let (Some(file), Some(signal), Ok(outcome)) =
            (&saving.save, interrupt.signal(), &outcome)
            && outcome.steps < settings.steps
        {
            bar.clear();
            let message = format!(
                "interrupted at step {} of {}; it goes on with: bokashi paper fit --resume {}",
                outcome.steps,
                settings.steps,
                shell_word(file)
            );
            return Err(Failure::Interrupted { signal, message });
        }
        if let Some(alternative) = planned.alternative {
            // An error is what such a fit may be there to show.
            if let Some(report) = &mut report {
                report.add_alternative(alternative, settings, outcome);
            }
            continue;
        }
        match outcome {
            Ok(outcome) => {
                summary.add(settings, &outcome);
                if request.json().is_some() {
                    let text = serde_json::to_string(&outcome);
                    json = Some(text.map_err(|error| Failure::Work(format!("no JSON: {error}")))?);
                }
                if let Some(report) = &mut report {
                    report.add(settings, outcome);
                }
            }
            Err(error) => {
                if let Some(report) = &mut report {
                    report.add_failure(settings, &error);
                }
                failures.push(format!("{name}: {error}"));
            }
        }
    }
    bar.say("writing");
    let written = write(request, report.as_ref(), json.as_deref(), writing);
    bar.clear();
    let page = written?;
    if !quiet && !request.json().is_some_and(is_standard_output) {
        let page = page.map(|page| format!("\nReport: {page}\n")).unwrap_or_default();
        say(&format!("{}{page}", summary.table()))?;
    }
    match &failures[..] {
        [] => Ok(()),
        [only] if plan.len() == 1 => Err(Failure::Work(only.clone())),
        [first, ..] => {
            let (count, all) = (failures.len(), plan.len());
            Err(Failure::Work(format!("{count} of {all} fits failed, the first: {first}")))
        }
    }
}

/// Writes what was asked for; returns the path of the report's page.
fn write(
    request: &CubeRequest<'_>,
    report: Option<&Report>,
    json: Option<&str>,
    writing: &Writing,
) -> Result<Option<String>, Failure> {
    let failed = |error: ReportError| Failure::Work(error.to_string());
    let report = report.filter(|report| !report.is_empty());
    let rendered = report.map(Report::render).transpose().map_err(failed)?;
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    if let (Some(file), Some(json)) = (request.json(), json) {
        say_json(file, json)?;
    }
    let (Some(rendered), Some(out)) = (rendered, request.out()) else { return Ok(None) };
    let page = rendered.write(out).map_err(failed)?;
    Ok(Some(page.display().to_string()))
}
