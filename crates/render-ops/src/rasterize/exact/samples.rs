//! What is visible in a crowded pixel, by samples: where so many faces meet that to find it exactly
//! would take too long.
//!
//! # Forward
//! The nearest face at each of [`GRID`]^2 samples; integrals over it are sums over them.
//!
//! # Backward
//! Weights change where the outline of a surface moves. Each edge of the outline is cut into steps
//! about as long as samples are apart. A step counts where the edge's face is seen beside its middle:
//! it is then a side of that face. It is also a side of the face seen beyond, if that face continues
//! behind. A face that no sample sees, but that has a side, is a piece of area 0. Where steps times
//! faces are more than [`MOST_PAIRS`], only faces that samples see count. Samples do not move.
//! Intersections do not move either, since they are no edges.

use bokashi_core::Scalar;

use super::extent::{Extent, Spread};
use super::pixel_border::{WIDER, clipped};
use super::polygon::{Line, Polygons, value_at};
use super::visible::{Candidate, Side, Source};

/// Samples along a pixel's side.
const GRID: usize = 16;

/// Stands for "nothing is seen".
const NOTHING: u32 = u32::MAX;

/// How many pairs of a piece of an edge and a face may be looked at.
const MOST_PAIRS: usize = 1 << 23;

/// What lies in the pixel of an edge of the surface's outline.
#[derive(Debug, Clone, Copy)]
struct Stretch<S> {
    candidate: u32,
    k: u8,
    ends: [[S; 2]; 2],
}

/// The samples of a pixel.
#[derive(Debug, Default)]
pub(super) struct Samples<S> {
    depths: Vec<S>,
    seen: Vec<u32>,
    /// Per candidate.
    spreads: Vec<Spread<S>>,
    /// The candidates that count.
    counting: Vec<u32>,
    polygons: Polygons<S>,
    stretches: Vec<Stretch<S>>,
    /// What the last call found.
    pub(super) sides: Vec<(u32, Side<S>)>,
}

/// How far beside an edge one looks, in half pixels.
const BESIDE: f64 = 1e-6;

impl<S: Scalar> Samples<S> {
    /// Finds the areas of what the samples see of each candidate, the extents of those that are seen or
    /// have sides, and the sides. `t_of` tells the t of a candidate.
    pub(super) fn find(
        &mut self,
        candidates: &[Candidate<S>],
        t_of: impl Fn(&Candidate<S>) -> Line<S>,
        areas: &mut [S],
        extents: &mut [Option<Extent<S>>],
    ) {
        self.look(candidates, t_of, areas);
        for ((extent, spread), &area) in extents.iter_mut().zip(&self.spreads).zip(&*areas) {
            *extent = spread.extent(area);
        }
        self.find_stretches(candidates);
        let Self { counting, stretches, sides, .. } = self;
        let cuts: usize = stretches.iter().map(|stretch| cuts(stretch.ends)).sum();
        let do_all_count = cuts.saturating_mul(candidates.len()) <= MOST_PAIRS;
        counting.clear();
        let all = 0..candidates.len() as u32;
        counting.extend(all.filter(|&at| do_all_count || extents[at as usize].is_some()));
        if !do_all_count {
            stretches.retain(|stretch| extents[stretch.candidate as usize].is_some());
        }
        sides.clear();
        for &Stretch { candidate: at, k, ends } in &*stretches {
            let [_, x, y] = candidates[at as usize].edges[usize::from(k)];
            let source = Source::Edge { candidate: at, k };
            let is_on_border = candidates[at as usize].on_border >> k & 1 == 1;
            let beside = S::from_f64(BESIDE) / x.abs().maximum_or_nan(y.abs());
            for ends in cut(ends) {
                let [p, q] = ends;
                let half = S::from_f64(0.5);
                let middle = [0, 1].map(|axis| half * (p[axis] + q[axis]));
                let [inner, outer] = [beside, -beside]
                    .map(|offset| [middle[0] + offset * x, middle[1] + offset * y]);
                if nearest(candidates, counting, inner) != Some(at) {
                    continue;
                }
                let mut add = |at: u32, is_inside| {
                    extents[at as usize].get_or_insert_with(|| Extent::at(middle));
                    let normal = [x, y];
                    sides.push((at, Side { source, is_inside, is_on_border, normal, ends }));
                };
                add(at, true);
                // What ends here, too, has a side of its own.
                let beyond = nearest(candidates, counting, outer);
                if let Some(beyond) = beyond.filter(|&at| candidates[at as usize].covers(inner)) {
                    add(beyond, false);
                }
            }
        }
    }

    /// Finds the edges of the surface's outline.
    fn find_stretches(&mut self, candidates: &[Candidate<S>]) {
        let Self { polygons, stretches, .. } = self;
        stretches.clear();
        for (at, Candidate { edges, outline, on_border, .. }) in (0..).zip(candidates) {
            if *outline == 0 {
                continue;
            }
            let mut add = |reach: f64, some: u8| {
                polygons.clear();
                let mut polygon = Some(polygons.pixel(S::from_f64(reach)));
                for (k, &edge) in (0..).zip(edges) {
                    polygon = polygon.and_then(|polygon| polygons.inside(polygon, edge, k));
                }
                let sides = polygon.iter().flat_map(|&polygon| polygons.segments(polygon));
                stretches.extend(sides.filter_map(|(bound, ends)| {
                    let is_one = some.checked_shr(bound.line).unwrap_or(0) & 1 == 1;
                    let [_, x, y] = edges[if is_one { bound.line as usize } else { 0 }];
                    let ends = if reach > 1.0 { clipped(ends, [x, y])? } else { ends };
                    is_one.then_some(Stretch { candidate: at, k: bound.line as u8, ends })
                }));
            };
            add(1.0, outline & !on_border);
            if outline & on_border != 0 {
                add(WIDER, outline & on_border);
            }
        }
    }

