//! The samples that people in this field know, with their figures, as a table, JSON and a page.

mod figures;
mod page;

use std::sync::PoisonError;

use bokashi_examples::{Request, SAMPLES, Sample};
use bokashi_report::ReportError;
use serde_json::Value;

use self::figures::Run;
use crate::arguments::SamplesArguments;
use crate::failure::{Failure, one_line};
use crate::interrupt::{Writing, end_when_interrupted};
use crate::output::{is_standard_output, say, say_json};
use crate::places::Places;
use crate::threads::start_threads;

/// The file that the report has; pictures stand in it.
const REPORT: [&str; 1] = ["samples.html"];

/// Runs the samples that `arguments` ask for.
///
/// # Errors
/// [`Failure::Work`] where a sample ran into an error; a figure that misses its goal is none.
pub(crate) fn run(arguments: &SamplesArguments) -> Result<(), Failure> {
    let json = arguments.json.as_deref().map(|file| ("--json", file));
    let files = json.into_iter().collect();
    let out = arguments.out.as_deref();
    Places { out, is_out_named: true, report: &REPORT, files, read: Vec::new() }.check()?;
    start_threads(arguments.threads)?;
    let writing = Writing::default();
    end_when_interrupted(&writing, None)?;

    let is_asked = |sample: &&Sample| {
        arguments.only.is_empty() || arguments.only.iter().any(|name| name == sample.name)
    };
    let speaks = !arguments.quiet && !arguments.json.as_deref().is_some_and(is_standard_output);
    let mut runs = Vec::new();
    for sample in SAMPLES.iter().filter(is_asked) {
        for seed in (arguments.first_seed..).take(arguments.seeds as usize) {
            let silhouettes = arguments.silhouettes.unwrap_or(sample.silhouettes);
            let options = Request { seed, silhouettes, most_steps: arguments.steps };
            let result = (sample.run)(&options).map_err(|error| one_line(&error.to_string()));
            let run = Run { sample: *sample, seed, silhouettes, result };
            if speaks {
                say(&run.lines())?;
            }
            runs.push(run);
        }
    }
    let failed = |error: ReportError| Failure::Work(error.to_string());
    let page = out.map(|_| page::page(&runs)?.render()).transpose().map_err(failed)?;
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(file) = &arguments.json {
        say_json(file, &Value::from_iter(runs.iter().flat_map(Run::json)).to_string())?;
    }
    if let (Some(page), Some(out)) = (page, out) {
        let path = page.write(out).map_err(failed)?;
        if speaks {
            say(&format!("\nReport: {}\n", path.display()))?;
        }
    }
    let failures: Vec<_> = runs.iter().filter_map(|run| run.result.as_ref().err()).collect();
    match &failures[..] {
        [] => Ok(()),
        [first, ..] => {
            let (count, all) = (failures.len(), runs.len());
            Err(Failure::Work(format!("{count} of {all} runs failed, the first: {first}")))
        }
    }
}
