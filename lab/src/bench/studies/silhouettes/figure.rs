//! Errors against times.

use bokashi_report::{Curve, Figure, Figures, PALETTE, Scale, Stroke};

use super::method::METHODS;
use super::row::Row;

/// A panel per scene, with a curve per method through the scene's sizes.
pub(super) fn figures(rows: &[Row]) -> Figures {
    let panels = rows.chunk_by(|row, next| row.case == next.case).map(panel);
    let legend = METHODS.iter().enumerate();
    let legend = legend.map(|(index, method)| {
        (method.name.to_owned(), PALETTE[index % PALETTE.len()], Stroke::Solid)
    });
    Figures::new(panels, legend)
        .with_heading("Relative error of the gradient, a dot per size; bands: least and largest")
}

/// That of one scene.
fn panel(rows: &[Row]) -> Figure {
    let point = |row: &Row, index: usize| {
        let [least, median, largest] = row.errors[index].of_gradient();
        row.timings[index].as_ref().map(|timing| [timing.minimum, least, median, largest])
    };
    let curve = |color: usize| {
        let mut points: Vec<_> = rows.iter().filter_map(|row| point(row, color)).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Curve::new(color, Stroke::Solid, points).with_dots()
    };
    let x = (Scale::Seconds, "time of an image and its gradient");
    Figure::new(&*rows[0].case, x, Scale::Logarithmic, (0..METHODS.len()).map(curve))
}
