//! A whole trial: every optimizer on every problem, and the condition of our scenes.

use std::time::Duration;

use bokashi_fit::FitError;
use bokashi_paper::Experiment;

use super::conditioning::{Conditioning, conditioning};
use super::ledger::{Budget, TARGET};
use super::optimizers::{Method, Run, run};
use super::problem::{Family, Problem};
use super::problems::{SceneSettings, SigmaAs, literature, rotated_quadratic, scene};

/// How much to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudySettings {
    /// How many rotations of the quadratic, and how many starts of each scene.
    pub seeds: u64,
    /// Gradient evaluations per run on a problem of the literature.
    pub literature_budget: f64,
    /// The same on a scene.
    pub scene_budget: f64,
    /// Wall-clock time per run, so that none hangs; far above what the other budgets take.
    pub time: Duration,
}

impl Default for StudySettings {
    fn default() -> Self {
        Self {
            seeds: 1,
            literature_budget: 5_000.0,
            scene_budget: 2_000.0,
            time: Duration::from_secs(60),
        }
    }
}

/// What a trial found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Study {
    /// Every run, failed ones too.
    pub runs: Vec<Run>,
    /// The condition of every scene at its start and at the truth.
    pub conditionings: Vec<Conditioning>,
}

/// Parameters of the rotated quadratic.
const QUADRATIC_SIZE: usize = 20;
/// Its condition number.
const QUADRATIC_CONDITION: f64 = 1e8;

/// The problems of `settings`, each with the seed of its start.
///
/// # Errors
/// [`FitError`] where a scene can't be made.
pub(super) fn problems(settings: &StudySettings) -> Result<Vec<(Problem, u64)>, FitError> {
    let mut all: Vec<(Problem, u64)> = literature().into_iter().map(|p| (p, 0)).collect();
    for seed in 0..settings.seeds {
        all.push((rotated_quadratic(QUADRATIC_SIZE, QUADRATIC_CONDITION, seed), seed));
    }
    for seed in 0..settings.seeds {
        all.push((scene(SceneSettings::new(Experiment::Vertices, seed))?, seed));
        for experiment in [Experiment::Sigma, Experiment::Joint] {
            // Experiment 5.2 has the same pose and the same start for every seed.
            if experiment == Experiment::Sigma && seed > 0 {
                continue;
            }
            for sigma_as in SigmaAs::ALL {
                let settings = SceneSettings { sigma_as, ..SceneSettings::new(experiment, seed) };
                all.push((scene(settings)?, seed));
            }
        }
    }
    Ok(all)
}

/// The scenes whose condition is reported: the paper's sizes, sigmas and starts.
fn conditioned(seed: u64) -> Vec<(String, SceneSettings)> {
    let paper = |experiment| SceneSettings {
        resolution: 32,
        distance: 1.0,
        ..SceneSettings::new(experiment, seed)
    };
    let mut all = Vec::new();
    for resolution in [8, 16, 32] {
        let settings = SceneSettings { resolution, ..paper(Experiment::Vertices) };
        all.push((format!("5.1, {resolution} px"), settings));
    }
    for sigma_target in [1.0, 1.4, 2.8, 4.0] {
        let settings = SceneSettings { sigma_target, ..paper(Experiment::Joint) };
        all.push((format!("5.3, sigma {sigma_target}"), settings));
    }
    for sigma_as in [SigmaAs::Logarithm, SigmaAs::Variance] {
        let settings = SceneSettings { sigma_target: 4.0, sigma_as, ..paper(Experiment::Joint) };
        all.push((format!("5.3, sigma 4, {}", sigma_as.name()), settings));
    }
    all
}

/// Does the whole trial, one run after the other, so that none disturbs another's times; `on_run`
/// sees each run, how many are done and how many there are.
///
/// # Errors
/// [`FitError`] where a scene can't be made. Failed runs are results.
pub fn study(
    settings: &StudySettings,
    on_run: &mut dyn FnMut(&Run, usize, usize),
) -> Result<Study, FitError> {
    let problems = problems(settings)?;
    let methods = Method::all();
    let count = problems.len() * methods.len();
    let mut study = Study::default();
    for (problem, seed) in &problems {
        let gradients = match problem.family() {
            Family::Literature => settings.literature_budget,
            Family::Scene => settings.scene_budget,
        };
        let budget = Budget { gradients, time: settings.time, target: TARGET };
        for &method in &methods {
            let run = run(problem, *seed, method, budget);
            on_run(&run, study.runs.len() + 1, count);
            study.runs.push(run);
        }
    }
    for seed in 0..settings.seeds {
        for (name, scene_settings) in conditioned(seed) {
            let conditionings =
                conditioning(&scene(scene_settings)?, seed).map_err(FitError::operation)?;
            let named =
                conditionings.into_iter().map(|one| Conditioning { problem: name.clone(), ..one });
            study.conditionings.extend(named);
        }
    }
    Ok(study)
}