    /// Finds what the samples see, and its areas.
    fn look(
        &mut self,
        candidates: &[Candidate<S>],
        t_of: impl Fn(&Candidate<S>) -> Line<S>,
        areas: &mut [S],
    ) {
        self.depths.clear();
        self.depths.resize(GRID * GRID, S::ONE);
        self.seen.clear();
        self.seen.resize(GRID * GRID, NOTHING);
        let places: [S; GRID] =
            std::array::from_fn(|k| S::from_f64((2 * k + 1) as f64 / GRID as f64 - 1.0));
        for (at, candidate) in (0..).zip(candidates) {
            let rows = self.depths.chunks_exact_mut(GRID).zip(self.seen.chunks_exact_mut(GRID));
            for (&y, (depths, seen)) in places.iter().zip(rows) {
                for ((&x, nearest), seen) in places.iter().zip(depths).zip(seen) {
                    let depth = value_at(candidate.depth, [x, y]);
                    let is_nearer = depth < *nearest || depth == S::ONE && *seen == NOTHING;
                    if is_nearer && depth >= -S::ONE && candidate.covers([x, y]) {
                        (*nearest, *seen) = (depth, at);
                    }
                }
            }
        }
        self.spreads.clear();
        self.spreads.extend(candidates.iter().map(|candidate| Spread::new(t_of(candidate))));
        let share = S::from_f64(4.0 / (GRID * GRID) as f64);
        for (sample, &seen) in self.seen.iter().enumerate().filter(|(_, seen)| **seen != NOTHING) {
            let [x, y] = [places[sample % GRID], places[sample / GRID]];
            areas[seen as usize] += share;
            self.spreads[seen as usize].add_sample([x, y], share);
        }
    }
}

/// How many pieces about as long as samples are apart make a segment.
fn cuts<S: Scalar>([p, q]: [[S; 2]; 2]) -> usize {
    let [x, y] = [0, 1].map(|axis| (q[axis] - p[axis]).abs().to_f64());
    (x.max(y) * GRID as f64 / 2.0).ceil().max(1.0) as usize
}

/// Cuts a segment into these.
fn cut<S: Scalar>([p, q]: [[S; 2]; 2]) -> impl Iterator<Item = [[S; 2]; 2]> {
    let along = [0, 1].map(|axis| q[axis] - p[axis]);
    let count = cuts([p, q]);
    let place = move |k: usize| {
        let share = S::from_f64(k as f64 / count as f64);
        [0, 1].map(|axis| p[axis] + share * along[axis])
    };
    (0..count).map(move |k| [place(k), place(k + 1)])
}

/// The nearest of some candidates at a point.
fn nearest<S: Scalar>(candidates: &[Candidate<S>], some: &[u32], point: [S; 2]) -> Option<u32> {
    let mut nearest = None;
    let mut least = S::ONE;
    for &at in some {
        let candidate = &candidates[at as usize];
        let depth = value_at(candidate.depth, point);
        let is_nearer = depth < least || depth == S::ONE && nearest.is_none();
        if is_nearer && depth >= -S::ONE && candidate.covers(point) {
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
        let mut samples = Samples::default();
        for _ in 0..500 {
            let (triangles, weights) = scenes.new_tree(&mut runner).unwrap().current();
            // Each in a plane of its own: intersections do not move.
            let flat = |(at, points): (usize, [[f64; 3]; 3])| {
                candidate(at as u32, points.map(|[x, y, _]| [x, y, 0.1 * at as f64]))
            };
            let all: Vec<_> = triangles.into_iter().enumerate().filter_map(flat).collect();
            let mut visible = Visible::default();
            visible.clear(1.0);
            visible.add(&all);
            let mut exact = vec![0.0; all.len()];
            visible.add_areas(&mut exact);
            let mut found = vec![0.0; all.len()];
            let constant = |_: &Candidate<f64>| [1.0, 0.0, 0.0];
            samples.find(&all, constant, &mut found, &mut vec![None; all.len()]);
            for (found, exact) in found.iter().zip(&exact) {
                size[0] += exact;
                error[0] += (found - exact).abs();
            }
            // The gradient of a weighted sum of areas, as all edges move outwards alike.
            let moved = |(at, side): (u32, Side<f64>)| {
                let Side { ends, normal, .. } = side;
                let bar = line_bar(ends, side.share(), normal, [0.5 * weights[at as usize]; 2]);
                bar[0] * side.normal[0].hypot(side.normal[1])
            };
            let mut exact = 0.0;
            visible.for_each_side(|at, side| exact += moved((at, side)));
            let found: f64 = samples.sides.iter().copied().map(moved).sum();
            size[1] += exact.abs();
            error[1] += (found - exact).abs();
        }
        // Memory is that of one candidate.
        assert!(samples.polygons.len() < 32, "{}", samples.polygons.len());
        assert!(size[0] > 500.0 && error[0] < 0.04 * size[0], "{error:?} of {size:?}");
        assert!(size[1] > 200.0 && error[1] < 0.1 * size[1], "{error:?} of {size:?}");
    }
}
