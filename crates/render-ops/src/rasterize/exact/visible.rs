//! What is visible of each face in one pixel, exactly.
//!
//! # Forward
//! Each face is cut to the pixel. Then it loses what lies behind another face. Outside each edge of
//! the other face a convex part stays; inside all of them the part in front stays. Depth z / w is
//! linear over the image (`setup`), so two faces pass through each other in a line. Where depths are
//! equal, the lower face index wins, as elsewhere. Faces come in depth groups (`depth_intervals`),
//! the nearest first: once the parts fill the pixel, nothing behind them is looked at.
//!
//! # Backward
//! From integrals over the parts to the lines that bound them (`polygon`), and from these to the
//! faces. An edge's line is a face's edge function; the line of two faces is the difference of their
//! depths.

use std::ops::Range;

use bokashi_core::Scalar;

use super::extent::{Extent, Spread};
use super::pixel_border::{FAR, clipped, lies_on_border};
use super::polygon::{BORDER, Line, Polygon, Polygons, size, value_at};

/// A face in a pixel: lines are relative to the pixel's centre.
#[derive(Debug, Clone)]
pub(super) struct Candidate<S> {
    /// The position of its face among those of the band.
    pub(super) band_face: u32,
    /// The edge functions, positive inside.
    pub(super) edges: [Line<S>; 3],
    pub(super) depth: Line<S>,
    /// More than what the depth is off by in the pixel.
    pub(super) depth_error_bound: S,
    /// Bit k: whether edge k is one of a surface's outline, or a seam.
    pub(super) outline: u8,
    /// Bit k: whether edge k lies on the pixel's border.
    pub(super) on_border: u8,
}

impl<S: Scalar> Candidate<S> {
    /// Whether a point lies in it or on its edges.
    #[inline(always)]
    pub(super) fn covers(&self, point: [S; 2]) -> bool {
        self.edges.iter().all(|&edge| value_at(edge, point) >= S::ZERO)
    }
}

/// Where a line comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// Edge k of a candidate.
    Edge { candidate: u32, k: u8 },
    /// Where a candidate's depth is -1 or 1.
    End { candidate: u32, is_far: bool },
    /// The depth of the second less that of the first.
    Between { first: u32, second: u32 },
}

impl Source {
    /// The same of other names for candidates.
    #[inline(always)]
    pub(super) fn map(self, name: impl Fn(u32) -> u32) -> Self {
        match self {
            Self::Edge { candidate, k } => Self::Edge { candidate: name(candidate), k },
            Self::End { candidate, is_far } => Self::End { candidate: name(candidate), is_far },
            Self::Between { first, second } => {
                Self::Between { first: name(first), second: name(second) }
            }
        }
    }
}

/// A side of what is visible of a candidate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side<S> {
    pub(super) source: Source,
    pub(super) is_inside: bool,
    /// Whether it lies on the pixel's border, which it shares with another pixel.
    pub(super) is_on_border: bool,
    /// The line's normal.
    pub(super) normal: [S; 2],
    pub(super) ends: [[S; 2]; 2],
}

impl<S> Side<S> {
    /// How often it counts, negative where its candidate is on the line's outside.
    #[inline(always)]
    pub(super) fn share(&self) -> f64 {
        let share = if self.is_on_border { 0.5 } else { 1.0 };
        if self.is_inside { share } else { -share }
    }
}

/// A visible part of a candidate.
#[derive(Debug, Clone, Copy)]
struct Part<S> {
    candidate: u32,
    polygon: Polygon,
    area: S,
}

/// All that a pixel holds of a candidate.
#[derive(Debug)]
struct Whole<S> {
    polygon: Option<Polygon>,
    /// The lines that cut it: edges, and ends of the depth range.
    cuts: Range<usize>,
    /// The least and the largest x, y and depth of its corners.
    least: [S; 3],
    most: [S; 3],
    /// More than what its depths are off by.
    error_bound: S,
    /// Its visible parts.
    parts: Range<usize>,
}

