//! What the report keeps of a fit: its outcome, and its history thinned to log-spaced steps.
//!
//! A history of 10,000 steps is cut into windows of equal length in the logarithm of the step,
//! [`PER_DECADE`] to a decade. Of each window and each quantity the least, the median and the
//! largest value stay, so that a spike that lasts one step is still in the picture.
//!
//! # Lines and bands
//! One seed: the line is the window's median, the band its least and largest value.
//! Several seeds: each seed's median per window; the line is the median of these over the seeds,
//! the band their quartiles. A seed that ended early counts as long as it ran.

use std::fmt::Write as _;

use bokashi_render_ops::Kernel;
use bokashi_report::{Stroke, quantiles, quartiles};

use crate::{CubeSettings, Experiment, Outcome, Preset, Record, Silhouettes, Snapshot};

/// Windows per decade of steps: about 130 over a run of 10,000, where the first are single steps.
const PER_DECADE: f64 = 40.0;

/// What is measured at every step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Quantity {
    /// The loss.
    Loss,
    /// Mean distance of the vertices.
    VertexError,
    /// Mean distance of the colours.
    ColorError,
    /// Distance of sigma from its target.
    SigmaError,
    /// Sigma.
    Sigma,
}

impl Quantity {
    /// All of them, in the order of a [`Window`]'s values.
    pub(crate) const ALL: [Self; 5] =
        [Self::Loss, Self::VertexError, Self::ColorError, Self::SigmaError, Self::Sigma];

    fn value(self, record: &Record, sigma_target: Option<f64>) -> f64 {
        let value = match self {
            Self::Loss => Some(record.loss),
            Self::VertexError => record.vertex_error,
            Self::ColorError => record.color_error,
            Self::Sigma => record.sigma,
            Self::SigmaError => {
                record.sigma.zip(sigma_target).map(|(sigma, target)| (sigma - target).abs())
            }
        };
        value.unwrap_or(f64::NAN)
    }
}

/// A stretch of steps of one fit.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Window {
    /// Number of the window; the same steps have the same number in every fit.
    pub(crate) number: usize,
    /// Its median step.
    pub(crate) step: f64,
    /// Its median time, in seconds since the start.
    pub(crate) seconds: f64,
    /// `[least, median, largest]` of every quantity; NaN where it does not apply.
    pub(crate) values: [[f64; 3]; 5],
}

/// A history as windows.
pub(crate) fn thinned(history: &[Record], sigma_target: Option<f64>) -> Vec<Window> {
    let number = |record: &Record| match record.step {
        0 => 0,
        step => 1 + ((step as f64).log10() * PER_DECADE + 1e-9) as usize,
    };
    let windows = history.chunk_by(|a, b| number(a) == number(b));
    let windows = windows.map(|records| {
        let spread =
            |value: &dyn Fn(&Record) -> f64| quantiles(records.iter().map(value), [0.0, 0.5, 1.0]);
        Window {
            number: number(&records[0]),
            step: spread(&|record| record.step as f64)[1],
            seconds: spread(&|record| record.seconds)[1],
            values: Quantity::ALL
                .map(|quantity| spread(&|record| quantity.value(record, sigma_target))),
        }
    });
    windows.collect()
}

/// One fit, as the report keeps it.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    /// Its settings.
    pub(crate) settings: CubeSettings,
    /// Its outcome, without history and snapshots.
    pub(crate) outcome: Outcome,
    /// Its history, thinned.
    pub(crate) windows: Vec<Window>,
    /// The learnt cube along the way.
    pub(crate) snapshots: Vec<Snapshot>,
}

impl Fit {
    /// Takes an outcome apart.
    pub(crate) fn new(settings: &CubeSettings, mut outcome: Outcome) -> Self {
        let windows = thinned(&outcome.history, outcome.sigma_target);
        outcome.history = Vec::new();
        let snapshots = std::mem::take(&mut outcome.snapshots);
        Self { settings: settings.clone(), outcome, windows, snapshots }
    }

    /// `[x, least, median, largest]` of a quantity.
    pub(crate) fn curve(&self, quantity: Quantity, x: impl Fn(&Window) -> f64) -> Vec<[f64; 4]> {
        let point = |window: &Window| {
            let [low, middle, high] = window.values[quantity as usize];
            [x(window), low, middle, high]
        };
        self.windows.iter().map(point).collect()
    }

    /// Distance of sigma from its target at the end.
    pub(crate) fn sigma_error(&self) -> Option<f64> {
        let (last, target) = (self.outcome.sigma_final?, self.outcome.sigma_target?);
        Some((last - target).abs())
    }

    /// The error that says whether the fit succeeded: of the vertices, or of sigma alone.
    pub(crate) fn main_error(&self) -> Option<f64> {
        match self.settings.experiment {
            Experiment::Sigma => self.sigma_error(),
            _ => self.outcome.vertex_error_final,
        }
    }

    /// Whether the fit ended far from the cube.
    pub(crate) fn is_stuck(&self) -> bool {
        self.outcome.is_stuck()
    }
}

/// Fits that differ in their seed alone.
#[derive(Debug)]
pub(crate) struct Group {
    /// The settings that they share; the seed is the first one's.
    pub(crate) settings: CubeSettings,
    /// By rising seed; never empty.
    pub(crate) fits: Vec<Fit>,
}

impl Group {
    /// Sorts fits into groups, in the order of the first fit of each.
    pub(crate) fn sorted(fits: &[Fit]) -> Vec<Self> {
        let mut groups: Vec<Self> = Vec::new();
        for fit in fits {
            let alike = |group: &&mut Self| {
                let seed = fit.settings.seed;
                CubeSettings { seed, ..group.settings.clone() } == fit.settings
            };
            match groups.iter_mut().find(alike) {
                Some(group) => group.fits.push(fit.clone()),
                None => {
                    groups.push(Self { settings: fit.settings.clone(), fits: vec![fit.clone()] });
                }
            }
        }
        for group in &mut groups {
            group.fits.sort_by_key(|fit| fit.settings.seed);
        }
        groups
    }

