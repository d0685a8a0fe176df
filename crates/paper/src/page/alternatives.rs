//! What other choices do than ours, where the paper leaves one open: a table, and sigma's error
//! against step for the window's radius.
//!
//! These fits stand by themselves: no other part of the report shows or counts them.

use std::fmt::Write as _;

use bokashi_report::{
    Curve, Figure, PALETTE, Panel, ReportError, SIZES, Scale, Stroke, digits, escaped, grouped,
    legend_line, plain, row,
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

/// The section, as HTML; empty without fits.
pub(crate) fn html(trials: &[Trial]) -> Result<String, ReportError> {
    let Some(first) = trials.first() else { return Ok(String::new()) };
    Ok(format!(
        "<p>The paper leaves open how far the blur’s window reaches, what it sees outside the \
         image, how its taps are made, and how sigma stays positive. Here each choice of ours is \
         exchanged for another, one at a time, in the learnt image and in its target. One seed \
         each, in {}, where rounding hides no floor, and counted nowhere else in this report; σ* is the \
         target.</p><ul>{}</ul>\
         {}<p class=\"note\">Sigma error against step for the rules of the radius. A line is the \
         median of the few steps that a point of it stands for, the band around it their least \
         and largest value.</p>{}<p class=\"note\"><i>Learnt</i>: from here on the error stays \
         below 10⁻⁴ pixels. <i>Last tenth</i>: the largest error within the last tenth of a run. \
         Seconds and ms per step are wall clock on the machine of this report.</p>",
        first.settings.precision,
        Choice::ALL.map(what_to_look_for).concat(),
        figure(trials)?,
        table(trials),
    ))
}

/// What a reader should compare, as an item of a list. It claims nothing that another run could
/// contradict.
fn what_to_look_for(choice: Choice) -> String {
    let text = match choice {
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
             whether its numbers differ from ours without that."
        }
        Choice::Mapping => {
            "a step of the optimizer is a step of what the mapping is given: look at how many \
             each takes. With nothing to hold it, sigma is positive only while no step is larger \
             than what is left of it: look at the <i>least sigma</i>, or for an error."
        }
    };
    format!("<li><b>{}</b>: {text}", capital(choice))
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
fn table(trials: &[Trial]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\"><table class=\"wide\"><thead><tr><th rowspan=2>Choice\
         <th colspan=2>sigma error<th colspan=2>sigma is learnt after\
         <th rowspan=2>ms per<br>step<th rowspan=2>least<br>sigma\
         <tr><th class=\"first\">at the end<th>last tenth<th class=\"first\">steps<th>seconds\
         </thead><tbody>",
    );
    for (heading, part) in parts(trials) {
        // Writing to a string cannot fail.
        let _ = write!(html, "<tr class=\"part\"><th colspan=7>{heading}");
        for trial in part {
            let _ = write!(html, "<tr><th>{}{}", name(trial), numbers(trial));
        }
    }
    html.push_str("</tbody></table></div>");
    html
}

/// What was chosen, as HTML, ours marked.
fn name(trial: &Trial) -> String {
    let name = escaped(trial.alternative.name);
    match trial.alternative.choice {
        None => {
            let CubeSettings { border, kernel, sigma_mapping, .. } = trial.settings;
            let others = format!("{border:?}, {kernel:?}, {sigma_mapping:?}").to_lowercase();
            format!("<b class=\"ours\">Ours</b>: {name}, {others}")
        }
        Some(choice) => format!("{}: {name}", capital(choice)),
    }
}

/// A choice as the beginning of a line.
fn capital(choice: Choice) -> String {
    let name = choice.to_string();
    name[..1].to_uppercase() + &name[1..]
}

/// The cells of one fit.
fn numbers(trial: &Trial) -> String {
    let reached = match &trial.reached {
        Ok(reached) => reached,
        Err(error) => return format!("<td class=\"first\" colspan=6>{}", escaped(error)),
    };
    let never = || ("never".to_owned(), "–".to_owned());
    let (steps, seconds) = reached
        .learnt
        .map_or_else(never, |(steps, seconds)| (grouped(steps as f64), plain(Some(seconds))));
    format!(
        "<td class=\"first\">{}<td>{}<td class=\"first\">{steps}<td>{seconds}<td>{}<td>{}",
        digits(reached.fit.sigma_error()),
        digits(Some(reached.tail)),
        plain(reached.fit.outcome.ms_per_step_median),
        digits(Some(reached.least)),
    )
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
fn figure(trials: &[Trial]) -> Result<String, ReportError> {
    let mut names: Vec<Alternative> = Vec::new();
    for trial in trials.iter().filter(|trial| is_drawn(trial)) {
        if !names.contains(&trial.alternative) {
            names.push(trial.alternative);
        }
    }
    let place = |trial: &Trial| names.iter().position(|&name| name == trial.alternative);
    let panels = parts(trials).map(|(heading, part)| {
        // Ours, the first, lies over the others.
        let drawn = part.iter().rev().filter(|trial| is_drawn(trial));
        let curves = drawn.filter_map(|trial| {
            let fit = &trial.reached.as_ref().ok()?.fit;
            Some(Curve {
                color: place(trial)?,
                stroke: stroke(trial.alternative),
                dots: false,
                points: fit.curve(Quantity::SigmaError, |window| window.step),
            })
        });
        let CubeSettings { experiment, sigma_target, .. } = part[0].settings;
        let number = panels::number(experiment);
        let title = format!("{number}, σ* = {sigma_target}: |σ − σ*|, pixels");
        let spoken = format!("Sigma error against step. {heading}");
        Panel {
            figure: Figure {
                x: Scale::Counts,
                y: Scale::Logarithmic,
                x_title: "step",
                size: SIZES[1],
                spoken,
                curves: curves.collect(),
                marks: Vec::new(),
            },
            title,
        }
    });
    let panels: Vec<Panel> = panels.filter(|panel| !panel.figure.is_empty()).collect();
    let legend = names.iter().enumerate().map(|(at, &name)| {
        let line = legend_line(PALETTE[at % PALETTE.len()], stroke(name));
        let ours = if name.choice.is_none() { "ours: " } else { "" };
        format!("<li>{line}{ours}{}", escaped(name.name))
    });
    let legend: String = legend.collect();
    Ok(format!("<ul class=\"legend\">{legend}</ul>{}", row(&panels)?))
}

#[cfg(test)]
mod tests {
    use super::super::tests::outcome;
    use super::*;
    use crate::alternatives;

    fn reached(errors: &[f64]) -> Reached {
        let (_, settings) = alternatives(errors.len() as u64 - 1).remove(0);
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
        let trials: Vec<Trial> = alternatives(20)
            .iter()
            .map(|(alternative, settings)| {
                let failed = alternative.name == "nothing";
                let outcome = outcome(settings, 1e-3);
                let outcome = if failed { Err("sigma < 0".to_owned()) } else { Ok(outcome) };
                Trial::new(*alternative, settings, outcome)
            })
            .collect();
        let html = html(&trials).expect("a section");
        let parts = parts(&trials).count();
        assert_eq!(html.matches("<tr class=\"part\">").count(), parts);
        assert_eq!(html.matches(">Ours</b>").count(), parts);
        assert_eq!(html.matches("sigma &lt; 0").count(), parts);
        assert_eq!(html.matches("<svg viewBox=\"0 0 680").count(), parts);
        assert_eq!(html.matches("<tr><th>").count(), trials.len());
    }
}
