//! Rasterization of triangles to fragments.
//!
//! # Forward
//! Each pixel centre sees the nearest face that covers it (`setup` has the coverage, `visibility` the
//! search). Let `a_i = q_j x q_k` be the edge functions of the face's vertices relative to the pixel
//! centre, and `A = a_0 + a_1 + a_2`. The weights `u = a_0 / A` and `v = a_1 / A` are
//! perspective-correct, and computed in [`Scalar::Wide`]. With exact coverage the pieces of boundary
//! pixels follow. Their weights are a second output: see `exact`.
//!
//! # Backward
//! With `m = u_bar u + v_bar v`: `a_bar_0 = (u_bar - m) / A`, `a_bar_1 = (v_bar - m) / A`,
//! `a_bar_2 = -m / A`; from there to the vertices as in `edge_functions`. The gradients grow as 1
//! over the scale of the positions. Terms beyond the range of the numbers make an entry infinite and
//! not NaN, with the sign of the first such term. For pieces such terms may be NaN.
//!
//! # Where it is not smooth
//! Which face a pixel sees is a step function of the vertices: its derivative is zero almost
//! everywhere and not defined where a silhouette or an intersection crosses the pixel centre.
//! [`antialias`](crate::antialias()) makes up for silhouettes. With exact coverage silhouettes and
//! intersections are smooth; what is not is listed in `docs/exact-coverage.md`.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020; coverage as in `homogeneous`.

mod behind;
mod blocks;
mod canvas;
mod corner;
mod culling;
mod exact;
mod filter;
mod orientations;
mod plane;
mod prepared;
mod pull_back;
mod setup;
mod spans;
mod vertices;
mod visibility;

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::parallel::{merge_each, merge_ranges_into};
use bokashi_core::{
    Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var,
};
use smallvec::SmallVec;

use self::canvas::Weigh;
use self::exact::Adjoints;
use self::pull_back::WeightPullBack;
use self::visibility::Visibility;
use crate::boundary::BoundaryCounts;
use crate::coverage::Coverage;
use crate::creases::mark_creases;
use crate::dispatch::dispatch;
use crate::error::RenderError;
use crate::face_sums::{Layout, add_term};
use crate::fragments::Fragments;
use crate::mesh::Mesh;
use crate::raster_options::{RasterOptions, Rasterization, Sampling};
use crate::scratch::Workbench;

/// The fragments of `mesh` with vertices `clip: [V, 4]` in clip space: a fragment for each pixel
/// whose centre some face covers. With [`Sampling::Exact`] the pixels that a discontinuity crosses
/// have no fragment at their centre. They have a fragment for each visible piece, behind all other
/// fragments, and [`Fragments::weight`] is there.
///
/// `how` is a [`Size`](crate::Size), [`RasterOptions`], or for exact coverage options with the attributes that will be
/// shown: `rasterize(clip, &mesh, options.creases(&[colors.into()]))`. The mesh of the fragments' coverage then has the
/// creases as seams.
///
/// Smaller z / w wins; where it is equal, the lower face index wins. Faces may reach behind the eye
/// and through the near and far planes: the visible part is drawn. Faces whose area is zero within
/// rounding are not drawn and are counted in [`Coverage::culled`].
///
/// # Errors
/// - [`RenderError::ImageSize`] for an image without pixels.
/// - [`RenderError::Shape`] unless `clip` is `[V, 4]` with the mesh's number of vertices.
/// - [`RenderError::Position`] for a coordinate that is not finite.
/// - For [`Sampling::Exact`]: [`RenderError::UnnamedCreases`] where no attributes are named;
///   [`RenderError::FaceCount`] and [`RenderError::Shape`] for attributes that do not fit the mesh;
///   `TensorError::Value` for a tolerance that is not positive.
pub fn rasterize<'a, 't: 'a, T: Scalar>(
    clip: Var<'t, T>,
    mesh: &Mesh,
    how: impl Into<Rasterization<'a, 't, T>>,
) -> Result<Fragments<'t, T>, RenderError> {
    let Rasterization { options, creases } = how.into();
    if options.sampling != Sampling::Exact {
        return Ok(record(clip, mesh, options, None, 1)?.remove(0));
    }
    let mut creased = mesh.clone();
    for &attributes in creases.ok_or(RenderError::UnnamedCreases)? {
        creased = mark_creases(&creased, clip, attributes, &options)?;
    }
    Ok(record(clip, &creased, options, None, 1)?.remove(0))
}

