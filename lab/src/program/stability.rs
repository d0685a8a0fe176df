//! The grid of extreme cases: rows as they are found, then the files that were asked for.

use std::ops::ControlFlow;

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use bokashi_cli::output::say;

use super::arguments::Files;
use super::files::failed;
use crate::stability::{Row, grid, line, page, summary};

/// Runs the grid; a row that fails is a failure of the program.
pub(crate) fn run(files: &Files, writing: &Writing) -> Result<(), Failure> {
    let mut printed = Ok(());
    let rows = grid(|row| {
        if !files.is_json_alone() {
            printed = say(&format!("{}\n", line(row)));
        }
        // Nobody reads the rest.
        if printed.is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    printed?;
    let text = format!("{}\n", summary(&rows));
    files.write(&rows, &text, |about| page(&rows, about), writing)?;
    let mut wrong = rows.iter().filter(|row| !row.pass);
    match wrong.next() {
        None => Ok(()),
        Some(Row { name, precision, outcome, .. }) => {
            let (count, all) = (1 + wrong.count(), rows.len());
            Err(failed(format!(
                "{count} of {all} rows failed, the first: {name}, {precision}: {outcome}"
            )))
        }
    }
}
