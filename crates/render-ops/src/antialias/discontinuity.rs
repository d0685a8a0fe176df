//! Whether an edge crosses between two neighbouring pixel centres, and at which point.
//!
//! Coordinates are local to the pair, in pixels, homogeneous with w. The origin is the centre of the
//! *owner*, the pixel that the edge's face covers. x runs along the pair from the first pixel to the
//! second, y across. For vertices `(x_1, y_1, w_1)` and `(x_2, y_2, w_2)` the edge meets the line y =
//! 0 at `x = n / m`, `n = x_1 y_2 - y_1 x_2`, `m = w_1 y_2 - y_1 w_2`. Nothing is divided by a w, so
//! an end behind the eye needs no clipping.

use bokashi_core::Scalar;

use super::pairs::{BELOW, BESIDE, Directions, Pair};
use crate::homogeneous::{Vertex, edge, edge_error_bound, extent};
use crate::size::Size;

/// How far beyond the two pixel centres a crossing may lie, in pixels, and still count: rounding
/// moves an edge that passes through a centre to either side of it. Then it is clamped.
const SLACK: f64 = 1.0 / 16.0;

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
    /// `pixel` is the row and the column of the first pixel.
    fn new(pixel: [usize; 2], below: bool, covers_first: bool, size: Size) -> Self {
        let [mut row, mut column] = pixel;
        if !covers_first {
            if below { row += 1 } else { column += 1 }
        }
        Self { below, center: [size.center_x(column), size.center_y(row)] }
    }

    /// Scaled coordinates count 2 units a pixel and y upwards.
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

fn crossing<S: Scalar>(p: Local<S>, q: Local<S>) -> Crossing<S> {
    let m = p.w * q.y - p.y * q.w;
    Crossing { x: (p.x * q.y - p.y * q.x) / m, m }
}

/// Where the visible part of an edge with an end on either side of y = 0 crosses it. Its point there
/// has the sign of `m / (q.y - p.y)` as its w.
fn visible_crossing<S: Scalar>(p: Local<S>, q: Local<S>) -> Option<Crossing<S>> {
    let m = p.w * q.y - p.y * q.w;
    let is_visible = (m > S::ZERO) == (q.y > p.y) && m != S::ZERO;
    is_visible.then(|| crossing(p, q))
}

/// A face with a silhouette.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outline<S> {
    pub(super) vertices: [Vertex<S>; 3],
    /// Of the vertices.
    indices: [u32; 3],
    /// Its silhouettes, a bit for the corner that each edge faces.
    silhouettes: u8,
    /// Those that can blend pixels beside each other, and those that can blend pixels below each other.
    across: [u8; 2],
    /// The edge functions of the silhouettes, as coefficients of 1, X and Y.
    lines: [[S; 3]; 3],
    /// More than the rounding errors of the edge functions.
    error_bound: S,
}

impl<S: Scalar<Wide = S>> Outline<S> {
    /// Of the face of vertices `indices` of `clip: [V, 4]`.
    pub(super) fn new<T: Scalar<Wide = S>>(
        clip: &[T],
        indices: [u32; 3],
        silhouettes: u8,
        size: Size,
    ) -> Self {
        let (vertices, _) = Vertex::from_face(clip, indices, size);
        let (mut lines, mut across) = ([[S::ZERO; 3]; 3], [0; 2]);
        for corner in (0..3).filter(|corner| silhouettes & 1 << corner != 0) {
            let ends = [vertices[(corner + 1) % 3], vertices[(corner + 2) % 3]];
            lines[corner] = edge(ends[0], ends[1]);
            for (across, crosses) in across.iter_mut().zip(crosses(ends, lines[corner], size)) {
                *across |= u8::from(crosses) << corner;
            }
        }
        let [p, q, r] = vertices;
        let error_bound = edge_error_bound(q, r, size)
            + edge_error_bound(r, p, size)
            + edge_error_bound(p, q, size);
        Self { vertices, indices, silhouettes, across, lines, error_bound }
    }

    /// Whether a silhouette can blend pixels beside each other, and pixels below each other.
    pub(super) fn counts(&self) -> Directions {
        let [beside, below] = self.across.map(|silhouettes| u8::from(silhouettes != 0));
        (beside * BESIDE) | (below * BELOW)
    }

