//! A trial as a page of a report, and in print.

use bokashi_report::{About, Curve, Document, Figure, Figures, PALETTE, Scale, Section, Stroke};

use super::optimizers::{Outcome, Run};
use super::problem::Family;
use super::profile::{Cost, Solver, profiles, solvers};
use super::study::Study;
use super::table::{condition_table, endings, problem_table, run_table, shares_table};

/// Levels of the performance profiles: a rough solution, a good one, and all digits that matter.
const LEVELS_SHOWN: [usize; 3] = [2, 5, 8];
/// Profiles end at this multiple of the least cost: whoever needs more has all but failed.
const LARGEST_RATIO: f64 = 1e4;

/// The files of [`page`].
pub const FILES: [&str; 3] = ["stiff.html", "stiff-conditions.csv", "stiff-runs.csv"];

/// The page `stiff`, with a CSV file per table.
pub fn page(study: &Study, about: About) -> Document {
    Document {
        name: "stiff",
        heading: "Optimizers against stiff problems".to_owned(),
        introduction: format!(
            "Least-squares problems with known minima: those of Moré, Garbow and Hillstrom, a rotated \
             quadratic of condition 10⁸, and the paper’s cube over six fixed poses. Gradients, \
             Jacobians and Hessian-vector products come from the tape. {}.",
            endings(study)
        ),
        sections: sections(study),
        files: Vec::new(),
        about,
    }
}

/// The whole trial in words and numbers.
pub fn markdown(study: &Study) -> String {
    let sections = sections(study).iter().map(Section::markdown).collect::<Vec<_>>();
    format!("{}\n{}.\n", sections.join("\n"), endings(study))
}

fn sections(study: &Study) -> Vec<Section> {
    let solvers_of = |family| solvers(study.runs.iter().filter(move |run| run.family == family));
    let (known, ours) = (solvers_of(Family::Literature), solvers_of(Family::Scene));
    let mut shares = Section::new(
        "profiles",
        "Who solves how much",
        "Share of the literature’s problems that are solved within so many times the cost of the \
         cheapest optimizer. Above by gradient evaluations, below by time. A line that ends below 1 \
         leaves problems unsolved at any cost. Gradient descent, Adam and AMSGrad are shown at the best \
         of five rates on each problem, and are not charged for the other four.",
    );
    for cost in [Cost::Gradients, Cost::Seconds] {
        shares.push_figures(Figures::new(profile_panels(&known, cost), legend(&known)));
    }
    shares.push_table(shares_table(&known));
    let errors = |id, title, solvers: &[Solver<'_>]| {
        let mut section = Section::new(
            id,
            title,
            "The error is (f − f_min) / (f(start) − f_min), the least so far. Gradient evaluations: one \
             pass forward and one backward; a Jacobian of n columns counts n, a Hessian-vector product 2, \
             an objective alone 1/2. Every optimizer has a line, however it ended; a line ends where its \
             run did.",
        );
        section.push_table(problem_table(solvers));
        let count = solvers.first().map_or(0, |solver| solver.runs.len());
        for problem in 0..count {
            section.push_figures(Figures::new(error_panels(solvers, problem), legend(solvers)));
            add_failures(&mut section, solvers, problem);
        }
        section
    };
    let mut conditions = Section::new("conditions", "How stiff our scenes are", "");
    conditions.push_table(condition_table(study));
    let mut all = Section::new("runs", "Every run", "");
    all.push_table(run_table(&study.runs));
    vec![
        shares,
        errors("scenes", "Our scenes: error against cost", &ours),
        conditions,
        errors("literature", "The literature’s problems: error against cost", &known),
        all,
    ]
}

