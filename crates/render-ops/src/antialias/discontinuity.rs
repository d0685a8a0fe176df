//! Whether an edge crosses between two neighbouring pixel centres, and at which point.
//!
//! Coordinates are local to the pair, in pixels, homogeneous with w. The origin is the centre of the
//! *owner*, the pixel that the edge's face covers. x runs along the pair from the first pixel to the
//! second, y across. For vertices `(x_1, y_1, w_1)` and `(x_2, y_2, w_2)` the edge meets the line y =
//! 0 at `x = n / m`, `n = x_1 y_2 - y_1 x_2`, `m = w_1 y_2 - y_1 w_2`. Nothing is divided by a w, so
//! an end behind the eye needs no clipping.

use bokashi_core::Scalar;

use super::pairs::{Line, Pair, SLACK};
use crate::homogeneous::Vertex;
use crate::size::Size;

/// One blend of neighbouring pixels across a silhouette.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend<S> {
    /// The pixel on the left or above.
    pub(super) pixel: u32,
    /// Whether the other pixel lies below, not on the right.
    pub(super) below: bool,
    /// Whether the face covers the first pixel, not the second.
    pub(super) covers_first: bool,
    /// The vertices of the edge.
    pub(super) edge: [u32; 2],
    /// The share, in [-1/2, 1/2]: of the second pixel mixed into the first where positive, of the
    /// first into the second where negative.
    pub(super) alpha: S,
    /// Whether the crossing was clamped, so that the share does not move with it.
    pub(super) clamped: bool,
}

impl<S: Scalar> Blend<S> {
    /// Which of the two pixels is blended.
    #[inline(always)]
    pub(super) fn target(&self) -> usize {
        usize::from(self.alpha <= S::ZERO)
    }

    /// Both pixels.
    pub(super) fn pixels(&self, size: Size) -> [u32; 2] {
        let step = if self.below { size.width as u32 } else { 1 };
        [self.pixel, self.pixel + step]
    }
}

/// A vertex in the coordinates of a pair.
#[derive(Debug, Clone, Copy)]
struct Local<S> {
    x: S,
    y: S,
    w: S,
}

/// The local coordinates of a pair of pixels.
#[derive(Debug, Clone, Copy)]
struct Frame<S> {
    below: bool,
    center: [S; 2],
}

impl<S: Scalar<Wide = S>> Frame<S> {
    /// Around a pixel of a row and a column, which the face covers.
    #[inline(always)]
    fn new([row, column]: [u32; 2], below: bool, size: Size) -> Self {
        Self { below, center: [size.center_x(column as usize), size.center_y(row as usize)] }
    }

    /// Scaled coordinates count 2 units a pixel and y upwards.
    #[inline(always)]
    fn local(&self, vertex: Vertex<S>) -> Local<S> {
        let half = S::from_f64(0.5);
        let [x, y] = vertex.relative_to(self.center[0], self.center[1]);
        let (right, down) = (half * x, -half * y);
        if self.below {
            Local { x: down, y: right, w: vertex.w }
        } else {
            Local { x: right, y: down, w: vertex.w }
        }
    }

    /// The gradient with respect to clip (x, y, w) from that with respect to local (x, y, w).
    #[inline(always)]
    fn pull_back(&self, local_bar: [S; 3], size: Size) -> [S; 3] {
        let half = S::from_f64(0.5);
        let [along, across, w_bar] = local_bar;
        let (right, down) = if self.below { (across, along) } else { (along, across) };
        let (x_bar, y_bar) = (half * right, -half * down);
        [
            x_bar * S::from_f64(size.width as f64),
            y_bar * S::from_f64(size.height as f64),
            w_bar - self.center[0] * x_bar - self.center[1] * y_bar,
        ]
    }
}

/// Where the line through two vertices meets y = 0.
struct Crossing<S> {
    x: S,
    m: S,
}

#[inline(always)]
fn crossing<S: Scalar>(p: Local<S>, q: Local<S>) -> Crossing<S> {
    let m = p.w * q.y - p.y * q.w;
    Crossing { x: (p.x * q.y - p.y * q.x) / m, m }
}

