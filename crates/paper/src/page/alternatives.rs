//! What other choices do than ours, where the paper leaves one open: a table, and sigma's error
//! against step for the window's radius.
//!
//! These fits stand by themselves: no other part of the report shows or counts them.

use bokashi_report::{
    Cell, Curve, Figure, Figures, PALETTE, Scale, Section, Stroke, Table, grouped,
};

use super::digest::{Fit, Quantity};
use super::panels;
use crate::{Alternative, Choice, CubeSettings, Outcome};

/// Sigma is learnt where its error stays below this, in pixels: far below what a picture shows, far
/// above every floor of rounding.
const LEARNT: f64 = 1e-4;

/// A fit of one alternative.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    alternative: Alternative,
    settings: CubeSettings,
    /// What it reached, or the error that it ended in: that too is what a choice does.
    reached: Result<Reached, String>,
}

/// What a fit reached.
#[derive(Debug, Clone)]
struct Reached {
    fit: Fit,
    /// The largest error of sigma in the last tenth of the run.
    tail: f64,
    /// Steps and seconds until sigma was learnt for good.
    learnt: Option<(u64, f64)>,
    /// The least sigma on the way.
    least: f64,
}

impl Trial {
    /// A fit that came to its end, or the error that it ended in.
    pub(crate) fn new(
        alternative: Alternative,
        settings: &CubeSettings,
        outcome: Result<Outcome, String>,
    ) -> Self {
        let reached = outcome.map(|outcome| Reached::new(settings, outcome));
        Self { alternative, settings: settings.clone(), reached }
    }
}

impl Reached {
    fn new(settings: &CubeSettings, outcome: Outcome) -> Self {
        let history = &outcome.history;
        let sigmas = || history.iter().map(|record| record.sigma.unwrap_or(f64::NAN));
        let errors: Vec<f64> =
            sigmas().map(|sigma| (sigma - settings.sigma_target).abs()).collect();
        // An error that is NaN is not below.
        let first = errors
            .iter()
            .rposition(|error| error.is_nan() || *error >= LEARNT)
            .map_or(0, |last| last + 1);
        let last_tenth = &errors[errors.len() - errors.len().div_ceil(10)..];
        Self {
            tail: last_tenth.iter().copied().max_by(f64::total_cmp).unwrap_or(f64::NAN),
            learnt: history.get(first).map(|record| (record.step, record.seconds)),
            least: sigmas().min_by(f64::total_cmp).unwrap_or(f64::NAN),
            fit: Fit::new(settings, outcome),
        }
    }
}

/// The section; it shows nothing without fits.
pub(crate) fn section(trials: &[Trial]) -> Section {
    let mut section = Section::new("others", "What other choices do", "");
    let Some(first) = trials.first() else { return section };
    section.note = format!(
        "The paper leaves open how far the blur’s window reaches, what it sees outside the image, how its \
         weights are made, and how sigma stays positive. Here each choice of ours is exchanged for another, \
         one at a time, in the learnt image and in its target. One seed each, in {}, where rounding hides \
         no floor, and counted nowhere else in this report; σ* is the target.",
        first.settings.precision
    );
    let is_shown =
        |choice: &Choice| trials.iter().any(|trial| trial.alternative.choice == Some(*choice));
    let questions: Vec<_> = Choice::ALL
        .into_iter()
        .filter(is_shown)
        .map(|choice| format!("<li><b>{}</b>: {}", capital(choice), question(choice)))
        .collect();
    section.push_html(format!(
        "<ul>{}</ul><p class=\"note\">Sigma error against step for the rules of the radius. A line is the \
         median of the few steps that a point of it stands for, the band around it their least and largest \
         value.</p>",
        questions.concat()
    ));
    section.push_figures(figures(trials));
    section.push_table(table(trials));
    section.push_html(
        "<p class=\"note\"><i>Learnt</i>: from here on the error stays below 10⁻⁴ pixels. <i>Last \
         tenth</i>: the largest error within the last tenth of a run. Seconds and ms per step are wall \
         clock on the machine of this report.</p>",
    );
    section
}