impl<S: Scalar> Whole<S> {
    /// Whether all of this face lies beside another face, where there is anything of it.
    #[inline(always)]
    fn is_beside(&self, other: &Self) -> bool {
        self.polygon.is_none()
            || (self.least[0] >= other.most[0]) | (self.most[0] <= other.least[0])
            || (self.least[1] >= other.most[1]) | (self.most[1] <= other.least[1])
    }

    /// Whether all of this face surely lies behind another face.
    #[inline(always)]
    fn is_behind(&self, other: &Self) -> bool {
        self.least[2] > other.most[2] + self.error_bound + other.error_bound
    }
}

/// What is visible in a pixel, and memory.
#[derive(Debug, Default)]
pub(super) struct Visible<S> {
    parts: Vec<Part<S>>,
    /// Of all parts.
    area: S,
    /// How far the pixel reaches: 1, or a little more.
    reach: S,
    /// How often polygons were held against faces.
    cuts: usize,
    polygons: Polygons<S>,
    lines: Vec<Line<S>>,
    /// Per line: where it comes from, and whether it lies on the pixel's border.
    sources: Vec<(Source, bool)>,
    /// Whether some line does.
    pub(super) touches_border: bool,
    whole: Vec<Whole<S>>,
    /// What is left of a candidate, before and after another face was taken away.
    left: Vec<Polygon>,
    next: Vec<Polygon>,
}

/// A pixel is crowded if its polygons have more corners than this on the way, or would be held against
/// faces more often.
const MOST_CORNERS: usize = 1 << 18;
const MOST_CUTS: usize = 1 << 22;

/// Pieces below this share of a pixel do not count.
pub(super) const SMALLEST: f64 = 1e-14;

impl<S: Scalar> Visible<S> {
    /// Forgets all candidates, for a pixel that reaches as far as `reach` from its centre.
    pub(super) fn clear(&mut self, reach: S) {
        self.parts.clear();
        self.lines.clear();
        self.sources.clear();
        self.whole.clear();
        self.polygons.clear();
        (self.area, self.cuts, self.reach, self.touches_border) = (S::ZERO, 0, reach, false);
    }

    /// Adds the candidates that are new in `candidates`: finds their visible parts behind the candidates
    /// added earlier, which surely lie before them. Returns whether it did so within [`MOST_CORNERS`]
    /// and [`MOST_CUTS`].
    #[inline(always)]
    pub(super) fn add(&mut self, candidates: &[Candidate<S>]) -> bool {
        let new = self.whole.len()..candidates.len();
        let pixel = self.polygons.pixel(self.reach);
        for at in new.clone() {
            self.cut_to_pixel(pixel, at as u32, &candidates[at]);
        }
        new.clone().all(|at| self.find_parts(candidates, at, new.start))
    }

    /// Whether nothing can be seen behind the candidates so far.
    pub(super) fn fills_pixel(&self) -> bool {
        self.area >= S::from_f64(4.0 * (1.0 - SMALLEST)) * self.reach * self.reach
    }

    /// Cuts a candidate to the pixel and to the depth range.
    #[inline(always)]
    fn cut_to_pixel(&mut self, pixel: Polygon, at: u32, candidate: &Candidate<S>) {
        let Self { polygons, lines, sources, touches_border, whole, .. } = self;
        let half = self.reach;
        // What has no depth, since that leaves the range of the numbers, is not in the depth range.
        let reach = size(candidate.depth);
        let mut polygon = (reach < S::from_f64(f64::INFINITY)).then_some(pixel);
        let first = lines.len();
        *touches_border |= candidate.on_border != 0;
        let mut cut = |line: Line<S>, source: Source, is_on_border: bool| {
            // Most lines do not come near the pixel.
            let [one, x, y] = line;
            let Some(before) = polygon.filter(|_| one < half * (x.abs() + y.abs())) else { return };
            polygon = polygons.inside(before, line, lines.len() as u32);
            if polygon != Some(before) {
                lines.push(line);
                sources.push((source, is_on_border));
            }
        };
        for (k, &edge) in (0..).zip(&candidate.edges) {
            let is_on_border = candidate.on_border >> k & 1 == 1;
            cut(edge, Source::Edge { candidate: at, k }, is_on_border);
        }
        let [one, x, y] = candidate.depth;
        // A plane may reach the end of the range at the pixel's border.
        if half * reach > S::from_f64(1.0 - FAR) {
            for (line, is_far) in [([one + S::ONE, x, y], false), ([S::ONE - one, -x, -y], true)] {
                let is_on_border = lies_on_border(line, [S::ZERO; 2], candidate.depth_error_bound);
                *touches_border |= is_on_border;
                cut(line, Source::End { candidate: at, is_far }, is_on_border);
            }
        }
        let infinity = S::from_f64(f64::INFINITY);
        let (mut least, mut most) = ([infinity; 3], [-infinity; 3]);
        for point in polygon.iter().flat_map(|&polygon| polygons.points(polygon)) {
            let place = [point[0], point[1], value_at(candidate.depth, point)];
            least = std::array::from_fn(|k| least[k].minimum_or_nan(place[k]));
            most = std::array::from_fn(|k| most[k].maximum_or_nan(place[k]));
        }
        let error_bound = candidate.depth_error_bound;
        let cuts = first..lines.len();
        whole.push(Whole { polygon, cuts, least, most, error_bound, parts: 0..0 });
    }

