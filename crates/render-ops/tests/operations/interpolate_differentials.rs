use crate::fixtures::surface;
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Fragments, differentials, interpolate, interpolate_differentials};

#[test]
fn they_are_the_derivative_of_interpolation_along_the_differentials() {
    let tape = Tape::<f64>::new();
    let (fragments, _) = surface(&tape);
    let slopes = differentials(&fragments).unwrap();
    for channels in [1, 2, 5] {
        let numbers = Tensor::from_flat_fn([3, channels], |k| (1.3 * k as f64).cos());
        let attributes = tape.leaf(&numbers);
        let found = interpolate_differentials(attributes, &fragments, slopes).unwrap().value();
        // Interpolation is linear in the weights.
        let at = |h: f64, axis: usize| {
            let moved = Tensor::from_fn([fragments.coverage.count(), 2], |[n, k]| {
                fragments.barycentrics.value()[[n, k]] + h * slopes.value()[[n, k, axis]]
            });
            let moved = Fragments { barycentrics: tape.leaf(&moved), ..fragments.clone() };
            interpolate(attributes, &moved).unwrap().value()
        };
        for axis in 0..2 {
            let (after, before) = (at(1.0, axis), at(-1.0, axis));
            for n in 0..fragments.coverage.count() {
                for c in 0..channels {
                    let expected = 0.5 * (after[[n, c]] - before[[n, c]]);
                    approx::assert_relative_eq!(found[[n, c, axis]], expected, epsilon = 1e-14);
                }
            }
        }
    }
}

#[test]
fn wrong_shapes_are_refused() {
    let tape = Tape::<f64>::new();
    let (fragments, _) = surface(&tape);
    let count = fragments.coverage.count();
    let slopes = differentials(&fragments).unwrap();
    let attributes = tape.leaf(&Tensor::zeros([3, 2]));
    let error = interpolate_differentials(tape.leaf_scalar(0.0), &fragments, slopes);
    let rule = "interpolate_differentials needs attributes of shape [3, C], C > 0, got shape []";
    assert_eq!(error.unwrap_err().to_string(), rule);
    let error = interpolate_differentials(attributes, &fragments, fragments.barycentrics);
    let rule = format!(
        "interpolate_differentials needs differentials of shape [{count}, 2, 2], got shape [{count}, 2]"
    );
    assert_eq!(error.unwrap_err().to_string(), rule);
}
