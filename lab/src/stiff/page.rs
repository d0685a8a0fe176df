//! A trial as a page of a report, and as CSV.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use bokashi_report::{
    Curve, Document, Figure, PALETTE, Panel, ReportError, SIZES, Scale, Section, Stroke, add_page,
    escaped, legend_line, row,
};
use bokashi_write::write_below;

use super::optimizers::{Outcome, Run};
use super::problem::Family;
use super::profile::{Cost, Solver, profiles, solvers};
use super::study::Study;
use super::table::{condition_table, endings, problem_table, shares_table};

/// Levels of the performance profiles: a rough solution, a good one, and all digits that matter.
const LEVELS_SHOWN: [usize; 3] = [2, 5, 8];
/// Profiles end at this multiple of the least cost: whoever needs more has all but failed.
const LARGEST_RATIO: f64 = 1e4;

/// Writes the page `stiff.html` and `stiff.csv` into `folder`; returns the path of the page.
///
/// # Errors
/// Where a figure can't be drawn or the file system refuses.
pub fn write_page(study: &Study, footer: &str, folder: &Path) -> Result<PathBuf, ReportError> {
    let page = Document {
        title: "Bokashi: stiff problems".to_owned(),
        heading: "Optimizers against stiff problems".to_owned(),
        introduction: format!(
            "<p>Least-squares problems with known minima: those of Moré, Garbow and Hillstrom, a \
             rotated quadratic of condition 10⁸, and the paper’s cube over six fixed poses. \
             Gradients, Jacobians and Hessian-vector products come from the tape. {}.</p>",
            escaped(endings(study).trim_end())
        ),
        sections: sections(study)?,
        footer: footer.to_owned(),
    };
    write_below(folder, "stiff.csv", csv(&study.runs).as_bytes())
        .map_err(|error| ReportError::Write { path: folder.join("stiff.csv"), error })?;
    add_page(folder, "stiff.html", &page.html())
}

fn sections(study: &Study) -> Result<Vec<Section>, ReportError> {
    let of =
        |family| -> Vec<&Run> { study.runs.iter().filter(|run| run.family == family).collect() };
    let (literature, scenes) = (of(Family::Literature), of(Family::Scene));
    let (known, ours) = (solvers(literature.iter().copied()), solvers(scenes.iter().copied()));
    let legend = legend(&known);
    let mut profiles_html = legend.clone();
    for cost in [Cost::Gradients, Cost::Seconds] {
        profiles_html += &row(&profile_panels(&known, cost))?;
    }
    profiles_html += "<p class=\"note\">Share of the literature’s problems that are solved within \
        so many times the cost of the cheapest optimizer. Above by gradient evaluations, below by \
        time. A line that ends below 1 leaves problems unsolved at any cost. Gradient descent, \
        Adam and AMSGrad are shown at the best of five rates on each problem, and are not charged \
        for the other four.</p>";
    profiles_html += &pre(&shares_table(&known));
    let note = "<p class=\"note\">The error is (f − f_min) / (f(start) − f_min), the least so far. \
        Gradient evaluations: one pass forward and one backward; a Jacobian of n columns counts n, \
        a Hessian-vector product 2, an objective alone 1/2. Every optimizer has a line, however \
        it ended; a line ends where its run did.</p>";
    let all_panels = |solvers: &[Solver<'_>]| -> Result<String, ReportError> {
        let mut html = legend.clone();
        let count = solvers.first().map_or(0, |solver| solver.runs.len());
        for problem in 0..count {
            html += &row(&error_panels(solvers, problem))?;
            html += &failures(solvers, problem);
        }
        Ok(html + note)
    };
    Ok(vec![
        Section { id: "profiles", title: "Who solves how much", body: profiles_html },
        Section {
            id: "scenes",
            title: "Our scenes: error against cost",
            body: all_panels(&ours)? + &pre(&problem_table(&ours)),
        },
        Section {
            id: "conditions",
            title: "How stiff our scenes are",
            body: pre(&condition_table(study)),
        },
        Section {
            id: "literature",
            title: "The literature’s problems: error against cost",
            body: pre(&problem_table(&known)) + &all_panels(&known)?,
        },
    ])
}

fn pre(text: &str) -> String {
    format!("<pre>{}</pre>", escaped(text.trim_end()))
}

/// Seven optimizers, six colours: the seventh is dashed.
fn look(at: usize) -> (usize, Stroke) {
    (at, if at < PALETTE.len() { Stroke::Solid } else { Stroke::Dashed })
}

