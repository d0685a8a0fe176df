//! How soon fits reach errors, and their errors along the way: what two studies tell of fits.

use bokashi_report::{Cell, Column, Curve, Figure, Scale};

/// The errors to reach.
const LEVELS: [f64; 3] = [0.1, 0.01, 1e-3];
/// How many points a curve has.
const POINTS: i32 = 60;

/// The columns of [`cells`].
pub(crate) const COLUMNS: [Column; 9] = [
    ("seeds to 0.1", "seeds_to_1e-1"),
    ("steps", "median_steps_to_1e-1"),
    ("seconds", "median_seconds_to_1e-1"),
    ("seeds to 0.01", "seeds_to_1e-2"),
    ("steps", "median_steps_to_1e-2"),
    ("seconds", "median_seconds_to_1e-2"),
    ("seeds to 1e-3", "seeds_to_1e-3"),
    ("steps", "median_steps_to_1e-3"),
    ("seconds", "median_seconds_to_1e-3"),
];

/// What is kept of a fit's errors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Descent {
    /// Steps and seconds to each of [`LEVELS`]; infinite where it is never reached.
    pub(crate) levels: [[f64; 2]; LEVELS.len()],
    /// The error at the end.
    pub(crate) last: f64,
    /// Seconds of a step, all included.
    pub(crate) step_seconds: f64,
    /// Seconds and errors at the steps of the curve.
    pub(crate) curve: Vec<[f64; 2]>,
}

impl Descent {
    /// Of seconds and errors before the first step and after each, and of all seconds.
    pub(crate) fn new(history: &[[f64; 2]], seconds: f64) -> Self {
        let levels = LEVELS.map(|level| {
            let first = history.iter().position(|[_, error]| *error <= level);
            first.map_or([f64::INFINITY; 2], |step| [step as f64, history[step][0]])
        });
        let steps = history.len().saturating_sub(1).max(1) as f64;
        let step = |point: i32| steps.powf(f64::from(point) / f64::from(POINTS)).round() as usize;
        let mut shown: Vec<usize> = (0..=POINTS).map(step).collect();
        shown.dedup();
        Self {
            levels,
            last: history[history.len() - 1][1],
            step_seconds: seconds / steps,
            curve: shown.into_iter().map(|step| history[step]).collect(),
        }
    }

    /// Whether it ends farther off than `most`.
    pub(crate) fn is_stuck(&self, most: f64) -> bool {
        self.last.is_nan() || self.last > most
    }
}

/// How many of the fits reach each error, and the medians of their steps and seconds.
pub(crate) fn cells<'a>(fits: impl Iterator<Item = &'a Descent> + Clone) -> Vec<Cell> {
    let of_level = |level: usize| {
        let reached = fits.clone().filter(|fit| fit.levels[level][0].is_finite());
        let medians =
            [0, 1].map(|what| Cell::median(fits.clone().map(|fit| fit.levels[level][what])));
        [Cell::part([reached.count(), fits.clone().count()])].into_iter().chain(medians)
    };
    (0..LEVELS.len()).flat_map(of_level).collect()
}

/// Errors against time, a curve per way: medians over its fits, and quartiles as bands.
pub(crate) fn panel<'a>(title: String, ways: impl Iterator<Item = Vec<&'a Descent>>) -> Figure {
    let curves = ways.enumerate().map(|(way, fits)| {
        Curve::medians(way, &fits.iter().map(|fit| &*fit.curve).collect::<Vec<_>>())
    });
    Figure::new(title, (Scale::Seconds, "wall-clock time"), Scale::Logarithmic, curves)
}
