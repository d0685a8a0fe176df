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
/// [`RenderError::Shape`] unless the attributes are `[V, C]` with the mesh's number of vertices,
/// and for fragments that are not whole; `TensorError::ForeignVariable` for variables of several
/// tapes.
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
/// [`RenderError::Shape`] unless the attributes are `[A, C]` with A its number of vertices, and for
/// fragments that are not whole; `TensorError::ForeignVariable` for variables of several tapes.
pub fn interpolate_indexed<'t, T: Scalar>(
    attributes: Var<'t, T>,
    indices: &Mesh,
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let coverage = fragments.checked_coverage("interpolate", attributes.tape())?;
    let expected = coverage.mesh().faces().len();
    let given = indices.faces().len();
    if given != expected {
        return Err(RenderError::FaceCount { expected, given });
    }
    let op = Interpolate { indices: indices.clone(), coverage };
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

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;
    use crate::rasterize::rasterize;
    use crate::size::Size;

    const SIZE: Size = Size { width: 7, height: 5 };

    fn quad() -> Mesh {
        Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4).unwrap()
    }

    /// The fragments of a quad in perspective.
    fn fragments<T: Scalar>(tape: &Tape<T>, size: Size) -> Fragments<'_, T> {
        let clip = [
            [-0.9, -0.8, 0.0, 1.0],
            [1.9, -1.6, 0.0, 2.0],
            [1.2, 1.4, 0.1, 1.5],
            [-0.4, 0.4, 0.0, 0.5],
        ];
        let clip = tape.leaf(&Tensor::from_fn([4, 4], |k| T::from_f64(clip[k / 4][k % 4])));
        rasterize(clip, &quad(), size).unwrap()
    }

    fn numbers<T: Scalar>(rows: usize, channels: usize) -> Tensor<T> {
        let entry = |k: usize| ((k * 7919 + 5) % 101) as f64 / 101.0 - 0.3;
        Tensor::from_fn([rows, channels], |k| T::from_f64(entry(k)))
    }

    #[test]
    fn a_constant_attribute_comes_out_exactly() {
        let tape = Tape::<f32>::new();
        let fragments = fragments(&tape, SIZE);
        let attributes = tape.leaf(&Tensor::from_fn([4, 2], |k| [0.1, 1e30][k % 2]));
        let values = interpolate(attributes, &fragments).unwrap().value();
        assert!(fragments.coverage.count() > 10);
        assert_eq!(*values.shape(), [fragments.coverage.count(), 2].into());
        assert!(values.data().chunks(2).all(|value| value == [0.1, 1e30]));
    }

    #[test]
    fn each_value_is_the_weighted_mean_of_its_corners() {
        // More fragments than a piece of work holds, with one channel and with several.
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape, Size { width: 211, height: 203 });
        let uv = fragments.barycentrics.value();
        for channels in [1, 3, 9] {
            let attributes = numbers(4, channels);
            let values = interpolate(tape.leaf(&attributes), &fragments).unwrap().value();
            for (n, value) in values.data().chunks(channels).enumerate() {
                let face = quad().faces()[fragments.coverage.faces()[n] as usize];
                let (u, v) = (uv.data()[2 * n], uv.data()[2 * n + 1]);
                for (c, &value) in value.iter().enumerate() {
                    let [a, b, d] =
                        face.map(|vertex| attributes.data()[vertex as usize * channels + c]);
                    let expected = u * a + v * b + (1.0 - u - v) * d;
                    approx::assert_relative_eq!(value, expected, epsilon = 1e-14);
                }
            }
        }
    }

    #[test]
    fn backward_is_the_adjoint_in_the_attributes_and_in_the_weights() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape, Size { width: 211, height: 203 });
        for channels in [1, 3, 9] {
            let attributes = tape.leaf(&numbers(4, channels));
            let values = interpolate(attributes, &fragments).unwrap();
            let upstream = numbers::<f64>(fragments.coverage.count(), channels);
            let wanted = [attributes, fragments.barycentrics];
            let gradients = tape.vjp_to(&[(values, &upstream)], &wanted).unwrap();
            let dot = |x: &Tensor<f64>, y: &Tensor<f64>| -> f64 {
                x.data().iter().zip(y.data()).map(|(x, y)| x * y).sum()
            };
            // Linear in the attributes; in the weights but for the value at (0, 0), corner 2's.
            let whole = dot(&values.value(), &upstream);
            let by_attributes = dot(gradients.get(attributes).unwrap(), &attributes.value());
            approx::assert_relative_eq!(by_attributes, whole, max_relative = 1e-11);
            let offset: f64 = upstream
                .data()
                .iter()
                .enumerate()
                .map(|(k, bar)| {
                    let face = fragments.coverage.faces()[k / channels] as usize;
                    let last = quad().faces()[face][2] as usize;
                    bar * attributes.value().data()[last * channels + k % channels]
                })
                .sum();
            let uv_bar = gradients.get(fragments.barycentrics).unwrap();
            let by_weights = dot(uv_bar, &fragments.barycentrics.value());
            approx::assert_relative_eq!(by_weights, whole - offset, max_relative = 1e-11);
        }
    }

    #[test]
    fn an_index_buffer_of_its_own_gives_faces_their_own_attributes() {
        let tape = Tape::<f32>::new();
        let fragments = fragments(&tape, SIZE);
        // One attribute per face: every corner of a face names the same.
        let flat = Mesh::new(vec![[1, 1, 1], [0, 0, 0]], 2).unwrap();
        let attributes = tape.leaf(&Tensor::new([2, 1], vec![10.0, 20.0]).unwrap());
        let values = interpolate_indexed(attributes, &flat, &fragments).unwrap();
        let faces = fragments.coverage.faces();
        let expected: Vec<_> = faces.iter().map(|&face| [20.0, 10.0][face as usize]).collect();
        assert_eq!(values.value().data(), expected);
        // Each attribute's gradient is the number of its face's pixels.
        let gradients = values.sum().backward().unwrap();
        let count = |face| faces.iter().filter(|&&other| other == face).count() as f32;
        let found = gradients.get(attributes).unwrap();
        approx::assert_relative_eq!(found.data()[0], count(1), max_relative = 1e-6);
        approx::assert_relative_eq!(found.data()[1], count(0), max_relative = 1e-6);
    }

    #[test]
    fn wrong_shapes_and_face_counts_are_refused() {
        let tape = Tape::<f32>::new();
        let fragments = fragments(&tape, SIZE);
        for shape in [&[4][..], &[3, 2], &[4, 0], &[4, 1, 1]] {
            let error = interpolate(tape.leaf(&Tensor::zeros(shape)), &fragments).unwrap_err();
            let rule = "interpolate needs attributes of shape [4, C], C > 0, got";
            assert!(error.to_string().starts_with(rule), "{error}");
        }
        let single = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let attributes = tape.leaf(&Tensor::zeros([3, 1]));
        let error = interpolate_indexed(attributes, &single, &fragments).unwrap_err();
        assert_eq!(
            error.to_string(),
            "attribute indices need one face per rasterized face, 2, got 1"
        );
    }
}
