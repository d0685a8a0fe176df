//! The paper's experiments end where they should: a sample of seeds of each, and every choice that
//! the paper leaves open. `bokashi paper reproduce` does all seeds.

use std::ops::ControlFlow;

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_fit::{Fit, FitError, FitSettings, Parameter, Parameters, from_fn, squared_error};
use bokashi_paper::{CubeSettings, Experiment, Outcome, Precision, Preset, STUCK, run_cube};
use bokashi_render_ops::{
    Background, Border, Kernel, Mesh, RasterOptions, Silhouettes, Size, render,
};

fn run(settings: &CubeSettings) -> Outcome {
    run_cube(settings, &mut |_| ControlFlow::Continue(())).expect("the experiment runs")
}

/// The experiment in f64, at the paper's other settings.
fn experiment(experiment: Experiment, preset: Preset) -> CubeSettings {
    CubeSettings { precision: Precision::F64, ..CubeSettings::new(experiment, preset) }
}

/// The vertex errors at the end for some seeds, in increasing order.
fn vertex_errors(settings: &CubeSettings, seeds: u64) -> Vec<f64> {
    let of_seed = |seed| run(&CubeSettings { seed, ..settings.clone() }).vertex_error_final;
    let mut errors: Vec<f64> = (0..seeds).filter_map(of_seed).collect();
    assert_eq!(errors.len() as u64, seeds, "every fit has a vertex error");
    errors.sort_unstable_by(f64::total_cmp);
    errors
}

#[test]
fn sigma_is_found_under_every_kernel_and_border_from_either_side() {
    for kernel in [Kernel::Unnormalized, Kernel::Sampled, Kernel::Disc] {
        for border in [Border::Zero, Border::Mirror, Border::Clamp] {
            for sigma_target in [1.0, 4.0] {
                let fit = experiment(Experiment::Sigma, Preset::Paper);
                let outcome =
                    run(&CubeSettings { kernel, border, sigma_target, steps: 3000, ..fit });
                let error_at = |step: usize| {
                    let sigma = outcome.history[step].sigma.expect("sigma is learnt");
                    (sigma - sigma_target).abs()
                };
                let what = format!("{kernel:?} {border:?} to {sigma_target}");
                assert!(error_at(1000) < 1e-4, "{what}: {:.1e} at 1,000 steps", error_at(1000));
                assert!(error_at(3000) < 1e-9, "{what}: {:.1e} at 3,000 steps", error_at(3000));
            }
        }
    }
}

#[test]
fn sigma_is_found_in_f32_too() {
    for sigma_target in [1.0, 1.4, 2.8, 4.0] {
        let fit = CubeSettings::new(Experiment::Sigma, Preset::Paper);
        let outcome = run(&CubeSettings { sigma_target, steps: 3000, ..fit });
        let error = (outcome.sigma_final.expect("sigma is learnt") - sigma_target).abs();
        assert!(error < 1e-5, "{error:.1e} off {sigma_target}");
    }
}

#[test]
fn vertices_are_found_with_antialias_and_exact_coverage_and_never_where_aliased() {
    let fit = CubeSettings { resolution: 8, ..experiment(Experiment::Vertices, Preset::Paper) };
    let errors = |silhouettes| vertex_errors(&CubeSettings { silhouettes, ..fit.clone() }, 5);
    for silhouettes in [Silhouettes::Antialias, Silhouettes::Exact] {
        let errors = errors(silhouettes);
        assert!(errors[2] < 1e-5, "{silhouettes}: {errors:?}");
    }
    let aliased = errors(Silhouettes::Aliased);
    assert!(aliased[0] > STUCK, "aliased: {aliased:?}");
}

#[test]
fn tuned_rates_find_the_vertices_in_a_thousand_steps() {
    let fit = CubeSettings { steps: 1000, ..experiment(Experiment::Vertices, Preset::Tuned) };
    let errors = vertex_errors(&fit, 5);
    assert!(errors[2] < 1e-6, "{errors:?}");
}

#[test]
fn vertices_colors_and_sigma_are_found_together() {
    for (kernel, sigma_target) in
        [(Kernel::Sampled, 1.0), (Kernel::Sampled, 4.0), (Kernel::Disc, 4.0)]
    {
        let fit = experiment(Experiment::Joint, Preset::Tuned);
        let fit = CubeSettings { kernel, sigma_target, ..fit };
        let outcome = run(&fit);
        let vertices = outcome.vertex_error_final.expect("vertices are learnt");
        let sigma = (outcome.sigma_final.expect("sigma is learnt") - sigma_target).abs();
        assert!(vertices < 1e-8, "vertices {vertices:.1e} off at {kernel} {sigma_target}");
        assert!(sigma < 1e-8, "sigma {sigma:.1e} off {kernel} {sigma_target}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let bits = |threads: usize, precision: Precision| {
        let fit = CubeSettings::new(Experiment::Joint, Preset::Paper);
        let fit = CubeSettings { precision, resolution: 160, steps: 12, seed: 3, ..fit };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let outcome = pool.install(|| run(&fit));
        let numbers = outcome.history.iter().flat_map(|record| {
            [record.loss, record.vertex_error.unwrap_or(0.0), record.sigma.unwrap_or(0.0)]
        });
        numbers.map(f64::to_bits).collect::<Vec<_>>()
    };
    for precision in [Precision::F32, Precision::F64] {
        let one = bits(1, precision);
        for threads in [1, 2, 4, 8] {
            assert_eq!(bits(threads, precision), one, "{threads} threads, {precision}");
        }
    }
}

/// Two steps of a fit of a white triangle, `offset` to the right, to a black image.
fn fit_silhouette<T: Scalar>(silhouettes: Silhouettes, offset: f64) -> Result<(), FitError> {
    let corners = [[-0.5, -0.6, 0.0, 1.0], [0.7, -0.4, 0.0, 1.0], [0.1, 0.65, 0.0, 1.0]];
    let clip = Tensor::from_fn([3, 4], |[corner, axis]| {
        T::from_f64(corners[corner][axis] + if axis == 0 { offset } else { 0.0 })
    });
    let parameters = Parameters::new().with(Parameter::new("clip", clip))?;
    let mesh = Mesh::new(vec![[0, 1, 2]], 3)?;
    let options = RasterOptions::new(Size::square(16)).silhouettes(silhouettes);
    let mut pipeline = from_fn(|tape: &Tape<T>, variables| {
        let white = tape.constant_full([3, 1], T::ONE);
        let picture = render(variables.get("clip")?, &mesh, white, options, Background::Zero)?;
        Ok(squared_error(picture.image()?, tape.constant_full([16, 16, 1], T::ZERO))?)
    });
    let settings = FitSettings { steps: 2, ..FitSettings::default() };
    Fit::new(parameters, settings)?.run(&mut pipeline).map(drop)
}

#[test]
fn a_silhouette_that_gets_no_gradient_is_refused_and_where_it_ends_is_named() {
    let message = "\"clip\" needs a way to the loss, got one that ends at rasterize, \
                   whose output is detached";
    // In view, and out of sight.
    for offset in [0.0, 5.0] {
        for refused in [
            fit_silhouette::<f32>(Silhouettes::Aliased, offset),
            fit_silhouette::<f64>(Silhouettes::Aliased, offset),
        ] {
            assert_eq!(refused.unwrap_err().to_string(), message);
        }
        for edges in [Silhouettes::Antialias, Silhouettes::Exact] {
            fit_silhouette::<f32>(edges, offset).unwrap();
            fit_silhouette::<f64>(edges, offset).unwrap();
        }
    }
}
