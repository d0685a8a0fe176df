//! What is visible of each face in one cell, exactly: in a pixel, or in a part of a crowded one.
//!
//! # Forward
//! Each face is cut to the cell. Then it loses what lies behind another face. Outside each edge of
//! the other face a convex part stays; inside all of them the part in front stays. Depth z / w is
//! linear over the image (`setup`), so two faces pass through each other in a line. Where depths are
//! equal, the lower face index wins, as elsewhere. Faces come in depth groups (`depth_intervals`),
//! the nearest first: once the parts fill the cell, nothing behind them is looked at.
//!
//! # Backward
//! From integrals over the parts to the lines that bound them (`polygon`), and from these to the
//! faces. An edge's line is a face's edge function; the line of two faces is the difference of their
//! depths.

use std::ops::Range;

use bokashi_core::Scalar;

use super::cell::Cell;
use super::parts::{Part, Parts, Source};
use super::pixel_border::{FAR, lies_on_border};
use super::polygon::{Bound, Line, Polygon, size, value_at};
use super::side_by_side::{FaceInCell, lie_side_by_side};

/// A face in a pixel: lines are relative to the pixel's centre.
#[derive(Debug, Clone)]
pub(super) struct Candidate<S> {
    /// The position of its face among those of the band.
    pub(super) band_face: u32,
    /// The factors of its face's vertices.
    pub(super) factors: [S; 3],
    /// The edge functions, positive inside.
    pub(super) edges: [Line<S>; 3],
    pub(super) depth: Line<S>,
    /// More than what the depth is off by in the pixel.
    pub(super) depth_error_bound: S,
    /// The same of the depth of the face before its vertices were rounded to what they are.
    pub(super) tie_bound: S,
    /// Bit k: whether edge k lies on the pixel's border.
    pub(super) on_border: u8,
    /// The index of its face in the mesh.
    pub(super) face: u32,
    /// The faces beyond its edges, likewise: `NO_FACE` at those of the surface's outline. It may stand at others.
    pub(super) neighbors: [u32; 3],
}

impl<S: Scalar> Candidate<S> {
    /// Whether a point lies in it or on its edges, and in the depth range.
    pub(super) fn covers(&self, point: [S; 2]) -> bool {
        let is_inside = self.edges.iter().all(|&edge| value_at(edge, point) >= S::ZERO);
        is_inside && value_at(self.depth, point).abs() <= S::ONE
    }
}

/// All that a cell holds of a candidate.
#[derive(Debug)]
struct Whole<S> {
    candidate: u32,
    /// As of its candidate.
    face: u32,
    polygon: Polygon,
    /// The lines that cut it: edges, and ends of the depth range.
    cuts: Range<usize>,
    /// The least and the largest x, y and depth of its corners.
    least: [S; 3],
    most: [S; 3],
    /// As of its candidate.
    tie_bound: S,
}

impl<S: Scalar> Whole<S> {
    /// Whether all of this face lies beside another face.
    #[inline(always)]
    fn is_beside(&self, other: &Self) -> bool {
        (self.least[0] >= other.most[0])
            | (self.most[0] <= other.least[0])
            | (self.least[1] >= other.most[1])
            | (self.most[1] <= other.least[1])
    }

    /// Whether all of this face surely lies behind another face.
    #[inline(always)]
    fn is_behind(&self, other: &Self) -> bool {
        self.least[2] > other.most[2] + self.tie_bound + other.tie_bound
    }
}

/// What is visible in a cell, and memory.
#[derive(Debug, Default)]
pub(super) struct Visible<S> {
    /// What was found in this cell, or in the end in all cells of a pixel.
    pub(super) parts: Parts<S>,
    /// What was found in earlier cells.
    kept: Parts<S>,
    cell: Cell<S>,
    /// Of the parts in this cell.
    area: S,
    /// How often polygons were held against faces in this cell, and how often they may be.
    cuts: usize,
    most_cuts: usize,
    whole: Vec<Whole<S>>,
    /// What is left of a candidate, before and after another face was taken away.
    left: Vec<Polygon>,
    next: Vec<Polygon>,
}

/// So many faces are soon found to lie beside another face: that takes as long as to hold a polygon
/// against a face.
const BOXES_PER_CUT: usize = 16;

