//! Errors against times.

use bokashi_report::{Curve, Figure, PALETTE, Panel, SIZES, Scale, Stroke};

use super::method::METHODS;
use super::row::Row;
use crate::bench::study::Figures;

/// A panel per scene, with a curve per method through the scene's sizes.
pub(super) fn figures(rows: &[Row]) -> Figures {
    let panels = rows.chunk_by(|row, next| row.case == next.case).map(panel).collect();
    let legend = METHODS.iter().enumerate();
    let legend = legend
        .map(|(at, method)| (method.name.to_owned(), PALETTE[at % PALETTE.len()], Stroke::Solid));
    Figures {
        heading: Some(
            "Relative error of the gradient, a dot per size; bands: least and largest".to_owned(),
        ),
        is_folded: false,
        legend: legend.collect(),
        panels,
    }
}

/// That of one scene.
fn panel(rows: &[Row]) -> Panel {
    let title = rows[0].case.clone();
    let point = |row: &Row, at: usize| {
        let [least, median, largest] = row.errors[at].of_gradient();
        row.timings[at].as_ref().map(|timing| [timing.minimum, least, median, largest])
    };
    let curve = |color: usize| {
        let mut points: Vec<_> = rows.iter().filter_map(|row| point(row, color)).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Curve { color, stroke: Stroke::Solid, dots: true, points }
    };
    Panel {
        figure: Figure {
            x: Scale::Seconds,
            y: Scale::Logarithmic,
            x_title: "time of an image and its gradient",
            size: SIZES[1],
            spoken: format!("error of the gradient against time: {title}"),
            curves: (0..METHODS.len()).map(curve).collect(),
            marks: Vec::new(),
        },
        title,
    }
}
