//! Projection of a mesh that is there several times.
//!
//! # Forward
//! `clip_ki = C M_k (p_i, 1)`, with the camera `C: [4, 4]` and a model matrix M_k for each instance.
//!
//! # Backward
//! With `A_k = C M_k` and the moments `S_k = sum_i clip_bar_ki (p_i, 1)^T`: `M_bar_k = C^T S_k`,
//! `C_bar = sum_k S_k M_k^T`; `p_bar_i` is the first three entries of `sum_k A_k^T clip_bar_ki`. It is
//! smooth everywhere.
//!
//! # Source
//! As [`project`](crate::project()).

use std::ops::Range;

use bokashi_core::parallel::{for_each_piece_mut, write_each};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};
use smallvec::SmallVec;

use crate::error::RenderError;
use crate::matrix::{self, Matrix4};
use crate::point_map::{POINTS_PER_PIECE, map_piece, piece_moments};
use crate::projection::{CAMERA_RULE, Camera};

const NAME: &str = "project_instances";

/// Positions `[V, 3]` of one mesh in the clip space of each of I instances, one instance after another:
/// `[I V, 4]`. `matrices: [I, 4, 4]` take an instance from its own space to the world, and `camera` from
/// there to clip space, as in [`project`](crate::project()). No vertex is copied before that.
///
/// The positions have the sum of all instances' gradients; the matrices have a gradient, and so has a
/// camera that is a variable. The faces are those of an [`Assembly`](crate::Assembly).
///
/// # Errors
/// - [`RenderError::Shape`] unless positions are `[V, 3]`, matrices `[I, 4, 4]`, and a variable camera
///   `[4, 4]`.
/// - [`RenderError::Camera`] for an entry of the camera that is not finite, `TensorError::Value` for such an
///   entry of the other matrices.
/// - [`RenderError::MeshSize`] for 2^31 vertices and more.
/// - `TensorError::ForeignVariable` for variables of several tapes.
pub fn project_instances<'t, T: Scalar>(
    positions: Var<'t, T>,
    matrices: Var<'t, T>,
    camera: impl Into<Camera<'t, T>>,
) -> Result<Var<'t, T>, RenderError> {
    record(positions, matrices, camera.into())
}

/// [`project_instances()`], compiled once.
#[inline(never)]
fn record<'t, T: Scalar>(
    positions: Var<'t, T>,
    matrices: Var<'t, T>,
    camera: Camera<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let (fixed, variable) = (camera.fixed()?, camera.variable());
    let inputs: SmallVec<[_; 3]> = [positions, matrices].into_iter().chain(variable).collect();
    positions.tape().apply(ProjectInstances { fixed }, &inputs)
}

/// Inputs: positions `[V, 3]`, matrices `[I, 4, 4]`, and a variable camera `[4, 4]`. Output: clip
/// `[I V, 4]`.
struct ProjectInstances<S> {
    fixed: Option<Matrix4<S>>,
}

/// Memory.
#[derive(Debug)]
struct Saved<S> {
    /// `C M_k`.
    products: Vec<Matrix4<S>>,
    /// Of each piece of each instance.
    moments: Vec<Matrix4<S>>,
}

impl<S> Default for Saved<S> {
    fn default() -> Self {
        Self { products: Vec::new(), moments: Vec::new() }
    }
}

/// Points that are summed over the instances at once: their sums stay in the cache.
const POINTS_PER_BLOCK: usize = 1 << 8;

/// Calls `visit(k, points, place)` for the points of each instance k among `rows`, with their place
/// within `rows`.
fn for_each_instance(
    rows: Range<usize>,
    vertices: usize,
    mut visit: impl FnMut(usize, Range<usize>, Range<usize>),
) {
    let mut row = rows.start;
    while row < rows.end {
        let (instance, first) = (row / vertices, row % vertices);
        let count = (vertices - first).min(rows.end - row);
        let start = row - rows.start;
        visit(instance, first..first + count, start..start + count);
        row += count;
    }
}

impl<T: Scalar> Op<T> for ProjectInstances<T::Wide> {
    type Saved = Saved<T::Wide>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let &[vertices, 3] = &**inputs.shape(0) else {
            let rule = "positions of shape [V, 3]";
            return Err(RenderError::shape(NAME, rule, inputs.shape(0)));
        };
        let &[instances, 4, 4] = &**inputs.shape(1) else {
            let rule = "matrices of shape [I, 4, 4]";
            return Err(RenderError::shape(NAME, rule, inputs.shape(1)));
        };
        let camera = match self.fixed {
            Some(fixed) => fixed,
            None if **inputs.shape(2) != [4, 4] => {
                return Err(RenderError::shape(NAME, CAMERA_RULE, inputs.shape(2)));
            }
            None => {
                matrix::check_finite(inputs.data(2))?;
                matrix::from_entries(inputs.data(2))
            }
        };
        let (positions, matrices) = (inputs.data(0), inputs.data(1));
        if let Some(index) = matrices.iter().position(|entry| !entry.is_finite()) {
            let rule = format!("finite entries of matrix {}", index / 16);
            return Err(RenderError::value(NAME, rule, matrices[index].to_f64()));
        }
        let rows = instances.saturating_mul(vertices);
        if rows >= 1 << 31 {
            return Err(RenderError::MeshSize { given: rows });
        }