/// A cell is crowded if its polygons have more corners than this on the way.
const MOST_CORNERS: usize = 1 << 18;

/// Pieces below this share of a pixel do not count.
pub(super) const SMALLEST: f64 = 1e-14;

impl<S: Scalar> Visible<S> {
    /// Begins with a cell, in which polygons may be held against faces `most_cuts` times. Forgets what
    /// was found in the cell before, unless that was kept.
    pub(super) fn begin(&mut self, cell: Cell<S>, most_cuts: usize) {
        self.parts.clear();
        self.whole.clear();
        (self.cell, self.area, self.cuts, self.most_cuts) = (cell, S::ZERO, 0, most_cuts);
    }

    /// How often polygons were held against faces in this cell.
    pub(super) fn cuts(&self) -> usize {
        self.cuts
    }

    /// Keeps what is visible in this cell; returns how many parts that are.
    pub(super) fn keep(&mut self) -> usize {
        self.kept.append(&self.parts)
    }

    /// Keeps a candidate in a cell of the area `area`, for it is seen at a point of it.
    pub(super) fn keep_sample(&mut self, candidate: u32, point: [S; 2], area: S) {
        self.kept.add_sample(candidate, point, area);
    }

    /// Ends the work on cells: what was kept of all of them has been found in the pixel.
    pub(super) fn join_cells(&mut self) {
        std::mem::swap(&mut self.parts, &mut self.kept);
        self.kept.clear();
        self.parts.sort();
    }

