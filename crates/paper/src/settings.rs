//! What to fit: the paper's experiments and their settings.

use std::fmt;
use std::str::FromStr;

use bokashi_fit::{FitError, FitSettings, Mapping, Optimizer, Schedule};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, Silhouettes};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The paper's experiments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Experiment {
    /// 5.1: vertices and colours, random poses, no blur.
    Vertices,
    /// 5.2: sigma alone, one pose.
    Sigma,
    /// 5.3: vertices, colours and sigma, random poses.
    Joint,
}

/// Learning rates and how they change over a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// As printed in the paper: vertices and colours 1e-3, sigma 1e-2, constant.
    Paper,
    /// Larger rates that fall over the run. In 5.1 vertices have 6e-3 and colours 6e-2, along a
    /// cosine to 0. With a blur vertices have 5e-3, colours 3e-2 and sigma 6e-2, exponentially to
    /// 0.01 of these rates.
    Tuned,
    /// The first half of the run has the tuned rates. The other half has steps of
    /// Levenberg-Marquardt, in `f64` whatever the fit computes with. Each takes the place, and about
    /// the time, of 150 updates. Made for 32 px: at 16 px its steps can undo what the first half
    /// learnt, see lab/docs/stiff.md.
    SecondOrder,
}

/// The numbers that a fit computes with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// `f32`.
    F32,
    /// `f64`.
    F64,
}

/// An enum whose variants have one word each, in messages, on command lines and in JSON.
macro_rules! words {
    ($type:ident, $setting:literal, $rule:literal, $($variant:ident = $word:literal),+) => {
        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(match self { $(Self::$variant => $word),+ })
            }
        }

        impl FromStr for $type {
            type Err = FitError;

            fn from_str(word: &str) -> Result<Self, FitError> {
                match word {
                    $($word => Ok(Self::$variant),)+
                    _ => Err(FitError::setting($setting, $rule, word)),
                }
            }
        }
    };
}

words!(
    Experiment,
    "experiment",
    "one of vertices, sigma, joint",
    Vertices = "vertices",
    Sigma = "sigma",
    Joint = "joint"
);
words!(
    Preset,
    "preset",
    "one of paper, tuned, second-order",
    Paper = "paper",
    Tuned = "tuned",
    SecondOrder = "second-order"
);
words!(Precision, "precision", "f32 or f64", F32 = "f32", F64 = "f64");

/// Learning rates per parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rates {
    /// Of the vertices.
    pub vertices: f64,
    /// Of the colours.
    pub colors: f64,
    /// Of sigma, before its mapping.
    pub sigma: f64,
}

impl Preset {
    /// The learning rates of `experiment`.
    pub fn rates_of(self, experiment: Experiment) -> Rates {
        match (self, experiment) {
            (Self::Paper, _) => Rates { vertices: 1e-3, colors: 1e-3, sigma: 1e-2 },
            // Colours at ten times the vertices' rate free starts that would stay stuck.
            (Self::Tuned | Self::SecondOrder, Experiment::Vertices) => {
                Rates { vertices: 6e-3, colors: 6e-2, sigma: 5e-2 }
            }
            (Self::Tuned | Self::SecondOrder, _) => {
                Rates { vertices: 5e-3, colors: 3e-2, sigma: 6e-2 }
            }
        }
    }

    /// How the rates change over a run of `steps` of `experiment`.
    pub fn schedule_of(self, experiment: Experiment, steps: u64) -> Schedule {
        match (self, experiment) {
            (Self::Paper, _) => Schedule::Constant,
            (Self::Tuned | Self::SecondOrder, Experiment::Vertices) => {
                Schedule::Cosine { steps, floor: 0.0 }
            }
            // Under a wide blur Adam is unstable above about a tenth of these rates and converges
            // geometrically below: a run needs many steps there, which a cosine does not give it.
            (Self::Tuned | Self::SecondOrder, _) => {
                Schedule::Exponential { steps: steps.max(1), factor: 0.01, floor: 0.0 }
            }
        }
    }
}

/// Larger images of a cube would take gigabytes, which a file with a wrong number must not.
const LARGEST_RESOLUTION: usize = 4096;

