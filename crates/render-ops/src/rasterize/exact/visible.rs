//! What is visible of each face in one pixel, exactly.
//!
//! # Forward
//! Each face is cut to the pixel; then from each the part of every other one that lies in front of it is
//! taken away: the pieces outside each of the other's edges stay, of what is left the part that the
//! other is behind. All pieces are convex. Depth z / w is linear over the image (`setup`), so two faces
//! pass through each other in a line. Of equal depths the lower face index wins, as elsewhere.
//!
//! # Backward
//! From the measures of the pieces to the lines that bound them (`polygon`), and from these to the
//! faces: an edge's line is a face's edge function; the line of two faces is the difference of their
//! depths.

use bokashi_core::Scalar;
use smallvec::SmallVec;

use super::polygon::{Line, Measure, Polygon, value_at};

/// A face in a pixel: lines are relative to the pixel's centre.
#[derive(Debug, Clone)]
pub(super) struct Candidate<S> {
    /// The position of its face among those of the band.
    pub(super) drawn: u32,
    /// The edge functions, positive inside.
    pub(super) edges: [Line<S>; 3],
    pub(super) depth: Line<S>,
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

/// A visible piece of a candidate.
#[derive(Debug, Clone)]
pub(super) struct Piece<S> {
    pub(super) candidate: u32,
    pub(super) polygon: Polygon<S>,
}

/// All that a pixel holds of a candidate, and the least and the largest depth of its corners.
#[derive(Debug)]
struct Whole<S> {
    polygon: Polygon<S>,
    /// The lines that cut it, edges and ends of the depth range.
    cuts: SmallVec<[u32; 3]>,
    nearest: S,
    farthest: S,
}

/// What is visible in a pixel, and memory.
#[derive(Debug, Default)]
pub(super) struct Visible<S> {
    pub(super) pieces: Vec<Piece<S>>,
    pub(super) lines: Vec<Line<S>>,
    pub(super) sources: Vec<Source>,
    whole: Vec<Whole<S>>,
    /// What is left of a candidate, before and after another one was taken away.
    left: Vec<Polygon<S>>,
    next: Vec<Polygon<S>>,
}

/// The sum of the coefficients' sizes: no value in the pixel is larger.
#[inline(always)]
fn size<S: Scalar>([one, x, y]: Line<S>) -> S {
    one.abs() + x.abs() + y.abs()
}

/// Depths that differ by no more than this share of their size are equal: the order of two faces in
/// one plane is no accident of rounding.
const EQUAL: f64 = 64.0 * f64::EPSILON;

impl<S: Scalar> Visible<S> {
    /// Finds the visible pieces of `candidates`, which are in the order of their faces.
    pub(super) fn find(&mut self, candidates: &[Candidate<S>]) {
        self.pieces.clear();
        self.lines.clear();
        self.sources.clear();
        self.whole.clear();
        for (at, candidate) in (0..).zip(candidates) {
            self.cut_to_pixel(at, candidate);
        }
        for at in 0..candidates.len() {
            self.find_piece(candidates, at);
        }
    }

    /// Cuts a candidate to the pixel and to the depth range.
    fn cut_to_pixel(&mut self, at: u32, candidate: &Candidate<S>) {
        let mut polygon = Polygon::pixel();
        let mut cuts = SmallVec::new();
        let mut cut = |line: Line<S>, source: Source| {
            if polygon.lies(line)[1] {
                let index = self.lines.len() as u32;
                self.lines.push(line);
                self.sources.push(source);
                cuts.push(index);
                polygon = polygon.inside(line, index);
            }
        };
        for (k, &edge) in (0..).zip(&candidate.edges) {
            cut(edge, Source::Edge { candidate: at, k });
        }
        let [one, x, y] = candidate.depth;
        if size(candidate.depth) > S::ONE {
            cut([one + S::ONE, x, y], Source::End { candidate: at, is_far: false });
            cut([S::ONE - one, -x, -y], Source::End { candidate: at, is_far: true });
        }
        let (mut nearest, mut farthest) = (S::from_f64(f64::INFINITY), -S::from_f64(f64::INFINITY));
        for &point in polygon.points() {
            let depth = value_at(candidate.depth, point);
            (nearest, farthest) = (nearest.lesser(depth), farthest.greater(depth));
        }
        self.whole.push(Whole { polygon, cuts, nearest, farthest });
    }

