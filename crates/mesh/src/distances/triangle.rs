//! The point of a triangle that is nearest to another point.

use super::cloud::{cross, dot, minus};

/// The barycentrics of the point of the triangle nearest to `query`, and the square of its distance.
///
/// It is the foot of the perpendicular where this falls within, or lies on one of the edges. Distances are those of
/// the points that are found, so rounding in a sliver can make the point a bit farther, and never wrong.
pub(super) fn nearest(corners: [[f64; 3]; 3], query: [f64; 3]) -> ([f64; 3], f64) {
    let [a, b, c] = corners;
    let (to_b, to_c, to_query) = (minus(b, a), minus(c, a), minus(query, a));
    let normal = cross(to_b, to_c);
    let square = dot(normal, normal);
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    let mut offer = |weights: [f64; 3]| {
        let [_, v, w] = weights;
        let away = [0, 1, 2].map(|axis| to_query[axis] - v * to_b[axis] - w * to_c[axis]);
        let found = dot(away, away);
        if found < best.1 {
            best = (weights, found);
        }
    };
    if square > 0.0 {
        let v = dot(cross(to_query, to_c), normal) / square;
        let w = dot(cross(to_b, to_query), normal) / square;
        let u = 1.0 - v - w;
        if u >= 0.0 && v >= 0.0 && w >= 0.0 {
            offer([u, v, w]);
        }
    }
    for k in 0..3 {
        let (from, to) = (k, (k + 1) % 3);
        let along = minus(corners[to], corners[from]);
        let length = dot(along, along);
        let share = dot(minus(query, corners[from]), along) / length;
        let share = if length > 0.0 { share.clamp(0.0, 1.0) } else { 0.0 };
        let mut weights = [0.0; 3];
        (weights[from], weights[to]) = (1.0 - share, share);
        offer(weights);
    }
    best
}