/// What a reader should compare, as HTML. It claims nothing that another run could contradict.
fn question(choice: Choice) -> &'static str {
    match choice {
        Choice::Radius => {
            "a window that follows sigma gains or loses a tap where its radius steps, and the \
             loss jumps there. Where that step lies on σ*, look for a floor that the error does \
             not pass, or jumps back to long after; compare 3σ* with 4σ*, and with windows that \
             are fixed or step beside σ*."
        }
        Choice::Border => {
            "the target has the same border, so the truth is a minimum under each; look whether \
             the steps to it differ, and whether they do so more for the wider blur."
        }
        Choice::Kernel => {
            "over a window without an end, the unnormalized kernel’s gain differs from 1 by more than 0.4 % only \
             below sigma 0.6; look whether a fit comes that low (<i>least sigma</i>), and \
             whether its numbers differ from ours without that. A disc of the same variance has a rim where \
             a Gaussian has tails; compare steps and seconds."
        }
        Choice::Mapping => {
            "a step of the optimizer is a step of what the mapping is given: look at how many \
             each takes. With nothing to hold it, sigma is positive only while no step is larger \
             than what is left of it: look at the <i>least sigma</i>, or for an error."
        }
    }
}

/// Fits of one experiment and target, in the order they were given.
fn parts(trials: &[Trial]) -> impl Iterator<Item = (String, &[Trial])> {
    let key = |trial: &Trial| (trial.settings.experiment, trial.settings.sigma_target);
    trials.chunk_by(move |a, b| key(a) == key(b)).map(|part| {
        let CubeSettings { experiment, preset, sigma_target, .. } = part[0].settings;
        (format!("{}, σ* = {sigma_target}, {preset} rates", panels::heading(experiment)), part)
    })
}

/// One row per fit.
fn table(trials: &[Trial]) -> Table {
    let columns =
        ["Choice", "at the end", "last tenth", "steps", "seconds", "ms per step", "least sigma"];
    let mut table = Table::new("", "", &columns.map(|title| (title, ""))).with_groups(&[
        ("", 1),
        ("sigma error", 2),
        ("sigma is learnt after", 2),
        ("", 2),
    ]);
    for (heading, part) in parts(trials) {
        table.push_part(heading);
        part.iter().for_each(|trial| table.push(row(trial)));
    }
    table
}

/// What was chosen, ours marked.
fn name(trial: &Trial) -> Cell {
    let name = trial.alternative.name;
    match trial.alternative.choice {
        None => {
            let CubeSettings { border, kernel, sigma_mapping, .. } = trial.settings;
            let others = format!("{border:?}, {kernel}, {sigma_mapping:?}").to_lowercase();
            Cell::text(format!("Ours: {name}, {others}")).strong()
        }
        Some(choice) => Cell::text(format!("{}: {name}", capital(choice))),
    }
}

/// A choice as the beginning of a line.
fn capital(choice: Choice) -> String {
    let name = choice.to_string();
    name[..1].to_uppercase() + &name[1..]
}

/// The cells of one fit.
fn row(trial: &Trial) -> Vec<Cell> {
    let reached = match &trial.reached {
        Ok(reached) => reached,
        Err(error) => return vec![name(trial), Cell::text(error)],
    };
    let (steps, seconds) = match reached.learnt {
        None => (Cell::text("never"), Cell::Nothing),
        Some((steps, seconds)) => (Cell::text(grouped(steps as f64)), Cell::Time(seconds)),
    };
    vec![
        name(trial),
        Cell::maybe(reached.fit.sigma_error()),
        Cell::number(reached.tail),
        steps,
        seconds,
        Cell::maybe_time(reached.fit.outcome.ms_per_step_median),
        Cell::number(reached.least),
    ]
}

/// Whether a fit is one of the figure: ours, or another rule for the radius.
fn is_drawn(trial: &Trial) -> bool {
    matches!(trial.alternative.choice, None | Some(Choice::Radius))
}

/// Ours is dashed: a line that runs along it stays visible.
fn stroke(alternative: Alternative) -> Stroke {
    if alternative.choice.is_none() { Stroke::Dashed } else { Stroke::Solid }
}