    /// Takes from candidate `at` what lies behind others; those before `group` surely lie before
    /// it; returns whether it did so within the limits.
    #[inline(always)]
    fn find_parts(&mut self, candidates: &[Candidate<S>], at: usize, group: usize) -> bool {
        let Self { parts, area, cuts, polygons, lines, sources, whole, left, next, .. } = self;
        let Self { touches_border, .. } = self;
        left.clear();
        left.extend(whole[at].polygon);
        for (other, rival) in candidates.iter().enumerate() {
            let is_before = other < group;
            let [this, that] = [&whole[at], &whole[other]];
            let hides_nothing = that.is_beside(this) || !is_before && that.is_behind(this);
            if other == at || left.is_empty() || hides_nothing {
                continue;
            }
            *cuts += left.len();
            if *cuts > MOST_CUTS || polygons.len() > MOST_CORNERS {
                return false;
            }
            let own = &candidates[at];
            let behind = if is_before { [-S::ONE, S::ZERO, S::ZERO] } else { behind(own, rival) };
            let mut between = None;
            next.clear();
            for &polygon in &*left {
                if !polygons.has_outside(polygon, behind) {
                    // All of it is in front of the rival's plane.
                    next.push(polygon);
                    continue;
                }
                // What is left of it once all that is neither before nor behind the rival is gone.
                let mut overlap = Some(polygon);
                for index in whole[other].cuts.clone() {
                    let Some(polygon) = overlap else { break };
                    let [inside, outside] = polygons.split(polygon, lines[index], index as u32);
                    overlap = inside;
                    next.extend(outside);
                }
                let Some(overlap) = overlap else { continue };
                let index = match between {
                    Some(index) => index,
                    None => {
                        let source = Source::Between { first: at as u32, second: other as u32 };
                        let error_bound = own.depth_error_bound + rival.depth_error_bound;
                        let is_on_border = lies_on_border(behind, [S::ZERO; 2], error_bound);
                        *touches_border |= is_on_border;
                        lines.push(behind);
                        sources.push((source, is_on_border));
                        lines.len() as u32 - 1
                    }
                };
                between = Some(index);
                next.extend(polygons.inside(overlap, behind, index));
            }
            std::mem::swap(left, next);
        }
        let (candidate, first) = (at as u32, parts.len());
        for &polygon in &*left {
            let own = polygons.area(polygon);
            *area += own;
            parts.push(Part { candidate, polygon, area: own });
        }
        whole[at].parts = first..parts.len();
        true
    }

    /// Calls `visit` with each candidate and the sides of its visible parts: lines, not the pixel's
    /// border.
    #[inline(always)]
    pub(super) fn for_each_side(&self, mut visit: impl FnMut(u32, Side<S>)) {
        for part in &self.parts {
            for (bound, ends) in self.polygons.segments(part.polygon) {
                if bound.line == BORDER {
                    continue;
                }
                let at = bound.line as usize;
                let [_, x, y] = self.lines[at];
                let ((source, is_on_border), is_inside) = (self.sources[at], bound.is_inside);
                let side = Side { source, is_inside, is_on_border, normal: [x, y], ends };
                visit(part.candidate, side);
            }
        }
    }

