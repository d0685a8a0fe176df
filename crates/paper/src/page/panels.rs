//! The report's figures: which quantities, against what, for which groups of fits.

use std::collections::BTreeSet;

use bokashi_report::{Curve, Figure, Figures, INK, PALETTE, Scale, Stroke};

use super::digest::{Group, Quantity, Window};
use crate::Experiment;

/// Error against run time: loss, vertex error, colour error and sigma error, as far as the
/// experiment knows them.
pub(crate) fn against_time(groups: &[&Group]) -> Figures {
    let panels = [
        (Quantity::Loss, "Loss, sum of squared differences"),
        (Quantity::VertexError, "Vertex error, in edges of the cube"),
        (Quantity::ColorError, "Colour error, mean distance in RGB"),
        (Quantity::SigmaError, "Sigma error |σ − σ*|, pixels"),
    ];
    let panels = panels.map(|(quantity, title)| {
        let y = if quantity == Quantity::Loss { Scale::Squares } else { Scale::Logarithmic };
        panel(groups, title, quantity, (Scale::Seconds, "wall-clock time"), y)
    });
    figures(groups, panels)
}

/// Mean vertex distance and sigma against step: the paper's Figures 4, 6 and 7.
pub(crate) fn against_step(groups: &[&Group]) -> Figures {
    let x = (Scale::Counts, "step");
    let distance = "Vertex error, in edges of the cube";
    let sigma = "Sigma, pixels; thin lines: targets";
    let mut sigma = panel(groups, sigma, Quantity::Sigma, x, Scale::Linear);
    if !sigma.is_empty() {
        sigma.marks = groups.iter().map(|group| (color(groups, group), group.grade())).collect();
        sigma.marks.dedup();
    }
    figures(groups, [panel(groups, distance, Quantity::VertexError, x, Scale::Logarithmic), sigma])
}

fn panel(
    groups: &[&Group],
    title: &'static str,
    quantity: Quantity,
    x: (Scale, &'static str),
    y: Scale,
) -> Figure {
    let spent = |window: &Window| if x.0 == Scale::Seconds { window.seconds } else { window.step };
    let curves = groups.iter().map(|group| {
        Curve::new(color(groups, group), group.stroke(), group.curve(quantity, spent))
    });
    Figure::new(title, x, y, curves)
}

/// One colour per resolution or sigma: the index of the group's among all there are.
fn color(groups: &[&Group], group: &Group) -> usize {
    let mut grades: Vec<f64> = groups.iter().map(|group| group.grade()).collect();
    grades.sort_by(f64::total_cmp);
    grades.dedup();
    grades.iter().position(|&grade| grade == group.grade()).unwrap_or(0)
}

/// Panels under a legend: the colours, then the kinds of line where there are several.
fn figures<const N: usize>(groups: &[&Group], panels: [Figure; N]) -> Figures {
    let strokes: BTreeSet<Stroke> = groups.iter().map(|group| group.stroke()).collect();
    let mut grades = groups.to_vec();
    grades.sort_by(|a, b| a.grade().total_cmp(&b.grade()));
    grades.dedup_by_key(|group| group.grade());
    let grades = grades.into_iter().map(|group| {
        let color = PALETTE[color(groups, group) % PALETTE.len()];
        let stroke = if strokes.len() == 1 { group.stroke() } else { Stroke::Solid };
        (group.grade_name(), color, stroke)
    });
    let kinds = strokes.iter().filter(|_| strokes.len() > 1);
    let kinds = kinds.map(|&stroke| (stroke_name(stroke).to_owned(), INK[0], stroke));
    let mut figures = Figures::new(panels, grades.chain(kinds));
    if let (1, Some(&stroke)) = (strokes.len(), strokes.first())
        && stroke != Stroke::Solid
    {
        figures.remarks.push(stroke_name(stroke).to_owned());
    }
    let counts = || groups.iter().map(|group| group.fits.len());
    if let (Some(least), Some(most)) = (counts().min(), counts().max()) {
        figures.remarks.push(match (least, most) {
            (_, 1) => "one seed each".to_owned(),
            (a, b) if a == b => format!("{a} seeds each"),
            (a, b) => format!("{a} to {b} seeds each"),
        });
    }
    figures.with_heading(groups.first().map_or("", |group| heading(group.settings.experiment)))
}

/// What a kind of line stands for.
fn stroke_name(stroke: Stroke) -> &'static str {
    match stroke {
        Stroke::Solid => "the paper’s rates",
        Stroke::Dashed => "tuned rates",
        Stroke::Dotted => "aliased",
        Stroke::DashDotted => "exact coverage",
    }
}

/// The heading of an experiment: its number in the paper, and what it learns.
pub(crate) fn heading(experiment: Experiment) -> &'static str {
    match experiment {
        Experiment::Vertices => "5.1 Vertices and colours",
        Experiment::Sigma => "5.2 Sigma alone",
        Experiment::Joint => "5.3 Vertices, colours and sigma together",
    }
}

/// The number of an experiment in the paper.
pub(crate) fn number(experiment: Experiment) -> &'static str {
    let heading = heading(experiment);
    heading.split(' ').next().unwrap_or(heading)
}
