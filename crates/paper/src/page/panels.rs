//! The report's figures: which quantities, against what, for which groups of fits.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use bokashi_report::{
    Curve, Figure, INK, PALETTE, Panel, ReportError, SIZES, Scale, Stroke, escaped, legend_line,
    row,
};

use super::digest::{Group, Quantity, Window};
use crate::Experiment;

/// Error against run time: loss, vertex error, colour error and sigma error, as far as the
/// experiment knows them.
pub(crate) fn against_time(groups: &[&Group]) -> Vec<Panel> {
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
    let mut panels = Vec::from(panels);
    panels.retain(|panel| !panel.figure.is_empty());
    if panels.len() == 3 {
        panels.iter_mut().for_each(|panel| panel.figure.size = SIZES[1]);
    }
    panels
}

/// Mean vertex distance and sigma against step: the paper's Figures 4, 6 and 7.
pub(crate) fn against_step(groups: &[&Group]) -> Vec<Panel> {
    let x = (Scale::Counts, "step");
    let distance = "Vertex error, in edges of the cube";
    let mut panels = vec![
        panel(groups, distance, Quantity::VertexError, x, Scale::Logarithmic),
        panel(groups, "Sigma, pixels; thin lines: targets", Quantity::Sigma, x, Scale::Linear),
    ];
    panels.retain(|panel| !panel.figure.is_empty());
    for panel in panels.iter_mut().filter(|panel| panel.figure.y == Scale::Linear) {
        let targets = groups.iter().map(|group| (color(groups, group), group.grade()));
        panel.figure.marks = targets.collect();
        panel.figure.marks.dedup();
    }
    panels
}

fn panel(
    groups: &[&Group],
    title: &'static str,
    quantity: Quantity,
    (x, x_title): (Scale, &'static str),
    y: Scale,
) -> Panel {
    let place = |window: &Window| if x == Scale::Seconds { window.seconds } else { window.step };
    let curves = groups.iter().map(|group| Curve {
        color: color(groups, group),
        stroke: group.stroke(),
        dots: false,
        points: group.curve(quantity, place),
    });
    let names: Vec<_> = groups.iter().map(|group| group.name()).collect();
    let spoken = format!("{title}, against {x_title}: {}", names.join("; "));
    let curves = curves.collect();
    Panel {
        title: title.to_owned(),
        figure: Figure { x, y, x_title, size: SIZES[0], spoken, curves, marks: Vec::new() },
    }
}

/// One colour per resolution or sigma: the index of the group's among all there are.
fn color(groups: &[&Group], group: &Group) -> usize {
    let mut grades: Vec<f64> = groups.iter().map(|group| group.grade()).collect();
    grades.sort_by(f64::total_cmp);
    grades.dedup();
    grades.iter().position(|&grade| grade == group.grade()).unwrap_or(0)
}

/// The legend of a row of panels, as HTML: the colours, then the kinds of line where there are
/// several.
fn legend(groups: &[&Group]) -> String {
    let strokes: BTreeSet<Stroke> = groups.iter().map(|group| group.stroke()).collect();
    let mut html = String::from("<ul class=\"legend\">");
    let mut grades = groups.to_vec();
    grades.sort_by(|a, b| a.grade().total_cmp(&b.grade()));
    grades.dedup_by_key(|group| group.grade());
    for group in grades {
        let color = PALETTE[color(groups, group) % PALETTE.len()];
        let stroke = if strokes.len() == 1 { group.stroke() } else { Stroke::Solid };
        // Writing to a string cannot fail.
        let _ = write!(html, "<li>{}{}", legend_line(color, stroke), escaped(&group.grade_name()));
    }
    for (at, stroke) in strokes.iter().enumerate() {
        let name = match stroke {
            Stroke::Solid => "the paper’s rates",
            Stroke::Dashed => "tuned rates",
            Stroke::Dotted => "aliased",
            Stroke::DashDotted => "exact coverage",
        };
        let class = if at == 0 { " class=\"apart\"" } else { "" };
        let _ = match (strokes.len(), stroke) {
            (1, Stroke::Solid) => Ok(()),
            (1, _) => write!(html, "<li{class}><small>{name}</small>"),
            _ => write!(html, "<li{class}>{}{name}", legend_line(INK[0], *stroke)),
        };
    }
    let counts: BTreeSet<usize> = groups.iter().map(|group| group.fits.len()).collect();
    if let (Some(least), Some(most)) = (counts.first(), counts.last()) {
        let _ = match (least, most) {
            (_, 1) => write!(html, "<li class=\"apart\"><small>one seed each</small>"),
            (a, b) if a == b => write!(html, "<li class=\"apart\"><small>{a} seeds each</small>"),
            (a, b) => write!(html, "<li class=\"apart\"><small>{a} to {b} seeds each</small>"),
        };
    }
    html.push_str("</ul>");
    html
}

/// Panels side by side under their legend, as HTML.
pub(crate) fn html(groups: &[&Group], panels: &[Panel]) -> Result<String, ReportError> {
    Ok(legend(groups) + &row(panels)?)
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
