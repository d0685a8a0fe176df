//! The paper's cube over a fixed set of poses, as a least-squares problem.
//!
//! # Forward
//! `r = image - reference` over all poses and pixels, through the public interface of
//! [`bokashi_paper`]. `x` holds the vertices (24), then the colours (24), then the number
//! that stands for sigma; an experiment leaves out what it does not learn.
//!
//! # Where it is not smooth
//! Where a pixel's nearest face changes: the image is continuous there but for corners, its
//! derivative is not.

use bokashi_core::{Scalar, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_paper::{
    CubeSettings, CubeViews, Experiment, Precision, Preset, Snapshot, View, random_start, truth,
};

use super::super::problem::{Problem, Residuals};

/// The number that stands for sigma.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SigmaAs {
    /// Sigma itself, in pixels.
    Sigma,
    /// Its logarithm.
    Logarithm,
    /// Its square, in square pixels.
    Variance,
}

impl SigmaAs {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Sigma, Self::Logarithm, Self::Variance];

    /// The number for `sigma`.
    fn parameter_for(self, sigma: f64) -> f64 {
        match self {
            Self::Sigma => sigma,
            Self::Logarithm => sigma.ln(),
            Self::Variance => sigma * sigma,
        }
    }

    /// Records sigma from its number.
    fn record<T: Scalar>(self, raw: Var<'_, T>) -> Var<'_, T> {
        match self {
            Self::Sigma => raw,
            Self::Logarithm => raw.exp(),
            Self::Variance => raw.sqrt(),
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sigma => "sigma",
            Self::Logarithm => "log sigma",
            Self::Variance => "variance",
        }
    }
}

/// One of our scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneSettings {
    /// What is learnt.
    pub experiment: Experiment,
    /// Width and height of the images, in pixels.
    pub resolution: usize,
    /// How many poses; one, the paper's, in experiment 5.2.
    pub poses: usize,
    /// Blur of the reference image, in pixels.
    pub sigma_target: f64,
    /// Blur at the start, in pixels.
    pub sigma_start: f64,
    /// The number that stands for sigma.
    pub sigma_as: SigmaAs,
    /// How far from the truth it starts: 1 as in the paper, below that on the line to the truth.
    pub distance: f64,
    /// Of the start and the poses.
    pub seed: u64,
}

impl SceneSettings {
    /// The scene of `experiment` at 16 px in 6 poses, from sigma 2 to 1.4, a fifth of the paper's
    /// distance from the truth.
    pub fn new(experiment: Experiment, seed: u64) -> Self {
        Self {
            experiment,
            resolution: 16,
            poses: if experiment == Experiment::Sigma { 1 } else { 6 },
            sigma_target: 1.4,
            sigma_start: 2.0,
            sigma_as: SigmaAs::Sigma,
            distance: 0.2,
            seed,
        }
    }

    /// The settings in the words of the experiments.
    fn cube(&self) -> CubeSettings {
        CubeSettings {
            resolution: self.resolution,
            sigma_target: self.sigma_target,
            sigma_start: self.sigma_start,
            seed: self.seed,
            precision: Precision::F64,
            ..CubeSettings::new(self.experiment, Preset::Paper)
        }
    }

    fn learns_cube(&self) -> bool {
        self.experiment != Experiment::Sigma
    }

    fn learns_sigma(&self) -> bool {
        self.experiment != Experiment::Vertices
    }

    /// The entries of `x` for a cube.
    fn entries(&self, cube: &Snapshot, sigma: f64) -> Vec<f64> {
        let mut x = Vec::new();
        if self.learns_cube() {
            x.extend_from_slice(cube.vertices.data());
            x.extend_from_slice(cube.colors.data());
        }
        if self.learns_sigma() {
            x.push(self.sigma_as.parameter_for(sigma));
        }
        x
    }
}

