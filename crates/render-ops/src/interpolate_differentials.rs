//! How vertex attributes change from pixel to pixel.
//!
//! # Forward
//! `ds/dk = du/dk (A_0 - A_2) + dv/dk (A_1 - A_2)`, for `k = x, y`, with the attributes `A_i` of the
//! face's vertices: the derivative of `interpolate`'s formula.
//!
//! # Backward
//! With the gradients `g_k` of `ds/dk`: `(du/dk)_bar = g_k . (A_0 - A_2)`,
//! `(dv/dk)_bar = g_k . (A_1 - A_2)`; `A_bar_0 = sum_k du/dk g_k`, `A_bar_1 = sum_k dv/dk g_k`,
//! `A_bar_2 = -A_bar_0 - A_bar_1`. It is smooth.

use std::ops::Range;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::attributes::Attributes;
use crate::error::RenderError;
use crate::face_sums::{FaceSums, Layout};
use crate::fragments::Fragments;
use crate::mesh::Mesh;
use crate::scratch::Workbench;

const NAME: &str = "interpolate_differentials";

/// How vertex attributes `[V, C]` change from pixel to pixel at the fragments: `[N, C, 2]`, with
/// d/dx and d/dy of each channel, x to the right and y down. `differentials` are the fragments'
/// [`differentials`](crate::differentials()).
///
/// # Errors
/// - [`RenderError::Shape`] unless the attributes are `[V, C]` with the mesh's number of vertices,
///   and the differentials `[N, 2, 2]`; and for fragments that are not whole.
/// - `TensorError::ForeignVariable` for variables of several tapes.
pub fn interpolate_differentials<'t, T: Scalar>(
    attributes: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    differentials: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let indices = fragments.coverage.mesh();
    interpolate_differentials_indexed(attributes, indices, fragments, differentials)
}

/// [`interpolate_differentials`] of attributes `[A, C]` with an index buffer of their own, as in
/// [`interpolate_indexed`](crate::interpolate_indexed()).
///
/// # Errors
/// As [`interpolate_differentials`]; and [`RenderError::FaceCount`] unless `indices` has as many faces
/// as the mesh that was rasterized.
#[inline(never)]
pub fn interpolate_differentials_indexed<'t, T: Scalar>(
    attributes: Var<'t, T>,
    indices: &Mesh,
    fragments: &Fragments<'t, T>,
    differentials: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let tape = attributes.tape();
    let coverage = fragments.checked_coverage(NAME, tape)?;
    let op = InterpolateDifferentials(Attributes::new(indices, coverage)?);
    tape.apply(op, &[attributes, differentials])
}

/// Inputs: attributes `[A, C]`, differentials of barycentrics `[N, 2, 2]`. Output: `[N, C, 2]`.
struct InterpolateDifferentials(Attributes);

impl<T: Scalar> Op<T> for InterpolateDifferentials {
    /// Memory for sums over faces.
    type Saved = Workbench<Vec<T>>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _rows: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let channels = self.0.channels(NAME, inputs.shape(0))?;
        let count = self.0.coverage.count();
        if **inputs.shape(1) != [count, 2, 2] {
            let (rule, shape) =
                (format!("differentials of shape [{count}, 2, 2]"), inputs.shape(1).clone());
            return Err(RenderError::Shape { operation: NAME, rule, shape });
        }
        let (attributes, slopes) = (inputs.data(0), inputs.data(1).as_chunks::<4>().0);
        let out = outputs.try_push(NAME, [count, channels, 2])?;
        self.0.for_each_face_mut(
            attributes,
            out,
            channels,
            #[inline(always)]
            |fragments, [a0, a1, a2], out| {
                let out = out.as_chunks_mut::<2>().0.chunks_exact_mut(channels);
                for (out, &[ux, uy, vx, vy]) in out.zip(&slopes[fragments]) {
                    for (c, out) in out.iter_mut().enumerate() {
                        let [first, second] = [a0[c] - a2[c], a1[c] - a2[c]];
                        *out = [ux * first + vx * second, uy * first + vy * second];
                    }
                }
            },
        );
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(1, inputs.needs(0)).input_if(0, inputs.needs(1))
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        rows: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let bars = kept.only_upstream().as_chunks::<2>().0;
        let channels = kept.input_shape(0)[1];
        if let Some(attributes_bar) = gradients.get(0) {
            let slopes = kept.input(1).as_chunks::<4>().0;
            for (runs, first) in self.0.coverage.kinds() {
                let (slopes, bars) = (&slopes[first..], &bars[first * channels..]);
                let shares = Shares { slopes, bars, channels };
                Layout { runs, mesh: &self.0.indices, width: channels }.add_to(
                    attributes_bar,
                    &shares,
                    rows,
                );
            }
        }
        if let Some(slopes_bar) = gradients.get(1) {
            let (entries, is_fresh) = slopes_bar.entries_or_fresh();
            self.0.for_each_face_mut(
                kept.input(0),
                entries,
                channels,
                #[inline(always)]
                |fragments, [a0, a1, a2], row| {
                    let bars = bars[fragments.start * channels..fragments.end * channels]
                        .chunks_exact(channels);
                    for (row, bars) in row.as_chunks_mut::<4>().0.iter_mut().zip(bars) {
                        let mut sums = if is_fresh { [T::ZERO; 4] } else { *row };
                        for (c, &[x, y]) in bars.iter().enumerate() {
                            let [first, second] = [a0[c] - a2[c], a1[c] - a2[c]];
                            sums[0] += x * first;
                            sums[1] += y * first;
                            sums[2] += x * second;
                            sums[3] += y * second;
                        }
                        *row = sums;
                    }
                },
            );
        }
    }

    fn saved_bytes(&self, rows: &Self::Saved) -> usize {
        rows.bytes()
    }
}

/// The shares of each vertex in the gradients of the derivatives of attributes.
struct Shares<'a, T> {
    slopes: &'a [[T; 4]],
    bars: &'a [[T; 2]],
    channels: usize,
}

impl<T: Scalar> FaceSums<T::Wide> for Shares<'_, T> {
    type Memory = ();

    fn memory(&self) {}

    #[inline(always)]
    fn sum(&self, (): &mut (), _slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        rows.fill(T::Wide::ZERO);
        let channels = self.channels;
        let bars = &self.bars[fragments.start * channels..fragments.end * channels];
        for (slopes, bars) in self.slopes[fragments].iter().zip(bars.chunks_exact(channels)) {
            let [ux, uy, vx, vy] = slopes.map(T::widen);
            for (c, bar) in bars.iter().enumerate() {
                let [x, y] = bar.map(T::widen);
                let (first, second) = (ux * x + uy * y, vx * x + vy * y);
                rows[c] += first;
                rows[channels + c] += second;
                rows[2 * channels + c] -= first + second;
            }
        }
    }
}
