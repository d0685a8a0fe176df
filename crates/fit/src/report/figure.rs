//! Plots: one panel, logarithmic or linear axes, lines with bands, as SVG text.
//!
//! A panel carries no title and no legend: the page sets both in its own type, outside of the
//! data. Colours are written as the entries of [`PALETTE`]; the page's style sheet exchanges
//! them for a dark scheme, so that one SVG serves both.
//!
//! # Values that a logarithm cannot take
//! Zero, negative values and values under [`FLOOR`] are drawn on the axis' lower end, whose
//! label then reads "≤10^k". On a horizontal logarithmic axis a point at or before zero is
//! left out. What is NaN or infinite is never drawn: it cuts the line in two.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::{
    ChartBuilder, DrawingArea, IntoDrawingArea, IntoFont, PathElement, Polygon, RGBColor,
    SVGBackend, ShapeStyle,
};
use plotters::style::Color;

use super::ReportError;

/// Under this a logarithmic axis does not go: an eighth of f64's rounding unit at 1.
pub(crate) const FLOOR: f64 = 1e-17;

/// Colours of the curves, after Okabe and Ito: told apart by colour-blind eyes and in grey.
pub(crate) const PALETTE: [&str; 6] =
    ["#0072B2", "#D55E00", "#009E73", "#AA4499", "#B8860B", "#56606B"];

/// The same colours for a dark page.
pub(crate) const PALETTE_DARK: [&str; 6] =
    ["#4FB3F0", "#FF8A4C", "#2FD0A0", "#E07BCB", "#E6C229", "#A9B3BE"];

/// Text of the axes, on a light page and on a dark one.
pub(crate) const INK: [&str; 2] = ["#4A4A55", "#B4B6C0"];

/// Grid lines, on a light page and on a dark one.
pub(crate) const GRID: [&str; 2] = ["#E4E4EA", "#2E3038"];

/// Drawn size: twice the nominal one, since the backend rounds to whole units.
const SIZE: (u32, u32) = (960, 640);
/// Height of the text of the axes, in drawn units.
const TEXT: u32 = 32;
/// Line widths that stand for the kinds of line until [`dashed`] exchanges them.
const WIDTHS: [u32; 3] = [4, 5, 6];

/// How an axis maps values to lengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Equal differences, equal lengths.
    Linear,
    /// Equal ratios, equal lengths; labels are powers of ten.
    Logarithmic,
    /// Logarithmic, in seconds; labels carry units.
    Seconds,
    /// Logarithmic, in counts; labels are whole numbers.
    Counts,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Stroke {
    /// Unbroken.
    Solid,
    /// Long dashes.
    Dashed,
    /// Dots.
    Dotted,
}

/// A line, and the band around it.
#[derive(Debug, Clone)]
pub(crate) struct Curve {
    /// Index into [`PALETTE`], taken modulo its length.
    pub(crate) color: usize,
    /// The kind of line.
    pub(crate) stroke: Stroke,
    /// `[x, low, middle, high]`, by ascending `x`.
    pub(crate) points: Vec<[f64; 4]>,
}

/// One panel.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// The horizontal axis.
    pub(crate) x: Scale,
    /// The vertical axis.
    pub(crate) y: Scale,
    /// What the horizontal axis shows, with its unit.
    pub(crate) x_title: &'static str,
    /// What the panel shows, for readers who hear the page.
    pub(crate) spoken: String,
    /// The lines.
    pub(crate) curves: Vec<Curve>,
    /// Values marked by a thin horizontal line: the truth that lines should reach.
    pub(crate) marks: Vec<(usize, f64)>,
}

impl Figure {
    /// Whether there is anything to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.curves.iter().all(|curve| self.runs(curve).is_empty())
    }

    /// The panel as an SVG element that fills the width it is given.
    pub(crate) fn svg(&self) -> Result<String, ReportError> {
        let (x, y) = (self.axis(self.x, 0..1), self.axis(self.y, 1..4));
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            self.draw(&root, &x, &y).map_err(|error| ReportError::Figure(error.to_string()))?;
        }
        Ok(self.finish(&text))
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
        let color = |at: usize| hex(PALETTE[at % PALETTE.len()]);
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
        for &(at, value) in self.marks.iter().filter(|mark| mark.1.is_finite()) {
            let ends = vec![(x.value(x.ends.start), value), (x.value(x.ends.end), value)];
            let style = ShapeStyle { stroke_width: 2, ..color(at).mix(0.7).into() };
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
            }
        }
        root.present()?;
        Ok(())
    }

    /// Makes the backend's file an element of a page: fluid, named, with its dashes.
    fn finish(&self, text: &str) -> String {
        let body = text.find('>').map_or("", |at| &text[at + 1..]);
        let spoken = self.spoken.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
        let (width, height) = SIZE;
        let head =
            format!("<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{spoken}\">");
        dashed(&format!("{head}{}", body.replace(" \"/>", "\"/>").replace('\n', "")))
    }
}

