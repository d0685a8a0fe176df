//! What a sample found.

use std::fmt;
use std::time::Instant;

use bokashi::prelude::*;

/// What a figure has to reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// Nothing: the figure is there to be compared.
    None,
    /// A figure below this.
    Below(f64),
    /// A figure above this.
    Above(f64),
}

impl Goal {
    /// Whether `value` reaches it.
    pub fn is_reached(self, value: f64) -> bool {
        match self {
            Self::None => true,
            Self::Below(limit) => value < limit,
            Self::Above(limit) => value > limit,
        }
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(f, "none"),
            Self::Below(limit) => write!(f, "below {limit}"),
            Self::Above(limit) => write!(f, "above {limit}"),
        }
    }
}

/// The figure over the time of a run.
#[derive(Debug, Clone)]
pub struct Curve {
    start: Instant,
    /// Seconds and figures.
    pub points: Vec<(f64, f64)>,
}

impl Curve {
    /// A curve that starts now.
    pub fn starting_now() -> Self {
        Self { start: Instant::now(), points: Vec::new() }
    }

    /// Adds the figure as it is now.
    pub fn add(&mut self, value: f64) {
        self.points.push((self.start.elapsed().as_secs_f64(), value));
    }
}

/// A figure that a sample reached.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// What was measured, with its unit.
    pub metric: String,
    /// The figure.
    pub value: f64,
    /// What it has to reach.
    pub goal: Goal,
    /// Updates that led there.
    pub steps: u64,
    /// Seconds that led there.
    pub seconds: f64,
    /// The figure on its way.
    pub curve: Vec<(f64, f64)>,
    /// Pictures `[H, W, 3]` with their names.
    pub pictures: Vec<(String, Tensor<f64>)>,
}

impl Outcome {
    /// The last figure of `curve`, after `steps` updates.
    ///
    /// # Panics
    /// Where the curve has no point.
    #[track_caller]
    pub fn last(metric: impl Into<String>, goal: Goal, steps: u64, curve: Curve) -> Self {
        let &(seconds, value) = curve.points.last().expect("a curve with a point");
        let (metric, curve) = (metric.into(), curve.points);
        Self { metric, value, goal, steps, seconds, curve, pictures: Vec::new() }
    }

    /// The same with a picture more: `[H, W, 3]`, or `[H, W, 1]` in grey.
    #[must_use]
    pub fn picture<T: Scalar>(mut self, name: &str, image: &Tensor<T>) -> Self {
        let (shape, image) = (image.shape().clone(), image.cast());
        let color = Tensor::from_fn([shape[0], shape[1], 3], |[row, column, channel]| {
            image.data()[(row * shape[1] + column) * shape[2] + channel % shape[2]]
        });
        self.pictures.push((name.to_owned(), color));
        self
    }

    /// Whether the figure reaches its goal.
    pub fn passes(&self) -> bool {
        self.goal.is_reached(self.value)
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { metric, value, goal, steps, seconds, .. } = self;
        let verdict = match (goal, self.passes()) {
            (Goal::None, _) => "no goal",
            (_, true) => "reached",
            (_, false) => "MISSED",
        };
        write!(f, "{metric}: {value:.3e} (goal {goal}: {verdict}), {steps} steps, {seconds:.1} s")
    }
}
