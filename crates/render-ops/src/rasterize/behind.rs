//! The surfaces behind a surface: depth peeling of several layers at once.
//!
//! A pixel sees the faces behind the one in front in the order of their depths, and where depths are
//! equal, of their indices. So every face that covers the pixel is seen in one layer, and none in two.
//! Depths are compared as they are computed for visibility, to the last bit.
//!
//! Each face is drawn alone. What is behind the layer in front changes places, pixel by pixel, with what
//! the next layer has, where that is farther away. The farther one of both goes on to the layer after it. So
//! one walk over a band's faces sorts them into all layers.
//!
//! # Source
//! Everitt, *Interactive order-independent transparency*, NVIDIA 2001. Several layers at once: Bavoil et al.,
//! *Multi-fragment effects on the GPU using the k-buffer*, I3D 2007.

use std::ops::Range;
use std::sync::atomic::{Ordering, compiler_fence};

use bokashi_core::Scalar;

use super::plane::{NO_FACE, Plane};
use super::prepared::Prepared;
use super::setup::{LANES, Setup, Weights, beyond, lanes};
use crate::coverage::Coverage;

/// Memory for the layers of a band.
#[derive(Debug)]
pub(super) struct Peeling<S> {
    /// What is in front of them: a pixel in which nothing is has nothing behind it, either.
    pub(super) front: Plane<S>,
    /// What is kept of the faces in front.
    pub(super) weights: Vec<Weights<S>>,
    /// From the nearest on.
    pub(super) layers: Vec<Plane<S>>,
}

impl<S> Default for Peeling<S> {
    fn default() -> Self {
        Self { front: Plane::default(), weights: Vec::new(), layers: Vec::new() }
    }
}

impl<S: Scalar<Wide = S>> Peeling<S> {
    /// Makes it that for `view`.
    pub(super) fn fit<T: Scalar<Wide = S>>(&mut self, view: &Prepared<'_, T>) {
        let count = view.layers - usize::from(view.front.is_none());
        self.layers.resize_with(count, Plane::default);
        self.layers.iter_mut().for_each(|layer| layer.fit(view));
        if count > 0 {
            self.front.fit(view);
        }
    }
}

impl<S: Scalar<Wide = S>> Plane<S> {
    /// Draws the band of `rows` of a layer that was found before. Where depths are equal, a face of `faces`
    /// is behind that of the layer if its position there is above what is drawn.
    pub(super) fn draw_front<T: Scalar<Wide = S>>(
        &mut self,
        view: &Prepared<'_, T>,
        front: &Coverage,
        rows: Range<usize>,
        faces: &[u32],
    ) {
        let width = view.size.width;
        let band = rows.start / view.rows;
        for slot in front.centers.slots_of(band..band + 1) {
            let face = front.centers.face(slot);
            // As many faces up to this one less one: its position.
            let position = faces.partition_point(|&other| other as usize <= face).saturating_sub(1);
            let orientation = view.verdicts[face].orientation;
            let mut setup = Setup::new(view.corners_of(face), orientation, view.size);
            for run in front.centers.in_slot(slot) {
                let [row, column] = view.size.row_and_column(run.pixel as usize);
                let columns = [column, column + run.length as usize];
                let (depths, faces, reached) = self.row(row - rows.start);
                let centers = &view.centers[..width];
                let edges = setup.row(view.ys[row]);
                let [first, end] =
                    setup.cover_span(&edges, columns, centers, depths, faces, position as u64);
                *reached = [reached[0].min(first), reached[1].max(end)];
            }
        }
    }
}

/// The work of sorting a face, drawn alone in some rows of a plane, into layers.
pub(super) struct SortIn<'a, S> {
    pub(super) drawn: &'a mut Plane<S>,
    pub(super) front: &'a Plane<S>,
    pub(super) layers: &'a mut [Plane<S>],
    /// Rows of the band.
    pub(super) rows: Range<usize>,
}

impl<S: Scalar<Wide = S>> pulp::WithSimd for SortIn<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { drawn, front, layers, rows } = self;
        for row in rows {
            let [first, end] = drawn.take_reached(row);
            if first >= end {
                continue;
            }
            let blocks = drawn.blocks(row, [first, end]);
            let (depths, faces) =
                (&mut drawn.depths[blocks.clone()], &mut drawn.faces[blocks.clone()]);
            let before = (&front.depths[blocks.clone()], &front.faces[blocks.clone()]);
            let mut is_left = keep_behind((depths, faces), before);
            for layer in &mut *layers {
                if !is_left {
                    break;
                }
                let reached = &mut layer.reached[row];
                *reached = [reached[0].min(first), reached[1].max(end)];
                let kept = (&mut layer.depths[blocks.clone()], &mut layer.faces[blocks.clone()]);
                is_left = keep_nearer((depths, faces), kept);
            }
            if is_left {
                depths.fill([beyond(); LANES]);
                faces.fill([NO_FACE; LANES]);
            }
        }
        drawn.reached_by_blocks = [usize::MAX, 0];
    }
}

/// The depths of neighbouring pixels, in blocks, and the positions of their faces.
type Blocks<'a, S> = (&'a mut [[S; LANES]], &'a mut [[u64; LANES]]);

/// Forgets what is not behind `front`; returns whether something is left.
#[inline(always)]
fn keep_behind<S: Scalar>(
    (depths, faces): Blocks<'_, S>,
    front: (&[[S; LANES]], &[[u64; LANES]]),
) -> bool {
    let mut nearest = [beyond(); LANES];
    let fronts = front.0.iter().zip(front.1);
    for ((depth, face), (front, front_face)) in depths.iter_mut().zip(faces).zip(fronts) {
        let (before, face_before) = (*depth, *face);
        compiler_fence(Ordering::SeqCst);
        let is_behind = lanes(|k| {
            (before[k] > front[k]) | (before[k] == front[k]) & (face_before[k] > front_face[k])
        });
        let kept = lanes(|k| if is_behind[k] { before[k] } else { beyond() });
        *depth = kept;
        *face = lanes(|k| if is_behind[k] { face_before[k] } else { NO_FACE });
        nearest = lanes(|k| if kept[k] < nearest[k] { kept[k] } else { nearest[k] });
    }
    nearest.iter().any(|&depth| depth < beyond())
}

/// Exchanges what is nearer than what a layer has with that; returns whether something is left to go on to
/// the next layer.
#[inline(always)]
fn keep_nearer<S: Scalar>(
    (depths, faces): Blocks<'_, S>,
    (kept_depths, kept_faces): Blocks<'_, S>,
) -> bool {
    let mut nearest = [beyond(); LANES];
    let kept = kept_depths.iter_mut().zip(kept_faces);
    for ((depth, face), (kept, kept_face)) in depths.iter_mut().zip(faces).zip(kept) {
        let (a, b, face_a, face_b) = (*depth, *kept, *face, *kept_face);
        compiler_fence(Ordering::SeqCst);
        let is_nearer = lanes(|k| (a[k] < b[k]) | (a[k] == b[k]) & (face_a[k] < face_b[k]));
        let left = lanes(|k| if is_nearer[k] { b[k] } else { a[k] });
        *kept = lanes(|k| if is_nearer[k] { a[k] } else { b[k] });
        *kept_face = lanes(|k| if is_nearer[k] { face_a[k] } else { face_b[k] });
        *depth = left;
        *face = lanes(|k| if is_nearer[k] { face_b[k] } else { face_a[k] });
        nearest = lanes(|k| if left[k] < nearest[k] { left[k] } else { nearest[k] });
    }
    nearest.iter().any(|&depth| depth < beyond())
}
