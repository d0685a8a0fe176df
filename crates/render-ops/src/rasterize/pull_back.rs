//! From the gradients of the weights to those of the vertices: per face and row, sums of the edge
//! functions' gradients; per face, `edge_functions`' adjoint.

use std::ops::Range;

use bokashi_core::Scalar;

use super::culling::Corner;
use crate::coverage::Coverage;
use crate::edge_functions::{EdgeSums, LocalFace};
use crate::face_sums::FaceSums;
use crate::homogeneous::{are_one, missing_factors};

/// From the gradients of u and v to those of the vertices.
pub(super) struct PullBack<'a, T: Scalar> {
    pub(super) coverage: &'a Coverage,
    pub(super) corners: &'a [Corner<T::Wide>],
    pub(super) uv_bar: &'a [T],
}

impl<T: Scalar> FaceSums<T::Wide> for PullBack<'_, T> {
    #[inline(always)]
    fn sum(&self, slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        let Coverage { mesh, size, slots, .. } = self.coverage;
        let corners =
            mesh.faces()[slots[slot].face as usize].map(|vertex| &self.corners[vertex as usize]);
        let factors = corners.map(|corner| corner.factor);
        let origin = self.coverage.first_pixel_of(slot);
        let vertices = corners.map(|corner| corner.vertex);
        let face = LocalFace::new(vertices, factors, origin, *size);
        let mut sums = EdgeSums::default();
        for span in self.coverage.spans_within(slot, fragments) {
            let [x, y] = face.place(span.pixel, *size);
            let row = face.row(y);
            let uv_bar = &self.uv_bar[2 * span.fragments.start..2 * span.fragments.end];
            let [ones, xs] = if are_one(factors) {
                if uv_bar.len() >= 2 * LONG_ROW {
                    sum_long_row(row, x, uv_bar)
                } else {
                    sum_row(row, x, uv_bar, weights_bar)
                }
            } else {
                // The weights are missing_i a_i, so a_bar_i gets that factor.
                sum_row(row, x, uv_bar, |a, uv_bar| {
                    let missing = missing_factors(a, factors);
                    let weights = std::array::from_fn(|i| missing[i] * a[i]);
                    let weights_bar = weights_bar(weights, uv_bar);
                    std::array::from_fn(|i| missing[i] * weights_bar[i])
                })
            };
            sums.add_row(ones, xs, y);
        }
        for (i, row) in rows.chunks_exact_mut(4).enumerate() {
            let [x_bar, y_bar, w_bar] = face.pull_back(&sums, i, *size);
            row.copy_from_slice(&[x_bar, y_bar, T::Wide::ZERO, w_bar].map(|bar| factors[i] * bar));
        }
    }
}

/// The sums of `a_bar` and of `x a_bar` over neighbouring pixels of a row, whose edge functions
/// are `row`, from the first one's `x` on.
#[inline(always)]
fn sum_row<T: Scalar>(
    row: [[T::Wide; 2]; 3],
    mut x: T::Wide,
    uv_bar: &[T],
    a_bar: impl Fn([T::Wide; 3], [T::Wide; 2]) -> [T::Wide; 3],
) -> [[T::Wide; 3]; 2] {
    let two = T::Wide::from_f64(2.0);
    let mut ones = [T::Wide::ZERO; 3];
    let mut xs = [T::Wide::ZERO; 3];
    for uv_bar in uv_bar.chunks_exact(2) {
        let a = row.map(|[start, slope]| start + slope * x);
        let a_bar = a_bar(a, [uv_bar[0].widen(), uv_bar[1].widen()]);
        for i in 0..3 {
            ones[i] += a_bar[i];
            xs[i] += x * a_bar[i];
        }
        x += two;
    }
    [ones, xs]
}

/// A row of at least as many pixels is summed in parts: of shorter ones the zeros cost more.
const LONG_ROW: usize = 48;

/// Pixels of a long row whose terms are worked out before any is summed: they stay in the first-level
/// cache.
const PIXELS_AT_ONCE: usize = 64;

/// Partial sums along a long row: as many as the widest vectors hold.
const PARTS: usize = 8;

/// [`sum_row`] with [`weights_bar`] for long rows: terms first, then sums in parts, as two loops
/// that are compiled to vectors, which one loop is not.
#[inline(always)]
fn sum_long_row<T: Scalar>(
    row: [[T::Wide; 2]; 3],
    mut x: T::Wide,
    uv_bar: &[T],
) -> [[T::Wide; 3]; 2] {
    let mut ones = [[T::Wide::ZERO; PARTS]; 3];
    let mut xs = [[T::Wide::ZERO; PARTS]; 3];
    for uv_bar in uv_bar.as_chunks::<2>().0.chunks(PIXELS_AT_ONCE) {
        // Zeros after the last pixel, so that the last parts are whole.
        let mut terms = [[T::Wide::ZERO; PIXELS_AT_ONCE]; 3];
        let mut places = [T::Wide::ZERO; PIXELS_AT_ONCE];
        let [p, q, r] = &mut terms;
        let entries = p.iter_mut().zip(q).zip(r).zip(&mut places).zip(uv_bar);
        for (k, ((((p, q), r), place), uv_bar)) in (0_u32..).zip(entries) {
            *place = x + T::Wide::from_f64(f64::from(2 * k));
            let a = row.map(|[start, slope]| start + slope * *place);
            [*p, *q, *r] = weights_bar(a, uv_bar.map(T::widen));
        }
        let parts = uv_bar.len().div_ceil(PARTS);
        for (i, terms) in terms.iter().enumerate() {
            let places = places.as_chunks::<PARTS>().0;
            for (terms, places) in terms.as_chunks::<PARTS>().0.iter().zip(places).take(parts) {
                for part in 0..PARTS {
                    ones[i][part] += terms[part];
                    xs[i][part] += places[part] * terms[part];
                }
            }
        }
        x += T::Wide::from_f64(2.0 * PIXELS_AT_ONCE as f64);
    }
    [ones, xs].map(|sums| sums.map(|parts| parts.into_iter().sum()))
}

/// The gradients of weights that are not normalized from those of u and v.
#[inline(always)]
pub(super) fn weights_bar<S: Scalar>(weights: [S; 3], [u_bar, v_bar]: [S; 2]) -> [S; 3] {
    let scale = S::ONE / (weights[0] + weights[1] + weights[2]);
    let m = (u_bar * weights[0] + v_bar * weights[1]) * scale;
    [(u_bar - m) * scale, (v_bar - m) * scale, -m * scale]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_rows_have_the_sums_of_short_ones() {
        let row = [[0.7, 1e-3], [2.0, -2e-3], [0.4, 5e-4]];
        for length in [1, 7, 8, 48, 63, 64, 65, 129, 200] {
            let uv_bar: Vec<f64> = (0..2 * length).map(|k| (k as f64 * 0.7).sin()).collect();
            let expected = sum_row(row, -3.0, &uv_bar, weights_bar);
            let found = sum_long_row(row, -3.0, &uv_bar);
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                approx::assert_relative_eq!(found, expected, epsilon = 1e-12, max_relative = 1e-12);
            }
        }
    }
}
