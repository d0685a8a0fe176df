//! Doing what was asked: the fits, the report, the JSON, the last words.

use std::fs;
use std::io::{self, Write as _};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bokashi_paper::page::{About, Report};
use bokashi_paper::{Saving, run_cube_saving};
use bokashi_report::ReportError;
use bokashi_write::{check_folder, write_whole};
use rayon::{ThreadPoolBuildError, ThreadPoolBuilder};

use crate::arguments::{Command, Request};
use crate::failure::{Failure, INTERRUPTED};
use crate::plan::{Planned, plan};
use crate::progress::{Bar, name};
use crate::summary::Summary;

/// Held while files are written: a program that is interrupted finishes them first.
pub type Writing = Arc<Mutex<()>>;

/// Set by the first interrupt of a fit that is saved: it then ends at its next step.
pub type Interrupt = Arc<AtomicBool>;

/// Does all that `request` asks for.
pub fn run(request: &Request) -> Result<(), Failure> {
    if let Some(out) = request.out() {
        check_folder_of_out(&out)?;
    }
    if let Some(file) = request.json().filter(|file| !is_standard_output(file)) {
        check_file(file, "--json")?;
    }
    if let Some(file) = request.save() {
        check_file(file, "--save")?;
    }
    let writing = Writing::default();
    let Some(threads) = request.threads() else { return work(request, &writing) };
    pool(threads, ThreadPoolBuilder::build)?.install(|| work(request, &writing))
}

/// What `build` makes of `threads` threads: a pool, or the global one.
///
/// # Errors
/// [`Failure::Work`] where they can't be started.
pub fn pool<P>(
    threads: usize,
    build: impl FnOnce(ThreadPoolBuilder) -> Result<P, ThreadPoolBuildError>,
) -> Result<P, Failure> {
    build(ThreadPoolBuilder::new().num_threads(threads))
        .map_err(|error| Failure::Work(format!("{threads} threads could not be started: {error}")))
}

/// Does what the command says.
fn work(request: &Request, writing: &Writing) -> Result<(), Failure> {
    let plan = plan(request)?;
    let interrupt = Interrupt::default();
    end_when_interrupted(writing, request.save().map(|_| &interrupt))?;
    fit_all(request, &plan, writing, &interrupt)
}

/// Every fit, one after the other, so that none disturbs another's times.
fn fit_all(
    request: &Request,
    plan: &[Planned],
    writing: &Writing,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let saving = saving(request);
    let quiet = request.common().quiet;
    let mut report = request.out().map(|_| Report::new(about("bokashi")));
    let (mut summary, mut json, mut failures) = (Summary::default(), Vec::new(), Vec::new());
    let mut bar = Bar::new(plan, quiet);
    for (at, planned) in plan.iter().enumerate() {
        let (settings, name) = (&planned.settings, name(planned, at + 1, plan.len()));
        bar.begin(settings, &name);
        let outcome = run_cube_saving(settings, &saving, &mut |progress| {
            bar.step(&progress);
            match interrupt.load(Ordering::Relaxed) {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        });
        bar.end(settings.steps);
        if let (Some(file), Ok(outcome)) = (request.save(), &outcome)
            && interrupt.load(Ordering::Relaxed)
            && outcome.steps < settings.steps
        {
            bar.clear();
            return Err(Failure::Interrupted(format!(
                "interrupted at step {} of {}; it goes on with: bokashi fit --resume {}",
                outcome.steps,
                settings.steps,
                file.display()
            )));
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
                    json = serde_json::to_vec(&outcome)
                        .map_err(|error| Failure::Work(format!("no JSON: {error}")))?;
                    json.push(b'\n');
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
    let written = write(request, report.as_ref(), &json, writing);
    bar.clear();
    let page = written?;
    if !quiet && !request.json().is_some_and(|file| is_standard_output(file)) {
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

/// Where fits are saved, and what they go on from.
fn saving(request: &Request) -> Saving {
    match &request.command {
        Some(Command::Fit(fit)) => {
            Saving { resume: fit.resume.clone(), save: fit.save.clone(), every: fit.save_every }
        }
        _ => Saving::default(),
    }
}

/// Writes what was asked for; returns the path of the report's page.
fn write(
    request: &Request,
    report: Option<&Report>,
    json: &[u8],
    writing: &Writing,
) -> Result<Option<String>, Failure> {
    let failed = |error: ReportError| Failure::Work(error.to_string());
    let report = report.filter(|report| !report.is_empty());
    let rendered = report.map(Report::render).transpose().map_err(failed)?;
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(file) = request.json().filter(|_| !json.is_empty()) {
        if is_standard_output(file) {
            say_bytes(json)?;
        } else {
            let said = |error| Failure::Work(format!("{} not written: {error}", file.display()));
            write_whole(file, json).map_err(said)?;
        }
    }
    let (Some(rendered), Some(out)) = (rendered, request.out()) else { return Ok(None) };
    let page = rendered.write(&out).map_err(failed)?;
    Ok(Some(page.display().to_string()))
}

/// What a report says of this run of `program`.
pub fn about(program: &str) -> About {
    let arguments = std::env::args_os().skip(1);
    let words: Vec<_> = arguments.map(|word| word.to_string_lossy().into_owned()).collect();
    About {
        program: format!("{program} {}", env!("CARGO_PKG_VERSION")),
        command: format!("{program} {}", words.join(" ")).trim_end().to_owned(),
        threads: rayon::current_num_threads(),
    }
}

/// Whether `--json` names standard output.
pub fn is_standard_output(file: &Path) -> bool {
    file == Path::new("-")
}

/// Whether the folder that `--out` names could be written to.
///
/// # Errors
/// [`Failure::Use`] where it can't.
pub fn check_folder_of_out(out: &Path) -> Result<(), Failure> {
    let said = |error| Failure::Use(format!("--out needs a folder to write to: {error}"));
    check_folder(out).map_err(said)
}

/// Whether a file could be written, before hours are spent on what it should hold.
pub fn check_file(file: &Path, option: &str) -> Result<(), Failure> {
    let said = |rule: String| Failure::Use(format!("{option} needs a file to write to: {rule}"));
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    if fs::metadata(file).is_ok_and(|found| found.is_dir()) || file.file_name().is_none() {
        return Err(said(format!("{} is a folder", file.display())));
    }
    if !folder.is_dir() {
        return Err(said(format!("{} is not a folder", folder.display())));
    }
    check_folder(folder).map_err(|error| said(error.to_string()))
}

/// Ends the program at an interrupt, but never between the halves of a file. A fit that is saved
/// is asked to end, and the program ends at the second interrupt only.
pub fn end_when_interrupted(writing: &Writing, saved: Option<&Interrupt>) -> Result<(), Failure> {
    let (writing, saved) = (Arc::clone(writing), saved.map(Arc::clone));
    let end = move || {
        if saved.as_ref().is_some_and(|interrupt| !interrupt.swap(true, Ordering::Relaxed)) {
            return;
        }
        let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
        std::process::exit(i32::from(INTERRUPTED));
    };
    ctrlc::set_handler(end).map_err(|error| Failure::Work(error.to_string()))
}

/// Writes to standard output. A reader that went away is no failure.
pub fn say(text: &str) -> Result<(), Failure> {
    say_bytes(text.as_bytes())
}

/// Writes bytes to standard output. A reader that went away is no failure.
pub fn say_bytes(bytes: &[u8]) -> Result<(), Failure> {
    let mut output = io::stdout().lock();
    match output.write_all(bytes).and_then(|()| output.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::Work(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}