        let Saved { products, .. } = saved;
        products.clear();
        let models = matrices.chunks_exact(16).map(matrix::from_entries);
        products.extend(models.map(|model| matrix::product(&camera, &model)));
        let (products, points) = (&products[..], positions.as_chunks::<3>().0);
        let clip = outputs.try_push(NAME, [rows, 4])?;
        for_each_piece_mut(clip, 4 * POINTS_PER_PIECE, |piece, clip| {
            let clip = clip.as_chunks_mut::<4>().0;
            let first = piece * POINTS_PER_PIECE;
            for_each_instance(first..first + clip.len(), vertices, |instance, range, rows| {
                map_piece(&products[instance], &points[range], &mut clip[rows]);
            });
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let needs_camera = self.fixed.is_none() && inputs.needs(2);
        Keep::NOTHING
            .input_if(0, inputs.needs(1) || needs_camera)
            .input_if(1, needs_camera)
            .input_if(2, self.fixed.is_none() && inputs.needs(1))
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (vertices, instances) = (kept.input_shape(0)[0], kept.input_shape(1)[0]);
        let bars = kept.only_upstream().as_chunks::<4>().0;
        let Saved { products, moments } = saved;
        if let Some(positions_bar) = gradients.get(0) {
            for_each_piece_mut(positions_bar.entries(), 3 * POINTS_PER_PIECE, |piece, entries| {
                let blocks = entries.as_chunks_mut::<3>().0.chunks_mut(POINTS_PER_BLOCK);
                let firsts = (piece * POINTS_PER_PIECE..).step_by(POINTS_PER_BLOCK);
                for (first, block) in firsts.zip(blocks) {
                    add_positions_bar(products, vertices, first, bars, block);
                }
            });
        }
        let needs_camera = self.fixed.is_none() && gradients.needs(2);
        if !gradients.needs(1) && !needs_camera {
            return;
        }
        let points = kept.input(0).as_chunks::<3>().0;
        let pieces = vertices.div_ceil(POINTS_PER_PIECE);
        sum_moments(points, bars, [instances, vertices], moments);
        let of_instances = moments.iter().step_by(pieces.max(1));
        if let Some(matrices_bar) = gradients.get(1) {
            let camera = self.fixed.unwrap_or_else(|| matrix::from_entries(kept.input(2)));
            let entries = matrices_bar.entries().chunks_exact_mut(16);
            for (moments, entries) in of_instances.clone().zip(entries) {
                let bar = matrix::transposed_product(&camera, moments);
                let terms = bar.iter().flatten();
                entries.iter_mut().zip(terms).for_each(|(entry, &term)| *entry += T::narrow(term));
            }
        }
        if needs_camera && let Some(camera_bar) = gradients.get(2) {
            let mut total = [[T::Wide::ZERO; 4]; 4];
            let models = kept.input(1).chunks_exact(16).map(matrix::from_entries);
            for (moments, model) in of_instances.zip(models) {
                matrix::add(&mut total, &matrix::product_transposed(moments, &model));
            }
            camera_bar.add_each(|k| T::narrow(total[k / 4][k % 4]));
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        size_of_val(&saved.products[..])
    }
}

/// Writes the moments of all pieces of all instances; those of an instance's first piece are then of all.
fn sum_moments<T: Scalar>(
    points: &[[T; 3]],
    bars: &[[T; 4]],
    [instances, vertices]: [usize; 2],
    moments: &mut Vec<Matrix4<T::Wide>>,
) {
    let pieces = vertices.div_ceil(POINTS_PER_PIECE);
    moments.clear();
    moments.resize(instances * pieces, [[T::Wide::ZERO; 4]; 4]);
    // Of small meshes a thread takes several at once.
    let together = (POINTS_PER_PIECE / vertices.max(1)).max(1);
    write_each(moments, together, |index| {
        let (instance, piece) = (index / pieces, index % pieces);
        let range = piece * POINTS_PER_PIECE..((piece + 1) * POINTS_PER_PIECE).min(vertices);
        let first = instance * vertices;
        piece_moments(&points[range.clone()], &bars[first + range.start..first + range.end])
    });
    for moments in moments.chunks_exact_mut(pieces.max(1)) {
        let (total, others) = moments.split_first_mut().expect("a piece at least");
        others.iter().for_each(|other| matrix::add(total, other));
    }
}

/// Adds the gradients of a block of positions, the first of them `first`.
fn add_positions_bar<T: Scalar>(
    products: &[Matrix4<T::Wide>],
    vertices: usize,
    first: usize,
    bars: &[[T; 4]],
    block: &mut [[T; 3]],
) {
    let mut sums = [[T::Wide::ZERO; 3]; POINTS_PER_BLOCK];
    crate::dispatch::dispatch::<T, _>(
        #[inline(always)]
        || {
            for (instance, a) in products.iter().enumerate() {
                let bars = &bars[instance * vertices + first..][..block.len()];
                for (sums, bar) in sums.iter_mut().zip(bars) {
                    let [x, y, z, w] = bar.map(T::widen);
                    for k in 0..3 {
                        sums[k] += a[0][k] * x + a[1][k] * y + a[2][k] * z + a[3][k] * w;
                    }
                }
            }
        },
    );
    for (entries, sums) in block.iter_mut().zip(sums) {
        entries.iter_mut().zip(sums).for_each(|(entry, sum)| *entry += T::narrow(sum));
    }
}