    /// Whether all silhouettes surely run along the line through two pixel centres, or pass it beyond
    /// these and the slack: most do. Along the line an edge function changes by its slope s a unit, and so it
    /// is zero by `|a / s|` away from the middle, where it is a.
    #[inline(always)]
    fn misses(&self, pair: &Pair, size: Size) -> bool {
        let (x, y) = (size.center_x::<S>(pair.column), size.center_y::<S>(pair.row));
        // Pixels are two units wide.
        let reach = S::from_f64(1.0 + 2.0 * SLACK);
        let [x, y] = if pair.below { [x, y - S::ONE] } else { [x + S::ONE, y] };
        let across = self.across[usize::from(pair.below)];
        self.lines.iter().enumerate().all(|(corner, &[one, by_x, by_y])| {
            let slope = if pair.below { by_y } else { by_x };
            across & 1 << corner == 0
                || (one + by_x * x + by_y * y).abs() > slope.abs() * reach + self.error_bound
        })
    }
}

/// Whether a line may run more across the direction of pixels beside each other than along it, and
/// whether more across that of pixels below each other: surely not, where its coefficients differ by more
/// than the rounding errors of both and of [`Blend`]'s own.
#[inline(always)]
fn crosses<S: Scalar<Wide = S>>(
    [p, q]: [Vertex<S>; 2],
    [_, by_x, by_y]: [S; 3],
    size: Size,
) -> [bool; 2] {
    let ([px, py], [qx, qy]) = (extent(p, size), extent(q, size));
    let noise = S::from_f64(16.0 * f64::EPSILON) * (p.w.abs() * (qx + qy) + q.w.abs() * (px + py));
    let (by_x, by_y) = (by_x.abs(), by_y.abs());
    [by_x + noise < by_y, by_y + noise < by_x].map(|runs_along| !runs_along)
}

/// The blend at a pair by the edges of a face which covers the first pixel or the second; `None`
/// where none of its silhouettes passes between the centres.
#[inline(always)]
pub(super) fn blend<S: Scalar<Wide = S>>(
    outline: &Outline<S>,
    pair: &Pair,
    covers_first: bool,
    size: Size,
) -> Option<Blend<S>> {
    if outline.misses(pair, size) { None } else { looked_at(outline, pair, covers_first, size) }
}

/// [`blend`] without the shortcut.
#[inline]
fn looked_at<S: Scalar<Wide = S>>(
    outline: &Outline<S>,
    pair: &Pair,
    covers_first: bool,
    size: Size,
) -> Option<Blend<S>> {
    let &Outline { vertices, indices, silhouettes, .. } = outline;
    let &Pair { row, column, below, .. } = pair;
    let frame = Frame::<S>::new([row, column], below, covers_first, size);
    // Not by `map`, which would copy them one by one.
    let corners = [frame.local(vertices[0]), frame.local(vertices[1]), frame.local(vertices[2])];
    // The line through the centres meets edges with an end on either side of it.
    let [a, b, c] = [0, 1, 2].map(|k| corners[k].y < S::ZERO);
    let met = u8::from(b != c) | u8::from(c != a) << 1 | u8::from(a != b) << 2;
    if silhouettes & met == 0 {
        return None;
    }
    let sign = if covers_first { S::ONE } else { -S::ONE };

    // The straddling edge that lies farthest towards the neighbour: there the face ends.
    let mut farthest: Option<(usize, S, S)> = None;
    for corner in (0..3).filter(|corner| met & 1 << corner != 0) {
        let (p, q) = (corners[(corner + 1) % 3], corners[(corner + 2) % 3]);
        if let Some(Crossing { x, m }) = visible_crossing(p, q)
            && farthest.is_none_or(|(_, distance, _)| sign * x > distance)
        {
            farthest = Some((corner, sign * x, m));
        }
    }
    let (corner, distance, m) = farthest?;
    if silhouettes & 1 << corner == 0 {
        return None;
    }
    let (j, k) = ((corner + 1) % 3, (corner + 2) % 3);
    let (p, q) = (corners[j], corners[k]);

    // Edges closer to the direction of the pair belong to pairs in the other direction.
    if m.abs() < (p.w * q.x - p.x * q.w).abs() {
        return None;
    }
    let slack = S::from_f64(SLACK);
    if !(distance >= -slack && distance <= S::ONE + slack) {
        return None;
    }
    let inside = distance.maximum_or_nan(S::ZERO).minimum_or_nan(S::ONE);
    Some(Blend {
        pixel: pair.pixels(size)[0] as u32,
        below,
        covers_first,
        edge: [indices[j], indices[k]],
        alpha: sign * (S::from_f64(0.5) - inside),
        clamped: inside != distance,
    })
}