    /// The fit whose main error is the median of the group's (the lower one of an even number).
    pub(crate) fn typical(&self) -> &Fit {
        let mut fits: Vec<&Fit> = self.fits.iter().collect();
        let error = |fit: &Fit| fit.main_error().unwrap_or(f64::NAN);
        fits.sort_by(|a, b| error(a).total_cmp(&error(b)));
        fits[(fits.len() - 1) / 2]
    }

    /// `[x, low, middle, high]` of a quantity, see the head of this file.
    pub(crate) fn curve(&self, quantity: Quantity, x: impl Fn(&Window) -> f64) -> Vec<[f64; 4]> {
        let index = quantity as usize;
        if let [fit] = &self.fits[..] {
            return fit.curve(quantity, x);
        }
        let mut windows: Vec<&Window> = self.fits.iter().flat_map(|fit| &fit.windows).collect();
        windows.sort_by_key(|window| window.number);
        let same = windows.chunk_by(|a, b| a.number == b.number);
        let point = |same: &[&Window]| {
            let [low, middle, high] = quartiles(same.iter().map(|window| window.values[index][1]));
            [quartiles(same.iter().map(|window| x(window)))[1], low, middle, high]
        };
        same.map(point).collect()
    }

    /// The kind of line: with antialias unbroken for the paper's rates and dashed for the tuned
    /// ones, dots and dashes with exact coverage, dotted where silhouettes are aliased.
    pub(crate) fn stroke(&self) -> Stroke {
        match (self.settings.silhouettes, self.settings.preset) {
            (Silhouettes::Aliased, _) => Stroke::Dotted,
            (Silhouettes::Exact, _) => Stroke::DashDotted,
            (Silhouettes::Antialias, Preset::Tuned | Preset::SecondOrder) => Stroke::Dashed,
            (Silhouettes::Antialias, Preset::Paper) => Stroke::Solid,
        }
    }

    /// What sets the group apart from others of its experiment: its size or its blur.
    pub(crate) fn grade(&self) -> f64 {
        match self.settings.experiment {
            Experiment::Vertices => self.settings.resolution as f64,
            _ => self.settings.sigma_target,
        }
    }

    /// A name for a file, without its ending.
    pub(crate) fn file_name(&self) -> String {
        let CubeSettings { experiment, resolution, preset, precision, .. } = self.settings;
        let sigma = self.settings.blurs().then(|| format!("-sigma-{}", self.settings.sigma_target));
        let kernel = self.other_kernel().map(|kernel| format!("-{kernel}")).unwrap_or_default();
        let silhouettes = match self.settings.silhouettes {
            Silhouettes::Antialias => String::new(),
            other => format!("-{other}"),
        };
        let sigma = sigma.unwrap_or_default();
        format!("{experiment}-{resolution}px{sigma}{kernel}-{preset}{silhouettes}-{precision}")
    }

    /// The size or the blur, in words.
    pub(crate) fn grade_name(&self) -> String {
        match self.settings.experiment {
            Experiment::Vertices => format!("{} px", self.settings.resolution),
            _ => format!("σ = {}", self.settings.sigma_target),
        }
    }

    /// The kernel of the blur, where it is not the usual one.
    fn other_kernel(&self) -> Option<Kernel> {
        let CubeSettings { kernel, .. } = self.settings;
        (self.settings.blurs() && kernel != Kernel::default()).then_some(kernel)
    }

    /// A name within the experiment.
    pub(crate) fn name(&self) -> String {
        let mut name = self.grade_name();
        if let Some(kernel) = self.other_kernel() {
            let _ = write!(name, ", {kernel}");
        }
        match self.settings.preset {
            Preset::Paper => {}
            Preset::Tuned => name.push_str(", tuned rates"),
            Preset::SecondOrder => name.push_str(", second-order"),
        }
        match self.settings.silhouettes {
            Silhouettes::Antialias => {}
            Silhouettes::Aliased => name.push_str(", aliased"),
            Silhouettes::Exact => name.push_str(", exact coverage"),
        }
        name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(step: u64, loss: f64) -> Record {
        let seconds = step as f64;
        Record { step, seconds, loss, vertex_error: None, sigma: Some(1.0), color_error: None }
    }

    #[test]
    fn windows_are_single_steps_first_and_few_later() {
        let history: Vec<_> = (0..=10_000).map(|step| record(step, 1.0)).collect();
        let windows = thinned(&history, Some(4.0));
        assert!(windows.len() < 140, "{} windows", windows.len());
        let steps: Vec<_> = windows.iter().take(12).map(|window| window.step).collect();
        assert_eq!(steps, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
        assert!(windows.windows(2).all(|pair| pair[0].number < pair[1].number));
        assert!(windows.iter().all(|window| window.values[3] == [3.0; 3]));
        assert!(windows[0].values[1][1].is_nan());
    }

    #[test]
    fn a_spike_of_one_step_stays_in_its_window() {
        let loss = |step| if step == 7_777 { 5.0 } else { 1.0 };
        let history: Vec<_> = (0..=10_000).map(|step| record(step, loss(step))).collect();
        let windows = thinned(&history, None);
        assert_eq!(windows.iter().filter(|window| window.values[0] == [1.0, 1.0, 5.0]).count(), 1);
        assert_eq!(windows.iter().filter(|window| window.values[0] != [1.0; 3]).count(), 1);
    }

    #[test]
    fn thinning_nothing_gives_nothing() {
        assert!(thinned(&[], None).is_empty());
    }
}
