//! The grid of extreme cases: rows as they are found, then the files that were asked for.

use std::ops::ControlFlow;
use std::sync::PoisonError;

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use bokashi_cli::output::{is_standard_output, say, say_json};
use bokashi_report::add_page;

use super::arguments::StabilityArguments;
use crate::stability::{Row, grid, line, page, summary};

/// Runs the grid; a row that fails is a failure of the program.
pub(crate) fn run(arguments: &StabilityArguments, writing: &Writing) -> Result<(), Failure> {
    let quiet = arguments.json.as_ref().is_some_and(|file| is_standard_output(file));
    let tell = |text: &str| if quiet { Ok(()) } else { say(text) };
    let mut told = Ok(());
    let rows = grid(|row| {
        told = tell(&format!("{}\n", line(row)));
        // Nobody reads the rest.
        if told.is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    told?;
    tell(&format!("{}\n", summary(&rows)))?;
    write(arguments, &rows, writing, tell)?;
    let mut failed = rows.iter().filter(|row| !row.pass);
    match failed.next() {
        None => Ok(()),
        Some(Row { name, precision, outcome, .. }) => {
            let (count, all) = (1 + failed.count(), rows.len());
            Err(Failure::Work(format!(
                "{count} of {all} rows failed, the first: {name}, {precision}: {outcome}"
            )))
        }
    }
}

/// Writes what was asked for.
fn write(
    arguments: &StabilityArguments,
    rows: &[Row],
    writing: &Writing,
    tell: impl Fn(&str) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(file) = &arguments.json {
        let json = serde_json::to_string(rows);
        let json = json.map_err(|error| Failure::Work(format!("no JSON: {error}")))?;
        say_json(file, &json)?;
    }
    let Some(out) = &arguments.out else { return Ok(()) };
    let html = page(rows, concat!("bokashi-lab ", env!("CARGO_PKG_VERSION")));
    let failed = |error: bokashi_report::ReportError| Failure::Work(error.to_string());
    let path = add_page(out, "stability.html", &html).map_err(failed)?;
    tell(&format!("\nReport: {}\n", path.display()))
}