/// A face with a silhouette.
#[derive(Debug, Clone, Copy)]
pub(super) struct SilhouetteFace<S> {
    pub(super) vertices: [Vertex<S>; 3],
    /// Of the vertices.
    indices: [u32; 3],
    /// Its silhouettes, a bit for the corner that each edge faces.
    silhouettes: u8,
}

impl<S: Scalar<Wide = S>> SilhouetteFace<S> {
    /// Of the face of vertices `indices` of `clip: [V, 4]`.
    #[inline(always)]
    pub(super) fn new<T: Scalar<Wide = S>>(
        clip: &[T],
        indices: [u32; 3],
        silhouettes: u8,
        size: Size,
    ) -> Self {
        Self { vertices: Self::corners(clip, indices, size), indices, silhouettes }
    }

    /// The vertices `indices` of `clip: [V, 4]`.
    #[inline(always)]
    pub(super) fn corners<T: Scalar<Wide = S>>(
        clip: &[T],
        [a, b, c]: [u32; 3],
        size: Size,
    ) -> [Vertex<S>; 3] {
        // Not by `map`, which would copy them one by one.
        let vertex = |index| Vertex::from_clip(clip, index, size).0;
        [vertex(a), vertex(b), vertex(c)]
    }

    /// Calls `visit` with each silhouette's corner and line, for pairs of either kind that it can blend.
    #[inline(always)]
    pub(super) fn for_each_line(&self, size: Size, mut visit: impl FnMut(usize, &Line)) {
        let mut rest = self.silhouettes;
        while rest != 0 {
            let corner = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let [p, q] = [self.vertices[(corner + 1) % 3], self.vertices[(corner + 2) % 3]];
            // Not by `for_each`, which would leave what is visited out of line: 3 million of 165.
            for line in Line::new(p, q, size).iter().flatten() {
                visit(corner, line);
            }
        }
    }

    /// The blend at a pair by the edge that faces a corner; `None` where it does not pass between the
    /// centres, or where another edge is the one that lies farthest towards the other pixel.
    #[inline(always)]
    pub(super) fn blend(&self, corner: usize, pair: &Pair, size: Size) -> Option<Blend<S>> {
        let frame = Frame::<S>::new(pair.covered_pixel(), pair.below, size);
        // The line through the centres meets edges with an end on either side of it: this one, and one of
        // the two at the third vertex.
        let (j, k) = ((corner + 1) % 3, (corner + 2) % 3);
        let (p, q) = (frame.local(self.vertices[j]), frame.local(self.vertices[k]));
        let sides = [p, q].map(|end| end.y < S::ZERO);
        if sides[0] == sides[1] {
            return None;
        }
        let sign = if pair.covers_first { S::ONE } else { -S::ONE };
        let Crossing { x, m } = visible_crossing(p, q)?;
        // Edges closer to the direction of the pair belong to pairs in the other direction.
        if m.abs() < (p.w * q.x - p.x * q.w).abs() {
            return None;
        }
        let distance = sign * x;
        let slack = S::from_f64(SLACK);
        if !(distance >= -slack && distance <= S::ONE + slack) {
            return None;
        }
        let third = frame.local(self.vertices[corner]);
        let (other, met) = if (third.y < S::ZERO) == sides[0] {
            (j, visible_crossing(q, third))
        } else {
            (k, visible_crossing(third, p))
        };
        // Of edges that are crossed at the same distance it is the first.
        let is_behind = met.is_some_and(|Crossing { x, .. }| {
            let other_distance = sign * x;
            let (is_ahead, is_behind) = (distance > other_distance, other_distance > distance);
            if other < corner { !is_ahead } else { is_behind }
        });
        if is_behind {
            return None;
        }
        let inside = distance.maximum_or_nan(S::ZERO).minimum_or_nan(S::ONE);
        Some(Blend {
            pixel: pair.row * size.width as u32 + pair.column,
            below: pair.below,
            covers_first: pair.covers_first,
            edge: [self.indices[j], self.indices[k]],
            alpha: sign * (S::from_f64(0.5) - inside),
            clamped: inside != distance,
        })
    }
}