/// Exchanges the widths that stand for kinds of line for widths and dashes.
fn dashed(svg: &str) -> String {
    let width = |at: usize| format!("stroke-width=\"{}\"", WIDTHS[at]);
    let joined = "stroke-width=\"4\" stroke-linejoin=\"round\" stroke-linecap=\"round\"";
    svg.replace(&width(0), joined)
        .replace(&width(1), &format!("{joined} stroke-dasharray=\"18 12\""))
        .replace(&width(2), &format!("{joined} stroke-dasharray=\"1 10\""))
}

/// A colour of the palette; these are all written `#rrggbb`.
fn hex(text: &str) -> RGBColor {
    let part = |at: usize| u8::from_str_radix(&text[at..at + 2], 16).unwrap_or(0);
    RGBColor(part(1), part(3), part(5))
}

/// An axis: where it begins and ends, in drawn lengths (log10 of the value if logarithmic).
#[derive(Debug, Clone)]
struct Axis {
    scale: Scale,
    ends: Range<f64>,
    ticks: Vec<f64>,
    /// Some value lies under the axis and is drawn on its end.
    clamped: bool,
}

impl Axis {
    fn new(scale: Scale, values: impl Iterator<Item = f64>, vertical: bool) -> Self {
        let values: Vec<f64> = values.collect();
        if scale == Scale::Linear {
            return Self::linear(&values);
        }
        let above = values.iter().copied().filter(|&value| value >= FLOOR);
        let (low, high) = above.fold((f64::MAX, f64::MIN), |(low, high), value| {
            (low.min(value.log10()), high.max(value.log10()))
        });
        let (low, high) = if low > high { (-1.0, 0.0) } else { (low, high) };
        let stride = ((high - low) / 6.0).ceil().max(1.0);
        // Sideways the curve itself fills the panel; upwards from a tick to a whole decade.
        let (low, high) = if vertical {
            (((low + 1e-9) / stride).floor() * stride, (high - 1e-9).ceil())
        } else {
            (low, high)
        };
        let high = if high - low < 0.5 { low + 1.0 } else { high };
        let mut ticks = Vec::new();
        let mut tick = (low / stride).ceil() * stride;
        while tick <= high + 1e-9 {
            ticks.push(tick);
            tick += stride;
        }
        let clamped = vertical && values.iter().any(|&value| value < FLOOR);
        Self { scale, ends: low..high, ticks, clamped }
    }

    fn linear(values: &[f64]) -> Self {
        let low = values.iter().copied().fold(f64::MAX, f64::min);
        let high = values.iter().copied().fold(f64::MIN, f64::max);
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        let span = if high - low > 0.0 { high - low } else { low.abs().max(1.0) };
        // The round step (1, 2 or 5 times a power of ten) that gives three to seven ticks.
        let power = 10f64.powf((span / 4.0).log10().floor());
        let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power);
        let step = steps.into_iter().find(|step| span / step <= 6.0).unwrap_or(10.0 * power);
        let (first, last) = ((low / step).floor(), (high / step).ceil().max((low / step) + 1.0));
        let count = (last - first).clamp(1.0, 20.0) as usize;
        let ticks: Vec<f64> = (0..=count).map(|at| (first + at as f64) * step).collect();
        Self { scale: Scale::Linear, ends: ticks[0]..ticks[count], ticks, clamped: false }
    }

    /// Where a finite value is drawn.
    fn place(&self, value: f64) -> f64 {
        let place = match self.scale {
            Scale::Linear => value,
            _ if value >= FLOOR => value.log10(),
            _ => self.ends.start,
        };
        place.clamp(self.ends.start, self.ends.end)
    }

    /// The value drawn at `place`.
    fn value(&self, place: f64) -> f64 {
        if self.scale == Scale::Linear { place } else { 10f64.powf(place) }
    }

    /// The label of the tick drawn at `at`.
    fn label(&self, at: f64) -> String {
        let decade = at.round() as i32;
        match self.scale {
            Scale::Linear => short(at),
            Scale::Counts => grouped(10f64.powi(decade)),
            Scale::Seconds if decade < -6 => format!("{} ns", short(10f64.powi(decade + 9))),
            Scale::Seconds if decade < -3 => format!("{} µs", short(10f64.powi(decade + 6))),
            Scale::Seconds if decade < 0 => format!("{} ms", short(10f64.powi(decade + 3))),
            Scale::Seconds => format!("{} s", grouped(10f64.powi(decade))),
            Scale::Logarithmic => {
                let under = self.clamped && (at - self.ends.start).abs() < 0.5;
                format!("{}{}", if under { "≤" } else { "" }, power_of_ten(decade))
            }
        }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let part = (self.place(*value) - self.ends.start) / (self.ends.end - self.ends.start);
        from + (part * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let bold = !hint.weight().allow_light_points();
        if bold { self.ticks.iter().map(|&tick| self.value(tick)).collect() } else { Vec::new() }
    }

    fn range(&self) -> Range<f64> {
        self.value(self.ends.start)..self.value(self.ends.end)
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        self.label(self.place(*value))
    }
}

