//! What a lens shows at a point, back to where the point is. It has no gradient.
//!
//! Newton's method on the map of `distortion`, from the solution without p1 and p2. A step that does
//! not come nearer is halved.

use glam::{DMat2, DVec2};

use super::distortion::{Distortion, all};

/// Steps at most.
const STEPS: usize = 64;

/// Halvings of a step at most.
const HALVINGS: usize = 40;

/// A residual below this, as a share of the point, is a solution.
const TOLERANCE: f64 = 1e-12;

/// The normalized camera coordinates (x, y) that [`distort`](crate::distort()) of `coefficients` =
/// (k1, k2, p1, p2, k3), and perhaps k4, k5, k6, shows at `point`: `N` is 5 or 8. `None` where Newton's method
/// finds none: for numbers that are not finite, and where p1 and p2 are so large that the lens shows nothing
/// there.
pub fn undistorted<const N: usize>(point: DVec2, coefficients: [f64; N]) -> Option<DVec2> {
    let lens = Distortion::new(all(coefficients));
    let residual = |guess: DVec2| DVec2::from(lens.shown([guess.x, guess.y, 1.0])) - point;
    let length = point.length();
    let mut guess = if length == 0.0 { point } else { point * (lens.radius_of(length) / length) };
    let mut left = residual(guess);
    for _ in 0..STEPS {
        let ([across, down], _) = lens.shown_slopes([guess.x, guess.y, 1.0]);
        let slopes = DMat2::from_cols_array(&[across[0], down[0], across[1], down[1]]);
        let step = slopes.inverse() * left;
        let tries = (0..HALVINGS).map(|k| guess - step * f64::powi(0.5, k as i32));
        let nearer = |&to: &DVec2| residual(to).length() < left.length();
        let Some(next) = tries.into_iter().find(nearer) else { break };
        (guess, left) = (next, residual(next));
    }
    (left.length() <= TOLERANCE * length.max(1e-300)).then_some(guess)
}
