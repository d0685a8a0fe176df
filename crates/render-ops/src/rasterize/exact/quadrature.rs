//! Integrals for tests, from nothing but values.

use std::f64::consts::PI;

/// Nodes u and weights on [0, 1], `[u, 1 - u, weight]`, that crowd at both ends: equal steps of s, `steps`
/// of them to a unit, after
/// `u = 1 / (1 + exp(-pi sinh s))`. A function that is analytic inside has all digits, also where it
/// nearly is infinite at an end.
pub(in crate::rasterize) fn nodes(steps: i32) -> Vec<[f64; 3]> {
    let step = 1.0 / f64::from(steps);
    let node = |k: i32| {
        let s = f64::from(k) * step;
        let e = (-PI * s.sinh()).exp();
        let [u, rest] = [1.0 / (1.0 + e), e / (1.0 + e)];
        [u, rest, u * rest * PI * s.cosh() * step]
    };
    (-4 * steps..=4 * steps).map(node).filter(|[.., weight]| *weight > 0.0).collect()
}
