//! Axes: where a value is drawn, which values are labelled, and how.
//!
//! # Values that a logarithm cannot take
//! Zero, negative values and values under the scale's floor are drawn on the axis' lower end,
//! whose label then reads "≤10^k".

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// Errors under this are rounding: f64 numbers next to 1/2 lie 1.1e-16 apart.
const FLOOR: f64 = 1e-17;

/// How an axis maps values to lengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences, equal lengths.
    Linear,
    /// Equal ratios, equal lengths; labels are powers of ten.
    Logarithmic,
    /// The same for squares: it goes twice as deep.
    Squares,
    /// Logarithmic, in seconds; labels carry units.
    Seconds,
    /// Logarithmic, in counts; labels are whole numbers.
    Counts,
}

impl Scale {
    /// A logarithmic axis goes no deeper.
    fn floor(self) -> f64 {
        if self == Self::Squares { FLOOR * FLOOR } else { FLOOR }
    }
}

/// An axis: where it begins and ends, in drawn lengths (log10 of the value if logarithmic).
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    scale: Scale,
    pub(crate) ends: Range<f64>,
    pub(crate) ticks: Vec<f64>,
    /// Some value lies under the axis and is drawn on its end.
    clamped: bool,
}

impl Axis {
    /// The axis that holds all of the finite `values`.
    pub(crate) fn new(scale: Scale, values: impl Iterator<Item = f64>, vertical: bool) -> Self {
        let values: Vec<f64> = values.collect();
        if scale == Scale::Linear {
            return Self::linear(&values);
        }
        let above = values.iter().copied().filter(|&value| value >= scale.floor());
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
        // Sideways a range may lie between two ticks: it goes on to the next one.
        let high = high.max((low / stride).ceil() * stride);
        let mut ticks = Vec::new();
        let mut tick = (low / stride).ceil() * stride;
        while tick <= high + 1e-9 {
            ticks.push(tick);
            tick += stride;
        }
        let clamped = vertical && values.iter().any(|&value| value < scale.floor());
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
        let ticks: Vec<f64> = (0..=count).map(|index| (first + index as f64) * step).collect();
        Self { scale: Scale::Linear, ends: ticks[0]..ticks[count], ticks, clamped: false }
    }

    /// Where a finite value is drawn.
    fn position_of(&self, value: f64) -> f64 {
        let position = match self.scale {
            Scale::Linear => value,
            _ if value >= self.scale.floor() => value.log10(),
            _ => self.ends.start,
        };
        position.clamp(self.ends.start, self.ends.end)
    }

    /// The value drawn at `place`.
    pub(crate) fn value(&self, position: f64) -> f64 {
        if self.scale == Scale::Linear { position } else { 10f64.powf(position) }
    }

    /// The label of the tick drawn at `at`.
    fn label(&self, position: f64) -> String {
        let decade = position.round() as i32;
        match self.scale {
            Scale::Linear => short(position),
            Scale::Counts => grouped(10f64.powi(decade)),
            Scale::Seconds if decade < -6 => format!("{} ns", short(10f64.powi(decade + 9))),
            Scale::Seconds if decade < -3 => format!("{} µs", short(10f64.powi(decade + 6))),
            Scale::Seconds if decade < 0 => format!("{} ms", short(10f64.powi(decade + 3))),
            Scale::Seconds => format!("{} s", grouped(10f64.powi(decade))),
            Scale::Logarithmic | Scale::Squares => {
                let under = self.clamped && (position - self.ends.start).abs() < 0.5;
                format!("{}{}", if under { "≤" } else { "" }, power_of_ten(decade))
            }
        }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let part = (self.position_of(*value) - self.ends.start) / (self.ends.end - self.ends.start);
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
        self.label(self.position_of(*value))
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
pub fn grouped(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extreme_ranges_have_few_ticks() {
        for (low, high) in [(1e-300, 1e300), (0.0, 0.0), (1e-17, 1e-17), (-1.0, -1.0), (3.0, 3.0)] {
            let logarithmic = [Scale::Logarithmic, Scale::Squares, Scale::Seconds, Scale::Counts];
            for scale in [Scale::Linear].into_iter().chain(logarithmic) {
                let axis = Axis::new(scale, [low, high].into_iter(), true);
                assert!((2..=21).contains(&axis.ticks.len()), "{low} {high} {axis:?}");
                assert!(axis.ends.start < axis.ends.end, "{low} {high} {axis:?}");
            }
        }
    }

    #[test]
    fn an_axis_has_a_tick_wherever_its_values_lie() {
        for (low, high) in [(2.0, 9.5), (0.02, 0.07), (1.1, 1.2), (11.0, 99.0), (1.0, 5.0)] {
            for scale in [Scale::Logarithmic, Scale::Seconds, Scale::Counts] {
                let axis = Axis::new(scale, [low, high].into_iter(), false);
                assert!(!axis.ticks.is_empty(), "{low} {high} {axis:?}");
                assert!(axis.ticks.iter().all(|tick| *tick <= axis.ends.end + 1e-9));
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
}