    /// Adds some of the candidates: finds their visible parts behind the candidates added earlier, which
    /// surely lie before them. They `end_at_edges` if they have depths, all within the depth range, and
    /// if at each edge all that meets there is among them. Returns whether it did so within the limits.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        candidates: &[Candidate<S>],
        some: impl Iterator<Item = u32>,
        end_at_edges: bool,
    ) -> bool {
        let first = self.whole.len();
        let cell = self.parts.polygons.rectangle(self.cell.low, self.cell.high);
        // All of the group are cut to the cell first, since each is then compared with each.
        for index in some {
            self.cut_to_cell(cell, index, &candidates[index as usize]);
        }
        let are_side_by_side = end_at_edges && self.are_side_by_side(candidates, first);
        (first..self.whole.len())
            .all(|index| self.find_parts(candidates, index, first, are_side_by_side))
    }

    /// Whether the candidates from `first` on surely lie side by side in this cell.
    #[inline(always)]
    fn are_side_by_side(&self, candidates: &[Candidate<S>], first: usize) -> bool {
        let Parts { polygons, sources, touches_border, .. } = &self.parts;
        if *touches_border {
            return false;
        }
        let faces = self.whole[first..].iter().map(|&Whole { candidate, polygon, .. }| {
            let Candidate { edges, neighbors, .. } = &candidates[candidate as usize];
            FaceInCell { polygon, edges, neighbors: *neighbors }
        });
        let source = |bound: Bound| sources.get(bound.line() as usize).map(|&(source, _)| source);
        lie_side_by_side(faces, polygons, source)
    }

    /// Whether nothing can be seen behind the candidates so far.
    pub(super) fn fills_cell(&self) -> bool {
        self.area >= self.cell.area() - S::from_f64(SMALLEST) * self.cell.half_border()
    }

    /// Cuts a candidate to the cell and to the depth range.
    #[inline(always)]
    fn cut_to_cell(&mut self, whole: Polygon, index: u32, candidate: &Candidate<S>) {
        let Parts { polygons, lines, sources, touches_border, .. } = &mut self.parts;
        // What has no depth, since that leaves the range of the numbers, is not in the depth range.
        let has_depth = size(candidate.depth) < S::from_f64(f64::INFINITY);
        if !has_depth {
            return;
        }
        let mut polygon = Some(whole);
        let first = lines.len();
        *touches_border |= candidate.on_border != 0;
        let center = self.cell.center();
        let Candidate { band_face, face, .. } = *candidate;
        let cell = self.cell;
        // Most lines do not come near the cell.
        let is_near = |line: Line<S>| value_at(line, center) < cell.change(line);
        let mut cut = |line: Line<S>, source: Source, is_on_border: bool| {
            let Some(before) = polygon else { return };
            polygon = polygons.inside(before, line, lines.len() as u32);
            // Only a line that cut something off is kept: its index stands at a side by then.
            if polygon != Some(before) {
                lines.push(line);
                sources.push((source, is_on_border));
            }
        };
        for (k, &edge) in (0..).zip(&candidate.edges) {
            if is_near(edge) {
                let is_on_border = candidate.on_border >> k & 1 == 1;
                cut(edge, Source::Edge { band_face, k }, is_on_border);
            }
        }
        let [one, x, y] = candidate.depth;
        let [least, most] = self.cell.range(candidate.depth);
        // A plane may reach the end of the range at the cell's border.
        let end = S::from_f64(1.0 - FAR);
        if least < -end || most > end {
            for (line, is_far) in [([one + S::ONE, x, y], false), ([S::ONE - one, -x, -y], true)] {
                let is_on_border = lies_on_border(line, [S::ZERO; 2], candidate.depth_error_bound);
                *touches_border |= is_on_border;
                if is_near(line) {
                    cut(line, Source::End { band_face, is_far }, is_on_border);
                }
            }
        }
        let Some(polygon) = polygon else { return };
        let infinity = S::from_f64(f64::INFINITY);
        let (mut least, mut most) = ([infinity; 3], [-infinity; 3]);
        // A plane over a convex polygon has its least and its largest depth at corners.
        for point in polygons.points(polygon) {
            let corner = [point[0], point[1], value_at(candidate.depth, point)];
            // None is NaN.
            least = [0, 1, 2].map(|k| if corner[k] < least[k] { corner[k] } else { least[k] });
            most = [0, 1, 2].map(|k| if corner[k] > most[k] { corner[k] } else { most[k] });
        }
        let (cuts, tie_bound) = (first..lines.len(), candidate.tie_bound);
        self.whole.push(Whole { candidate: index, face, polygon, cuts, least, most, tie_bound });
    }

    /// Takes from the candidate `position` of this cell what lies behind others; those before `group` surely
    /// lie before it; returns whether it did so within the limits.
    ///
    /// In one piece: each rival cuts what the last one left, and every way out of the loop ends the candidate.
    #[inline(always)]
    fn find_parts(
        &mut self,
        candidates: &[Candidate<S>],
        position: usize,
        group: usize,
        are_side_by_side: bool,
    ) -> bool {
        let Self { parts, area, cuts, most_cuts, whole, left, next, .. } = self;
        let Parts { parts, polygons, lines, sources, touches_border } = parts;
        // What is left of the candidate is a list of convex polygons that share no area. Each rival takes its
        // part of them:
        //      +--------------+  The rival's edges, one after another, split off what lies outside: 1, 2, 3.
        //      |  1  / \  2   |  What is inside all of them, `overlap`, is cut where the planes of both faces
        //      |    /   \     |  meet, and the part in front stays. Where that is all of the overlap, the
        //      |   /  o  \    |  polygon stays whole: pieces without need would be cut again and again.
        //      |--/-------\---|
        //      |      3       |
        //      +--------------+
        left.clear();
        left.push(whole[position].polygon);
        let (candidate, mut boxes) = (whole[position].candidate, 0);
        let neighbors = candidates[candidate as usize].neighbors;
        // Side by side no face of the group hides another, but those of earlier groups still may.
        let rivals = if are_side_by_side { group } else { whole.len() };
        for other in 0..rivals {
            boxes += 1;
            let is_before = other < group;
            let [this, that] = [&whole[position], &whole[other]];
            // A neighbour's function of the edge between them is exactly the opposite of this one's.
            // One branch, for no processor foresees which of these holds.
            let [p, q, r] = neighbors;
            let hides_nothing = that.is_beside(this)
                | (!is_before & that.is_behind(this))
                | (p == that.face)
                | (q == that.face)
                | (r == that.face)
                | (other == position);
            if hides_nothing {
                continue;
            }
            let is_hidden = is_before | this.is_behind(that);
            *cuts += left.len();
            if *cuts > *most_cuts || polygons.len() > MOST_CORNERS {
                return false;
            }
            let [one, rival] = [this, that].map(|face| &candidates[face.candidate as usize]);
            // Positive where the rival lies behind.
            let behind = behind(one, rival);
            // The line between both planes is added once for all polygons, and only if it is needed.
            let (mut between, mut on_border) = (None, None);
            next.clear();
            for &polygon in &*left {
                let [has_front, has_back] =
                    if is_hidden { [false, true] } else { polygons.lies(polygon, behind) };
                if !has_back {
                    // All of it is in front of the rival's plane.
                    next.push(polygon);
                    continue;
                }
                // What is left of it once all that is neither before nor behind the rival is gone.
                let (mut overlap, before) = (Some(polygon), next.len());
                for index in that.cuts.clone() {
                    let Some(polygon) = overlap else { break };
                    let (line, index) = (lines[index], index as u32);
                    // Where none of it is in front, the overlap need not be known.
                    let outside = if !has_front && index as usize + 1 == that.cuts.end {
                        let (has_inside, outside) = polygons.outside(polygon, line, index);
                        overlap = has_inside.then_some(polygon);
                        outside
                    } else {
                        let [inside, outside] = polygons.split(polygon, line, index);
                        overlap = inside;
                        outside
                    };
                    next.extend(outside);
                }
                let Some(overlap) = overlap else {
                    // Beside the rival, which leaves it whole.
                    next.truncate(before);
                    next.push(polygon);
                    continue;
                };
                // What is hidden up to the pixel's border may be in front beyond it.
                let is_on_border = *on_border.get_or_insert_with(|| {
                    let error_bound = one.depth_error_bound + rival.depth_error_bound;
                    !is_before && lies_on_border(behind, [S::ZERO; 2], error_bound)
                });
                *touches_border |= is_on_border;
                if !has_front {
                    continue;
                }
                let index = *between.get_or_insert_with(|| {
                    let (first, second) = (one.band_face, rival.band_face);
                    lines.push(behind);
                    sources.push((Source::Between { first, second }, is_on_border));
                    lines.len() as u32 - 1
                });
                let in_front = polygons.inside(overlap, behind, index);
                if in_front == Some(overlap) {
                    // In front of the rival wherever they overlap, which leaves it whole, too.
                    next.truncate(before);
                    next.push(polygon);
                } else {
                    next.extend(in_front);
                }
            }
            std::mem::swap(left, next);
            // All of it is hidden.
            if left.is_empty() {
                break;
            }
        }
        *cuts += boxes / BOXES_PER_CUT;
        for &polygon in &*left {
            let part_area = polygons.area(polygon);
            *area += part_area;
            parts.push(Part { candidate, polygon, area: part_area });
        }
        *cuts <= *most_cuts
    }
}

