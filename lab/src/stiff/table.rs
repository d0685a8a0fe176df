//! A trial as tables.

use bokashi_report::{Cell, Table};

use super::conditioning::Conditioning;
use super::ledger::LEVELS;
use super::optimizers::{Outcome, Run};
use super::profile::{Solver, shares};
use super::study::Study;

/// Whether the optimizer was tried at several rates.
fn has_rates(solver: &Solver<'_>) -> bool {
    solver.runs.iter().any(|run| run.rate.is_some())
}

/// The share of problems that each optimizer solves to each level. Its marks are for people: programs have the
/// table of runs.
pub(super) fn shares_table(solvers: &[Solver<'_>]) -> Table {
    const TITLES: [&str; LEVELS] = ["1e-1", "1e-2", "1e-3", "1e-4", "1e-5", "1e-6", "1e-7", "1e-8"];
    let columns = std::iter::once(("optimizer", "optimizer")).chain(TITLES.map(|to| (to, to)));
    let title = "Problems solved to a level, %; *: the best of its rates on each problem";
    let mut table = Table::new("", title, &columns.collect::<Vec<_>>());
    for solver in solvers {
        let star = if has_rates(solver) { " *" } else { "" };
        let name = Cell::text(format!("{}{star}", solver.optimizer));
        let shares =
            shares(&solver.runs).map(|share| Cell::Count((100.0 * share).round() as usize));
        table.push([vec![name], shares.to_vec()].concat());
    }
    table
}

/// The short name of an optimizer, for the head of a column.
fn short(optimizer: &'static str) -> &'static str {
    match optimizer {
        "gradient descent" => "GD",
        "trust region" => "trust-r",
        "Gauss-Newton" => "Gauss-N",
        "Levenberg-Marquardt" => "Lev-Mar",
        other => other,
    }
}

/// The error of each optimizer on each problem, for people as well.
pub(super) fn problem_table(solvers: &[Solver<'_>]) -> Table {
    let title = "Error as a power of ten; d: diverged, f: failed, c: converged by its own test, none: \
                 budget spent";
    let optimizers = solvers.iter().map(|solver| (short(solver.optimizer), solver.optimizer));
    let columns = std::iter::once(("problem", "problem")).chain(optimizers);
    let mut table = Table::new("", title, &columns.collect::<Vec<_>>());
    let runs = solvers.first().map_or(&[][..], |solver| &solver.runs);
    for (index, one) in runs.iter().enumerate() {
        let alike = runs.iter().filter(|run| run.problem == one.problem).count();
        let seed = if alike > 1 { format!(" #{}", one.seed) } else { String::new() };
        let errors = solvers
            .iter()
            .map(|solver| solver.runs.get(index).map_or(Cell::Nothing, |run| error(run)));
        let name = Cell::text(format!("{}{seed}", one.problem));
        table.push(std::iter::once(name).chain(errors).collect());
    }
    table
}

/// The error of a run as a power of ten, and how it ended.
fn error(run: &Run) -> Cell {
    let mark = match run.outcome {
        Outcome::Reached => return Cell::text("<-12"),
        Outcome::Budget => "",
        Outcome::Converged => "c",
        Outcome::Diverged => "d",
        Outcome::Failed => "f",
    };
    Cell::Number(run.error.max(1e-99).log10() + 0.0, mark)
}

/// How many runs ended in which way, all rates counted.
pub(super) fn endings(study: &Study) -> String {
    let all =
        [Outcome::Reached, Outcome::Converged, Outcome::Budget, Outcome::Diverged, Outcome::Failed];
    let parts = all.map(|outcome| {
        let count = study.runs.iter().filter(|run| run.outcome == outcome).count();
        format!("{count} {}", outcome.word())
    });
    format!("{} runs, every rate counted: {}", study.runs.len(), parts.join(", "))
}

/// The condition of each scene and each of its blocks.
pub(super) fn condition_table(study: &Study) -> Table {
    let title =
        "Condition of JᵀJ; null: directions that change no pixel; scaled: columns of J of length 1";
    let mut table = Table::new(
        "conditions",
        title,
        &[
            ("scene", "scene"),
            ("block", "block"),
            ("n", "parameters"),
            ("null", "null_at_start"),
            ("at start", "condition_at_start"),
            ("null", "null_at_truth"),
            ("at truth", "condition_at_truth"),
            ("scaled", "condition_scaled_at_truth"),
        ],
    );
    let several = study.conditionings.iter().any(|conditioning| conditioning.seed > 0);
    for start in study.conditionings.iter().filter(|conditioning| conditioning.at == "start") {
        // A block of one number has nothing to be conditioned by.
        if start.parameters == 1 {
            continue;
        }
        let truth = study.conditionings.iter().find(|conditioning| {
            conditioning.at != "start"
                && (&conditioning.problem, conditioning.seed, conditioning.block)
                    == (&start.problem, start.seed, start.block)
        });
        let seed = if several { format!(" #{}", start.seed) } else { String::new() };
        let null = |conditioning: &Conditioning| Cell::Count(conditioning.null_directions);
        table.push(vec![
            Cell::text(format!("{}{seed}", start.problem)),
            Cell::text(start.block),
            Cell::Count(start.parameters),
            null(start),
            Cell::maybe(start.condition),
            truth.map_or(Cell::Nothing, null),
            Cell::maybe(truth.and_then(|truth| truth.condition)),
            Cell::maybe(truth.and_then(|truth| truth.condition_scaled)),
        ]);
    }
    table
}

/// One row per run.
pub(super) fn run_table(runs: &[Run]) -> Table {
    let columns = [
        "problem",
        "seed",
        "optimizer",
        "rate",
        "solved_to",
        "error",
        "minimiser_error",
        "seconds",
        "gradient_evaluations",
        "outcome",
        "message",
    ];
    let columns = columns.map(|name| (name, name));
    let mut table = Table::new("runs", "Every run", &columns).not_printed();
    for run in runs {
        table.push(vec![
            Cell::text(&run.problem),
            Cell::Count(run.seed as usize),
            Cell::text(run.optimizer),
            Cell::maybe(run.rate),
            Cell::Count(run.solved_to),
            Cell::number(run.error),
            Cell::maybe(run.minimiser_error),
            Cell::number(run.seconds),
            Cell::number(run.gradient_evaluations),
            Cell::text(run.outcome.word()),
            Cell::text(&run.message),
        ]);
    }
    table
}
