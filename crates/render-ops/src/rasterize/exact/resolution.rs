//! A boundary pixel resolved into pieces.

use bokashi_core::Scalar;

use super::band_faces::BandFaces;
use super::cell::Cell;
use super::cells::Crowd;
use super::depth_intervals::{DepthInterval, depth_groups};
use super::extent::Extent;
use super::mean::{barycentrics, total};
use super::parts::Side;
use super::pieces::{Piece, Pieces, Segment};
use super::pixel_border::{WIDER, halves};
use super::ties::share_planes;
use super::visible::{Candidate, SMALLEST, Visible};
use crate::raster_options::Limits;

/// Stands for "no piece".
const NONE: u32 = u32::MAX;

/// What is visible of a candidate.
#[derive(Debug)]
struct VisibleFace<S> {
    candidate: u32,
    area: S,
    extent: Extent<S>,
}

/// The memory of the search.
#[derive(Debug, Default)]
pub(super) struct Resolution<S> {
    /// The faces of the pixel, the nearest first: as many as were looked at.
    candidates: Vec<Candidate<S>>,
    /// Those that tie, in the order in which they are given planes.
    order: Vec<u32>,
    visible: Visible<S>,
    /// The faces of the cells of a crowded pixel.
    cell_faces: Vec<DepthInterval<S>>,
    visible_faces: Vec<VisibleFace<S>>,
    /// Per candidate: its piece, counted from the pixel's first.
    piece_of: Vec<u32>,
    /// The sides on the pixel's border.
    border_sides: Vec<(u32, Side<S>)>,
}

