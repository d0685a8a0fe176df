//! A trial as text, 80 columns wide.

use std::fmt::Write as _;

use super::ledger::LEVELS;
use super::optimizers::{Outcome, Run};
use super::problem::Family;
use super::profile::{Solver, shares, solvers};
use super::study::Study;

/// Budgets, in gradient evaluations, of the shares that are shown.
pub const BUDGETS: [f64; 3] = [30.0, 300.0, 3_000.0];

/// The whole trial in words and numbers.
pub fn table(study: &Study) -> String {
    let mut text = String::new();
    for (family, title) in [
        (Family::Literature, "More, Garbow and Hillstrom, and a rotated quadratic"),
        (Family::Scene, "our scenes"),
    ] {
        let runs: Vec<&Run> = study.runs.iter().filter(|run| run.family == family).collect();
        if runs.is_empty() {
            continue;
        }
        let solvers = solvers(runs.iter().copied());
        let problems = solvers[0].runs.len();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{problems} problems: {title}\n");
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

fn shares_table(solvers: &[Solver<'_>]) -> String {
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
        "gradient descent" => "descent",
        "trust region" => "trust",
        "Gauss-Newton" => "Gauss-N",
        "Levenberg-Marquardt" => "Lev-Mar",
        other => other,
    }
}

fn problem_table(solvers: &[Solver<'_>]) -> String {
    let mut text = format!("{:<28}", "error, log10");
    for solver in solvers {
        let _ = write!(text, "{:>8}", short(solver.optimizer));
    }
    text.push('\n');
    for (at, first) in solvers[0].runs.iter().enumerate() {
        let alike = solvers[0].runs.iter().filter(|run| run.problem == first.problem).count();
        let seed = if alike > 1 { format!(" #{}", first.seed) } else { String::new() };
        let name: String = first.problem.chars().take(27 - seed.len()).collect();
        let _ = write!(text, "{:<28}", name + &seed);
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
fn endings(study: &Study) -> String {
    let all =
        [Outcome::Reached, Outcome::Converged, Outcome::Budget, Outcome::Diverged, Outcome::Failed];
    let parts = all.map(|outcome| {
        let count = study.runs.iter().filter(|run| run.outcome == outcome).count();
        format!("{count} {}", outcome.word())
    });
    format!("{} runs, every rate counted: {}\n", study.runs.len(), parts.join(", "))
}

fn condition_table(study: &Study) -> String {
    let mut text = format!(
        "{:<28}{:<10}{:>5}{:>6}{:>11}{:>10}{:>10}\n",
        "condition of J^T J", "block", "", "null", "at start", "at truth", "scaled"
    );
    let of = |found: Option<f64>| found.map_or("-".to_owned(), |c| format!("{c:.1e}"));
    for start in study.conditionings.iter().filter(|found| found.at == "start") {
        let truth = study.conditionings.iter().find(|found| {
            found.at != "start"
                && (&found.problem, found.seed, found.block)
                    == (&start.problem, start.seed, start.block)
        });
        let alike = study
            .conditionings
            .iter()
            .any(|found| found.problem == start.problem && found.seed != start.seed);
        let seed = if alike { format!(" #{}", start.seed) } else { String::new() };
        let name: String = start.problem.chars().take(27 - seed.len()).collect();
        let _ = writeln!(
            text,
            "{:<28}{:<10}{:>5}{:>6}{:>11}{:>10}{:>10}",
            name + &seed,
            start.block,
            start.parameters,
            truth.map_or(start.null_directions, |truth| truth.null_directions),
            of(start.condition),
            of(truth.and_then(|truth| truth.condition)),
            of(truth.and_then(|truth| truth.condition_scaled)),
        );
    }
    text.push_str("null: directions that change no pixel; scaled: columns of J of length 1\n");
    text
}
