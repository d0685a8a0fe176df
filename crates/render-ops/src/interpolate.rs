//! Interpolation of vertex attributes at fragments.
//!
//! # Forward
//! `s = A_2 + u (A_0 - A_2) + v (A_1 - A_2)`, with the attributes `A_k` of the face's three
//! vertices. In this form an attribute that is the same at all three comes out exactly.
//!
//! # Backward
//! `u_bar += s_bar . (A_0 - A_2)`, `v_bar += s_bar . (A_1 - A_2)`;
//! `A_bar_0 += u s_bar`, `A_bar_1 += v s_bar`, `A_bar_2 += (1 - u - v) s_bar`. It is smooth.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020.

use std::sync::Arc;

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;
use crate::fragments::{Coverage, Fragments};
use crate::mesh::Mesh;
use crate::runs::RunSums;

/// Vertex attributes `[V, C]` at the fragments: `[N, C]`.
///
/// # Errors
/// [`RenderError::Shape`] unless the attributes are `[V, C]` with the mesh's number of vertices.
pub fn interpolate<'t, T: Scalar>(
    attributes: Var<'t, T>,
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    interpolate_indexed(attributes, fragments.coverage.mesh(), fragments)
}

/// Attributes `[A, C]` with an index buffer of their own at the fragments: `[N, C]`. Face k of
/// `indices` names the attributes of face k of the mesh that was rasterized.
///
/// # Errors
/// [`RenderError::FaceCount`] unless `indices` has as many faces as the mesh that was rasterized;
/// [`RenderError::Shape`] unless the attributes are `[A, C]` with A its number of vertices.
pub fn interpolate_indexed<'t, T: Scalar>(
    attributes: Var<'t, T>,
    indices: &Mesh,
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let expected = fragments.coverage.mesh().faces().len();
    let given = indices.faces().len();
    if given != expected {
        return Err(RenderError::FaceCount { expected, given });
    }
    let op = Interpolate { indices: indices.clone(), coverage: Arc::clone(&fragments.coverage) };
    attributes.tape().apply(op, &[attributes, fragments.barycentrics])
}

/// Inputs: attributes `[A, C]`, barycentrics `[N, 2]`.
struct Interpolate {
    indices: Mesh,
    coverage: Arc<Coverage>,
}

impl Interpolate {
    /// The attributes of the three vertices of fragment `fragment`'s face.
    fn corners<'a, T>(
        &self,
        attributes: &'a [T],
        channels: usize,
        fragment: usize,
    ) -> [&'a [T]; 3] {
        let face = self.indices.faces()[self.coverage.faces()[fragment] as usize];
        face.map(|vertex| &attributes[vertex as usize * channels..][..channels])
    }
}

impl<T: Scalar> Op<T> for Interpolate {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "interpolate"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let shape = inputs.shape(0);
        let &[vertices, channels] = &**shape else { return Err(self.wrong_shape(shape)) };
        if vertices != self.indices.vertex_count() || channels == 0 {
            return Err(self.wrong_shape(shape));
        }
        let (attributes, barycentrics) = (inputs.data(0), inputs.data(1));
        let values = outputs.push([self.coverage.count(), channels]);
        let rows = ENTRIES_PER_PIECE.div_ceil(channels);
        for_each_piece_mut(values, rows * channels, |piece, values| {
            for (k, s) in values.chunks_exact_mut(channels).enumerate() {
                let fragment = piece * rows + k;
                let [a0, a1, a2] = self.corners(attributes, channels, fragment);
                let (u, v) = (barycentrics[2 * fragment], barycentrics[2 * fragment + 1]);
                for c in 0..channels {
                    s[c] = a2[c] + u * (a0[c] - a2[c]) + v * (a1[c] - a2[c]);
                }
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let mut keep = Keep::NOTHING;
        if inputs.needs(0) {
            keep = keep.input(1);
        }
        if inputs.needs(1) {
            keep = keep.input(0);
        }
        keep
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let s_bar = kept.only_upstream();
        let channels = kept.input_shape(0)[1];
        if let Some(attributes_bar) = gradients.get(0) {
            let barycentrics = kept.input(1);
            let sums = RunSums { coverage: &self.coverage, mesh: &self.indices, width: channels };
            sums.add_to(attributes_bar, |_, fragments, sums| {
                let (a0_bar, rest) = sums.split_at_mut(channels);
                let (a1_bar, a2_bar) = rest.split_at_mut(channels);
                for fragment in fragments {
                    let u = barycentrics[2 * fragment].widen();
                    let v = barycentrics[2 * fragment + 1].widen();
                    let rest = T::Wide::ONE - u - v;
                    for (c, s_bar) in s_bar[fragment * channels..][..channels].iter().enumerate() {
                        let s_bar = s_bar.widen();
                        a0_bar[c] += u * s_bar;
                        a1_bar[c] += v * s_bar;
                        a2_bar[c] += rest * s_bar;
                    }
                }
            });
        }
        if let Some(barycentrics_bar) = gradients.get(1) {
            let attributes = kept.input(0);
            let entries = barycentrics_bar.entries();
            for_each_piece_mut(entries, ENTRIES_PER_PIECE, |piece, entries| {
                for (k, uv_bar) in entries.chunks_exact_mut(2).enumerate() {
                    let fragment = piece * ENTRIES_PER_PIECE / 2 + k;
                    let [a0, a1, a2] = self.corners(attributes, channels, fragment);
                    let s_bar = &s_bar[fragment * channels..][..channels];
                    for c in 0..channels {
                        uv_bar[0] += s_bar[c] * (a0[c] - a2[c]);
                        uv_bar[1] += s_bar[c] * (a1[c] - a2[c]);
                    }
                }
            });
        }
    }
}

impl Interpolate {
    fn wrong_shape(&self, shape: &bokashi_core::Shape) -> RenderError {
        RenderError::Shape {
            operation: "interpolate",
            rule: format!("attributes of shape [{}, C], C > 0", self.indices.vertex_count()),
            shape: shape.clone(),
        }
    }
}
