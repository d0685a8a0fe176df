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

use std::ops::Range;

use bokashi_core::{Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};
use pulp::{Simd, WithSimd};

use crate::attributes::Attributes;
use crate::direct_gradients::{DirectGradients, FaceLists};
use crate::dispatch::dispatch;
use crate::error::RenderError;
use crate::face_sums::{FaceSums, Layout};
use crate::fragments::Fragments;
use crate::mesh::Mesh;
use crate::planes::{CAPACITY, LANES, Plane, join, load, split, zeros};
use crate::runs::Runs;
use crate::scratch::Workbench;
use crate::weighted_sums::{FragmentPlanes, Terms};

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
/// - [`RenderError::FaceCount`] unless `indices` has as many faces as the mesh that was rasterized.
/// - [`RenderError::Shape`] unless the attributes are `[A, C]` with A its number of vertices, and for
///   fragments that are not whole.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn interpolate_indexed<'t, T: Scalar>(
    attributes: Var<'t, T>,
    indices: &Mesh,
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let coverage = fragments.checked_coverage("interpolate", attributes.tape())?;
    let shown = Attributes::new(indices, coverage)?;
    let channels = shown.channels("interpolate", &attributes.shape())?;
    let tape = attributes.tape();
    let mut barycentrics = fragments.barycentrics;
    if barycentrics.needs_gradient()
        && !attributes.needs_gradient()
        && is_uniform(attributes, indices)
    {
        // No gradient could ever pass: nothing of `rasterize` need run backward, and who asks why
        // the vertices get none finds the way ended here.
        tape.leave_out(
            "interpolate",
            "attributes that are one constant: no barycentrics' gradient",
        );
        barycentrics = barycentrics.detach();
    }
    let is_direct = channels == 3
        && barycentrics.needs_gradient()
        && barycentrics.is_computed_from("rasterize", fragments.clip);
    let inputs = [attributes, barycentrics, fragments.clip];
    let count = if is_direct { 3 } else { 2 };
    tape.apply(Interpolate { shown, is_direct }, &inputs[..count])
}

/// Whether `attributes` are `[A, C]` with all rows the same.
fn is_uniform<T: Scalar>(attributes: Var<'_, T>, indices: &Mesh) -> bool {
    let value = attributes.value();
    let &[rows, channels] = &**value.shape() else { return false };
    // Equal numbers that are not finite differ by NaN, as `A_0 - A_2` has it.
    rows == indices.vertex_count()
        && channels > 0
        && value.data().windows(channels + 1).all(|pair| pair[0].is_same(pair[channels]))
        && value.data().iter().take(channels).all(|entry| entry.is_finite())
}

/// Inputs: attributes `[A, C]`, barycentrics `[N, 2]`, and where these lead to clip positions `[V, 4]` directly,
/// those, too.
struct Interpolate {
    shown: Attributes,
    /// Whether the attributes have three channels, and the barycentrics are those of `rasterize`.
    is_direct: bool,
}

/// Memory for sums over faces.
#[derive(Debug, Default)]
struct Lists<T> {
    direct: FaceLists<T>,
    rows: Workbench<Vec<T>>,
}

