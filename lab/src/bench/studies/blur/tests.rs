use bokashi_core::Tensor;

use super::algorithm::{Algorithm, USED};
use super::figure::front;
use super::*;

#[test]
fn a_point_is_on_the_front_where_none_is_both_faster_and_closer() {
    let point = |(seconds_per_pixel, error)| Point { line: 0, seconds_per_pixel, error };
    let points = [(3.0, 1e-3), (1.0, 1e-1), (2.0, 1e-3), (2.5, 1e-2), (4.0, 1e-5)];
    let found = front(&points.map(point));
    let expected = [(1.0, 1e-1), (2.0, 1e-1), (2.0, 1e-3), (4.0, 1e-3), (4.0, 1e-5)];
    assert_eq!(found, expected);
    assert!(front(&[point((1.0, f64::INFINITY))]).is_empty());
}

#[test]
fn the_error_follows_the_tolerance() {
    let input = Input::new(24, 2.0).unwrap();
    for algorithm in &ALGORITHMS {
        let exact = input.exact(algorithm.kernel).unwrap();
        let error = |tolerance, quantity| {
            let blur = algorithm.blur(tolerance, input.sigma).unwrap();
            input.error(algorithm, &blur, quantity, &exact).unwrap()
        };
        for quantity in Quantity::APART {
            let errors = TOLERANCES.map(|tolerance| error(tolerance, quantity));
            let what = format!("{}, {} {errors:?}", algorithm.name, quantity.name());
            assert!(errors[0] > 1e-4 && errors[3] < 1e-6, "{what}");
            // In f32 the last of them meet rounding.
            let falling = if algorithm.is_double { &errors[..] } else { &errors[..2] };
            assert!(falling.is_sorted_by(|a, b| a > b), "{what}");
        }
    }
}

#[test]
fn the_discrete_window_is_what_a_tolerance_chooses_where_sigma_is_small_and_another_where_not() {
    let window = ALGORITHMS.iter().find(|one| one.name.contains("window")).unwrap();
    let found = |algorithm: &Algorithm, sigma| -> Tensor<f32> {
        let blur = algorithm.blur(1e-4, sigma).unwrap();
        let [values, ..] = Input::new(64, sigma).unwrap().results(&blur, Quantity::Values).unwrap();
        values.unwrap()
    };
    let [_, chosen] = USED;
    assert_eq!(found(window, 1.0), found(chosen, 1.0));
    assert_ne!(found(window, 16.0), found(chosen, 16.0));
}

#[test]
fn at_every_sigma_there_are_gradients_to_compare() {
    for sigma in SIGMAS {
        let input = Input::new(24, sigma).unwrap();
        let [_, image, slope] = input.exact(Kernel::Discrete).unwrap();
        let [image, slope] = [image, slope].map(|gradient| {
            let gradient: Tensor<f64> = gradient.unwrap();
            gradient.data().iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs()))
        });
        assert!(image > 0.0 && slope > 0.0, "sigma {sigma}: {image} {slope}");
    }
}
