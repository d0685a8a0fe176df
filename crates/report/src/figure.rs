//! Plots: one panel, logarithmic or linear axes, lines with bands, as SVG text.
//!
//! A panel carries no title and no legend: the page sets both in its own type, outside of the
//! data. Colours are written as the entries of [`PALETTE`]; the page's style sheet exchanges
//! them for a dark scheme, so that one SVG serves both.
//!
//! What is NaN or infinite is never drawn: it cuts the line in two. On a horizontal logarithmic
//! axis a point at or before zero is left out; for the vertical one see the axis.

use std::ops::Range;

use plotters::prelude::{
    ChartBuilder, Circle, DrawingArea, IntoDrawingArea, IntoFont, PathElement, Polygon, RGBColor,
    SVGBackend, ShapeStyle,
};
use plotters::style::Color;

use crate::axis::{Axis, Scale};
use crate::error::ReportError;
use crate::markup::escaped;
use crate::quartiles::quartiles;

/// Colours of the curves, after Okabe and Ito: told apart by colour-blind eyes and in grey.
pub const PALETTE: [&str; 7] =
    ["#0072B2", "#D55E00", "#009E73", "#AA4499", "#B8860B", "#56B4E9", "#56606B"];

/// The same colours for a dark page.
pub(crate) const PALETTE_DARK: [&str; 7] =
    ["#4FB3F0", "#FF8A4C", "#2FD0A0", "#E07BCB", "#E6C229", "#B5E3FF", "#A9B3BE"];

/// Text of the axes, on a light page and on a dark one.
pub const INK: [&str; 2] = ["#4A4A55", "#B4B6C0"];

/// Grid lines, on a light page and on a dark one.
pub(crate) const GRID: [&str; 2] = ["#E4E4EA", "#2E3038"];

/// Drawn sizes, for two panels in a row and for three: twice the nominal ones, since the backend
/// rounds to whole units. Text has the same drawn height in both.
pub(crate) const SIZES: [(u32, u32); 2] = [(880, 600), (680, 560)];
/// Height of the text of the axes, in drawn units.
const TEXT: u32 = 32;
/// Radius of a dot, in drawn units.
const DOT: u32 = 9;
/// Line widths that stand for the kinds of line until [`dashed`] exchanges them.
const WIDTHS: [u32; 4] = [4, 5, 6, 7];

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stroke {
    /// Unbroken.
    Solid,
    /// Long dashes.
    Dashed,
    /// Dots.
    Dotted,
    /// Dashes and dots in turns.
    DashDotted,
}

/// A line, and the band around it.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Index into the palette, taken modulo its length.
    pub color: usize,
    /// The kind of line.
    pub stroke: Stroke,
    /// Whether each point has a dot: where points are measurements and the line only joins them.
    pub dots: bool,
    /// `[x, low, middle, high]`, by ascending `x`.
    pub points: Vec<[f64; 4]>,
}

impl Curve {
    /// A line without dots through `points`, each `[x, low, middle, high]`, by ascending `x`.
    pub fn new(color: usize, stroke: Stroke, points: Vec<[f64; 4]>) -> Self {
        Self { color, stroke, dots: false, points }
    }

    /// The same without a band, through points `(x, y)`.
    pub fn line(
        color: usize,
        stroke: Stroke,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        Self::new(color, stroke, points.into_iter().map(|(x, y)| [x, y, y, y]).collect())
    }

    /// The medians of several lines, point by point, with the quartiles of their heights as a band. A line has
    /// points `[x, y]`, as many as the others.
    pub fn medians(color: usize, lines: &[&[[f64; 2]]]) -> Self {
        let count = lines.iter().map(|line| line.len()).min().unwrap_or(0);
        let point = |index: usize| {
            let column = |entry: usize| quartiles(lines.iter().map(|line| line[index][entry]));
            let ([_, x, _], [low, middle, high]) = (column(0), column(1));
            [x, low, middle, high]
        };
        Self::new(color, Stroke::Solid, (0..count).map(point).collect())
    }

    /// The same line with a dot at each point.
    #[must_use]
    pub fn with_dots(self) -> Self {
        Self { dots: true, ..self }
    }
}

