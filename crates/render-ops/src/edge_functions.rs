//! The edge functions of a face around one of its pixels, and their adjoint.
//!
//! # Forward
//! The edge function that faces vertex i joins vertices j and k (`homogeneous::edge`). Coordinates are
//! relative to an origin `(X_0, Y_0)`: `q_i = (x_i - X_0 w_i, y_i - Y_0 w_i)`. Near the origin nothing
//! large cancels.
//!
//! # Backward
//! It takes three sums over the fragments: `s_i = sum a_bar_i`, `s_ix = sum X a_bar_i` and
//! `s_iy = sum Y a_bar_i`. Then
//! `x_bar_i = s_k q_jy - s_j q_ky + s_jy w_k - s_ky w_j`,
//! `y_bar_i = s_j q_kx - s_k q_jx + s_kx w_j - s_jx w_k`,
//! `w_bar_i = -X_0 x_bar_i - Y_0 y_bar_i - s_kx q_jy + s_jx q_ky - s_jy q_kx + s_ky q_jx`.

use bokashi_core::Scalar;

use crate::homogeneous::{Vertex, cross, edge};
use crate::order::{largest, least, smaller};
use crate::size::Size;

/// A face around the centre of one of its pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalFace<S> {
    pub(crate) vertices: [Vertex<S>; 3],
    pub(crate) factors: [S; 3],
    origin: [S; 2],
    /// The vertices in coordinates from the origin.
    local: [Vertex<S>; 3],
    /// The edge functions' coefficients of 1, X and Y.
    coefficients: [[S; 3]; 3],
}

/// The sums over fragments of `a_bar_i`, of `X a_bar_i` and of `Y a_bar_i`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct EdgeSums<S> {
    pub(crate) ones: [S; 3],
    pub(crate) xs: [S; 3],
    pub(crate) ys: [S; 3],
}

/// The depth z / w, and the sum `W = sum w_i a_i`, where the edge functions are `a`.
#[inline(always)]
pub(crate) fn depth_and_w<S: Scalar>(vertices: &[Vertex<S>; 3], a: [S; 3]) -> [S; 2] {
    let [p, q, r] = vertices;
    let w = p.w * a[0] + q.w * a[1] + r.w * a[2];
    [(p.z * a[0] + q.z * a[1] + r.z * a[2]) / w, w]
}

/// The depth z / w of a face at the centre of the pixel of a row and a column.
#[inline(always)]
pub(crate) fn depth_at<S: Scalar<Wide = S>>(
    vertices: &[Vertex<S>; 3],
    [row, column]: [u32; 2],
    size: Size,
) -> S {
    let (x, y) = (size.center_x(column as usize), size.center_y(row as usize));
    let q = vertices.map(|vertex| vertex.relative_to(x, y));
    depth_and_w(vertices, [cross(q[1], q[2]), cross(q[2], q[0]), cross(q[0], q[1])])[0]
}

impl<S: Scalar> EdgeSums<S> {
    /// Adds a row's sums of `a_bar_i` and of `X a_bar_i`.
    #[inline(always)]
    pub(crate) fn add_row(&mut self, ones: [S; 3], xs: [S; 3], y: S) {
        for i in 0..3 {
            self.ones[i] += ones[i];
            self.xs[i] += xs[i];
            self.ys[i] += y * ones[i];
        }
    }
}

impl<S: Scalar<Wide = S>> LocalFace<S> {
    /// Around the centre of pixel `pixel`.
    #[inline(always)]
    pub(crate) fn new(vertices: [Vertex<S>; 3], factors: [S; 3], pixel: usize, size: Size) -> Self {
        Self::around(vertices, factors, size.center(pixel))
    }

    /// Around a pixel centre.
    #[inline(always)]
    pub(crate) fn around(vertices: [Vertex<S>; 3], factors: [S; 3], origin: [S; 2]) -> Self {
        let local = vertices.map(|vertex| vertex.around(origin));
        let [p, q, r] = local;
        let coefficients = [edge(q, r), edge(r, p), edge(p, q)];
        Self { vertices, factors, origin, local, coefficients }
    }

    /// Of the vertices `indices` of `clip: [V, 4]`, around the centre of pixel `pixel`.
    pub(crate) fn at_pixel<T: Scalar<Wide = S>>(
        clip: &[T],
        indices: [u32; 3],
        pixel: usize,
        size: Size,
    ) -> Self {
        let (vertices, factors) = Vertex::from_face(clip, indices, size);
        Self::new(vertices, factors, pixel, size)
    }

    /// The edge functions' coefficients of 1, X and Y from the origin.
    #[inline(always)]
    pub(crate) fn coefficients(&self) -> &[[S; 3]; 3] {
        &self.coefficients
    }

    /// `sum w_i a_i`, the same at any point.
    pub(crate) fn determinant(&self) -> S {
        (0..3).map(|i| self.vertices[i].w * self.coefficients[i][0]).sum()
    }