impl<T: Scalar> Op<T> for Interpolate {
    type Saved = Lists<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "interpolate"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _lists: &mut Lists<T>,
    ) -> Result<(), RenderError> {
        let channels = self.shown.channels("interpolate", inputs.shape(0))?;
        let (attributes, barycentrics) = (inputs.data(0), inputs.data(1));
        let values = outputs.try_push("interpolate", [self.shown.coverage.count(), channels])?;
        if channels == 3 {
            let (attributes, uv) = (attributes.as_chunks().0, barycentrics.as_chunks().0);
            self.interpolate_three(attributes, uv, values.as_chunks_mut().0);
            return Ok(());
        }
        self.shown.for_each_face_mut(
            attributes,
            values,
            channels,
            #[inline(always)]
            |fragments, corners, values| {
                let uv = &barycentrics[2 * fragments.start..2 * fragments.end];
                for c in 0..channels {
                    let corners = corners.map(|corner| &corner[c..]);
                    interpolate_one(corners, channels, uv, &mut values[c..]);
                }
            },
        );
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let keep = Keep::NOTHING.input_if(1, inputs.needs(0) | self.is_direct);
        keep.input_if(0, inputs.needs(1)).input_if(2, self.is_direct)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        lists: &mut Lists<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let s_bar = kept.only_upstream();
        let channels = kept.input_shape(0)[1];
        // Who asks for the gradient of the barycentrics gets it.
        if self.is_direct && gradients.needs(2) && !gradients.is_result(1) {
            let direct = self.direct(kept);
            if direct.has_even_weights() {
                return self.pull_back_directly(&direct, kept, lists, gradients);
            }
        }
        let mut barycentrics_bar = gradients.take(1);
        let uv_bar = barycentrics_bar.as_mut().map(Accumulator::entries_or_fresh);
        match (gradients.get(0), uv_bar) {
            (Some(attributes_bar), Some((mut rest, is_fresh))) => {
                for (layout, shares) in self.shares(kept.input(1), s_bar, channels) {
                    let (uv_bar, others) = rest.split_at_mut(2 * layout.runs.count);
                    rest = others;
                    // One walk for both: what is upstream is then read from memory once.
                    layout.add_to_and_visit(
                        attributes_bar,
                        &shares,
                        &lists.rows,
                        uv_bar,
                        #[inline(always)]
                        |slot, fragments, uv_bar| {
                            let face = layout.runs.face(slot);
                            let corners = self.shown.corners(kept.input(0), channels, face);
                            let s_bar =
                                &shares.s_bar[fragments.start * channels..fragments.end * channels];
                            pull_back_face(corners, s_bar, uv_bar, is_fresh);
                        },
                    );
                }
            }
            (Some(attributes_bar), None) => {
                for (layout, shares) in self.shares(kept.input(1), s_bar, channels) {
                    layout.add_to(attributes_bar, &shares, &lists.rows);
                }
            }
            (None, Some((uv_bar, is_fresh))) => self.shown.for_each_face_mut(
                kept.input(0),
                uv_bar,
                channels,
                #[inline(always)]
                |fragments, corners, uv_bar| {
                    let s_bar = &s_bar[fragments.start * channels..fragments.end * channels];
                    pull_back_face(corners, s_bar, uv_bar, is_fresh);
                },
            ),
            (None, None) => {}
        }
        if let Some(barycentrics_bar) = barycentrics_bar {
            gradients.put_back(1, barycentrics_bar);
        }
    }

    fn saved_bytes(&self, lists: &Lists<T>) -> usize {
        lists.direct.bytes() + lists.rows.bytes()
    }
}

impl Interpolate {
    /// The values of three channels.
    fn interpolate_three<T: Scalar>(
        &self,
        attributes: &[[T; 3]],
        uv: &[[T; 2]],
        values: &mut [[T; 3]],
    ) {
        let mut rest = values;
        for (runs, before) in self.shown.coverage.kinds() {
            let (values, others) = rest.split_at_mut(runs.count);
            rest = others;
            runs.for_each_band_mut(1, values, |slots, first, values| {
                let uv = &uv[before + first..][..values.len()];
                let indices = &self.shown.indices;
                dispatch::<T, _>(ThreeChannels {
                    runs,
                    slots,
                    first,
                    indices,
                    attributes,
                    uv,
                    values,
                });
            });
        }
    }

    /// What three channels lead to.
    fn direct<'a, T: Scalar>(&'a self, kept: &'a Kept<'_, T>) -> DirectGradients<'a, T> {
        DirectGradients {
            coverage: &self.shown.coverage,
            indices: &self.shown.indices,
            attributes: kept.input(0).as_chunks().0,
            barycentrics: kept.input(1).as_chunks().0,
            clip: kept.input(2).as_chunks().0,
            s_bar: kept.only_upstream().as_chunks().0,
        }
    }

    /// Adds the gradients of three channels to those of attributes and clip positions: see `direct_gradients`.
    fn pull_back_directly<T: Scalar>(
        &self,
        direct: &DirectGradients<'_, T>,
        kept: &Kept<'_, T>,
        lists: &Lists<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let coverage = &*self.shown.coverage;
        let (attributes, uv, s_bar) = (kept.input(0), kept.input(1), kept.only_upstream());
        let mut attributes_bar = gradients.take(0);
        let clip_bar = gradients.get(2).expect("it is wanted");
        let [(centers, shares), (pieces, shares_of_pieces)] = self.shares(uv, s_bar, 3);
        let add_attributes = |entries: &mut [T], slot| centers.add_slot(entries, &shares, slot);
        let left_out =
            direct.add_to(clip_bar, attributes_bar.as_mut(), &lists.direct, add_attributes);
        // Through `rasterize` go those that are left out, and the pieces of boundary pixels.
        if !left_out.is_empty() || coverage.pieces.count > 0 {
            let uv_bar = gradients.get(1).expect("what it leads to is wanted").entries();
            let (of_centers, of_pieces) = uv_bar.split_at_mut(2 * coverage.centers());
            for slot in left_out {
                let fragments = centers.runs.fragments_of(slot..slot + 1);
                let corners = self.shown.corners(attributes, 3, centers.runs.face(slot));
                let s_bar = &s_bar[3 * fragments.start..3 * fragments.end];
                let uv_bar = &mut of_centers[2 * fragments.start..2 * fragments.end];
                pull_back_face(corners, s_bar, uv_bar, false);
            }
            let visit = |slot, fragments: Range<usize>, uv_bar: &mut [T]| {
                let corners = self.shown.corners(attributes, 3, pieces.runs.face(slot));
                let s_bar = &shares_of_pieces.s_bar[3 * fragments.start..3 * fragments.end];
                pull_back_face(corners, s_bar, uv_bar, false);
            };
            match &mut attributes_bar {
                Some(bar) => {
                    let (shares, rows) = (&shares_of_pieces, &lists.rows);
                    pieces.add_to_and_visit(bar, shares, rows, of_pieces, visit);
                }
                None => pieces.runs.for_each_slot_mut(2, of_pieces, visit),
            }
        }
        if let Some(attributes_bar) = attributes_bar {
            gradients.put_back(0, attributes_bar);
        }
    }

    /// The shares of fragments at pixel centres, and those of pieces.
    fn shares<'a, T>(
        &'a self,
        barycentrics: &'a [T],
        s_bar: &'a [T],
        channels: usize,
    ) -> [(Layout<'a>, Shares<'a, T>); 2] {
        self.shown.coverage.kinds().map(|(runs, first)| {
            let (barycentrics, s_bar) = (&barycentrics[2 * first..], &s_bar[first * channels..]);
            let layout = Layout { runs, mesh: &self.shown.indices, width: channels };
            (layout, Shares { barycentrics, s_bar, channels })
        })
    }
}