/// One panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What is shown, with its unit.
    pub title: String,
    /// The horizontal axis.
    pub x: Scale,
    /// What the horizontal axis shows, with its unit.
    pub x_title: &'static str,
    /// The vertical axis.
    pub y: Scale,
    /// The lines.
    pub curves: Vec<Curve>,
    /// Values marked by a thin horizontal line: the truth that lines should reach.
    pub marks: Vec<(usize, f64)>,
}

impl Figure {
    /// A panel without marks; the horizontal axis comes with what it shows.
    pub fn new(
        title: impl Into<String>,
        (x, x_title): (Scale, &'static str),
        y: Scale,
        curves: impl IntoIterator<Item = Curve>,
    ) -> Self {
        let (title, curves) = (title.into(), curves.into_iter().collect());
        Self { title, x, x_title, y, curves, marks: Vec::new() }
    }

    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        self.curves.iter().all(|curve| self.runs(curve).is_empty())
    }

    /// The panel as an SVG element that fills the width it is given, drawn in one of [`SIZES`]. Readers who
    /// hear the page are told its title and axis.
    pub(crate) fn svg(&self, size: (u32, u32)) -> Result<String, ReportError> {
        let (x, y) = (self.axis(self.x, 0..1), self.axis(self.y, 1..4));
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.draw(&root, &x, &y).map_err(|error| ReportError::Figure(error.to_string()))?;
        }
        Ok(self.finish(&text, size))
    }

    /// The axis over the entries `columns` of all points.
    fn axis(&self, scale: Scale, columns: Range<usize>) -> Axis {
        let vertical = columns.start > 0;
        let marks = self.marks.iter().map(|mark| mark.1).filter(|_| vertical);
        let points = self.curves.iter().flat_map(|curve| &curve.points);
        let values = points.flat_map(|point| point[columns.clone()].iter().copied());
        Axis::new(scale, values.chain(marks).filter(|value| value.is_finite()), vertical)
    }

    /// The stretches of finite points of a curve.
    fn runs(&self, curve: &Curve) -> Vec<Vec<[f64; 4]>> {
        let keep = |p: &[f64; 4]| {
            p.iter().all(|v| v.is_finite()) && (self.x == Scale::Linear || p[0] > 0.0)
        };
        let runs = curve.points.split(|p| !keep(p)).filter(|run| !run.is_empty());
        runs.map(<[_]>::to_vec).collect()
    }

    /// Draws axes, marks, bands and lines.
    fn draw(
        &self,
        root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
        x: &Axis,
        y: &Axis,
    ) -> Result<(), Box<dyn std::error::Error>> {
        let color = |index: usize| hex(PALETTE[index % PALETTE.len()]);
        let ink = hex(INK[0]);
        let font = ("sans-serif", TEXT).into_font().color(&ink);
        let mut chart = ChartBuilder::on(root)
            .margin_right(64)
            .margin_top(18)
            .x_label_area_size(92)
            .y_label_area_size(122)
            .build_cartesian_2d(x.clone(), y.clone())?;
        chart
            .configure_mesh()
            .x_labels(x.ticks.len().max(1))
            .y_labels(y.ticks.len().max(1))
            .x_desc(self.x_title)
            .label_style(font.clone())
            .axis_desc_style(font)
            .light_line_style(ink.mix(0.0))
            .bold_line_style(hex(GRID[0]).stroke_width(2))
            .axis_style(hex(GRID[0]).stroke_width(2))
            .draw()?;
        for &(index, value) in self.marks.iter().filter(|mark| mark.1.is_finite()) {
            let ends = vec![(x.value(x.ends.start), value), (x.value(x.ends.end), value)];
            let style = ShapeStyle { stroke_width: 2, ..color(index).mix(0.7).into() };
            chart.draw_series([PathElement::new(ends, style)])?;
        }
        for curve in &self.curves {
            for run in self.runs(curve).iter().filter(|run| run.iter().any(|p| p[1] != p[3])) {
                let low = run.iter().map(|p| (p[0], p[1]));
                let high = run.iter().rev().map(|p| (p[0], p[3]));
                let band: Vec<_> = low.chain(high).collect();
                chart.draw_series([Polygon::new(band, color(curve.color).mix(0.16))])?;
            }
        }
        for curve in &self.curves {
            for run in self.runs(curve) {
                let line: Vec<_> = run.iter().map(|p| (p[0], p[2])).collect();
                let width = WIDTHS[curve.stroke as usize];
                chart.draw_series([PathElement::new(
                    line,
                    color(curve.color).stroke_width(width),
                )])?;
                if curve.dots {
                    let dot =
                        |p: &[f64; 4]| Circle::new((p[0], p[2]), DOT, color(curve.color).filled());
                    chart.draw_series(run.iter().map(dot))?;
                }
            }
        }
        root.present()?;
        Ok(())
    }

    /// Makes the backend's file an element of a page: fluid, named, with its dashes.
    fn finish(&self, text: &str, (width, height): (u32, u32)) -> String {
        let body = text.find('>').map_or("", |start| &text[start + 1..]);
        let spoken = escaped(&format!("{}, against {}", self.title, self.x_title));
        let head =
            format!("<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{spoken}\">");
        dashed(&format!("{head}{}", body.replace(" \"/>", "\"/>").replace('\n', "")))
    }
}