/// How far `rival` lies behind `one`. Of depths that are equal, for all that is known of them, the
/// first face is in front: the order of two faces in one plane is no accident of rounding.
#[inline(always)]
pub(super) fn behind<S: Scalar>(one: &Candidate<S>, rival: &Candidate<S>) -> Line<S> {
    let behind = [0, 1, 2].map(|c| rival.depth[c] - one.depth[c]);
    if size(behind) > one.tie_bound + rival.tie_bound {
        return behind;
    }
    [if one.band_face < rival.band_face { S::ONE } else { -S::ONE }, S::ZERO, S::ZERO]
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::super::side_by_side::NO_FACE;
    use super::super::side_by_side::tests::{net, shifts};
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
            factors: [1.0; 3],
            edges,
            depth,
            depth_error_bound,
            tie_bound: depth_error_bound,
            on_border: 0,
            face,
            neighbors: [NO_FACE; 3],
        })
    }

    fn background(face: u32) -> Candidate<f64> {
        let (edges, depth) = ([[1.0, 0.0, 0.0]; 3], [1.0, 0.0, 0.0]);
        Candidate {
            band_face: face,
            factors: [1.0; 3],
            edges,
            depth,
            depth_error_bound: ERROR_BOUND,
            tie_bound: ERROR_BOUND,
            on_border: 0,
            face,
            neighbors: [NO_FACE; 3],
        }
    }

    fn at(line: [f64; 3], x: f64, y: f64) -> f64 {
        line[0] + line[1] * x + line[2] * y
    }

    pub(in super::super) fn triangle() -> impl Strategy<Value = [[f64; 3]; 3]> {
        proptest::array::uniform3(proptest::array::uniform3(-2.0..2.0))
    }

    /// The area of what is visible of each candidate.
    fn areas(visible: &Visible<f64>, count: usize) -> Vec<f64> {
        let mut areas = vec![0.0; count];
        for part in &visible.parts.parts {
            areas[part.candidate as usize] += part.area;
        }
        areas
    }

    /// What is known of a net: the faces beyond the edges of each, and that all that meets at an edge is there.
    #[derive(Clone, Copy)]
    struct Known {
        neighbors: bool,
        end_at_edges: bool,
    }

    /// All that can be known, less of it, and nothing.
    const KNOWN: [Known; 3] = [
        Known { neighbors: true, end_at_edges: true },
        Known { neighbors: true, end_at_edges: false },
        Known { neighbors: false, end_at_edges: false },
    ];

    /// What is visible of a net, all of it at the depths `depth`; and the areas of its faces.
    fn net_in_pixel(
        shifts: &[[f64; 2]],
        depth: [f64; 3],
        known: Known,
    ) -> (Visible<f64>, Vec<f64>) {
        // Faces have other indices in the mesh than in the band, and others than as candidates.
        let in_mesh = |at: u32| if at == NO_FACE { NO_FACE } else { 100 + at };
        let candidate = |(at, (edges, neighbors)): (u32, ([Line<f64>; 3], [u32; 3]))| Candidate {
            edges,
            face: in_mesh(at),
            neighbors: if known.neighbors { neighbors.map(in_mesh) } else { [NO_FACE; 3] },
            depth,
            ..background(50 - at)
        };
        let all: Vec<_> = (0..).zip(net(shifts)).map(candidate).collect();
        let mut visible = Visible::default();
        visible.begin(Cell::around_center(1.0), usize::MAX);
        assert!(visible.add(&all, 0..all.len() as u32, known.end_at_edges));
        let areas = areas(&visible, all.len());
        (visible, areas)
    }

    #[test]
    fn what_lies_side_by_side_is_not_held_against_each_other() {
        let shifts = [[0.0; 2]; 12];
        let cuts = KNOWN.map(|known| net_in_pixel(&shifts, [0.0; 3], known).0.cuts());
        assert!(cuts[0] == 0 && 0 < cuts[1] && cuts[1] < cuts[2], "{cuts:?}");
    }

    #[test]
    fn of_depths_that_differ_by_rounding_the_first_face_is_in_front_and_alone() {
        for steps in [-8, -1, 0, 1, 8] {
            let depth = -0.15 * (1.0 + f64::from(steps) * f64::EPSILON);
            let face = |face, depth| Candidate { depth: [depth, 0.0, 0.0], ..background(face) };
            let all = [face(0, -0.15), face(1, depth)];
            let mut visible = Visible::default();
            visible.begin(Cell::around_center(1.0), usize::MAX);
            assert!(visible.add(&all, 0..2, false));
            let areas = areas(&visible, 2);
            assert_eq!(areas, [4.0, 0.0], "{steps}");
        }
    }

    proptest! {
        #[test]
        fn outlines_tell_what_polygons_tell(
            most in 0.0..1.0,
            unit in shifts(1.0),
            depth in proptest::array::uniform3(-0.1..0.1),
        ) {
            let shifts: Vec<_> = unit.iter().map(|shift| shift.map(|by| most * by)).collect();
            let [all, some, none] = KNOWN.map(|known| net_in_pixel(&shifts, depth, known).1);
            for ((all, some), none) in all.iter().zip(&some).zip(&none) {
                let off = (all - none).abs().max((some - none).abs());
                prop_assert!(off < 1e-12, "{all} {some} {none}");
            }
        }

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
            visible.begin(Cell::around_center(1.0), usize::MAX);
            assert!(visible.add(&all, 0..all.len() as u32, false));
            let areas = areas(&visible, all.len());
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
                visible.begin(Cell::around_center(1.0), usize::MAX);
                let mut first = 0;
                for &group in groups {
                    assert!(visible.add(&all, first as u32..group as u32, false));
                    first = group;
                }
                (areas(&visible, all.len()), visible.fills_cell())
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
