//! The boundary pixels of a band: which they are, which faces they hold, and into which pieces they
//! fall.

use std::ops::Range;

use bokashi_core::Scalar;

use super::band_faces::{ALONG_AXIS, BEYOND_DEPTHS, BandFaces, Plane, REACH};
use super::depth_intervals::{DepthInterval, depth_groups, front_layers, may_cross};
use super::extent::Extent;
use super::faces_by_pixel::FacesByPixel;
use super::mean::{barycentrics, total};
use super::outline::{Covered, Outline};
use super::pieces::{Piece, Pieces, Segment};
use super::pixel_border::{WIDER, halves, is_along_axis};
use super::pixel_mask::PixelMask;
use super::polygon::Line;
use super::regions::Regions;
use super::samples::Samples;
use super::visible::{Candidate, SMALLEST, Side, Visible};
use crate::rasterize::options::Sampling;

/// Where more faces may be seen in a pixel, it is resolved by samples.
const MOST_FACES: usize = 2048;

/// Pixels of a row that are asked at once whether surface layers may cross in them.
const BLOCK: usize = 8;

/// The memory of the search.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct BoundarySearch<S> {
    marks: PixelMask,
    regions: Regions,
    /// The first pixel of each region, and how many faces cover its centre.
    firsts: PixelMask,
    layers: Vec<u32>,
    /// Blocks of pixels.
    blocks: PixelMask,
    /// Per face of the band: its plane; none where no pixel asks for one.
    planes: Vec<Plane<S>>,
    intervals: Vec<DepthInterval<S>>,
    faces_by_pixel: FacesByPixel,
    outline: Outline<S>,
    candidates: Vec<Candidate<S>>,
    visible: Visible<S>,
    /// What is visible in a pixel a little wider, where sides lie on its border.
    wide: Visible<S>,
    /// The sides on the pixel's border.
    border_sides: Vec<(u32, Side<S>)>,
    samples: Samples<S>,
    areas: Vec<S>,
    extents: Vec<Option<Extent<S>>>,
    order: Vec<u32>,
    /// Per face of the band: bit k, whether edge k is one of a surface's outline, or a seam; bit
    /// `ALONG_AXIS + k`, whether it runs along rows or columns; and bit `BEYOND_DEPTHS`.
    outlines: Vec<u8>,
}