/// The fragments of what is seen behind `front`, fragments of the same image with the same `options`:
/// at each pixel of `front` the nearest face behind the face there. Where depths are equal, faces follow
/// each other in the order of their indices. So each face that covers a pixel centre is seen in one layer
/// there. The last layer has none behind it: then there are no fragments.
///
/// A layer costs some three times what [`rasterize`] costs: [`depth_layers`] finds several for that.
///
/// # Errors
/// - [`RenderError::ExactLayers`] for exact coverage: the pieces of a boundary pixel hold what is visible
///   in it, and nothing is known of what lies behind a piece.
/// - [`RenderError::LayerSize`] for options with another size.
/// - As [`rasterize`], and for fragments that are not whole.
pub fn rasterize_behind<'t, T: Scalar>(
    front: &Fragments<'t, T>,
    options: impl Into<RasterOptions>,
) -> Result<Fragments<'t, T>, RenderError> {
    let options = options.into();
    let coverage = front.checked_coverage(BEHIND, front.clip.tape())?;
    if coverage.is_exact() || options.sampling.has_pieces() {
        return Err(RenderError::ExactLayers { operation: BEHIND });
    }
    if options.size != coverage.size() {
        return Err(RenderError::LayerSize { expected: coverage.size(), given: options.size });
    }
    let mesh = coverage.mesh().clone();
    Ok(record(front.clip, &mesh, options, Some(coverage), 1)?.remove(0))
}

/// The fragments of all surfaces that pixel centres see one behind another, the nearest first: at most
/// `most` layers, or all that there are. A layer without fragments is none. See [`rasterize_behind`].
///
/// Up to four layers are found at once, as one operation. Three cost some three to four times what [`rasterize`]
/// costs.
///
/// # Errors
/// As [`rasterize`], and [`RenderError::ExactLayers`] for exact coverage.
pub fn depth_layers<'t, T: Scalar>(
    clip: Var<'t, T>,
    mesh: &Mesh,
    options: impl Into<RasterOptions>,
    most: Option<usize>,
) -> Result<Vec<Fragments<'t, T>>, RenderError> {
    let options = options.into();
    if options.sampling.has_pieces() {
        return Err(RenderError::ExactLayers { operation: "depth_layers" });
    }
    let mut layers: Vec<Fragments<'t, T>> = Vec::new();
    loop {
        let wanted = most.map_or(LAYERS_AT_ONCE, |most| LAYERS_AT_ONCE.min(most - layers.len()));
        if wanted == 0 {
            return Ok(layers);
        }
        let front = layers.last().map(|front| Arc::clone(&front.coverage));
        let found = record(clip, mesh, options, front, wanted)?;
        let before = layers.len();
        layers.extend(found.into_iter().take_while(|layer| layer.coverage.count() > 0));
        if layers.len() < before + wanted {
            return Ok(layers);
        }
    }
}

/// Layers that one walk over the faces finds: their depths stay in a core's cache.
const LAYERS_AT_ONCE: usize = 4;

const BEHIND: &str = "rasterize_behind";

/// As many layers as [`depth_layers`] finds at once, without memory of their own.
type Layers<L> = SmallVec<[L; LAYERS_AT_ONCE]>;

/// [`rasterize()`], compiled once: the nearest `layers`, or those behind `front`, some perhaps without fragments.
#[inline(never)]
fn record<'t, T: Scalar>(
    clip: Var<'t, T>,
    mesh: &Mesh,
    options: RasterOptions,
    front: Option<Arc<Coverage>>,
    layers: usize,
) -> Result<Layers<Fragments<'t, T>>, RenderError> {
    options.size.checked()?;
    let op = Rasterize { mesh: mesh.clone(), options, front, layers };
    let look = |saved: &Saved<T>| (saved.layers.clone(), saved.visibility.reaches_behind);
    let (outputs, (layers, reaches_behind)) = clip.tape().record_with(op, &[clip], look)?;
    if !reaches_behind {
        clip.tape().leave_out("rasterize", "whole rows: no face reaches behind the eye");
    }
    let BoundaryCounts { dropped, sampled, .. } = layers[0].boundary_counts();
    let cuts = [
        (dropped > 0, "exact visibility: pieces below 1e-14 of a pixel are dropped"),
        (sampled > 0.0, "exact visibility: where too many faces meet, parts of pixels are sampled"),
    ];
    for (is_cut, reason) in cuts {
        if is_cut {
            clip.tape().leave_out("rasterize", reason);
        }
    }
    let weight = (options.sampling.has_pieces()).then(|| outputs[1]);
    let fragments = |(coverage, &barycentrics)| Fragments { barycentrics, weight, clip, coverage };
    Ok(layers.into_iter().zip(&outputs).map(fragments).collect())
}

/// Input: clip `[V, 4]`. Outputs: the barycentrics `[N, 2]` of each layer, and with exact coverage, which has
/// one, the weights `[K]` of the pieces.
struct Rasterize {
    mesh: Mesh,
    options: RasterOptions,
    /// The layer in front, if what is behind a layer is looked for.
    front: Option<Arc<Coverage>>,
    /// How many layers are looked for.
    layers: usize,
}