/// Exchanges the widths that stand for kinds of line for widths and dashes.
fn dashed(svg: &str) -> String {
    let width = |index: usize| format!("stroke-width=\"{}\"", WIDTHS[index]);
    let joined = "stroke-width=\"4\" stroke-linejoin=\"round\" stroke-linecap=\"round\"";
    svg.replace(&width(0), joined)
        .replace(&width(1), &format!("{joined} stroke-dasharray=\"18 12\""))
        .replace(&width(2), &format!("{joined} stroke-dasharray=\"1 10\""))
        .replace(&width(3), &format!("{joined} stroke-dasharray=\"16 10 1 10\""))
}

/// A colour of the palette; these are all written `#rrggbb`.
fn hex(text: &str) -> RGBColor {
    let part = |start: usize| u8::from_str_radix(&text[start..start + 2], 16).unwrap_or(0);
    RGBColor(part(1), part(3), part(5))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(y: Scale, points: Vec<[f64; 4]>) -> Figure {
        let curve = Curve::new(0, Stroke::Dashed, points);
        Figure::new("a \"quoted\" <name>", (Scale::Seconds, "time"), y, [curve])
    }

    #[test]
    fn zeros_lie_on_the_floor_and_its_label_says_so() {
        let svg = figure(Scale::Logarithmic, vec![[0.1, 1.0, 1.0, 1.0], [1.0, 0.0, 0.0, 1e-3]]);
        let svg = svg.svg(SIZES[0]).expect("a figure with zeros");
        assert!(svg.contains("≤10⁻³"), "{svg}");
        assert!(svg.contains("stroke-dasharray"), "{svg}");
    }

    #[test]
    fn every_measurement_has_its_dot_where_dots_are_asked_for() {
        let mut figure = figure(Scale::Linear, vec![[1.0; 4], [2.0, f64::NAN, 1.0, 1.0], [3.0; 4]]);
        assert!(!figure.svg(SIZES[0]).expect("lines").contains("<circle"));
        figure.curves[0].dots = true;
        assert_eq!(figure.svg(SIZES[0]).expect("dots").matches("<circle").count(), 2);
    }

    #[test]
    fn what_is_not_finite_is_never_drawn() {
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        for value in bad {
            let all = figure(Scale::Logarithmic, vec![[1.0, value, value, value]]);
            assert!(all.is_empty());
            for scale in [Scale::Linear, Scale::Logarithmic] {
                let points =
                    vec![[1.0, 0.1, 0.1, 0.1], [2.0, 0.1, value, 0.1], [3.0, 0.2, 0.2, 0.2]];
                let svg = figure(scale, points).svg(SIZES[0]).expect("a figure with gaps");
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
                assert_eq!(svg.matches("stroke-dasharray").count(), 2, "the line is cut");
            }
        }
    }

    #[test]
    fn a_name_cannot_break_the_page() {
        let svg =
            figure(Scale::Linear, vec![[1.0, 1.0, 1.0, 1.0]]).svg(SIZES[0]).expect("a figure");
        assert!(svg.contains("a &quot;quoted&quot; &lt;name&gt;, against time"), "{svg}");
    }
}