/// The settings of one fit of the cube.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CubeSettings {
    /// What is learnt.
    pub experiment: Experiment,
    /// Learning rates and schedule.
    pub preset: Preset,
    /// Width and height of the images, in pixels.
    pub resolution: usize,
    /// Blur of the target, in pixels; of no effect in [`Experiment::Vertices`].
    pub sigma_target: f64,
    /// Blur that the fit starts from, in pixels.
    pub sigma_start: f64,
    /// How many updates.
    pub steps: u64,
    /// Of the start and the poses.
    pub seed: u64,
    /// How silhouettes look, in the learnt image and in the target.
    pub silhouettes: Silhouettes,
    /// The numbers to compute with.
    pub precision: Precision,
    /// Learning rates; `None`: the preset's.
    pub rates: Option<Rates>,
    /// How the rates change over the run; `None`: as the preset says.
    pub schedule: Option<Schedule>,
    /// How gradients change parameters.
    pub optimizer: Optimizer,
    /// How sigma stays positive.
    pub sigma_mapping: Mapping,
    /// The weights of the blur, in the learnt image and in the target.
    pub kernel: Kernel,
    /// What the blur sees outside the image.
    #[serde(with = "BorderWord")]
    pub border: Border,
    /// The window of the blur; `None`: fixed at four times the larger of the two sigmas, rounded
    /// up, so that it never steps with sigma. A disc is then never cut off or refused, and halved
    /// from a radius of 512 pixels on.
    #[serde(with = "window")]
    pub radius: Option<Radius>,
}

/// The borders' words in files.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Border", rename_all = "lowercase")]
enum BorderWord {
    Zero,
    Mirror,
    Clamp,
}

/// A window in files.
mod window {
    use super::*;

    #[derive(Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Window {
        Fixed(usize),
        Tolerance(f64),
    }

    pub(super) fn serialize<S: Serializer>(
        radius: &Option<Radius>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let window = radius.map(|radius| match radius {
            Radius::Fixed(pixels) => Window::Fixed(pixels),
            Radius::Tolerance(tolerance) => Window::Tolerance(tolerance),
        });
        window.serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Radius>, D::Error> {
        let window = Option::<Window>::deserialize(deserializer)?;
        Ok(window.map(|window| match window {
            Window::Fixed(pixels) => Radius::Fixed(pixels),
            Window::Tolerance(tolerance) => Radius::Tolerance(tolerance),
        }))
    }
}

impl CubeSettings {
    /// The paper's settings of `experiment`, with the learning rates of `preset`: 32 px, antialias,
    /// `f32`, 10,000 steps, from sigma 2 to 4, seed 0.
    ///
    /// Where the paper leaves a choice open, ours is: softplus for sigma, the sampled kernel with
    /// a sum of 1, a zero border, a window that is fixed during a fit.
    pub fn new(experiment: Experiment, preset: Preset) -> Self {
        Self {
            experiment,
            preset,
            resolution: 32,
            sigma_target: 4.0,
            sigma_start: 2.0,
            steps: 10_000,
            seed: 0,
            silhouettes: Silhouettes::Antialias,
            precision: Precision::F32,
            rates: None,
            schedule: None,
            optimizer: Optimizer::default(),
            sigma_mapping: Mapping::Softplus,
            kernel: Kernel::Sampled,
            border: Border::Zero,
            radius: None,
        }
    }

    /// The learning rates.
    pub fn learning_rates(&self) -> Rates {
        self.rates.unwrap_or(self.preset.rates_of(self.experiment))
    }

    /// How the rates change over the run.
    pub fn rate_schedule(&self) -> Schedule {
        self.schedule.unwrap_or(self.preset.schedule_of(self.experiment, self.steps))
    }

    /// The window of the blur.
    pub fn blur_radius(&self) -> Radius {
        let widest = self.sigma_target.max(self.sigma_start);
        self.radius.unwrap_or_else(|| match self.kernel {
            // A disc has an end. A fixed window would refuse a sigma that overshoots its target by far.
            Kernel::Disc => Blur::default().radius,
            _ => Radius::Fixed((4.0 * widest).ceil() as usize),
        })
    }