/// Where the visible part of an edge with an end on either side of y = 0 crosses it. Its point there
/// has the sign of `m / (q.y - p.y)` as its w.
#[inline(always)]
fn visible_crossing<S: Scalar>(p: Local<S>, q: Local<S>) -> Option<Crossing<S>> {
    let crossing = crossing(p, q);
    let is_visible = (crossing.m > S::ZERO) == (q.y > p.y) && crossing.m != S::ZERO;
    is_visible.then_some(crossing)
}

impl<S: Scalar<Wide = S>> Blend<S> {
    /// The gradients with respect to clip (x, y, w) of the edge's two vertices, from the gradient
    /// `alpha_bar`.
    ///
    /// `dalpha/dx = -1` whichever pixel owns the edge, and from `x = n / m`:
    /// `dx/dx_1 = y_2 / m`, `dx/dx_2 = -y_1 / m`, `dx/dy_1 = (x w_2 - x_2) / m`,
    /// `dx/dy_2 = (x_1 - x w_1) / m`, `dx/dw_1 = -x y_2 / m`, `dx/dw_2 = x y_1 / m`.
    #[inline(always)]
    pub(super) fn pull_back<T: Scalar<Wide = S>>(
        &self,
        alpha_bar: S,
        clip: &[T],
        size: Size,
    ) -> [[S; 3]; 2] {
        let [row, column] = size.row_and_column(self.pixel as usize).map(|index| index as u32);
        let pair = Pair { row, column, below: self.below, covers_first: self.covers_first };
        let frame = Frame::new(pair.covered_pixel(), self.below, size);
        // Nothing by `map`, which would be calls.
        let vertex = |index| Vertex::from_clip(clip, index, size);
        let [(p, p_factor), (q, q_factor)] = [vertex(self.edge[0]), vertex(self.edge[1])];
        let [p, q] = [frame.local(p), frame.local(q)];
        let Crossing { x, m } = crossing(p, q);
        let scale = -alpha_bar / m;
        let p_bar = [scale * q.y, scale * (x * q.w - q.x), scale * (-x * q.y)];
        let q_bar = [scale * -p.y, scale * (p.x - x * p.w), scale * (x * p.y)];
        // The factors come last: with them a gradient may be beyond the range of the numbers.
        let in_clip_space = |bar, factor: S| {
            let [x_bar, y_bar, w_bar] = frame.pull_back(bar, size);
            [factor * x_bar, factor * y_bar, factor * w_bar]
        };
        [in_clip_space(p_bar, p_factor), in_clip_space(q_bar, q_factor)]
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use proptest::prelude::*;

    use super::*;

    /// Coordinates around the image, some of them on pixel centres, some behind the eye, some near the ends
    /// of the range of the numbers.
    fn vertex() -> impl Strategy<Value = [f64; 4]> {
        let near = prop_oneof![-1.5..1.5, (-8_i32..8).prop_map(|k| f64::from(k) / 8.0)];
        let w = prop_oneof![4 => Just(1.0), 4 => 0.1..3.0, 2 => -1.0..-0.1, 1 => Just(1e-9)];
        let scale =
            prop_oneof![6 => Just(1.0), 1 => Just(1e200), 1 => Just(1e-200), 1 => Just(1e59)];
        (near.clone(), near, w, scale)
            .prop_map(|(x, y, w, scale)| [x * w, y * w, 0.0, w].map(|number| scale * number))
    }

    /// The pairs of which one pixel lies in a run, and the other one outside of it.
    fn pairs_of(row: u32, columns: Range<u32>, size: Size) -> Vec<Pair> {
        let (width, height) = (size.width as u32, size.height as u32);
        let mut pairs = Vec::new();
        for column in columns.clone() {
            let pair = |row, column, below, covers_first| Pair { row, column, below, covers_first };
            if row > 0 {
                pairs.push(pair(row - 1, column, true, false));
            }
            if row + 1 < height {
                pairs.push(pair(row, column, true, true));
            }
            if column == columns.start && column > 0 {
                pairs.push(pair(row, column - 1, false, false));
            }
            if column + 1 == columns.end && columns.end < width {
                pairs.push(pair(row, column, false, true));
            }
        }
        pairs
    }

    /// The corner that the blending edge faces, and the share, by what the operation says of all edges.
    fn expected(face: &SilhouetteFace<f64>, pair: &Pair, size: Size) -> Option<(usize, f64)> {
        let frame = Frame::new(pair.covered_pixel(), pair.below, size);
        let corners = face.vertices.map(|vertex| frame.local(vertex));
        let sign = if pair.covers_first { 1.0 } else { -1.0 };
        let mut farthest: Option<(usize, f64, f64)> = None;
        for corner in 0..3 {
            let (p, q) = (corners[(corner + 1) % 3], corners[(corner + 2) % 3]);
            if (p.y < 0.0) != (q.y < 0.0)
                && let Some(Crossing { x, m }) = visible_crossing(p, q)
                && farthest.is_none_or(|(_, distance, _)| sign * x > distance)
            {
                farthest = Some((corner, sign * x, m));
            }
        }
        let (corner, distance, m) = farthest?;
        let (p, q) = (corners[(corner + 1) % 3], corners[(corner + 2) % 3]);
        let is_silhouette = face.silhouettes >> corner & 1 == 1;
        let runs_across = m.abs() >= (p.w * q.x - p.x * q.w).abs();
        let is_between = (-SLACK..=1.0 + SLACK).contains(&distance);
        let alpha = sign * (0.5 - distance.clamp(0.0, 1.0));
        (is_silhouette && runs_across && is_between).then_some((corner, alpha))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4096))]

        #[test]
        fn a_pair_is_visited_once_wherever_its_farthest_edge_blends_it_and_no_other_edge_does(
            clip in [vertex(), vertex(), vertex()],
            silhouettes in 1_u8..8,
            (row, start, length) in (0_u32..5, 0_u32..9, 1_u32..9),
            wide: bool,
        ) {
            let size = Size { width: if wide { 90 } else { 9 }, height: 5 };
            let (start, length) = if wide { (10 * start, 10 * length) } else { (start, length) };
            let columns = start..(start + length).min(size.width as u32);
            let face = SilhouetteFace::new(clip.as_flattened(), [0, 1, 2], silhouettes, size);
            let mut visited = Vec::new();
            face.for_each_line(size, |corner, line| {
                line.for_each_pair(row, columns.clone(), size, |pair| visited.push((corner, pair)));
            });
            let pairs = pairs_of(row, columns, size);
            for pair in &pairs {
                let expected = expected(&face, pair, size);
                for corner in 0..3 {
                    let count = visited.iter().filter(|&visited| *visited == (corner, *pair)).count();
                    let blend = (silhouettes >> corner & 1 == 1)
                        .then(|| face.blend(corner, pair, size))
                        .flatten();
                    let expected = expected.filter(|expected| expected.0 == corner);
                    prop_assert_eq!(blend.map(|blend| (corner, blend.alpha)), expected);
                    prop_assert!(count <= 1 && (count == 1 || blend.is_none()), "{:?}", pair);
                }
            }
            prop_assert!(visited.iter().all(|(_, pair)| pairs.contains(pair)));
        }
    }

    #[test]
    fn only_the_pairs_that_a_silhouette_passes_between_are_visited() {
        let size = Size { width: 9, height: 5 };
        // Upright, between columns 4 and 5; and level, between rows 2 and 3.
        for (clip, is_upright) in [
            ([[0.1, -2.0, 0.0, 1.0], [0.1, 2.0, 0.0, 1.0], [-3.0, 0.0, 0.0, 1.0]], true),
            ([[-2.0, -0.2, 0.0, 1.0], [2.0, -0.2, 0.0, 1.0], [0.0, 3.0, 0.0, 1.0]], false),
        ] {
            let face = SilhouetteFace::new(clip.as_flattened(), [0, 1, 2], 0b100, size);
            for row in 0..5 {
                for (start, end) in
                    (0..9).flat_map(|end| (0..=end).map(move |start| (start, end + 1)))
                {
                    let mut visited = Vec::new();
                    face.for_each_line(size, |_, line| {
                        line.for_each_pair(row, start..end, size, |pair| visited.push(pair));
                    });
                    let passes = |pair: &Pair| match is_upright {
                        true => !pair.below && pair.column == 4,
                        false => pair.below && pair.row == 2,
                    };
                    let expected: Vec<_> =
                        pairs_of(row, start..end, size).into_iter().filter(passes).collect();
                    assert_eq!(visited, expected, "{row} {start} {end}");
                }
            }
        }
    }
}