/// The scene of `settings` as a problem.
///
/// # Errors
/// [`FitError::Setting`] for settings outside their range.
pub fn scene(settings: SceneSettings) -> Result<Problem, FitError> {
    let views: Vec<View> = match settings.experiment {
        Experiment::Sigma => vec![View::fixed()],
        _ => (0..settings.poses as u64).map(|pose| View::random(settings.seed, pose)).collect(),
    };
    let cube = CubeViews::new(&settings.cube(), &views)?;
    let least = truth(None);
    let far = random_start(settings.seed, None);
    let between = |least: &Tensor<f64>, far: &Tensor<f64>| {
        Tensor::from_flat_fn(least.shape(), |k| {
            least.data()[k] + settings.distance * (far.data()[k] - least.data()[k])
        })
    };
    let start = Snapshot {
        vertices: between(&least.vertices, &far.vertices),
        colors: between(&least.colors, &far.colors),
        ..far
    };
    let mut blocks = Vec::new();
    if settings.learns_cube() {
        blocks.extend([("vertices", 0..24), ("colours", 24..48)]);
    }
    if settings.learns_sigma() {
        let first = blocks.last().map_or(0, |(_, range)| range.end);
        blocks.push((settings.sigma_as.name(), first..first + 1));
    }
    let name = match settings.experiment {
        Experiment::Vertices => "Cube 5.1".to_owned(),
        Experiment::Sigma => format!("Cube 5.2, {}", settings.sigma_as.name()),
        Experiment::Joint => format!("Cube 5.3, {}", settings.sigma_as.name()),
    };
    let start = settings.entries(&start, settings.sigma_start);
    let minimiser = settings.entries(&least, settings.sigma_target);
    let residuals = Cube { cube, settings, truth: least };
    Ok(Problem::new(name, start, 0.0, residuals).minimiser_at(minimiser).scene(blocks))
}

struct Cube {
    cube: CubeViews,
    settings: SceneSettings,
    truth: Snapshot,
}

impl Residuals for Cube {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let tape = x.tape();
        let (vertices, colors) = if self.settings.learns_cube() {
            (x.slice(0, 0..24)?.reshape([8, 3])?, x.slice(0, 24..48)?.reshape([8, 3])?)
        } else {
            let constant = |tensor: &Tensor<f64>| tape.constant(&tensor.map(T::from_f64));
            (constant(&self.truth.vertices), constant(&self.truth.colors))
        };
        let sigma = if self.settings.learns_sigma() {
            let last = x.shape().size() - 1;
            let raw = x.slice(0, last..last + 1)?.reshape([])?;
            Some(self.settings.sigma_as.record(raw))
        } else {
            None
        };
        self.cube.residuals(vertices, colors, sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPERIMENTS: [Experiment; 3] =
        [Experiment::Vertices, Experiment::Sigma, Experiment::Joint];

    #[test]
    fn the_truth_has_residual_zero_and_the_start_has_not() {
        for experiment in EXPERIMENTS {
            let problem = scene(SceneSettings::new(experiment, 1)).unwrap();
            let truth = problem.minimiser().unwrap();
            assert_eq!(truth.len(), problem.size());
            assert_eq!(problem.objective(truth).unwrap(), 0.0, "{}", problem.name());
            assert!(problem.objective(problem.start()).unwrap() > 0.1, "{}", problem.name());
        }
    }

    #[test]
    fn whatever_stands_for_sigma_the_image_is_the_same() {
        let at_start = SigmaAs::ALL.map(|sigma_as| {
            let settings = SceneSettings { sigma_as, ..SceneSettings::new(Experiment::Joint, 2) };
            let problem = scene(settings).unwrap();
            problem.objective(problem.start()).unwrap()
        });
        for value in at_start {
            assert!((value - at_start[0]).abs() < 1e-12 * at_start[0], "{at_start:?}");
        }
    }

    #[test]
    fn blocks_cover_every_parameter_once() {
        for experiment in EXPERIMENTS {
            let problem = scene(SceneSettings::new(experiment, 0)).unwrap();
            let mut next = 0;
            for (name, range) in problem.blocks() {
                assert_eq!(range.start, next, "{name}");
                next = range.end;
            }
            assert_eq!(next, problem.size());
        }
    }
}