/// Adds the gradients of u and v of a face's fragments; where they are fresh, writes them.
#[inline(always)]
fn pull_back_face<T: Scalar>(corners: [&[T]; 3], s_bar: &[T], uv_bar: &mut [T], is_fresh: bool) {
    match corners[0].len() {
        3 => pull_back_channels::<T, 3>(corners, 3, s_bar, uv_bar, is_fresh),
        channels => {
            for c in 0..channels {
                let corners = corners.map(|corner| &corner[c..]);
                let is_fresh = is_fresh && c == 0;
                pull_back_channels::<T, 1>(corners, channels, &s_bar[c..], uv_bar, is_fresh);
            }
        }
    }
}

/// Interpolates the first channel of `stride`.
#[inline(always)]
fn interpolate_one<T: Scalar>(corners: [&[T]; 3], stride: usize, uv: &[T], values: &mut [T]) {
    let [a0, a1, a2] = corners.map(|corner| corner[0]);
    for (s, uv) in values.chunks_mut(stride).zip(uv.as_chunks::<2>().0) {
        s[0] = interpolate_at([a0, a1, a2], *uv);
    }
}

/// The work of interpolating three channels of a band's fragments.
struct ThreeChannels<'a, T> {
    runs: &'a Runs,
    slots: Range<usize>,
    /// The first fragment.
    first: usize,
    indices: &'a Mesh,
    attributes: &'a [[T; 3]],
    uv: &'a [[T; 2]],
    values: &'a mut [[T; 3]],
}

impl<T: Scalar> WithSimd for ThreeChannels<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { runs, slots, first, indices, attributes, uv, values } = self;
        let (mut uv_planes, mut value_planes) = (zeros(), zeros());
        // The fragments whose u and v are in planes, and the end of those that are interpolated.
        let (mut range, mut done) = (0..0, 0);
        for slot in slots {
            let corners = indices.faces()[runs.face(slot)].map(|index| attributes[index as usize]);
            let fragments = runs.fragments_of(slot..slot + 1);
            let [start, end] = [fragments.start - first, fragments.end - first];
            if end - start >= MANY && end > range.end {
                join(&value_planes, &mut values[range.start..done]);
                (range, done) = (end..end, end);
                interpolate_rows(&corners, &uv[start..end], &mut values[start..end]);
            }
            while done < end {
                if done == range.end {
                    join(&value_planes, &mut values[range]);
                    range = done..values.len().min(done + CAPACITY);
                    split(&mut uv_planes, &uv[range.clone()]);
                }
                let here = done - range.start..end.min(range.end) - range.start;
                done = range.start + here.end;
                interpolate_planes(&corners, &uv_planes, &mut value_planes, here);
            }
        }
        join(&value_planes, &mut values[range.start..done]);
    }
}

/// A face with so many fragments needs no planes, unless they hold it.
const MANY: usize = 32;

/// Interpolates all fragments.
#[inline(always)]
fn interpolate_rows<T: Scalar>([a0, a1, a2]: &[[T; 3]; 3], uv: &[[T; 2]], values: &mut [[T; 3]]) {
    for (value, uv) in values.iter_mut().zip(uv) {
        for c in 0..3 {
            value[c] = interpolate_at([a0[c], a1[c], a2[c]], *uv);
        }
    }
}

