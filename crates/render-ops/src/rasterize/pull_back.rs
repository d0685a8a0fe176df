//! From the gradients of the weights to the gradients of the vertices. The coefficients of a face turn
//! sums over its fragments into gradients.
//!
//! # By stored weights
//! With the vertices `V_i = (x_i, y_i, w_i)` as the columns of M, the weights are the entries of
//! `M^-1 (X, Y, 1)`, divided by their sum. Let `b_i` be the weights, `b_bar_j` their gradients
//! (u_bar, v_bar, 0), and `m = sum_j b_bar_j b_j`. Then `V_bar_i = -sum_j S_ij E_j / D`, with the sums over the
//! fragments `S_ij = sum b_i (b_bar_j - m)`, `E_j` the coefficients of edge function j and D the
//! determinant. So neither a fragment's place nor its edge functions are asked for again.
//!
//! # By edge functions
//! The third weight is 1 - u - v, and loses digits where it is small in all fragments: where a vertex
//! is much farther away than another, or far outside the image. There the edge functions are worked out
//! again, and rows sum their gradients, from which `edge_functions`' adjoint leads on.

use std::ops::Range;

use bokashi_core::Scalar;

use super::corner::{ClipVertices, Corner};
use crate::coverage::Coverage;
use crate::edge_functions::{EdgeSums, LocalFace, has_even_vertices};
use crate::face_sums::FaceSums;
use crate::homogeneous::missing_factors;
use crate::weighted_sums::{FragmentPlanes, Terms};

/// From the gradients of u and v to those of the vertices.
pub(super) struct WeightPullBack<'a, T: Scalar> {
    pub(super) coverage: &'a Coverage,
    pub(super) corners: ClipVertices<'a, T>,
    pub(super) uv: &'a [T],
    pub(super) uv_bar: &'a [T],
}

impl<'a, T: Scalar> FaceSums<T::Wide> for WeightPullBack<'a, T> {
    const WIDTH: Option<usize> = Some(4);

    type Memory = FragmentPlanes<'a, T, 2>;

    fn memory(&self) -> Self::Memory {
        FragmentPlanes::new(self.uv.as_chunks().0, self.uv_bar.as_chunks().0)
    }

    #[inline(always)]
    fn sum(
        &self,
        planes: &mut Self::Memory,
        slot: usize,
        fragments: Range<usize>,
        rows: &mut [T::Wide],
    ) {
        let Coverage { mesh, size, centers, .. } = self.coverage;
        let uv_bar = &self.uv_bar[2 * fragments.start..2 * fragments.end];
        // Of a face whose vertices have got their gradients directly: see `direct_gradients`.
        if uv_bar.iter().all(|&bar| bar.is_same(T::ZERO)) {
            return rows.fill(T::Wide::ZERO);
        }
        let corners = self.corners.corners_of(mesh.faces()[centers.face(slot)]);
        let face = self.face(slot, &corners);
        if !has_even_vertices(&corners.map(|corner| corner.vertex), *size) {
            return self.sum_by_edges(slot, &face, fragments, rows);
        }
        let sums = planes.sum(&Slopes, fragments);
        let scale = -T::Wide::ONE / face.determinant();
        for (row, sums) in rows.chunks_exact_mut(4).zip(sums) {
            let [x_bar, y_bar, w_bar] = face.pull_back_weights(sums, *size);
            row.copy_from_slice(&[x_bar, y_bar, T::Wide::ZERO, w_bar].map(|bar| scale * bar));
        }
    }
}

impl<T: Scalar> WeightPullBack<'_, T> {
    /// The face of slot `slot` around its first pixel.
    #[inline(always)]
    fn face(&self, slot: usize, corners: &[Corner<T::Wide>; 3]) -> LocalFace<T::Wide> {
        let Coverage { size, centers, .. } = self.coverage;
        let factors = corners.map(|corner| corner.factor);
        let vertices = corners.map(|corner| corner.vertex);
        LocalFace::new(vertices, factors, centers.first_pixel_of(slot), *size)
    }

    /// The gradients of the face's vertices by edge functions.
    #[cold]
    #[inline(never)]
    fn sum_by_edges(
        &self,
        slot: usize,
        face: &LocalFace<T::Wide>,
        fragments: Range<usize>,
        rows: &mut [T::Wide],
    ) {
        let size = self.coverage.size;
        let mut sums = EdgeSums::default();
        for run in self.coverage.centers.within(slot, fragments) {
            let [mut x, y] = face.center_offset(run.pixel as usize, size);
            let row = face.row(y);
            let (mut ones, mut xs) = ([T::Wide::ZERO; 3], [T::Wide::ZERO; 3]);
            let uv_bar = &self.uv_bar[2 * run.fragments().start..2 * run.fragments().end];
            for uv_bar in uv_bar.as_chunks::<2>().0 {
                let a = row.map(|[start, slope]| start + slope * x);
                // The weights are missing_i a_i, so a_bar_i gets that factor.
                let missing = missing_factors(a, face.factors);
                let weights = std::array::from_fn(|i| missing[i] * a[i]);
                let bars = weights_bar(weights, uv_bar.map(T::widen));
                for i in 0..3 {
                    let a_bar = missing[i] * bars[i];
                    ones[i] += a_bar;
                    xs[i] += x * a_bar;
                }
                // A pixel is two units wide.
                x += T::Wide::from_f64(2.0);
            }
            sums.add_row(ones, xs, y);
        }
        for (i, row) in rows.chunks_exact_mut(4).enumerate() {
            let [x_bar, y_bar, w_bar] = face.pull_back(&sums, i, size);
            let bars = [x_bar, y_bar, T::Wide::ZERO, w_bar];
            row.copy_from_slice(&bars.map(|bar| face.factors[i] * bar));
        }
    }
}

/// `u_bar`, `v_bar` and `m`.
struct Slopes;

impl<S: Scalar> Terms<S, 2, 3> for Slopes {
    #[inline(always)]
    fn compute(&self, [u, v]: [S; 2], [u_bar, v_bar]: [S; 2]) -> [S; 3] {
        [u_bar, v_bar, u_bar * u + v_bar * v]
    }
}

/// The gradients of weights that are not normalized from those of u and v.
#[inline(always)]
pub(super) fn weights_bar<S: Scalar>(weights: [S; 3], [u_bar, v_bar]: [S; 2]) -> [S; 3] {
    let scale = S::ONE / (weights[0] + weights[1] + weights[2]);
    let m = (u_bar * weights[0] + v_bar * weights[1]) * scale;
    [(u_bar - m) * scale, (v_bar - m) * scale, -m * scale]
}
