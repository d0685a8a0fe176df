//! What is visible in a crowded pixel, by samples: where so many faces meet that to find it exactly
//! would take too long.
//!
//! # Forward
//! The nearest face at each of [`GRID`]^2 samples; its measure is theirs.
//!
//! # Backward
//! The boundary of what is visible moves with the edges. Each edge of a face that some sample sees is cut
//! into pieces about as long as samples are apart. Where the face is seen beside the middle of a piece,
//! the piece is a side of it, and of what is seen on the other side, among all that samples see. An
//! intersection of two faces is no edge of either: it does not move.

use bokashi_core::Scalar;

use super::polygon::{Measure, Polygons, value_at};
use super::visible::{Candidate, Side, Source};

/// Samples along a pixel's side.
pub(super) const GRID: usize = 16;

/// Stands for "nothing is seen".
const NOTHING: u32 = u32::MAX;

/// The samples of a pixel.
#[derive(Debug, Default)]
pub(super) struct Samples<S> {
    depths: Vec<S>,
    seen: Vec<u32>,
    /// The candidates that some sample sees.
    visible: Vec<u32>,
    polygons: Polygons<S>,
    sides: Vec<(u32, Side<S>)>,
}

/// How far beside an edge one looks, in half pixels.
const BESIDE: f64 = 1e-6;

impl<S: Scalar> Samples<S> {
    /// Finds what the samples see, and the measure of what is visible of each candidate.
    pub(super) fn find(&mut self, candidates: &[Candidate<S>], measures: &mut [Measure<S>]) {
        self.depths.clear();
        self.depths.resize(GRID * GRID, S::ONE);
        self.seen.clear();
        self.seen.resize(GRID * GRID, NOTHING);
        let places: [S; GRID] =
            std::array::from_fn(|k| S::from_f64((2 * k + 1) as f64 / GRID as f64 - 1.0));
        for (at, Candidate { edges, depth, .. }) in (0..).zip(candidates) {
            let rows = self.depths.chunks_exact_mut(GRID).zip(self.seen.chunks_exact_mut(GRID));
            for (&y, (depths, seen)) in places.iter().zip(rows) {
                for ((&x, nearest), seen) in places.iter().zip(depths).zip(seen) {
                    let depth = value_at(*depth, [x, y]);
                    let is_nearer = depth < *nearest || depth == S::ONE && *seen == NOTHING;
                    let is_in = edges.iter().all(|&edge| value_at(edge, [x, y]) > S::ZERO);
                    if is_nearer && is_in && depth >= -S::ONE {
                        (*nearest, *seen) = (depth, at);
                    }
                }
            }
        }
        let share = S::from_f64(4.0 / (GRID * GRID) as f64);
        for (sample, &seen) in self.seen.iter().enumerate().filter(|(_, seen)| **seen != NOTHING) {
            let measure = &mut measures[seen as usize];
            measure[0] += share;
            measure[1] += share * places[sample % GRID];
            measure[2] += share * places[sample / GRID];
        }
    }

    /// Finds the sides of what the samples see; after [`Samples::find`].
    pub(super) fn sides(
        &mut self,
        candidates: &[Candidate<S>],
        measures: &[Measure<S>],
    ) -> &[(u32, Side<S>)] {
        let Self { visible, polygons, sides, .. } = self;
        sides.clear();
        visible.clear();
        let all = 0..candidates.len() as u32;
        visible.extend(all.filter(|&at| measures[at as usize][0] > S::ZERO));
        for &at in &*visible {
            let candidate = &candidates[at as usize];
            let mut polygon = Some(polygons.pixel());
            for (k, &edge) in (0..).zip(&candidate.edges) {
                polygon = polygon.and_then(|polygon| polygons.inside(polygon, edge, k));
            }
            for (side, ends) in polygon.iter().flat_map(|&polygon| polygons.segments(polygon)) {
                let Some(&[_, x, y]) = candidate.edges.get(side.line as usize) else { continue };
                let source = Source::Edge { candidate: at, k: side.line as u8 };
                let beside = S::from_f64(BESIDE) / x.abs().greater(y.abs());
                for ends in cut(ends) {
                    let [p, q] = ends;
                    let seen = |sign: S| {
                        let half = S::from_f64(0.5);
                        let middle = [0, 1].map(|axis| half * (p[axis] + q[axis]));
                        let offset = sign * beside;
                        nearest(
                            candidates,
                            visible,
                            [middle[0] + offset * x, middle[1] + offset * y],
                        )
                    };
                    let (inner, outer) = (seen(S::ONE), seen(-S::ONE));
                    if inner != Some(at) || outer == inner {
                        continue;
                    }
                    let side = |is_inside| Side { source, is_inside, normal: [x, y], ends };
                    sides.push((at, side(true)));
                    sides.extend(outer.map(|outer| (outer, side(false))));
                }
            }
        }
        sides
    }
}