/// Interpolates some fragments, and numbers behind them, which are written over or never read.
#[inline(always)]
fn interpolate_planes<T: Scalar>(
    [a0, a1, a2]: &[[T; 3]; 3],
    [us, vs]: &[Plane<T>; 2],
    values: &mut [Plane<T>; 3],
    fragments: Range<usize>,
) {
    // A range with steps would divide to count them.
    let mut first = fragments.start;
    while first < fragments.end {
        let (us, vs): ([T; LANES], [T; LANES]) = (load(us, first), load(vs, first));
        for c in 0..3 {
            let values: &mut [T; LANES] =
                values[c][first..].first_chunk_mut().expect("there is room");
            for k in 0..LANES {
                values[k] = interpolate_at([a0[c], a1[c], a2[c]], [us[k], vs[k]]);
            }
        }
        first += LANES;
    }
}

/// A channel, from those of the vertices.
#[inline(always)]
fn interpolate_at<T: Scalar>([a0, a1, a2]: [T; 3], [u, v]: [T; 2]) -> T {
    a2 + u * (a0 - a2) + v * (a1 - a2)
}

/// Adds the gradients of u and v from `N` channels of `stride` that start each row of `s_bar`; where
/// they are fresh, writes them.
#[inline(always)]
fn pull_back_channels<T: Scalar, const N: usize>(
    corners: [&[T]; 3],
    stride: usize,
    s_bar: &[T],
    uv_bar: &mut [T],
    is_fresh: bool,
) {
    let [a0, a1, a2] = corners.map(|corner| first_of::<T, N>(corner));
    for (uv_bar, s_bar) in uv_bar.as_chunks_mut::<2>().0.iter_mut().zip(s_bar.chunks(stride)) {
        let [mut u_bar, mut v_bar] = if is_fresh { [T::ZERO; 2] } else { *uv_bar };
        for c in 0..N {
            u_bar += s_bar[c] * (a0[c] - a2[c]);
            v_bar += s_bar[c] * (a1[c] - a2[c]);
        }
        *uv_bar = [u_bar, v_bar];
    }
}

#[inline(always)]
fn first_of<T: Scalar, const N: usize>(entries: &[T]) -> [T; N] {
    *entries.first_chunk().expect("as many channels")
}

/// The shares of each vertex in the gradients of interpolated attributes.
struct Shares<'a, T> {
    barycentrics: &'a [T],
    s_bar: &'a [T],
    channels: usize,
}

impl<'a, T: Scalar> FaceSums<T::Wide> for Shares<'a, T> {
    /// Of three channels.
    type Memory = Option<FragmentPlanes<'a, T, 3>>;

    fn memory(&self) -> Self::Memory {
        let (uv, s_bar) = (self.barycentrics.as_chunks().0, self.s_bar.as_chunks().0);
        (self.channels == 3).then(|| FragmentPlanes::new(uv, s_bar))
    }

    #[inline(always)]
    fn sum(
        &self,
        planes: &mut Self::Memory,
        _slot: usize,
        fragments: Range<usize>,
        rows: &mut [T::Wide],
    ) {
        match planes {
            Some(planes) => {
                let sums = planes.sum(&Channels, fragments);
                rows.copy_from_slice(sums.as_flattened());
            }
            None => {
                let channels = self.channels;
                let uv = &self.barycentrics[2 * fragments.start..2 * fragments.end];
                let s_bar = &self.s_bar[fragments.start * channels..fragments.end * channels];
                for c in 0..channels {
                    sum_shares(channels, uv, &s_bar[c..], &mut rows[c..]);
                }
            }
        }
    }
}

/// The gradients of three channels, as they are.
struct Channels;

impl<S: Scalar> Terms<S, 3, 3> for Channels {
    #[inline(always)]
    fn compute(&self, _: [S; 2], s_bar: [S; 3]) -> [S; 3] {
        s_bar
    }
}

/// The shares from the first channel of `stride`, in each row of `s_bar` and of the vertices' `rows`.
#[inline(always)]
fn sum_shares<T: Scalar>(stride: usize, uv: &[T], s_bar: &[T], rows: &mut [T::Wide]) {
    let mut sums = [T::Wide::ZERO; 3];
    for (uv, s_bar) in uv.chunks_exact(2).zip(s_bar.chunks(stride)) {
        let (u, v) = (uv[0].widen(), uv[1].widen());
        let shares = [u, v, T::Wide::ONE - u - v];
        let s_bar = s_bar[0].widen();
        for (sum, share) in sums.iter_mut().zip(shares) {
            *sum += share * s_bar;
        }
    }
    for (row, sum) in rows.chunks_mut(stride).zip(sums) {
        row[0] = sum;
    }
}