impl<S: Scalar<Wide = S>> Resolution<S> {
    /// Finds the pieces of a pixel. `intervals` are the depths of its faces, the nearest first, and
    /// `candidate` tells a face of the band around the pixel's centre.
    #[inline(always)]
    pub(super) fn run<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        pixel: u32,
        intervals: &[DepthInterval<S>],
        candidate: impl Fn(u32) -> Candidate<S> + Copy,
        pieces: &mut Pieces<S>,
    ) {
        let (needs, limits) = (band.view.needs, band.view.limits);
        self.candidates.clear();
        if let Some(sampled) =
            self.find_parts(Cell::around_center(S::ONE), intervals, candidate, limits)
        {
            pieces.crowded += 1;
            pieces.sampled += 0.25 * sampled.to_f64();
        }
        self.find_visible_faces(needs, pieces);
        let Self { candidates, visible, visible_faces, piece_of, .. } = self;
        pieces.pixels.push(pixel);
        let first = pieces.pieces.len();
        // Sides know candidates; gradients need the pieces, which are sorted.
        piece_of.clear();
        piece_of.resize(candidates.len(), NONE);
        for (piece, &VisibleFace { candidate, area, extent }) in (0..).zip(&*visible_faces) {
            piece_of[candidate as usize] = piece;
            let face = &candidates[candidate as usize];
            let barycentrics = barycentrics(&face.edges, face.factors, &extent);
            let band_face = face.band_face;
            pieces.pieces.push(Piece { band_face, area, extent, moves: true, barycentrics });
        }
        let touches_border = visible.parts.touches_border;
        if needs {
            visible.parts.for_each_side(|candidate, side| {
                let piece = piece_of[candidate as usize];
                // Those on the border are found apart.
                if piece != NONE && !(touches_border && side.is_on_border) {
                    pieces.segments.push(Segment { piece, side });
                }
            });
        }
        if touches_border {
            self.add_border_sides(band, intervals, candidate, pieces);
        }
        if pieces.pieces.get(first).is_some_and(|piece| piece.area == S::ZERO) {
            pieces.unseen.push(pixel);
        }
        pieces.ends.push(pieces.pieces.len() as u32);
        if needs {
            pieces.segment_ends.push(pieces.segments.len() as u32);
        }
    }

    /// Finds the extents of what is visible of each candidate, the largest first.
    #[inline(always)]
    fn find_visible_faces(&mut self, spreads: bool, pieces: &mut Pieces<S>) {
        let Self { candidates, visible, visible_faces, .. } = self;
        // A pixel has 4 units of area.
        let smallest = S::from_f64(4.0 * SMALLEST);
        visible_faces.clear();
        for parts in visible.parts.by_candidate() {
            let candidate = parts[0].candidate;
            let area = parts.iter().map(|part| part.area).sum();
            if area > smallest {
                let face = &candidates[candidate as usize];
                let t = total(&face.edges, face.factors);
                let extent = visible.parts.extent(parts, area, t, spreads);
                visible_faces.extend(extent.map(|extent| VisibleFace { candidate, area, extent }));
            } else if area > S::ZERO {
                pieces.dropped += 1;
            }
        }
        // The largest first; where pieces are as large, the lower face.
        let face = |face: &VisibleFace<S>| candidates[face.candidate as usize].band_face;
        visible_faces.sort_unstable_by(|a, b| {
            b.area.to_f64().total_cmp(&a.area.to_f64()).then_with(|| face(a).cmp(&face(b)))
        });
    }

    /// Finds what is visible of the faces of `intervals` in the pixel, which reaches as far as `cell`.
    /// Returns the area that was sampled where the pixel is crowded.
    #[inline(always)]
    fn find_parts(
        &mut self,
        cell: Cell<S>,
        intervals: &[DepthInterval<S>],
        candidate: impl Fn(u32) -> Candidate<S>,
        limits: Limits,
    ) -> Option<S> {
        let Self { candidates, order, visible, cell_faces, .. } = self;
        let gather = |candidates: &mut Vec<Candidate<S>>, end: usize| {
            let known = candidates.len().min(end);
            candidates
                .extend(intervals[known..end].iter().map(|interval| candidate(interval.face)));
        };
        visible.begin(cell, limits.cuts);
        let (mut end, mut is_crowded) = (0, false);
        for group in depth_groups(intervals) {
            let first = end;
            end += group.len();
            // The time for a group goes with the square of its faces.
            is_crowded = group.len() > limits.faces;
            if !is_crowded {
                gather(candidates, end);
                share_planes(&mut candidates[first..end], order);
                // What meets at an edge has the same depths there, so it is in the same group.
                let end_at_edges = group.iter().all(DepthInterval::is_within);
                is_crowded = !visible.add(candidates, first as u32..end as u32, end_at_edges);
            }
            if is_crowded || visible.fills_cell() {
                break;
            }
        }
        if !is_crowded {
            return None;
        }
        // The cells start anew, with all faces: what groups have given so far is forgotten.
        gather(candidates, intervals.len());
        Some(find_in_cells(cell, intervals, candidates, visible, cell_faces, limits))
    }

    /// Finds the sides on the border of a pixel, and adds them to its last segments. What has no piece
    /// beside such a side becomes two pieces without an area.
    #[cold]
    #[inline(never)]
    fn add_border_sides<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        intervals: &[DepthInterval<S>],
        candidate: impl Fn(u32) -> Candidate<S>,
        pieces: &mut Pieces<S>,
    ) {
        // What is sampled in the wide pixel lacks its sides, as in the pixel, and has been counted there.
        self.find_parts(
            Cell::around_center(S::from_f64(WIDER)),
            intervals,
            candidate,
            band.view.limits,
        );
        let Self { candidates, visible, visible_faces, piece_of, border_sides, .. } = self;
        border_sides.clear();
        visible.parts.add_border_sides(border_sides);
        piece_of.resize(candidates.len(), NONE);
        let mut count = visible_faces.len() as u32;
        for &(candidate, side) in &*border_sides {
            let mut keep = |piece: u32, side: Side<S>| {
                if band.view.needs {
                    pieces.segments.push(Segment { piece, side });
                }
            };
            let piece = piece_of[candidate as usize];
            if piece != NONE {
                keep(piece, side);
                continue;
            }
            let Candidate { band_face, edges, factors, .. } = &candidates[candidate as usize];
            for (ends, point) in halves(side.ends) {
                keep(count, Side { ends, ..side });
                count += 1;
                let extent = Extent::from_point(point);
                let barycentrics = barycentrics(edges, *factors, &extent);
                pieces.pieces.push(Piece {
                    band_face: *band_face,
                    area: S::ZERO,
                    extent,
                    moves: false,
                    barycentrics,
                });
            }
        }
    }
}

/// Finds what is visible in the cells of a crowded pixel; returns the area that was sampled.
#[cold]
#[inline(never)]
fn find_in_cells<S: Scalar>(
    cell: Cell<S>,
    intervals: &[DepthInterval<S>],
    candidates: &[Candidate<S>],
    visible: &mut Visible<S>,
    faces: &mut Vec<DepthInterval<S>>,
    limits: Limits,
) -> S {
    faces.clear();
    faces.extend((0..).zip(intervals).map(|(face, &interval)| DepthInterval { face, ..interval }));
    let all = 0..faces.len();
    let mut crowd = Crowd { limits, candidates, visible, faces, sampled: S::ZERO };
    crowd.divide(cell, 0, all, limits.work);
    let sampled = crowd.sampled;
    visible.join_cells();
    sampled
}