impl<S: Scalar<Wide = S>> Blend<S> {
    /// The gradients with respect to clip (x, y, w) of the edge's two vertices, from the gradient
    /// `alpha_bar`.
    ///
    /// `dalpha/dx = -1` whichever pixel owns the edge, and from `x = n / m`:
    /// `dx/dx_1 = y_2 / m`, `dx/dx_2 = -y_1 / m`, `dx/dy_1 = (x w_2 - x_2) / m`,
    /// `dx/dy_2 = (x_1 - x w_1) / m`, `dx/dw_1 = -x y_2 / m`, `dx/dw_2 = x y_1 / m`.
    pub(super) fn pull_back<T: Scalar<Wide = S>>(
        &self,
        alpha_bar: S,
        clip: &[T],
        size: Size,
    ) -> [[S; 3]; 2] {
        let pixel = size.row_and_column(self.pixel as usize);
        let frame = Frame::new(pixel, self.below, self.covers_first, size);
        let [(p, p_factor), (q, q_factor)] =
            self.edge.map(|index| Vertex::from_clip(clip, index, size));
        let [p, q] = [p, q].map(|vertex| frame.local(vertex));
        let Crossing { x, m } = crossing(p, q);
        let scale = -alpha_bar / m;
        let p_bar = [q.y, x * q.w - q.x, -x * q.y].map(|partial| scale * partial);
        let q_bar = [-p.y, p.x - x * p.w, x * p.y].map(|partial| scale * partial);
        // The factors come last: with them a gradient may be beyond the range of the numbers.
        [(p_bar, p_factor), (q_bar, q_factor)]
            .map(|(bar, factor)| frame.pull_back(bar, size).map(|bar| factor * bar))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Coordinates around the image, some of them on pixel centres, some behind the eye.
    fn vertex() -> impl Strategy<Value = [f64; 4]> {
        let near = prop_oneof![-1.5..1.5, (-8_i32..8).prop_map(|k| f64::from(k) / 8.0)];
        let w = prop_oneof![4 => Just(1.0), 4 => 0.1..3.0, 2 => -1.0..-0.1, 1 => Just(1e-9)];
        (near.clone(), near, w).prop_map(|(x, y, w)| [x * w, y * w, 0.0, w])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4096))]

        #[test]
        fn what_misses_a_pair_blends_nothing(
            clip in [vertex(), vertex(), vertex()],
            silhouettes in 1_u8..8,
            (row, column) in (0_usize..4, 0_usize..8),
            below: bool,
            covers_first: bool,
        ) {
            let size = Size { width: 9, height: 5 };
            let outline = Outline::new(clip.as_flattened(), [0, 1, 2], silhouettes, size);
            let pair = Pair { row, column, below, seen: [None; 2] };
            let found = looked_at(&outline, &pair, covers_first, size);
            prop_assert!(found.is_none() || !outline.misses(&pair, size), "{found:?}");
        }
    }

    #[test]
    fn a_silhouette_misses_the_pairs_that_it_does_not_pass_between() {
        let size = Size { width: 9, height: 5 };
        // Upright, between columns 4 and 5.
        let clip = [[0.1, -2.0, 0.0, 1.0], [0.1, 2.0, 0.0, 1.0], [-3.0, 0.0, 0.0, 1.0]];
        let outline = Outline::new(clip.as_flattened(), [0, 1, 2], 0b100, size);
        for row in 0..4 {
            for column in 0..8 {
                let misses = [false, true].map(|below| {
                    outline.misses(&Pair { row, column, below, seen: [None; 2] }, size)
                });
                assert_eq!(misses, [column != 4, true], "{row} {column}");
            }
        }
    }
}
