//! What is measured of a fit: its columns in all tables, and the CSV files of all fits and of their histories.
//!
//! In the table of fits, numbers are written so that reading them gives the same bits; in that
//! of histories, with five digits. What does not apply, or is not a number, is an empty field.

use bokashi_report::{Cell, Column, Table};

use super::digest::{Fit, Quantity};

/// A column of a table of fits: its name for people, its name for programs, and its number.
type Number = (Column, fn(&Fit) -> Cell);

/// What is measured of a fit.
pub(crate) const NUMBERS: [Number; 13] = [
    (("vertex error at the end", "vertex_error_final"), |fit| {
        Cell::maybe(fit.outcome.vertex_error_final)
    }),
    (("at the start", "vertex_error_initial"), |fit| Cell::maybe(fit.outcome.vertex_error_initial)),
    (("largest of last tenth", "vertex_error_tail"), |fit| {
        Cell::maybe(fit.outcome.vertex_error_tail)
    }),
    (("without renaming", "vertex_error_plain"), |fit| Cell::maybe(fit.outcome.vertex_error_plain)),
    (("colour error", "color_error_final"), |fit| Cell::maybe(fit.outcome.color_error_final)),
    (("sigma", "sigma_final"), |fit| Cell::maybe(fit.outcome.sigma_final)),
    (("target sigma", "sigma_target"), |fit| Cell::maybe(fit.outcome.sigma_target)),
    (("sigma error", "sigma_error"), |fit| Cell::maybe(fit.sigma_error())),
    (("loss first", "loss_initial"), |fit| Cell::number(fit.outcome.loss_initial)),
    (("loss last", "loss_final"), |fit| Cell::number(fit.outcome.loss_final)),
    (("ms per step", "ms_per_step_median"), |fit| Cell::maybe_time(fit.outcome.ms_per_step_median)),
    (("target image, ms", "target_ms_per_step_median"), |fit| {
        Cell::maybe_time(fit.outcome.target_ms_per_step_median)
    }),
    (("seconds", "wall_seconds"), |fit| Cell::Time(fit.outcome.wall_seconds)),
];

/// The names of what sets a fit apart.
const SETTINGS: [&str; 8] =
    ["experiment", "preset", "resolution", "seed", "steps", "silhouettes", "precision", "kernel"];

/// What sets a fit apart: the cells of [`SETTINGS`].
fn settings(fit: &Fit) -> Vec<Cell> {
    let outcome = &fit.outcome;
    vec![
        Cell::text(outcome.experiment.to_string()),
        Cell::text(outcome.preset.to_string()),
        Cell::Count(outcome.resolution),
        Cell::Count(outcome.seed as usize),
        Cell::Count(outcome.steps as usize),
        Cell::text(outcome.silhouettes.to_string()),
        Cell::text(outcome.precision.to_string()),
        outcome.kernel.map_or(Cell::Nothing, |kernel| Cell::text(kernel.to_string())),
    ]
}

/// One row per fit.
pub(crate) fn fits(fits: &[Fit]) -> Table {
    let columns = SETTINGS.map(|name| (name, name)).into_iter();
    let columns = columns.chain(NUMBERS.map(|number| number.0)).chain([("stuck", "stuck")]);
    let mut table = Table::new("fits", "", &columns.collect::<Vec<_>>());
    for fit in fits {
        let numbers = NUMBERS.iter().map(|(_, number)| number(fit));
        let stuck = Cell::text(fit.is_stuck().to_string());
        table.push(settings(fit).into_iter().chain(numbers).chain([stuck]).collect());
    }
    table
}

/// One row per fit and window of steps: the median of each quantity, and of errors the largest.
pub(crate) fn histories(fits: &[Fit]) -> Table {
    const QUANTITIES: [&str; 11] = [
        "sigma_target",
        "step",
        "seconds",
        "loss",
        "loss_largest",
        "vertex_error",
        "vertex_error_largest",
        "color_error",
        "color_error_largest",
        "sigma",
        "sigma_error_largest",
    ];
    let columns = SETTINGS.into_iter().chain(QUANTITIES).map(|name| (name, name));
    let mut table = Table::new("histories", "", &columns.collect::<Vec<_>>());
    for fit in fits {
        for window in &fit.windows {
            let [loss, vertices, colors, sigma_error, sigma] = window.values;
            debug_assert_eq!(Quantity::ALL[3], Quantity::SigmaError);
            let numbers = [loss, vertices, colors].into_iter();
            let numbers = numbers.flat_map(|[_, median, largest]| [median, largest]);
            let numbers = numbers.chain([sigma[1], sigma_error[2]]);
            let numbers = std::iter::once(window.seconds).chain(numbers);
            let exact = [Cell::maybe(fit.outcome.sigma_target), Cell::number(window.step)];
            let row = settings(fit).into_iter().chain(exact);
            table.push(row.chain(numbers.map(|number| Cell::number(rounded(number)))).collect());
        }
    }
    table
}

/// A number with five digits.
fn rounded(number: f64) -> f64 {
    format!("{number:.4e}").parse().unwrap_or(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_digits_are_left_of_a_number() {
        assert_eq!([0.123456789, 1.0, f64::INFINITY].map(rounded), [0.12346, 1.0, f64::INFINITY]);
        assert!(rounded(f64::NAN).is_nan());
    }
}