    /// Takes from candidate `at` what lies behind others.
    fn find_piece(&mut self, candidates: &[Candidate<S>], at: usize) {
        let Self { pieces, lines, sources, whole, left, next } = self;
        left.clear();
        if !whole[at].polygon.is_empty() {
            left.push(whole[at].polygon.clone());
        }
        for (other, rival) in candidates.iter().enumerate() {
            let is_irrelevant = other == at
                || whole[other].polygon.is_empty()
                || whole[other].nearest > whole[at].farthest;
            if is_irrelevant || left.is_empty() {
                continue;
            }
            let own = candidates[at].depth;
            let mut behind = [0, 1, 2].map(|c| rival.depth[c] - own[c]);
            if size(behind) <= S::from_f64(EQUAL) * (size(own) + size(rival.depth)) {
                let sign = if at < other { S::ONE } else { -S::ONE };
                behind = [sign, S::ZERO, S::ZERO];
            }
            let mut between = None;
            next.clear();
            for polygon in left.drain(..) {
                // What is left of it once all that is not in front of or behind the rival is gone.
                let mut hidden = polygon;
                let is_apart = whole[other].cuts.iter().any(|&cut| {
                    let line = lines[cut as usize];
                    let [inside, outside] = hidden.lies(line);
                    if inside && outside {
                        next.push(hidden.outside(line, cut));
                        hidden = hidden.inside(line, cut);
                    }
                    !inside
                });
                if is_apart {
                    next.push(hidden);
                    continue;
                }
                match hidden.lies(behind) {
                    // All of it is in front.
                    [true, false] => next.push(hidden),
                    [false, _] => {}
                    [true, true] => {
                        let index = *between.get_or_insert_with(|| {
                            lines.push(behind);
                            sources
                                .push(Source::Between { first: at as u32, second: other as u32 });
                            lines.len() as u32 - 1
                        });
                        next.push(hidden.inside(behind, index));
                    }
                }
            }
            std::mem::swap(left, next);
        }
        let visible = left.drain(..).filter(|polygon| !polygon.is_empty());
        pieces.extend(visible.map(|polygon| Piece { candidate: at as u32, polygon }));
    }

    /// The measure of what is visible of each candidate, added to `measures`.
    pub(super) fn measure(&self, measures: &mut [Measure<S>]) {
        for piece in &self.pieces {
            let measure = piece.polygon.measure();
            let sum = &mut measures[piece.candidate as usize];
            sum.iter_mut().zip(measure).for_each(|(sum, part)| *sum += part);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A face through three points `(x, y, depth)`.
    fn candidate(face: u32, [p, q, r]: [[f64; 3]; 3]) -> Option<Candidate<f64>> {
        let edge = |p: [f64; 3], q: [f64; 3]| [p[0] * q[1] - p[1] * q[0], p[1] - q[1], q[0] - p[0]];
        let edges = [edge(q, r), edge(r, p), edge(p, q)];
        let area: f64 = edges.iter().map(|edge| edge[0]).sum();
        if area.abs() < 1e-3 {
            return None;
        }
        let depth =
            [0, 1, 2].map(|c| (0..3).map(|k| [p, q, r][k][2] * edges[k][c] / area).sum::<f64>());
        let sign = area.signum();
        Some(Candidate { drawn: face, edges: edges.map(|edge| edge.map(|c| sign * c)), depth })
    }

    fn background(face: u32) -> Candidate<f64> {
        Candidate { drawn: face, edges: [[1.0, 0.0, 0.0]; 3], depth: [1.0, 0.0, 0.0] }
    }

    fn at(line: [f64; 3], x: f64, y: f64) -> f64 {
        line[0] + line[1] * x + line[2] * y
    }

    fn triangle() -> impl Strategy<Value = [[f64; 3]; 3]> {
        proptest::array::uniform3(proptest::array::uniform3(-2.0..2.0))
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
            visible.find(&all);
            let mut measures = vec![[0.0; 3]; all.len()];
            visible.measure(&mut measures);
            let total: f64 = measures.iter().map(|measure| measure[0]).sum();
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
                let seen = all.iter().position(|one| one.drawn == seen.drawn).unwrap();
                sampled[seen] += 4.0 / (N * N) as f64;
            }
            for (exact, sampled) in measures.iter().zip(sampled) {
                prop_assert!((exact[0] - sampled).abs() < 0.06, "{} {sampled}", exact[0]);
            }
        }
    }
}