impl<S: Scalar<Wide = S>> BoundarySearch<S> {
    /// Finds the boundary pixels of a band and their pieces.
    #[inline(always)]
    pub(in crate::rasterize) fn run<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        pieces: &mut Pieces<S>,
    ) {
        pieces.clear();
        self.mark(band);
        if band.view.sampling == Sampling::Exact {
            self.mark_crossings(band);
        }
        if self.marks.count() == 0 {
            return;
        }
        let (mut marks, mut faces_by_pixel) =
            (std::mem::take(&mut self.marks), std::mem::take(&mut self.faces_by_pixel));
        faces_by_pixel.for_each(band, &mut marks, 1, |place, center, faces| {
            self.resolve(band, place, center, faces, pieces);
        });
        (self.marks, self.faces_by_pixel) = (marks, faces_by_pixel);
    }

    /// Marks the pixels that an edge of the surface or an end of the depth range may cross.
    #[inline(always)]
    fn mark<T: Scalar<Wide = S>>(&mut self, band: &BandFaces<'_, '_, T>) {
        let view = band.view;
        let Self { marks, outlines, planes, .. } = self;
        let has_seams = view.sampling == Sampling::Exact;
        marks.clear(band.rows.len(), view.size.width);
        outlines.clear();
        planes.clear();
        if view.sampling == Sampling::Exact {
            planes.extend((0..band.faces.len() as u32).map(|at| band.plane(at)));
        }
        for (at, (&face, weights)) in (0..).zip(band.faces.iter().zip(band.weights)) {
            let is_seam = |k| has_seams && view.mesh.is_seam(face as usize, k);
            let is_outline = |k| view.is_silhouette(face as usize, k) || is_seam(k);
            let outline: u8 = (0..3).map(|k| u8::from(is_outline(k)) << k).sum();
            let along_axis: u8 =
                (0..3).map(|k| u8::from(is_along_axis(weights.edges[k])) << k).sum();
            let corners = view.corners_of(face as usize);
            let is_beyond = corners.iter().any(|corner| corner.is_beyond_depths());
            let is_beyond_bit = u8::from(is_beyond) << BEYOND_DEPTHS;
            outlines.push(outline | along_axis << ALONG_AXIS | is_beyond_bit);
            for corner in (0..3).filter(|k| outline >> k & 1 == 1) {
                let [rows, columns] = band.reach_of_edge(face, corner);
                let [one, x, y] = weights.edges[corner];
                let start = one + x * view.centers[0];
                for row in rows {
                    let line = [start + y * view.ys[row], x, y];
                    marks.mark(row - band.rows.start, near_line(line, columns.clone()));
                }
            }
            if is_beyond {
                let [rows, columns] = band.reach(face);
                for row in rows {
                    let [depth, x, y] = band.depth(at, view.centers[0], view.ys[row]);
                    for end in [-S::ONE, S::ONE] {
                        let near = near_line([depth - end, x, y], columns.clone());
                        marks.mark(row - band.rows.start, near);
                    }
                }
            }
        }
    }

    /// Marks the pixels where surfaces may pass through each other.
    #[inline(always)]
    fn mark_crossings<T: Scalar<Wide = S>>(&mut self, band: &BandFaces<'_, '_, T>) {
        let Self {
            marks, regions, firsts, layers, blocks, planes, intervals, faces_by_pixel, ..
        } = self;
        let (rows, width) = (band.rows.len(), band.view.size.width);
        regions.find(marks, rows, width);
        firsts.clear(rows, width);
        regions.mark_first(firsts);
        layers.clear();
        layers.resize(firsts.count(), 0);
        band.for_each_face(firsts, 1, [0..rows, 0..width], |face, at, a, _| {
            // One too many does no harm.
            let bounds = &planes[face as usize].edge_error_bounds;
            layers[at] += u32::from((0..3).all(|k| a[k] >= -bounds[k]));
            true
        });
        if layers.iter().all(|&layers| layers < 2) {
            return;
        }
        // The first pixels are not needed any more.
        let suspects = firsts;
        suspects.clear(rows, width);
        regions.mark_all(layers, suspects);
        // Blocks first: in most the layers are far apart.
        blocks.clear(rows, width / BLOCK);
        for (row, block) in (0..rows).flat_map(|row| (0..width / BLOCK).map(move |at| (row, at))) {
            if suspects.has_all(row, block * BLOCK..(block + 1) * BLOCK) {
                blocks.mark(row, block..block + 1);
            }
        }
        faces_by_pixel.for_each(band, blocks, BLOCK, |[row, block], center, faces| {
            intervals.clear();
            intervals
                .extend(faces.iter().map(|&face| band.interval(planes, face, 0, center, BLOCK)));
            if !may_cross(intervals) {
                suspects.unmark(row, block * BLOCK..(block + 1) * BLOCK);
            }
        });
        faces_by_pixel.for_each(band, suspects, 1, |[row, column], center, faces| {
            intervals.clear();
            intervals.extend(faces.iter().map(|&face| band.interval(planes, face, 0, center, 1)));
            if may_cross(intervals) {
                marks.mark(row, column..column + 1);
            }
        });
    }

    /// Resolves a pixel of the band.
    #[inline(always)]
    fn resolve<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        [row, column]: [usize; 2],
        [x, y]: [S; 2],
        faces: &[u32],
        pieces: &mut Pieces<S>,
    ) {
        let Self { candidates, visible, wide, border_sides, samples, .. } = self;
        let Self { areas, extents, order, planes, outlines, intervals, outline, .. } = self;
        let pixel = ((band.rows.start + row) * band.view.size.width + column) as u32;
        if band.view.sampling == Sampling::Outline {
            if let Some(covered) = outline.find(band, outlines, faces, [x, y]) {
                return keep_covered(band, &covered, &outline.sides, pixel, pieces);
            }
            if planes.is_empty() {
                planes.extend((0..band.faces.len() as u32).map(|at| band.plane(at)));
            }
        }
        intervals.clear();
        intervals.extend(faces.iter().map(|&face| {
            let outline = outlines[face as usize];
            band.interval(planes, face, outline, [x, y], 1)
        }));
        if front_layers(intervals) == Some(1) {
            return;
        }
        candidates.clear();
        visible.clear(S::ONE);
        intervals.retain(|interval| !interval.is_out());
        let mut is_crowded = false;
        for group in depth_groups(intervals) {
            is_crowded = candidates.len() + group.len() > MOST_FACES;
            if !is_crowded {
                candidates.extend(group.iter().map(|interval| {
                    let face = interval.band_face;
                    band.candidate(face, outlines[face as usize], [x, y])
                }));
                is_crowded = !visible.add(candidates);
            }
            if is_crowded || visible.fills_pixel() {
                break;
            }
        }
        if is_crowded {
            gather(band, faces, outlines, [x, y], candidates);
        }
        areas.clear();
        areas.resize(candidates.len(), S::ZERO);
        extents.clear();
        let factors_of = |candidate: &Candidate<S>| {
            let face = band.faces[candidate.band_face as usize] as usize;
            band.view.corners_of(face).map(|corner| corner.factor)
        };
        let t_of = |candidate: &Candidate<S>| total(&candidate.edges, factors_of(candidate));
        let smallest = S::from_f64(4.0 * SMALLEST);
        if is_crowded {
            pieces.crowded += 1;
            extents.resize(candidates.len(), None);
            samples.find(candidates, t_of, areas, extents);
        } else {
            visible.add_areas(areas);
            extents.extend(areas.iter().zip(&*candidates).enumerate().map(
                |(at, (&area, candidate))| {
                    let is_kept = area > smallest;
                    is_kept.then(|| visible.extent(at, area, t_of(candidate), band.view.needs))?
                },
            ));
            let is_dropped = |area: &&S| **area > S::ZERO && **area <= smallest;
            pieces.dropped += areas.iter().filter(is_dropped).count();
        }
        order.clear();
        let all = 0..candidates.len() as u32;
        order.extend(all.filter(|&at| extents[at as usize].is_some()));
        // The largest first; where pieces are as large, the lower face.
        order.sort_unstable_by(|&a, &b| {
            let area = |at: u32| areas[at as usize].to_f64();
            let face = |at: u32| candidates[at as usize].band_face;
            area(b).total_cmp(&area(a)).then(face(a).cmp(&face(b)))
        });
        let first = pieces.pieces.len();
        pieces.pixels.push(pixel);
        pieces.pieces.extend(order.iter().filter_map(|&at| {
            let (candidate, area) = (&candidates[at as usize], areas[at as usize]);
            let extent = extents[at as usize]?;
            let factors = factors_of(candidate);
            let barycentrics = barycentrics(&candidate.edges, factors, &extent);
            let band_face = candidate.band_face;
            Some(Piece { band_face, area, extent, moves: !is_crowded, barycentrics })
        }));
        let first_segment = pieces.segments.len();
        if is_crowded {
            keep_sides(band, candidates, order, &samples.sides, pieces);
        } else if band.view.needs {
            visible.for_each_side(|candidate, side| {
                let Some(at) = order.iter().position(|&at| at == candidate) else { return };
                let source = side.source.map(|at| candidates[at as usize].band_face);
                pieces.segments.push(Segment { piece: at as u32, side: Side { source, ..side } });
            });
        }
        if visible.touches_border && !is_crowded {
            // Where the wide pixel is crowded, the sides on the border stay as they are.
            let candidate = |face: u32| band.candidate(face, outlines[face as usize], [x, y]);
            if find_border_sides(wide, candidates, intervals, candidate, border_sides) {
                let mut kept = first_segment;
                for at in first_segment..pieces.segments.len() {
                    if !pieces.segments[at].side.is_on_border {
                        pieces.segments[kept] = pieces.segments[at];
                        kept += 1;
                    }
                }
                pieces.segments.truncate(kept);
                keep_sides(band, candidates, order, border_sides, pieces);
            }
        }
        if pieces.pieces.get(first).is_some_and(|piece| piece.area == S::ZERO) {
            pieces.unseen.push(pixel);
        }
        pieces.ends.push(pieces.pieces.len() as u32);
        if band.view.needs {
            pieces.segment_ends.push(pieces.segments.len() as u32);
        }
    }
}