    /// Adds the sides that lie on the pixel's border, clipped to it, with their candidates.
    #[cold]
    pub(super) fn add_border_sides(&self, sides: &mut Vec<(u32, Side<S>)>) {
        self.for_each_side(|candidate, side| {
            if side.is_on_border {
                let ends = clipped(side.ends, side.normal);
                sides.extend(ends.map(|ends| (candidate, Side { ends, ..side })));
            }
        });
    }

    /// Adds the areas of what is visible of each candidate.
    #[inline(always)]
    pub(super) fn add_areas(&self, areas: &mut [S]) {
        for part in &self.parts {
            areas[part.candidate as usize] += part.area;
        }
    }

    /// The extent of what is visible of candidate `at`, of the area `area`, under the density 1 / t;
    /// where it `spreads`, all of it.
    #[inline(always)]
    pub(super) fn extent(
        &self,
        at: usize,
        area: S,
        t: Line<S>,
        spreads: bool,
    ) -> Option<Extent<S>> {
        let spread = self.spread(at, Spread::new(t), spreads);
        if spread.reaches_far {
            return self.spread(at, Spread::raised(t), spreads).extent(area);
        }
        spread.extent(area)
    }

    #[inline(always)]
    fn spread(&self, at: usize, mut spread: Spread<S>, spreads: bool) -> Spread<S> {
        for part in &self.parts[self.whole[at].parts.clone()] {
            let (corner, fan) = self.polygons.fan(part.polygon);
            if spreads {
                spread.add_fan::<true>(corner, fan, part.area);
            } else {
                spread.add_fan::<false>(corner, fan, part.area);
            }
        }
        spread
    }
}

