//! Points of time and error, and their figures.

use bokashi_report::{Curve, Figure, PALETTE, Scale, Stroke};

use super::input::Quantity;

/// A measured point.
pub(super) struct Point {
    /// Index of its line.
    pub(super) line: usize,
    pub(super) seconds_per_pixel: f64,
    pub(super) error: f64,
}

/// The colour of the front: the palette's grey.
pub(super) const FRONT: usize = PALETTE.len() - 1;

/// What a curve is called and looks like.
pub(super) struct Line {
    pub(super) name: String,
    /// Index into the palette.
    pub(super) color: usize,
    pub(super) stroke: Stroke,
}

/// The figure of one quantity.
pub(super) fn panel(lines: &[Line], quantity: Quantity, points: &[Point]) -> Figure {
    let position = |point: &Point| (point.seconds_per_pixel, point.error);
    let mut curves = Vec::new();
    for (index, &Line { color, stroke, .. }) in lines.iter().enumerate() {
        let mut points: Vec<_> =
            points.iter().filter(|point| point.line == index).map(position).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        curves.push(Curve::line(color, stroke, points).with_dots());
    }
    curves.push(Curve::line(FRONT, Stroke::Dotted, front(points)));
    let title = format!("{}: relative error", capital(quantity.name()));
    Figure::new(title, (Scale::Seconds, "time per pixel"), Scale::Logarithmic, curves)
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// The points that no other beats in both time and error, as a staircase.
pub(super) fn front(points: &[Point]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<&Point> = points.iter().filter(|point| point.error.is_finite()).collect();
    sorted.sort_by(|a, b| {
        (a.seconds_per_pixel, a.error)
            .partial_cmp(&(b.seconds_per_pixel, b.error))
            .expect("times and errors are numbers")
    });
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for point in sorted {
        match steps.last() {
            Some(&(_, least)) if point.error >= least => continue,
            Some(&(_, least)) => steps.push((point.seconds_per_pixel, least)),
            None => {}
        }
        steps.push((point.seconds_per_pixel, point.error));
    }
    steps
}
