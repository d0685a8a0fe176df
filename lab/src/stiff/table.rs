//! A trial as text, 80 columns wide.

use std::fmt::Write as _;

use super::conditioning::Conditioning;
use super::ledger::LEVELS;
use super::optimizers::{Outcome, Run};
use super::problem::Family;
use super::profile::{Solver, shares, solvers};
use super::study::Study;

/// The whole trial in words and numbers.
pub fn table(study: &Study) -> String {
    let mut text = String::new();
    for (family, title) in [
        (Family::Literature, "More, Garbow and Hillstrom, and a rotated quadratic"),
        (Family::Scene, "Our scenes, six fixed poses at 16 px"),
    ] {
        let runs: Vec<&Run> = study.runs.iter().filter(|run| run.family == family).collect();
        if runs.is_empty() {
            continue;
        }
        let solvers = solvers(runs.iter().copied());
        let problems = solvers[0].runs.len();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{title}: {problems} problems\n");
        text.push_str(&shares_table(&solvers));
        text.push('\n');
        text.push_str(&problem_table(&solvers));
        text.push('\n');
    }
    text.push_str(&endings(study));
    if !study.conditionings.is_empty() {
        text.push('\n');
        text.push_str(&condition_table(study));
    }
    text
}

/// Whether the optimizer was tried at several rates.
fn has_rates(solver: &Solver<'_>) -> bool {
    solver.runs.iter().any(|run| run.rate.is_some())
}

/// The share of problems that each optimizer solves to each level.
pub(super) fn shares_table(solvers: &[Solver<'_>]) -> String {
    let mut text = format!("{:<22}", "% solved to");
    for level in 1..=LEVELS {
        let _ = write!(text, "{:>6}", format!("1e-{level}"));
    }
    text.push('\n');
    for solver in solvers {
        let star = if has_rates(solver) { " *" } else { "" };
        let _ = write!(text, "{:<22}", format!("{}{star}", solver.optimizer));
        for share in shares(&solver.runs) {
            let _ = write!(text, "{:>6.0}", 100.0 * share);
        }
        text.push('\n');
    }
    text.push_str("* the best of its rates on each problem\n");
    text
}

/// The short name of an optimizer, for the head of a column.
fn short(optimizer: &str) -> &str {
    match optimizer {
        "gradient descent" => "GD",
        "trust region" => "trust-r",
        "Gauss-Newton" => "Gauss-N",
        "Levenberg-Marquardt" => "Lev-Mar",
        other => other,
    }
}

/// The error of each optimizer on each problem.
pub(super) fn problem_table(solvers: &[Solver<'_>]) -> String {
    let Some(first) = solvers.first() else { return String::new() };
    let mut text = format!("{:<24}", "error, log10");
    for solver in solvers {
        let _ = write!(text, "{:>8}", short(solver.optimizer));
    }
    text.push('\n');
    for (at, one) in first.runs.iter().enumerate() {
        let alike = first.runs.iter().filter(|run| run.problem == one.problem).count();
        let seed = if alike > 1 { format!(" #{}", one.seed) } else { String::new() };
        let name: String = one.problem.chars().take(23 - seed.len()).collect();
        let _ = write!(text, "{:<24}", name + &seed);
        for solver in solvers {
            let _ =
                write!(text, "{:>8}", solver.runs.get(at).map_or(String::new(), |run| cell(run)));
        }
        text.push('\n');
    }
    text.push_str("d diverged, f failed, c converged by its own test, none: budget spent\n");
    text
}

/// The error of a run as a power of ten, and how it ended.
fn cell(run: &Run) -> String {
    let mark = match run.outcome {
        Outcome::Reached | Outcome::Budget => "",
        Outcome::Converged => "c",
        Outcome::Diverged => "d",
        Outcome::Failed => "f",
    };
    if run.outcome == Outcome::Reached {
        return "<-12".to_owned();
    }
    format!("{:.1}{mark}", run.error.max(1e-99).log10() + 0.0)
}

/// How many runs ended in which way, all rates counted.
pub(super) fn endings(study: &Study) -> String {
    let all =
        [Outcome::Reached, Outcome::Converged, Outcome::Budget, Outcome::Diverged, Outcome::Failed];
    let parts = all.map(|outcome| {
        let count = study.runs.iter().filter(|run| run.outcome == outcome).count();
        format!("{count} {}", outcome.word())
    });
    format!("{} runs, every rate counted: {}\n", study.runs.len(), parts.join(", "))
}

/// The condition of each scene and each of its blocks.
pub(super) fn condition_table(study: &Study) -> String {
    let mut text = format!(
        "{:<24}{:<10}{:>4}{:>6}{:>10}{:>8}{:>9}{:>9}\n",
        "condition of J^T J", "block", "n", "null", "at start", "null", "at truth", "scaled"
    );
    let of = |found: Option<f64>| found.map_or("-".to_owned(), |c| format!("{c:.1e}"));
    let several = study.conditionings.iter().any(|found| found.seed > 0);
    for start in study.conditionings.iter().filter(|found| found.at == "start") {
        // A block of one number has nothing to be conditioned by.
        if start.parameters == 1 {
            continue;
        }
        let truth = study.conditionings.iter().find(|found| {
            found.at != "start"
                && (&found.problem, found.seed, found.block)
                    == (&start.problem, start.seed, start.block)
        });
        let seed = if several { format!(" #{}", start.seed) } else { String::new() };
        let name = if start.block == "all" { start.problem.clone() + &seed } else { String::new() };
        let null = |found: &Conditioning| found.null_directions.to_string();
        let _ = writeln!(
            text,
            "{name:<24}{:<10}{:>4}{:>6}{:>10}{:>8}{:>9}{:>9}",
            start.block,
            start.parameters,
            null(start),
            of(start.condition),
            truth.map_or("-".to_owned(), null),
            of(truth.and_then(|truth| truth.condition)),
            of(truth.and_then(|truth| truth.condition_scaled)),
        );
    }
    text.push_str("null: directions that change no pixel; scaled: columns of J of length 1\n");
    text
}