fn legend(solvers: &[Solver<'_>]) -> Vec<(String, &'static str, Stroke)> {
    let line = |(index, solver): (usize, &Solver<'_>)| {
        (solver.optimizer.to_owned(), PALETTE[index % PALETTE.len()], Stroke::Solid)
    };
    solvers.iter().enumerate().map(line).collect()
}

/// The error of every optimizer on one problem against time, and against gradient evaluations.
fn error_panels(solvers: &[Solver<'_>], problem: usize) -> [Figure; 2] {
    let name = solvers.iter().find_map(|solver| solver.runs.get(problem)).map(|run| {
        let seed = if run.seed > 0 { format!(", seed {}", run.seed) } else { String::new() };
        format!("{}{seed}", run.problem)
    });
    let name = name.unwrap_or_default();
    let costs = [(Scale::Seconds, "wall-clock time"), (Scale::Counts, "gradient evaluations")];
    costs.map(|x| {
        let curves = solvers.iter().enumerate().filter_map(|(index, solver)| {
            let points = solver.runs.get(problem)?.history.iter().map(|moment| {
                let by_time = x.0 == Scale::Seconds;
                let spent = if by_time { moment.seconds } else { moment.gradient_evaluations };
                (spent, moment.error)
            });
            Some(Curve::line(index, Stroke::Solid, points))
        });
        Figure::new(&*name, x, Scale::Logarithmic, curves)
    })
}

/// The optimizers that ended in failure on one problem, and what they said: some have no line.
fn add_failures(section: &mut Section, solvers: &[Solver<'_>], problem: usize) {
    let runs = solvers.iter().filter_map(|solver| solver.runs.get(problem));
    for run in runs.filter(|run| matches!(run.outcome, Outcome::Diverged | Outcome::Failed)) {
        let rate = run.rate.map_or(String::new(), |rate| format!(" at rate {rate:e}"));
        let Run { optimizer, outcome, message, .. } = run;
        section.push_failure(format!("{optimizer}{rate} {}: {message}.", outcome.word()));
    }
}

/// One profile per level.
fn profile_panels(solvers: &[Solver<'_>], cost: Cost) -> [Figure; LEVELS_SHOWN.len()] {
    let x_title = match cost {
        Cost::Seconds => "times the least time",
        Cost::Gradients => "times the fewest gradients",
    };
    LEVELS_SHOWN.map(|level| {
        let all = profiles(solvers, level, cost);
        let curves = all.into_iter().enumerate();
        let curves =
            curves.map(|(index, steps)| Curve::line(index, Stroke::Solid, staircase(&steps)));
        let title = format!("Share solved to 1e-{level}");
        Figure::new(title, (Scale::Logarithmic, x_title), Scale::Linear, curves)
    })
}

/// The steps of a profile as a line, from 1 to the largest ratio shown.
fn staircase(steps: &[[f64; 2]]) -> Vec<(f64, f64)> {
    let mut points = vec![(1.0, 0.0)];
    let mut height = 0.0;
    for &[ratio, share] in steps.iter().filter(|[ratio, _]| *ratio <= LARGEST_RATIO) {
        points.push((ratio, height));
        points.push((ratio, share));
        height = share;
    }
    points.push((LARGEST_RATIO, height));
    points
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::stiff::ledger::{Budget, TARGET};
    use crate::stiff::optimizers::{Method, run};
    use crate::stiff::problems::rotated_quadratic;
    use crate::stiff::table::run_table;

    #[test]
    fn a_staircase_rises_at_its_ratios_and_goes_on_to_the_edge() {
        let line = staircase(&[[1.0, 0.25], [8.0, 0.5], [1e9, 0.75]]);
        let expected = [(1.0, 0.0), (1.0, 0.0), (1.0, 0.25), (8.0, 0.25), (8.0, 0.5), (1e4, 0.5)];
        assert_eq!(line, expected);
    }

    #[test]
    fn a_failed_run_has_its_line_and_its_row() {
        let problem = rotated_quadratic(3, 10.0, 0);
        let budget = Budget { gradients: 50.0, time: Duration::from_secs(60), target: TARGET };
        let methods = [Method::GradientDescent { rate: 1e9 }, Method::LevenbergMarquardt];
        let runs: Vec<Run> =
            methods.iter().map(|&method| run(&problem, 0, method, budget)).collect();
        assert_ne!(runs[0].message, "");
        let rows = run_table(&runs).csv();
        assert_eq!(rows.lines().count(), 3);
        assert!(rows.contains("gradient descent,1e9,") && rows.contains(",diverged,"), "{rows}");
        let study = Study { runs, ..Study::default() };
        let rendered = page(&study, About::default()).render().unwrap();
        let files: Vec<_> = rendered.files.iter().map(|(path, _)| path.to_str().unwrap()).collect();
        assert_eq!(files, FILES[1..]);
        let html = rendered.html;
        assert!(html.contains("gradient descent") && html.contains("<polyline"), "{html}");
        assert!(html.contains("gradient descent at rate 1e9 diverged: "), "{html}");
        assert!(!html.contains("NaN"));
    }
}