/// `10` to a power, in superscript digits.
fn power_of_ten(exponent: i32) -> String {
    match exponent {
        0 => return "1".to_owned(),
        1 => return "10".to_owned(),
        _ => {}
    }
    let digits = exponent.to_string();
    let raised = digits.chars().map(|digit| match digit {
        '-' => '⁻',
        _ => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit as usize - '0' as usize],
    });
    format!("10{}", raised.collect::<String>())
}

/// A number without the noise of rounding.
fn short(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}

/// A whole number with its thousands set apart.
pub(crate) fn grouped(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(y: Scale, points: Vec<[f64; 4]>) -> Figure {
        let curves = vec![Curve { color: 0, stroke: Stroke::Dashed, points }];
        let spoken = "a \"quoted\" <name>".to_owned();
        Figure { x: Scale::Seconds, y, x_title: "time", spoken, curves, marks: Vec::new() }
    }

    #[test]
    fn zeros_lie_on_the_floor_and_its_label_says_so() {
        let svg = figure(Scale::Logarithmic, vec![[0.1, 1.0, 1.0, 1.0], [1.0, 0.0, 0.0, 1e-3]]);
        let svg = svg.svg().expect("a figure with zeros");
        assert!(svg.contains("≤10⁻³"), "{svg}");
        assert!(svg.contains("stroke-dasharray"), "{svg}");
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
                let svg = figure(scale, points).svg().expect("a figure with gaps");
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
                assert_eq!(svg.matches("stroke-dasharray").count(), 2, "the line is cut");
            }
        }
    }

    #[test]
    fn extreme_ranges_have_few_ticks() {
        for (low, high) in [(1e-300, 1e300), (0.0, 0.0), (1e-17, 1e-17), (-1.0, -1.0), (3.0, 3.0)] {
            for scale in [Scale::Linear, Scale::Logarithmic, Scale::Seconds, Scale::Counts] {
                let axis = Axis::new(scale, [low, high].into_iter(), true);
                assert!((2..=21).contains(&axis.ticks.len()), "{low} {high} {axis:?}");
                assert!(axis.ends.start < axis.ends.end, "{low} {high} {axis:?}");
            }
        }
    }

    #[test]
    fn labels_read_as_a_person_writes_them() {
        let axis = |scale| Axis::new(scale, [1e-7, 1e5].into_iter(), true);
        assert_eq!(axis(Scale::Seconds).label(-2.0), "10 ms");
        assert_eq!(axis(Scale::Seconds).label(3.0), "1,000 s");
        assert_eq!(axis(Scale::Counts).label(4.0), "10,000");
        assert_eq!(axis(Scale::Logarithmic).label(-12.0), "10⁻¹²");
        assert_eq!(Axis::new(Scale::Linear, [0.0, 4.0].into_iter(), true).label(0.1 + 0.2), "0.3");
    }

    #[test]
    fn a_name_cannot_break_the_page() {
        let svg = figure(Scale::Linear, vec![[1.0, 1.0, 1.0, 1.0]]).svg().expect("a figure");
        assert!(svg.contains("a &quot;quoted&quot; &lt;name>"), "{svg}");
    }
}
