//! One fit of the cube: from [`CubeSettings`] to an [`Outcome`].

use std::ops::ControlFlow;

use bokashi_core::Scalar;
use bokashi_fit::{Fit, FitError};

use super::first_order::run_to_end;
use super::outcome::{Outcome, Progress};
use super::pipeline::CubePipeline;
use super::second_order;
use super::settings::{CubeSettings, Precision, Preset};

/// Does the fit that `settings` describe; `on_step` sees every state before its update and the
/// final one, and may stop the fit.
///
/// # Errors
/// [`FitError::Setting`] for settings outside their range; what the operations and the optimizer
/// refuse.
pub fn run_cube(
    settings: &CubeSettings,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Outcome, FitError> {
    match settings.precision {
        Precision::F32 => run::<f32>(settings, on_step),
        Precision::F64 => run::<f64>(settings, on_step),
    }
}

fn run<T: Scalar>(
    settings: &CubeSettings,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Outcome, FitError> {
    if settings.preset == Preset::SecondOrder {
        return second_order::run::<T>(settings, on_step);
    }
    let (mut pipeline, parameters) = CubePipeline::<T>::new(settings)?;
    let mut fit = Fit::new(parameters, settings.fit_settings())?;
    run_to_end(settings, &mut pipeline, &mut fit, None, on_step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Experiment, Kernel, Silhouettes};

    fn settings(experiment: Experiment) -> CubeSettings {
        CubeSettings { resolution: 16, ..CubeSettings::new(experiment, Preset::Paper) }
    }

    fn run_quietly(settings: &CubeSettings) -> Outcome {
        run_cube(settings, &mut |_| ControlFlow::Continue(())).unwrap()
    }

    #[test]
    fn the_same_seed_gives_the_same_bits() {
        let settings = CubeSettings { steps: 30, ..settings(Experiment::Joint) };
        let [one, other] = [run_quietly(&settings), run_quietly(&settings)];
        assert_eq!(one.snapshots, other.snapshots);
        let losses = |outcome: &Outcome| -> Vec<u64> {
            outcome.history.iter().map(|record| record.loss.to_bits()).collect()
        };
        assert_eq!(losses(&one), losses(&other));
        let another = run_quietly(&CubeSettings { seed: 1, ..settings });
        assert_ne!(one.snapshots, another.snapshots);
    }

    #[test]
    fn a_callback_stops_a_fit_and_the_last_state_is_kept() {
        let settings = settings(Experiment::Vertices);
        let mut seen = Vec::new();
        let outcome = run_cube(&settings, &mut |progress| {
            seen.push(progress.step);
            if progress.step == 17 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let outcome = outcome.unwrap();
        assert_eq!(seen, (0..=17).collect::<Vec<_>>());
        assert_eq!((outcome.steps, outcome.history.len()), (17, 18));
        let steps: Vec<u64> = outcome.snapshots.iter().map(|snapshot| snapshot.step).collect();
        assert!(steps.contains(&0) && steps.contains(&10));
        assert_eq!(steps.last(), Some(&17));
        assert!(steps.is_sorted());
    }

    #[test]
    fn sigma_is_found_from_either_side() {
        for (start, target) in [(2.0, 1.0), (2.0, 2.8)] {
            let settings = CubeSettings {
                steps: 1_000,
                sigma_start: start,
                sigma_target: target,
                precision: Precision::F64,
                ..settings(Experiment::Sigma)
            };
            let outcome = run_quietly(&settings);
            let error = (outcome.sigma_final.unwrap() - target).abs();
            assert!(error < 1e-4, "from {start} to {target}: {error}");
        }
    }

    #[test]
    fn a_disc_may_have_any_radius_on_its_way() {
        for (sigma_start, sigma_target) in [(300.0, 0.5), (0.5, 300.0)] {
            let blur = CubeSettings { sigma_start, sigma_target, ..settings(Experiment::Sigma) };
            let outcome = run_quietly(&CubeSettings { kernel: Kernel::Disc, steps: 3, ..blur });
            assert_eq!(outcome.steps, 3, "from {sigma_start} to {sigma_target}");
        }
    }

    #[test]
    fn a_cube_is_learnt_in_a_thousand_steps() {
        for silhouettes in [Silhouettes::Antialias, Silhouettes::Exact] {
            let settings = CubeSettings {
                preset: Preset::Tuned,
                resolution: 32,
                steps: 1_000,
                silhouettes,
                precision: Precision::F64,
                ..settings(Experiment::Vertices)
            };
            let outcome = run_quietly(&settings);
            assert_eq!(outcome.silhouettes, silhouettes);
            assert!(outcome.vertex_error_initial.unwrap() > 0.3);
            let [vertices, colors] = [outcome.vertex_error_final, outcome.color_error_final];
            assert!(vertices.unwrap() < 1e-6, "{silhouettes}: {vertices:?}");
            assert!(colors.unwrap() < 1e-6, "{silhouettes}: {colors:?}");
            assert!(!outcome.is_stuck());
        }
    }
}