    /// Where the centre of pixel `pixel` lies from the origin.
    #[inline(always)]
    pub(crate) fn center_offset(&self, pixel: usize, size: Size) -> [S; 2] {
        self.offset_of(size.center(pixel))
    }

    /// Where a point lies from the origin.
    #[inline(always)]
    pub(crate) fn offset_of(&self, [x, y]: [S; 2]) -> [S; 2] {
        [x - self.origin[0], y - self.origin[1]]
    }

    /// The edge functions along a row: at X = 0 from the origin, and how they change with X.
    #[inline(always)]
    pub(crate) fn row(&self, y: S) -> [[S; 2]; 3] {
        self.coefficients.map(|[one, x, by_y]| [one + by_y * y, x])
    }

    /// `sum_j (b_i (b_bar_j - m)) E_j` for the weight `b_i`, from its sums of `b_i u_bar`, `b_i
    /// v_bar` and `b_i m`: -D times the gradients with respect to (x, y, w) of vertex i in clip
    /// space.
    #[inline(always)]
    pub(crate) fn pull_back_weights(&self, [u, v, m]: [S; 3], size: Size) -> [S; 3] {
        self.along_edges([u - m, v - m, -m], size)
    }

    /// `sum_j bars_j E_j`, the coefficients of X, Y and 1 from the image's middle, in units of clip
    /// space.
    #[inline(always)]
    pub(crate) fn along_edges(&self, bars: [S; 3], size: Size) -> [S; 3] {
        let along = |k: usize| -> S {
            (0..3).map(|j| bars[j] * self.factors[j] * self.coefficients[j][k]).sum()
        };
        let [w_bar, x_bar, y_bar] = [along(0), along(1), along(2)];
        let w_bar = w_bar - (self.origin[0] * x_bar + self.origin[1] * y_bar);
        let [width, height] = size.extents::<S>();
        [width * x_bar, height * y_bar, w_bar]
    }

    /// The gradients with respect to (x, y, w) of vertex i in clip space, after its factor has
    /// multiplied it. The factor's own turn comes last, for with it the gradients may be beyond the
    /// range of the numbers.
    #[inline(always)]
    pub(crate) fn pull_back(&self, sums: &EdgeSums<S>, i: usize, size: Size) -> [S; 3] {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let EdgeSums { ones, xs, ys } = sums;
        let Vertex { x: qjx, y: qjy, w: wj, .. } = self.local[j];
        let Vertex { x: qkx, y: qky, w: wk, .. } = self.local[k];
        let x_bar = ones[k] * qjy - ones[j] * qky + (ys[j] * wk - ys[k] * wj);
        let y_bar = ones[j] * qkx - ones[k] * qjx + (xs[k] * wj - xs[j] * wk);
        let w_bar = -(self.origin[0] * x_bar + self.origin[1] * y_bar)
            - (xs[k] * qjy - xs[j] * qky + ys[j] * qkx - ys[k] * qjx);
        let [width, height] = size.extents::<S>();
        [width * x_bar, height * y_bar, w_bar]
    }
}

/// Depths of vertices of a face with even weights differ by less than this factor.
const EVEN_DEPTHS: f64 = 64.0;

/// Its vertices lie within this many times half the image's size from the image's middle.
const EVEN_EXTENTS: f64 = 16.0;

/// Whether the third weight, as one less the others, has nearly as many digits as they have. Without a branch, so that it
/// is compiled to vectors.
#[inline(always)]
pub(crate) fn has_even_vertices<S: Scalar>(vertices: &[Vertex<S>; 3], size: Size) -> bool {
    let [p, q, r] = vertices.map(|vertex| vertex.w);
    let are_near = vertices.iter().fold(true, |all, vertex| all & is_near(vertex, size));
    are_near & (largest([p, q, r]) < S::from_f64(EVEN_DEPTHS) * least([p, q, r]))
}

/// Whether [`has_even_vertices`] holds for any three of these vertices, and products of their depths are in range.
#[inline(always)]
pub(crate) fn are_even<S: Scalar>(
    vertices: impl IntoIterator<Item = Vertex<S>>,
    size: Size,
) -> bool {
    let (mut are_near, mut least, mut largest) = (true, S::from_f64(f64::INFINITY), S::ZERO);
    for vertex in vertices {
        are_near &= is_near(&vertex, size);
        least = smaller(vertex.w, least);
        largest = if vertex.w > largest { vertex.w } else { largest };
    }
    // The coordinates of even vertices are at most some times their w.
    let is_in_range = (least >= S::from_f64(1e-60)) & (largest < S::from_f64(1e58));
    are_near & is_in_range & (largest < S::from_f64(EVEN_DEPTHS) * least)
}

/// Whether a vertex is within [`EVEN_EXTENTS`].
#[inline(always)]
fn is_near<S: Scalar>(vertex: &Vertex<S>, size: Size) -> bool {
    let [width, height] =
        [size.width, size.height].map(|extent| S::from_f64(EVEN_EXTENTS * extent as f64));
    (vertex.x.abs() <= width * vertex.w) & (vertex.y.abs() <= height * vertex.w)
}