/// The coverage of each layer, shared with the fragments that were handed out, and the memory of the search.
#[derive(Debug, Default)]
struct Saved<T: Scalar> {
    layers: Layers<Arc<Coverage>>,
    visibility: Visibility<T>,
    /// Of each band, where bands are worked on at the same time.
    adjoints: Vec<Adjoints<T::Wide>>,
    /// Memory for sums over faces.
    rows: Workbench<Vec<T>>,
}

impl<T: Scalar> Saved<T> {
    /// Makes room for the coverage of layers: that of an earlier step is written over where nobody else holds
    /// it.
    fn make_layers(&mut self, Rasterize { mesh, options, layers, .. }: &Rasterize) {
        let empty = || Arc::new(Coverage::empty(mesh.clone(), options.size));
        self.layers.resize_with(*layers, empty);
        for layer in &mut self.layers {
            if Arc::get_mut(layer).is_none() {
                *layer = empty();
            }
            let coverage = Arc::get_mut(layer).expect("nobody else holds it");
            coverage.mesh = mesh.clone();
            coverage.size = options.size;
            coverage.antialias = options.antialias && options.sampling == Sampling::Center;
        }
    }
}

/// Lets `work` fill the parts of a whole, side by side from its front, perhaps at the same time. Each
/// part comes with its length.
fn fill_parts<T: Scalar, P: Send + Sync>(
    whole: &mut [T],
    parts: impl ExactSizeIterator<Item = (usize, P)> + Send,
    are_shared: bool,
    work: impl Fn(&mut [T], &P) + Send + Sync,
) {
    let mut left = whole;
    let pairs = parts.map(|(length, part)| {
        let (target, rest) = std::mem::take(&mut left).split_at_mut(length);
        left = rest;
        (target, part)
    });
    merge_each(are_shared, pairs, |(target, part): (&mut [T], P)| work(target, &part), |()| {});
}

impl Rasterize {
    /// Adds the outputs of a layer.
    fn push_layer<T: Scalar>(
        &self,
        visibility: &Visibility<T>,
        clip: &[T],
        layer: usize,
        coverage: &Coverage,
        outputs: &mut Outputs<'_, T>,
    ) {
        let pieces = coverage.count() - coverage.centers();
        let barycentrics = [coverage.count(), 2].into();
        let (barycentrics, weights) = match self.options.sampling {
            Sampling::Center => (outputs.push(barycentrics), None),
            Sampling::Exact => {
                let [barycentrics, weights] = outputs.push_all([barycentrics, [pieces].into()]);
                (barycentrics, Some(weights))
            }
        };
        let (runs, were_settled) = (&coverage.centers, visibility.were_settled(layer));
        let view = &visibility.drawn(clip, &self.mesh, self.options, &coverage.orientations);
        let (at_centers, rest) = barycentrics.split_at_mut(2 * runs.count);
        runs.for_each_band_mut(2, at_centers, |slots, first, barycentrics| {
            dispatch::<T, _>(Weigh { view, runs, slots, first, were_settled, barycentrics });
        });
        if let Some(weights) = weights {
            let copy = |target: &mut [T], part: &&[T]| target.copy_from_slice(part);
            let are_shared = runs.is_shared();
            let of_pieces = visibility.bands().map(|band| &band.piece_fragments);
            let means = of_pieces
                .clone()
                .map(|fragments| (fragments.barycentrics.len(), &*fragments.barycentrics));
            fill_parts(rest, means, are_shared, copy);
            let shares = of_pieces.map(|fragments| (fragments.weights.len(), &*fragments.weights));
            fill_parts(weights, shares, are_shared, copy);
        }
    }