/// Sigma's error against step for every rule of the radius, a panel per experiment and target.
fn figures(trials: &[Trial]) -> Figures {
    let mut names: Vec<Alternative> = Vec::new();
    for trial in trials.iter().filter(|trial| is_drawn(trial)) {
        if !names.contains(&trial.alternative) {
            names.push(trial.alternative);
        }
    }
    let color = |trial: &Trial| names.iter().position(|&name| name == trial.alternative);
    let panels = parts(trials).map(|(_, part)| {
        // Ours, the first, lies over the others.
        let drawn = part.iter().rev().filter(|trial| is_drawn(trial));
        let curves = drawn.filter_map(|trial| {
            let fit = &trial.reached.as_ref().ok()?.fit;
            let points = fit.curve(Quantity::SigmaError, |window| window.step);
            Some(Curve::new(color(trial)?, stroke(trial.alternative), points))
        });
        let CubeSettings { experiment, sigma_target, .. } = part[0].settings;
        let title =
            format!("{}, σ* = {sigma_target}: |σ − σ*|, pixels", panels::number(experiment));
        Figure::new(title, (Scale::Counts, "step"), Scale::Logarithmic, curves)
    });
    let legend = names.iter().enumerate().map(|(index, &name)| {
        let ours = if name.choice.is_none() { "ours: " } else { "" };
        (format!("{ours}{}", name.name), PALETTE[index % PALETTE.len()], stroke(name))
    });
    Figures::new(panels, legend)
}

#[cfg(test)]
mod tests {
    use super::super::tests::outcome;
    use super::*;
    use crate::{Kernel, alternatives};

    fn reached(errors: &[f64]) -> Reached {
        let (_, settings) = alternatives(errors.len() as u64 - 1, Kernel::Sampled).remove(0);
        let mut outcome = outcome(&settings, 0.0);
        for (record, error) in outcome.history.iter_mut().zip(errors) {
            record.sigma = Some(settings.sigma_target + error);
        }
        Reached::new(&settings, outcome)
    }

    #[test]
    fn sigma_is_learnt_where_its_error_stays_below() {
        let step = |errors: &[f64]| reached(errors).learnt.map(|(step, _)| step);
        assert_eq!(step(&[1.0, 0.0, 0.5, 1e-5, 1e-6]), Some(3));
        assert_eq!(step(&[0.0, 0.0]), Some(0));
        assert_eq!(step(&[0.0, f64::NAN, 0.0]), Some(2));
        assert_eq!(step(&[0.0, 1.0]), None);
        assert_eq!(step(&[0.0, f64::NAN]), None);
    }

    #[test]
    fn the_last_tenth_and_the_least_sigma_are_of_single_steps() {
        let mut errors = [1e-6; 30];
        (errors[3], errors[26], errors[28]) = (-0.25, 9.0, 1e-3);
        let reached = reached(&errors);
        assert!((reached.tail - 1e-3).abs() < 1e-12);
        assert_eq!(reached.least, 0.75);
    }

    #[test]
    fn every_fit_has_a_row_in_its_part_and_a_failed_one_says_why() {
        let trials: Vec<Trial> = alternatives(20, Kernel::Sampled)
            .iter()
            .map(|(alternative, settings)| {
                let failed = alternative.name == "nothing";
                let outcome = outcome(settings, 1e-3);
                let outcome = if failed { Err("sigma < 0".to_owned()) } else { Ok(outcome) };
                Trial::new(*alternative, settings, outcome)
            })
            .collect();
        let parts = parts(&trials).count();
        let panels = figures(&trials).panels;
        assert!(panels.len() == parts && panels.iter().all(|panel| !panel.is_empty()));
        let rows = table(&trials).rows;
        let count = |what: &dyn Fn(&[Cell]) -> bool| rows.iter().filter(|row| what(row)).count();
        assert_eq!(rows.len(), trials.len());
        assert_eq!(count(&|row| matches!(row[0], Cell::Strong(_))), parts);
        assert_eq!(count(&|row| row[1..] == [Cell::text("sigma < 0")]), parts);
    }
}