    /// The settings of the fit's loop.
    pub(crate) fn fit_settings(&self) -> FitSettings {
        FitSettings {
            steps: self.steps,
            optimizer: self.optimizer,
            schedule: self.rate_schedule(),
            ..FitSettings::default()
        }
    }

    /// Whether the image is blurred.
    pub fn blurs(&self) -> bool {
        self.experiment != Experiment::Vertices
    }

    /// Checks what the operations would not refuse by themselves.
    pub(crate) fn check(&self) -> Result<(), FitError> {
        if self.resolution == 0 {
            return Err(FitError::setting("resolution", "at least 1 pixel", 0));
        }
        if self.resolution > LARGEST_RESOLUTION {
            let rule = "at most 4096 pixels";
            return Err(FitError::setting("resolution", rule, self.resolution));
        }
        if !self.blurs() {
            return Ok(());
        }
        // The blur allows no larger discs, and no wider windows than 4 of these sigmas.
        let (largest, rule) = match self.kernel {
            Kernel::Disc => (1024.0, "a number above 0 and up to 1024 for a disc"),
            _ => (4096.0, "a number above 0 and up to 4096"),
        };
        for (setting, sigma) in
            [("target sigma", self.sigma_target), ("starting sigma", self.sigma_start)]
        {
            if !(sigma > 0.0 && sigma <= largest) {
                return Err(FitError::setting(setting, rule, sigma));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_parse_to_what_they_print() {
        for experiment in [Experiment::Vertices, Experiment::Sigma, Experiment::Joint] {
            assert_eq!(experiment.to_string().parse(), Ok(experiment));
        }
        for preset in [Preset::Paper, Preset::Tuned, Preset::SecondOrder] {
            assert_eq!(preset.to_string().parse(), Ok(preset));
        }
        for precision in [Precision::F32, Precision::F64] {
            assert_eq!(precision.to_string().parse(), Ok(precision));
        }
        let error = "f16".parse::<Precision>().unwrap_err();
        assert_eq!(error.to_string(), "precision needs f32 or f64, got f16");
    }

    #[test]
    fn settings_outside_their_range_are_refused() {
        let settings = CubeSettings::new(Experiment::Joint, Preset::Paper);
        assert!(settings.check().is_ok());
        let message = |settings: CubeSettings| settings.check().map_err(|error| error.to_string());
        assert_eq!(
            message(CubeSettings { resolution: 0, ..settings.clone() }),
            Err("resolution needs at least 1 pixel, got 0".into())
        );
        assert_eq!(
            message(CubeSettings { resolution: 4097, ..settings.clone() }),
            Err("resolution needs at most 4096 pixels, got 4097".into())
        );
        for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let rule = "sigma needs a number above 0 and up to 4096, got";
            assert_eq!(
                message(CubeSettings { sigma_target: sigma, ..settings.clone() }),
                Err(format!("target {rule} {sigma}"))
            );
            assert_eq!(
                message(CubeSettings { sigma_start: sigma, ..settings.clone() }),
                Err(format!("starting {rule} {sigma}"))
            );
        }
        let disc = CubeSettings { kernel: Kernel::Disc, sigma_target: 1025.0, ..settings.clone() };
        let rule = "target sigma needs a number above 0 and up to 1024 for a disc, got 1025";
        assert_eq!(message(disc), Err(rule.into()));
        let blind = CubeSettings { experiment: Experiment::Vertices, ..settings };
        assert!(CubeSettings { sigma_target: f64::NAN, ..blind }.check().is_ok());
    }

    #[test]
    fn the_window_covers_four_times_the_larger_sigma() {
        let mut settings = CubeSettings::new(Experiment::Sigma, Preset::Paper);
        for (start, target, radius) in [(2.0, 1.0, 8), (2.0, 2.8, 12), (2.0, 4.0, 16)] {
            (settings.sigma_start, settings.sigma_target) = (start, target);
            assert_eq!(settings.blur_radius(), Radius::Fixed(radius));
        }
    }
}
