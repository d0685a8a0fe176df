use approx::assert_relative_eq;

use super::*;

fn taps(sigma: f64, kernel: Kernel, radius: Radius) -> Taps<f64> {
    let mut taps = [Taps::default(), Taps::default()];
    let blur = Blur { kernel, border: Border::Zero, radius };
    Taps::fill(&mut taps, sigma, &blur, [1, 1]).unwrap();
    let [taps, _] = taps;
    taps
}

/// The half windows of a line of `extent` pixels, folded and, above sigma 3561, endless.
fn folded(sigma: f64, border: Border, extent: usize, radius: Radius, kernel: Kernel) -> Taps<f64> {
    let mut taps = [Taps::default(), Taps::default()];
    let blur = Blur { kernel, border, radius };
    Taps::fill(&mut taps, sigma, &blur, [3, extent]).unwrap();
    let [_, taps] = taps;
    taps
}

#[test]
fn folding_keeps_the_sums_and_reaches_no_farther_than_the_line_is_long() {
    for border in [Border::Mirror, Border::Clamp] {
        for (extent, sigma) in [(1, 0.8), (1, 40.0), (4, 2.0), (7, 100.0), (7, 1e5), (2, 1e300)] {
            let taps = folded(sigma, border, extent, Radius::Tolerance(1e-9), Kernel::Sampled);
            assert!(taps.radius() <= extent);
            assert_relative_eq!(whole_sum(&taps.weights), 1.0, max_relative = 1e-13);
            assert!(whole_sum(&taps.slopes).abs() <= 1e-13);
            assert!(taps.weights.iter().all(|&weight| weight >= 0.0));
        }
    }
}

#[test]
fn the_endless_window_is_the_sum_over_all_taps_that_count() {
    let kernels =
        [(Kernel::Sampled, [4.0, 50.0, 400.0]), (Kernel::Discrete, [100.0, 400.0, 1500.0])];
    let borders = [Border::Zero, Border::Mirror, Border::Clamp];
    for ((kernel, sigmas), border) in kernels.into_iter().flat_map(|k| borders.map(|b| (k, b))) {
        for extent in [1, 2, 9, 50, 700] {
            for sigma in sigmas {
                let mut endless = Taps::default();
                let all = Radius::Fixed((9.2 * sigma) as usize);
                let blur = Blur { kernel, border, radius: all };
                endless.fill_endless(sigma, &blur, extent);
                let long = folded(sigma, border, extent, all, kernel);
                // The discrete taps are those of a series.
                let series = if kernel == Kernel::Discrete { sigma.powi(-4) } else { 0.0 };
                for k in 0..=extent.min(long.radius()) {
                    let epsilon = 2e-15 + series;
                    assert_relative_eq!(endless.weights[k], long.weights[k], epsilon = epsilon);
                    assert_relative_eq!(endless.slopes[k], long.slopes[k], epsilon = epsilon);
                }
                assert!(
                    endless.weights[long.radius().min(extent) + 1..].iter().all(|&w| w < 1e-15)
                );
            }
        }
    }
}

fn whole_sum(half: &[f64]) -> f64 {
    half[0] + 2.0 * half[1..].iter().sum::<f64>()
}

#[test]
fn sampled_weights_sum_to_one_and_their_slopes_to_zero() {
    for sigma in [1e-150, 1e-3, 0.1, 0.3, 1.0, 4.0, 30.0] {
        let taps = taps(sigma, Kernel::Sampled, Radius::Tolerance(1e-6));
        assert_relative_eq!(whole_sum(&taps.weights), 1.0, max_relative = 1e-14);
        assert!(taps.slopes.iter().all(|slope| slope.is_finite()));
        assert!(whole_sum(&taps.slopes).abs() < 1e-14);
    }
}

#[test]
fn the_seed_kernels_gain_is_that_of_the_formula_as_printed() {
    // The square of the one-dimensional sum, from numbers worked out for equation (2).
    for (sigma, gain, places) in [(0.1, 15.9, 0.05), (0.3, 1.80, 0.005), (0.5, 1.029, 0.0005)] {
        let sum = whole_sum(&taps(sigma, Kernel::Unnormalized, Radius::Fixed(8)).weights);
        assert_relative_eq!(sum * sum, gain, epsilon = places);
    }
}

#[test]
fn a_tolerance_bounds_the_weight_that_the_window_misses() {
    for tolerance in [1e-2, 1e-4, 1e-8] {
        for sigma in [0.2, 1.0, 3.7] {
            let radius = smallest_radius(sigma, tolerance).unwrap();
            let shape = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
            let weight = |r: usize| 1.0 + 2.0 * (1..=r).map(shape).sum::<f64>();
            let missing = |r: usize| 1.0 - weight(r) / weight(60);
            assert!(missing(radius) <= tolerance);
            assert!(radius == 0 || missing(radius - 1) > tolerance);
        }
    }
}

#[test]
fn negligible_taps_are_cut_off() {
    assert_eq!(taps(1.0, Kernel::Sampled, Radius::Fixed(40)).radius(), 9);
}

#[test]
fn a_discrete_window_has_the_variance_that_it_is_asked_for() {
    for sigma in [1e-3, 0.1, 0.7, 2.0, 9.0, 60.0, 700.0] {
        let taps = taps(sigma, Kernel::Discrete, Radius::Fixed(LARGEST_RADIUS));
        assert_relative_eq!(whole_sum(&taps.weights), 1.0, max_relative = 1e-14);
        assert!(whole_sum(&taps.slopes).abs() <= 1e-14);
        let moment = |half: &[f64]| -> f64 {
            half.iter().enumerate().map(|(k, w)| 2.0 * (k * k) as f64 * w).sum()
        };
        assert_relative_eq!(moment(&taps.weights), sigma * sigma, max_relative = 1e-12);
        assert_relative_eq!(moment(&taps.slopes), 2.0 * sigma, max_relative = 1e-10);
    }
}

#[test]
fn two_discrete_windows_in_a_row_are_one() {
    let whole = |sigma: f64| {
        let half = taps(sigma, Kernel::Discrete, Radius::Fixed(40)).weights;
        move |k: isize| half.get(k.unsigned_abs()).copied().unwrap_or(0.0)
    };
    let (first, second, both) = (whole(1.5), whole(2.0), whole(2.5));
    for k in -30..=30 {
        let sum: f64 = (-40..=40).map(|j| first(j) * second(k - j)).sum();
        assert_relative_eq!(sum, both(k), epsilon = 1e-15);
    }
}

#[test]
fn a_discrete_window_moves_with_sigma_however_narrow_it_is() {
    for sigma in [1e-6, 1e-3, 0.1] {
        let taps = taps(sigma, Kernel::Discrete, Radius::Tolerance(1e-2));
        assert_relative_eq!(taps.slopes[1], sigma, max_relative = 0.1);
    }
}

#[test]
fn each_kernel_has_a_word() {
    for (word, kernel) in WORDS {
        assert_eq!(kernel.to_string(), word);
        assert_eq!(word.parse(), Ok(kernel));
    }
}