/// Keeps what is covered of a pixel, with its sides, as a piece of a face at its rim.
#[inline(always)]
fn keep_covered<T: Scalar>(
    band: &BandFaces<'_, '_, T>,
    &Covered { area, rim }: &Covered<T::Wide>,
    sides: &[Side<T::Wide>],
    pixel: u32,
    pieces: &mut Pieces<T::Wide>,
) {
    // Without a rim the pixel is what its centre is.
    let Some((band_face, place, edges)) = rim else { return };
    pieces.pixels.push(pixel);
    if area > T::Wide::from_f64(4.0 * SMALLEST) {
        let corners = band.view.corners_of(band.faces[band_face as usize] as usize);
        let extent = Extent::at(place);
        let barycentrics = barycentrics(&edges, corners.map(|corner| corner.factor), &extent);
        pieces.pieces.push(Piece { band_face, area, extent, moves: false, barycentrics });
        if band.view.needs {
            pieces.segments.extend(sides.iter().map(|&side| Segment { piece: 0, side }));
        }
    } else {
        pieces.dropped += 1;
    }
    pieces.ends.push(pieces.pieces.len() as u32);
    if band.view.needs {
        pieces.segment_ends.push(pieces.segments.len() as u32);
    }
}

/// All of `faces` in a crowded pixel, whatever hides them.
#[cold]
#[inline(never)]
fn gather<T: Scalar>(
    band: &BandFaces<'_, '_, T>,
    faces: &[u32],
    outlines: &[u8],
    center: [T::Wide; 2],
    candidates: &mut Vec<Candidate<T::Wide>>,
) {
    candidates.clear();
    candidates
        .extend(faces.iter().map(|&face| band.candidate(face, outlines[face as usize], center)));
}