/// How far `rival` lies behind `own`. Of depths that are equal, for all that is known of them, the
/// first face is in front: the order of two faces in one plane is no accident of rounding.
#[inline(always)]
fn behind<S: Scalar>(own: &Candidate<S>, rival: &Candidate<S>) -> Line<S> {
    let behind = [0, 1, 2].map(|c| rival.depth[c] - own.depth[c]);
    if size(behind) > own.depth_error_bound + rival.depth_error_bound {
        return behind;
    }
    [if own.band_face < rival.band_face { S::ONE } else { -S::ONE }, S::ZERO, S::ZERO]
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    const ERROR_BOUND: f64 = 64.0 * f64::EPSILON;

    /// A face through three points `(x, y, depth)`.
    pub(in super::super) fn candidate(
        face: u32,
        [p, q, r]: [[f64; 3]; 3],
    ) -> Option<Candidate<f64>> {
        let edge = |p: [f64; 3], q: [f64; 3]| [p[0] * q[1] - p[1] * q[0], p[1] - q[1], q[0] - p[0]];
        let edges = [edge(q, r), edge(r, p), edge(p, q)];
        let area: f64 = edges.iter().map(|edge| edge[0]).sum();
        if area.abs() < 1e-3 {
            return None;
        }
        let depth =
            [0, 1, 2].map(|c| (0..3).map(|k| [p, q, r][k][2] * edges[k][c] / area).sum::<f64>());
        let sign = area.signum();
        let edges = edges.map(|edge| edge.map(|c| sign * c));
        let depth_error_bound = ERROR_BOUND * size(depth);
        Some(Candidate {
            band_face: face,
            edges,
            depth,
            depth_error_bound,
            outline: 7,
            on_border: 0,
        })
    }

    fn background(face: u32) -> Candidate<f64> {
        let (edges, depth) = ([[1.0, 0.0, 0.0]; 3], [1.0, 0.0, 0.0]);
        Candidate {
            band_face: face,
            edges,
            depth,
            depth_error_bound: ERROR_BOUND,
            outline: 0,
            on_border: 0,
        }
    }

    fn at(line: [f64; 3], x: f64, y: f64) -> f64 {
        line[0] + line[1] * x + line[2] * y
    }

    pub(in super::super) fn triangle() -> impl Strategy<Value = [[f64; 3]; 3]> {
        proptest::array::uniform3(proptest::array::uniform3(-2.0..2.0))
    }

    #[test]
    fn of_depths_that_differ_by_rounding_the_first_face_is_in_front_and_alone() {
        for steps in [-8, -1, 0, 1, 8] {
            let depth = -0.15 * (1.0 + f64::from(steps) * f64::EPSILON);
            let face = |face, depth| Candidate { depth: [depth, 0.0, 0.0], ..background(face) };
            let all = [face(0, -0.15), face(1, depth)];
            let mut visible = Visible::default();
            visible.clear(1.0);
            assert!(visible.add(&all));
            let mut areas = [0.0; 2];
            visible.add_areas(&mut areas);
            assert_eq!(areas, [4.0, 0.0], "{steps}");
        }
    }

    proptest! {
        #[test]
        fn visible_parts_are_a_partition_and_what_samples_see(
            triangles in proptest::collection::vec(triangle(), 0..6),
        ) {
            let mut all: Vec<_> = triangles
                .into_iter()
                .zip(0..)
                .filter_map(|(points, face)| candidate(face, points))
                .collect();
            all.push(background(9));
            let mut visible = Visible::default();
            visible.clear(1.0);
            assert!(visible.add(&all));
            let mut areas = vec![0.0; all.len()];
            visible.add_areas(&mut areas);
            let total: f64 = areas.iter().sum();
            prop_assert!((total - 4.0).abs() < 1e-12, "{total}");
            const N: usize = 100;
            let mut sampled = vec![0.0; all.len()];
            for k in 0..N * N {
                let [x, y] = [k % N, k / N].map(|k| (2 * k + 1) as f64 / N as f64 - 1.0);
                let depth = |one: &&Candidate<f64>| at(one.depth, x, y);
                let covers = |one: &&Candidate<f64>| {
                    one.edges.iter().all(|&e| at(e, x, y) > 0.0) && depth(one).abs() <= 1.0
                };
                let seen = all.iter().filter(covers);
                let seen = seen.min_by(|a, b| depth(a).total_cmp(&depth(b))).unwrap();
                let seen = all.iter().position(|one| one.band_face == seen.band_face).unwrap();
                sampled[seen] += 4.0 / (N * N) as f64;
            }
            for (exact, sampled) in areas.iter().zip(sampled) {
                prop_assert!((exact - sampled).abs() < 0.06, "{exact} {sampled}");
            }
        }

        #[test]
        fn what_lies_behind_others_may_come_later(
            front in proptest::collection::vec(triangle(), 0..4),
            back in proptest::collection::vec(triangle(), 0..4),
            is_full: bool,
        ) {
            let scaled = |triangles: Vec<[[f64; 3]; 3]>, first: u32, middle: f64| {
                let place = move |[x, y, depth]: [f64; 3]| [x, y, middle + 0.2 * depth];
                let faces = triangles.into_iter().map(move |points| points.map(place));
                (first..).zip(faces).filter_map(|(face, points)| candidate(face, points))
            };
            // The lower indices behind, which may not count.
            let mut all: Vec<_> = scaled(front, 10, -0.5).collect();
            all.extend(is_full.then(|| Candidate { depth: [-0.05, 0.0, 0.0], ..background(20) }));
            let group = all.len();
            all.extend(scaled(back, 0, 0.5));
            let areas = |groups: &[usize]| {
                let mut visible = Visible::default();
                for &group in groups {
                    assert!(visible.add(&all[..group]));
                }
                let mut areas = vec![0.0; all.len()];
                visible.add_areas(&mut areas);
                (areas, visible.fills_pixel())
            };
            let ((once, _), (twice, _)) = (areas(&[all.len()]), areas(&[group, all.len()]));
            for (once, twice) in once.iter().zip(&twice) {
                prop_assert!((once - twice).abs() < 1e-13, "{once} {twice}");
            }
            let (_, fills) = areas(&[group]);
            prop_assert!(fills || !is_full);
            prop_assert!(!fills || twice[group..].iter().all(|&area| area < 1e-13));
        }
    }
}
