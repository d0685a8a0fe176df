//! Stiff problems: what the engine and a second-order method must reach on them.

use std::ops::ControlFlow;
use std::time::Duration;

use bokashi_check::Dual;
use bokashi_core::{Tape, Tensor};
use bokashi_lab::stiff::problems::{SceneSettings, literature, rotated_quadratic, scene};
use bokashi_lab::stiff::{Budget, LEVELS, Method, Problem, TARGET, run};
use bokashi_paper::{CubeSettings, Experiment, Precision, Preset, run_cube};

const BUDGET: Budget =
    Budget { gradients: 5_000.0, time: Duration::from_secs(600), target: TARGET };

/// The gradient of the objective at `x`.
fn gradient(problem: &Problem, x: &[f64]) -> Vec<f64> {
    let tape = Tape::new();
    let leaf = tape.leaf(&Tensor::from_flat_fn([x.len()], |k| x[k]));
    let loss = problem.record(leaf).expect("residuals").square().sum();
    loss.backward().expect("a scalar").get_or_zeros(leaf).data().to_vec()
}

/// The Hessian at `x` times `v`: the tangent of the gradient over dual numbers.
fn hessian_times(problem: &Problem, x: &[f64], v: &[f64]) -> Vec<f64> {
    let tape = Tape::new();
    let leaf = tape.leaf(&Tensor::from_flat_fn([x.len()], |k| Dual::new(x[k], v[k])));
    let loss = problem.record_dual(leaf).expect("residuals").square().sum();
    let gradient = loss.backward().expect("a scalar").get_or_zeros(leaf);
    gradient.data().iter().map(|dual| dual.tangent).collect()
}

/// A direction without a pattern, as long as `n`.
fn direction(n: usize, phase: f64) -> Vec<f64> {
    (0..n).map(|k| (1.7 * k as f64 + phase).sin()).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn problems() -> Vec<Problem> {
    let mut all = literature();
    all.push(rotated_quadratic(20, 1e8, 7));
    for experiment in [Experiment::Vertices, Experiment::Sigma, Experiment::Joint] {
        all.push(scene(SceneSettings::new(experiment, 11)).expect("a scene"));
    }
    all
}

#[test]
fn hessian_vector_products_are_differences_of_gradients() {
    for problem in problems() {
        let x = problem.start();
        // In each parameter's own size, so that no step leaves the region where the gradient is
        // nearly linear.
        let sizes: Vec<f64> = x.iter().map(|x| x.abs().max(1e-2)).collect();
        let unit = direction(x.len(), 0.3);
        let v: Vec<f64> = unit.iter().zip(&sizes).map(|(u, size)| u * size).collect();
        let along = |h: f64| {
            let moved: Vec<f64> = x.iter().zip(&v).map(|(x, v)| x + h * v).collect();
            gradient(&problem, &moved)
        };
        let quotient = |h: f64| -> Vec<f64> {
            let pairs = along(h).into_iter().zip(along(-h));
            pairs.map(|(ahead, behind)| (ahead - behind) / (2.0 * h)).collect()
        };
        let (near, far) = (quotient(1e-6), quotient(2e-6));
        let product = hessian_times(&problem, x, &v);
        let gradient = gradient(&problem, x);
        for k in 0..x.len() {
            // A Richardson pair, its own error bar, and the rounding of the gradient's terms.
            let expected = near[k] + (near[k] - far[k]) / 3.0;
            let terms = gradient.iter().fold(1.0, |largest: f64, g| largest.max(g.abs()));
            let bar = (near[k] - far[k]).abs() + 64.0 * f64::EPSILON * terms / 1e-6;
            let (name, got) = (problem.name(), product[k]);
            assert!((got - expected).abs() <= bar, "{name} {k}: {got}, {expected} +- {bar}");
        }
    }
}

#[test]
fn hessians_are_symmetric() {
    for problem in problems() {
        let x = problem.start();
        let (u, v) = (direction(x.len(), 0.1), direction(x.len(), 2.0));
        let (hu, hv) = (hessian_times(&problem, x, &u), hessian_times(&problem, x, &v));
        let (one, other) = (dot(&hu, &v), dot(&hv, &u));
        let size = dot(&hu, &hu).sqrt() * dot(&v, &v).sqrt();
        assert!((one - other).abs() <= 1e-12 * size, "{} {one} {other}", problem.name());
    }
}

#[test]
fn levenberg_marquardt_solves_every_problem_with_residual_zero() {
    let mut all: Vec<Problem> = literature();
    all.push(rotated_quadratic(20, 1e8, 7));
    let mut solved = 0;
    for problem in all.iter().filter(|problem| problem.least() == 0.0) {
        // Local minima catch every descent method from the standard starts of these.
        if ["Freudenstein-Roth", "Trigonometric 10"].contains(&problem.name()) {
            continue;
        }
        let run = run(problem, 0, Method::LevenbergMarquardt, BUDGET);
        assert_eq!(run.solved_to, LEVELS, "{} {:?} {}", run.problem, run.outcome, run.message);
        solved += 1;
    }
    assert_eq!(solved, 7);
}

#[test]
fn known_minima_are_found_to_their_digits() {
    for problem in literature().iter().filter(|problem| problem.least() > 0.0) {
        let run = run(problem, 0, Method::LevenbergMarquardt, BUDGET);
        assert_eq!(run.solved_to, LEVELS, "{} {:?} {}", run.problem, run.outcome, run.message);
    }
}

#[test]
fn the_same_run_gives_the_same_bits_for_any_number_of_threads() {
    let problem = scene(SceneSettings::new(Experiment::Joint, 3)).expect("a scene");
    let small = Budget { gradients: 300.0, ..BUDGET };
    for method in [Method::Adam { rate: 1e-2 }, Method::TrustRegion, Method::LevenbergMarquardt] {
        let errors = [1, 2, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let run = pool.install(|| run(&problem, 3, method, small));
            (run.error.to_bits(), run.gradient_evaluations.to_bits(), run.outcome)
        });
        assert!(errors.iter().all(|found| *found == errors[0]), "{method:?}");
    }
}

#[test]
fn second_order_steps_end_where_first_order_ones_still_are_on_their_way() {
    let error = |preset| {
        let new = CubeSettings::new(Experiment::Joint, preset);
        let settings = CubeSettings {
            steps: 4_000,
            sigma_target: 1.4,
            seed: 200,
            precision: Precision::F64,
            ..new
        };
        let outcome = run_cube(&settings, &mut |_| ControlFlow::Continue(())).expect("a fit");
        assert_eq!(outcome.steps, settings.steps);
        outcome.vertex_error_final.expect("vertices are learnt")
    };
    let (first, second) = (error(Preset::Tuned), error(Preset::SecondOrder));
    assert!(second < 1e-12 && second < 1e-3 * first, "{first} {second}");
}