/// Finds the sides on the border of a pixel that holds the faces of `intervals`, and what lies
/// beside them; returns whether it did so within the limits. `candidates` are those of the first
/// groups, and may grow.
#[cold]
#[inline(never)]
fn find_border_sides<S: Scalar<Wide = S>>(
    wide: &mut Visible<S>,
    candidates: &mut Vec<Candidate<S>>,
    intervals: &[DepthInterval<S>],
    candidate: impl Fn(u32) -> Candidate<S>,
    sides: &mut Vec<(u32, Side<S>)>,
) -> bool {
    wide.clear(S::from_f64(WIDER));
    sides.clear();
    let mut end = 0;
    for group in depth_groups(intervals) {
        let known = candidates.len().saturating_sub(end).min(group.len());
        candidates.extend(group[known..].iter().map(|interval| candidate(interval.band_face)));
        end += group.len();
        if end > MOST_FACES || !wide.add(&candidates[..end]) {
            return false;
        }
        if wide.fills_pixel() {
            break;
        }
    }
    wide.add_border_sides(sides);
    true
}

/// Keeps the sides of a pixel whose pieces are those of the candidates `order`: sides of samples, or on
/// the pixel's border. What has no piece beside such a side becomes two pieces without an area.
#[cold]
#[inline(never)]
fn keep_sides<T: Scalar>(
    band: &BandFaces<'_, '_, T>,
    candidates: &[Candidate<T::Wide>],
    order: &[u32],
    sides: &[(u32, Side<T::Wide>)],
    pieces: &mut Pieces<T::Wide>,
) {
    let mut count = order.len() as u32;
    for &(candidate, side) in sides {
        let source = side.source.map(|at| candidates[at as usize].band_face);
        let side = Side { source, ..side };
        let mut keep = |piece: u32, side: Side<T::Wide>| {
            if band.view.needs {
                pieces.segments.push(Segment { piece, side });
            }
        };
        if let Some(at) = order.iter().position(|&at| at == candidate) {
            keep(at as u32, side);
            continue;
        }
        let Candidate { band_face, edges, .. } = &candidates[candidate as usize];
        let corners = band.view.corners_of(band.faces[*band_face as usize] as usize);
        for (ends, place) in halves(side.ends) {
            keep(count, Side { ends, ..side });
            count += 1;
            let (factors, extent) = (corners.map(|corner| corner.factor), Extent::at(place));
            let barycentrics = barycentrics(edges, factors, &extent);
            pieces.pieces.push(Piece {
                band_face: *band_face,
                area: T::Wide::ZERO,
                extent,
                moves: false,
                barycentrics,
            });
        }
    }
}

/// The range of `columns` in whose pixels of a row a line passes, and perhaps a few more columns. The
/// line has the value `start` at the centre of column 0 of the row. It changes by `x` with X and by
/// `y` with Y.
#[inline(always)]
fn near_line<S: Scalar>([start, x, y]: Line<S>, columns: Range<usize>) -> Range<usize> {
    let reach = S::from_f64(REACH) * (x.abs() + y.abs());
    if x == S::ZERO {
        return if start.abs() <= reach { columns } else { 0..0 };
    }
    // |start + x X| <= reach; columns are two units wide.
    let (center, half) = (-0.5 * (start / x).to_f64(), 0.5 * (reach / x).to_f64().abs());
    let first = (center - half).ceil().max(columns.start as f64);
    let end = ((center + half).floor() + 1.0).min(columns.end as f64);
    first as usize..end.max(0.0) as usize
}