fn legend(solvers: &[Solver<'_>]) -> String {
    let mut html = String::from("<ul class=\"legend\">");
    for (at, solver) in solvers.iter().enumerate() {
        let (color, stroke) = look(at);
        let line = legend_line(PALETTE[color % PALETTE.len()], stroke);
        // Writing to a string cannot fail.
        let _ = write!(html, "<li>{line}{}", escaped(solver.optimizer));
    }
    html + "</ul>"
}

/// The error of every optimizer on one problem against time, and against gradient evaluations.
fn error_panels(solvers: &[Solver<'_>], problem: usize) -> Vec<Panel> {
    let name = solvers.iter().find_map(|solver| solver.runs.get(problem)).map(|run| {
        let seed = if run.seed > 0 { format!(", seed {}", run.seed) } else { String::new() };
        format!("{}{seed}", run.problem)
    });
    let name = name.unwrap_or_default();
    let panel = |x: Scale, x_title: &'static str| {
        let curves = solvers.iter().enumerate().filter_map(|(at, solver)| {
            let run = solver.runs.get(problem)?;
            let (color, stroke) = look(at);
            let points = run.history.iter().map(|moment| {
                let spent =
                    if x == Scale::Seconds { moment.seconds } else { moment.gradient_evaluations };
                [spent, moment.error, moment.error, moment.error]
            });
            Some(Curve { color, stroke, dots: false, points: points.collect() })
        });
        Panel {
            title: name.clone(),
            figure: Figure {
                x,
                y: Scale::Logarithmic,
                x_title,
                size: SIZES[0],
                spoken: format!("{name}: error of each optimizer against {x_title}"),
                curves: curves.collect(),
                marks: Vec::new(),
            },
        }
    };
    vec![panel(Scale::Seconds, "wall-clock time"), panel(Scale::Counts, "gradient evaluations")]
}

/// The optimizers that ended in failure on one problem, and what they said: some have no line.
fn failures(solvers: &[Solver<'_>], problem: usize) -> String {
    let runs = solvers.iter().filter_map(|solver| solver.runs.get(problem));
    let failed = runs.filter(|run| matches!(run.outcome, Outcome::Diverged | Outcome::Failed));
    let lines = failed.map(|run| {
        let rate = run.rate.map_or(String::new(), |rate| format!(" at rate {rate:e}"));
        let (name, word) = (run.optimizer, run.outcome.word());
        format!("<p class=\"note\">{name}{rate} {word}: {}.</p>", escaped(&run.message))
    });
    lines.collect()
}

/// One profile per level.
fn profile_panels(solvers: &[Solver<'_>], cost: Cost) -> Vec<Panel> {
    let title = match cost {
        Cost::Seconds => "times the least time",
        Cost::Gradients => "times the fewest gradients",
    };
    let panel = |level: usize| {
        let all = profiles(solvers, level, cost);
        let curves = all.into_iter().enumerate().map(|(at, steps)| {
            let (color, stroke) = look(at);
            Curve { color, stroke, dots: false, points: staircase(&steps) }
        });
        Panel {
            title: format!("Share solved to 1e-{level}"),
            figure: Figure {
                x: Scale::Logarithmic,
                y: Scale::Linear,
                x_title: title,
                size: SIZES[1],
                spoken: format!("share of problems solved to 1e-{level} against cost, {title}"),
                curves: curves.collect(),
                marks: Vec::new(),
            },
        }
    };
    LEVELS_SHOWN.map(panel).into()
}

/// The steps of a profile as a line, from 1 to the largest ratio shown.
fn staircase(steps: &[[f64; 2]]) -> Vec<[f64; 4]> {
    let point = |x: f64, y: f64| [x, y, y, y];
    let mut points = vec![point(1.0, 0.0)];
    let mut height = 0.0;
    for &[ratio, share] in steps.iter().filter(|[ratio, _]| *ratio <= LARGEST_RATIO) {
        points.push(point(ratio, height));
        points.push(point(ratio, share));
        height = share;
    }
    points.push(point(LARGEST_RATIO, height));
    points
}

/// One row per run.
fn csv(runs: &[Run]) -> String {
    let mut text = String::from(
        "problem,seed,optimizer,rate,solved_to,error,minimiser_error,seconds,\
         gradient_evaluations,outcome,message\n",
    );
    let number = |number: Option<f64>| number.map_or(String::new(), |number| format!("{number:e}"));
    for run in runs {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{:e},{},{:e},{},{},{}",
            quoted(&run.problem),
            run.seed,
            run.optimizer,
            number(run.rate),
            run.solved_to,
            run.error,
            number(run.minimiser_error),
            run.seconds,
            run.gradient_evaluations,
            run.outcome.word(),
            quoted(&run.message),
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::stiff::ledger::{Budget, TARGET};
    use crate::stiff::optimizers::{Method, run};
    use crate::stiff::problems::rotated_quadratic;

    #[test]
    fn a_staircase_rises_at_its_ratios_and_goes_on_to_the_edge() {
        let points = staircase(&[[1.0, 0.25], [8.0, 0.5], [1e9, 0.75]]);
        let line: Vec<_> = points.iter().map(|p| (p[0], p[2])).collect();
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
        let rows = csv(&runs);
        assert_eq!(rows.lines().count(), 3);
        assert!(rows.contains("gradient descent,1e9,") && rows.contains(",diverged,"), "{rows}");
        let study = Study { runs, ..Study::default() };
        let sections = sections(&study).unwrap();
        let html: String = sections.iter().map(|section| section.body.as_str()).collect();
        assert!(html.contains("gradient descent") && html.contains("<polyline"), "{html}");
        assert!(html.contains("gradient descent at rate 1e9 diverged: "), "{html}");
        assert!(!html.contains("NaN"));
    }
}