    /// Adds the gradients that reach the vertices through the pieces of boundary pixels.
    fn pull_back_pieces<T: Scalar>(
        &self,
        kept: &Kept<'_, T>,
        coverage: &Coverage,
        visibility: &Visibility<T>,
        adjoints: &mut Vec<Adjoints<T::Wide>>,
        clip_bar: &mut Accumulator<T>,
    ) {
        let entries = clip_bar.entries();
        let corners = visibility.corners(kept.input(0), self.options.size);
        let mut add = |face: usize, rows: &[[T::Wide; 4]; 3]| {
            for (&vertex, row) in self.mesh.faces()[face].iter().zip(rows) {
                let entries = &mut entries[4 * vertex as usize..][..4];
                entries.iter_mut().zip(row).for_each(|(e, &term)| add_term(e, T::narrow(term)));
            }
        };
        let mut first = coverage.centers();
        let bands = visibility.bands().zip(visibility.faces()).map(|(band, faces)| {
            let count = band.piece_fragments.fragments.len();
            let (pieces, weights) = (first..first + count, first - coverage.centers());
            first = pieces.end;
            exact::PiecePullBack {
                mesh: &self.mesh,
                size: self.options.size,
                corners,
                faces,
                pieces: &band.pieces,
                fragments: &band.piece_fragments.fragments,
                barycentrics_bar: kept
                    .upstream(0)
                    .map(|bars| &bars[2 * pieces.start..2 * pieces.end]),
                weights_bar: kept.upstream(1).map(|bars| &bars[weights..weights + count]),
            }
        });
        if !coverage.pieces.is_shared() {
            adjoints.resize_with(1, Adjoints::default);
            return bands.for_each(|band| adjoints[0].sum(&band, &mut add));
        }
        let bands: Vec<_> = bands.collect();
        let work =
            |band: Range<usize>, adjoints: &mut Adjoints<_>| adjoints.keep(&bands[band.start]);
        merge_ranges_into(adjoints, bands.len(), 1, work, |adjoints| {
            adjoints.rows.iter().for_each(|(face, rows)| add(*face, rows));
        });
    }
}

/// Coordinates that are looked at before it is asked whether all are finite.
const COORDINATES_PER_PIECE: usize = 1 << 8;

/// # Errors
/// [`RenderError::Shape`] unless `clip` has a row of four for each vertex; [`RenderError::Position`] for a coordinate
/// that is not finite.
fn check_positions<T: Scalar>(
    operation: &'static str,
    mesh: &Mesh,
    shape: &Shape,
    clip: &[T],
) -> Result<(), RenderError> {
    if **shape != [mesh.vertex_count(), 4] {
        let rule = format!("clip positions of shape [{}, 4]", mesh.vertex_count());
        return Err(RenderError::shape(operation, rule, shape));
    }
    // In pieces without a branch, which are compiled to vectors.
    let are_finite = |piece: &[T]| piece.iter().fold(true, |all, c| all & c.is_finite());
    if !clip.chunks(COORDINATES_PER_PIECE).all(are_finite)
        && let Some(index) = clip.iter().position(|coordinate| !coordinate.is_finite())
    {
        let vertex = index / 4;
        let [x, y, z, w] = std::array::from_fn(|k| clip[4 * vertex + k].to_f64());
        return Err(RenderError::Position { vertex, x, y, z, w });
    }
    Ok(())
}

impl<T: Scalar> Op<T> for Rasterize {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "rasterize"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (clip, shape) = (inputs.data(0), inputs.shape(0));
        check_positions("rasterize", &self.mesh, shape, clip)?;
        saved.make_layers(self);
        let Saved { layers, visibility, .. } = saved;
        let (front, needs) = (self.front.as_deref(), inputs.needs(0));
        visibility.run(clip, self.options, needs, front, &self.mesh, layers);
        for (layer, coverage) in layers.iter().enumerate() {
            self.push_layer(visibility, clip, layer, coverage, outputs);
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        (0..self.layers).fold(Keep::NOTHING.input(0), Keep::output)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Saved { layers, visibility, adjoints, rows } = saved;
        if self.options.sampling.has_pieces() {
            // Of their own first: those of neighbouring slivers may be large, and cancel.
            let others = gradients.take(0);
            if let Some(clip_bar) = gradients.get(0) {
                self.pull_back_pieces(kept, &layers[0], visibility, adjoints, clip_bar);
            }
            if let Some(others) = others {
                gradients.put_back(0, others);
            }
        }
        let Some(clip_bar) = gradients.get(0) else { return };
        for (layer, coverage) in layers.iter().enumerate().rev() {
            let Some(uv_bar) = kept.upstream(layer) else { continue };
            // Vertices have mostly got theirs directly: see `direct_gradients`.
            if are_zero(&uv_bar[..2 * coverage.centers()]) {
                // All zeros, where nothing else is there.
                clip_bar.entries();
                continue;
            }
            let corners = visibility.corners(kept.input(0), self.options.size);
            let uv = kept.output(layer);
            let pull_back = WeightPullBack { coverage, corners, uv, uv_bar };
            let layout = Layout { runs: &coverage.centers, mesh: &self.mesh, width: 4 };
            layout.add_to(clip_bar, &pull_back, rows);
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let pieces: usize = saved.visibility.bands().map(|band| band.pieces.bytes()).sum();
        let lists = saved.rows.bytes();
        saved.layers.iter().map(|coverage| coverage.bytes()).sum::<usize>() + pieces + lists
    }
}

/// Whether all numbers are 0: some of them are looked at before a branch, so that the compiler makes vectors.
fn are_zero<T: Scalar>(numbers: &[T]) -> bool {
    numbers.chunks(64).all(|some| some.iter().fold(true, |all, it| all & it.is_same(T::ZERO)))
}