/// Cuts a segment into pieces about as long as samples are apart.
fn cut<S: Scalar>([p, q]: [[S; 2]; 2]) -> impl Iterator<Item = [[S; 2]; 2]> {
    let along = [0, 1].map(|axis| q[axis] - p[axis]);
    let length = along[0].abs().greater(along[1].abs()).to_f64();
    let count = (length * GRID as f64 / 2.0).ceil().max(1.0) as usize;
    let place = move |k: usize| {
        let share = S::from_f64(k as f64 / count as f64);
        [0, 1].map(|axis| p[axis] + share * along[axis])
    };
    (0..count).map(move |k| [place(k), place(k + 1)])
}

/// The nearest of some candidates at a point.
fn nearest<S: Scalar>(candidates: &[Candidate<S>], visible: &[u32], point: [S; 2]) -> Option<u32> {
    let mut nearest = None;
    let mut least = S::ONE;
    for &at in visible {
        let Candidate { edges, depth, .. } = &candidates[at as usize];
        let depth = value_at(*depth, point);
        let covers = || edges.iter().all(|&edge| value_at(edge, point) > S::ZERO);
        if (depth < least || depth == S::ONE && nearest.is_none()) && depth >= -S::ONE && covers() {
            (nearest, least) = (Some(at), depth);
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use proptest::array::uniform5;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;

    use super::super::polygon::line_bar;
    use super::super::visible::Visible;
    use super::super::visible::tests::{candidate, triangle};
    use super::*;

    /// What is thinner than samples are apart may be missed, so errors are bounded on the whole.
    #[test]
    fn samples_see_what_is_visible_and_their_sides_move_it_alike() {
        let mut runner = TestRunner::deterministic();
        let scenes = (vec(triangle(), 1..5), uniform5(-1.0..1.0));
        let (mut size, mut error) = ([0.0; 2], [0.0; 2]);
        for _ in 0..500 {
            let (triangles, weights) = scenes.new_tree(&mut runner).unwrap().current();
            // Each in a plane of its own: intersections do not move.
            let flat = |(at, points): (usize, [[f64; 3]; 3])| {
                candidate(at as u32, points.map(|[x, y, _]| [x, y, 0.1 * at as f64]))
            };
            let all: Vec<_> = triangles.into_iter().enumerate().filter_map(flat).collect();
            let mut visible = Visible::default();
            visible.find(&all);
            let mut exact = vec![[0.0; 3]; all.len()];
            visible.measure(&mut exact);
            let (mut samples, mut found) = (Samples::default(), vec![[0.0; 3]; all.len()]);
            samples.find(&all, &mut found);
            for (found, exact) in found.as_flattened().iter().zip(exact.as_flattened()) {
                size[0] += exact.abs();
                error[0] += (found - exact).abs();
            }
            // The gradient of a weighted sum of areas, as all edges move outwards alike.
            let moved = |(at, side): (u32, Side<f64>)| {
                let Side { ends, is_inside, normal, .. } = side;
                let bar = line_bar(ends, is_inside, normal, |_| weights[at as usize]);
                bar[0] * side.normal[0].hypot(side.normal[1])
            };
            let exact: f64 = visible.sides().map(moved).sum();
            let found: f64 = samples.sides(&all, &found).iter().copied().map(moved).sum();
            size[1] += exact.abs();
            error[1] += (found - exact).abs();
        }
        assert!(size[0] > 500.0 && error[0] < 0.04 * size[0], "{error:?} of {size:?}");
        assert!(size[1] > 200.0 && error[1] < 0.1 * size[1], "{error:?} of {size:?}");
    }
}
