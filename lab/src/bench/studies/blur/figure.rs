//! Points of time and error, and their figures.

use bokashi_report::{Curve, Figure, PALETTE, Panel, SIZES, Scale, Stroke};

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
pub(super) fn panel(
    lines: &[Line],
    quantity: Quantity,
    pixels: usize,
    sigma: f64,
    points: &[Point],
) -> Panel {
    let place = |point: &Point| {
        let error = point.error;
        [point.seconds_per_pixel, error, error, error]
    };
    let mut curves = Vec::new();
    for (at, &Line { color, stroke, .. }) in lines.iter().enumerate() {
        let mut points: Vec<_> =
            points.iter().filter(|point| point.line == at).map(place).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        curves.push(Curve { color, stroke, dots: true, points });
    }
    let front = front(points).into_iter().map(|(x, y)| [x, y, y, y]).collect();
    curves.push(Curve { color: FRONT, stroke: Stroke::Dotted, dots: false, points: front });
    Panel {
        title: format!("{}: relative error", capital(quantity.name())),
        figure: Figure {
            x: Scale::Seconds,
            y: Scale::Logarithmic,
            x_title: "time per pixel",
            size: SIZES[1],
            spoken: format!("{}, {pixels} px, sigma {sigma}: error against time", quantity.name()),
            curves,
            marks: Vec::new(),
        },
    }
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
