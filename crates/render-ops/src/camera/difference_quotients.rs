//! Slopes of lenses against difference quotients.

use bokashi_core::{Tape, Tensor, Var};

/// Checks the gradients of a motley sum of what `lens` makes of points and coefficients.
pub(super) fn assert_slopes(
    points: &[[f64; 3]],
    coefficients: &[f64],
    lens: impl for<'t> Fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>,
) {
    let upstream =
        Tensor::from_flat_fn([points.len(), 3], |k| (k as f64 + 1.0) / (2.0 * k as f64 - 5.0));
    let start = [Tensor::from(points.to_vec()), Tensor::from(coefficients)];
    let value = |inputs: &[Tensor<f64>; 2]| -> f64 {
        let tape = Tape::new();
        let out = lens(tape.leaf(&inputs[0]), tape.leaf(&inputs[1])).value();
        out.data().iter().zip(upstream.data()).map(|(y, u)| y * u).sum()
    };
    let tape = Tape::new();
    let leaves = [0, 1].map(|k| tape.leaf(&start[k]));
    let gradients = tape.vjp(&[(lens(leaves[0], leaves[1]), &upstream)]).unwrap();
    for (which, leaf) in leaves.into_iter().enumerate() {
        for (k, &found) in gradients.get(leaf).unwrap().data().iter().enumerate() {
            let at = |h: f64| {
                let mut moved = start.clone();
                moved[which].data_mut()[k] += h;
                value(&moved)
            };
            let central = |h: f64| (at(h) - at(-h)) / (2.0 * h);
            let quotient = (4.0 * central(5e-6) - central(1e-5)) / 3.0;
            approx::assert_relative_eq!(found, quotient, epsilon = 1e-6, max_relative = 1e-7);
        }
    }
}
