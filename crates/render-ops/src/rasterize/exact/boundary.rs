//! The boundary pixels of a band: which they are, which faces they hold, and into which pieces they
//! fall.

use std::ops::Range;

use bokashi_core::Scalar;

use super::drawn::{Drawn, Plane};
use super::gathered::Gathered;
use super::marks::Marks;
use super::mean::{Extent, barycentrics};
use super::pieces::{Piece, Pieces, Segment};
use super::pixel_border::{WIDER, clipped, halves, is_along_axis};
use super::polygon::{Line, Moments};
use super::samples::Samples;
use super::sheets::{REACH, Regions, Slab, front_sheets, layers, may_cross};
use super::visible::{Candidate, SMALLEST, Side, Visible};

/// Where more faces may be seen in a pixel, it is resolved by samples.
const MOST_FACES: usize = 2048;

/// Pixels of a row that are asked at once whether sheets may cross in them.
const BLOCK: usize = 8;

/// The first bit of a face's edges that run along rows or columns.
const ALONG_AXIS: u8 = 3;

/// The memory of the search.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct Search<S> {
    marks: Marks,
    regions: Regions,
    /// The first pixel of each region, and how many faces cover its centre.
    firsts: Marks,
    sheets: Vec<u32>,
    /// Blocks of pixels.
    blocks: Marks,
    /// Per face of the band: its plane.
    planes: Vec<Plane<S>>,
    slabs: Vec<Slab<S>>,
    gathered: Gathered,
    candidates: Vec<Candidate<S>>,
    visible: Visible<S>,
    /// What is visible in a pixel a little wider, where sides lie on its border.
    wide: Visible<S>,
    /// The sides on the pixel's border.
    border_sides: Vec<(u32, Side<S>)>,
    samples: Samples<S>,
    moments: Vec<Moments<S>>,
    extents: Vec<Option<Extent<S>>>,
    order: Vec<u32>,
    /// Per face of the band: bit k, whether edge k is one of a surface's outline, or a seam; bit
    /// `ALONG_AXIS + k`, whether it runs along rows or columns.
    outlines: Vec<u8>,
}

impl<S: Scalar<Wide = S>> Search<S> {
    /// Finds the boundary pixels of a band and their pieces.
    #[inline(always)]
    pub(in crate::rasterize) fn run<T: Scalar<Wide = S>>(
        &mut self,
        drawn: &Drawn<'_, '_, T>,
        pieces: &mut Pieces<S>,
    ) {
        pieces.clear();
        self.mark(drawn);
        self.mark_crossings(drawn);
        if self.marks.count() == 0 {
            return;
        }
        let (mut marks, mut gathered) =
            (std::mem::take(&mut self.marks), std::mem::take(&mut self.gathered));
        gathered.for_each(drawn, &mut marks, 1, |place, center, faces| {
            self.resolve(drawn, place, center, faces, pieces);
        });
        (self.marks, self.gathered) = (marks, gathered);
    }

    /// Marks the pixels that an edge of the surface or an end of the depth range may cross.
    #[inline(always)]
    fn mark<T: Scalar<Wide = S>>(&mut self, drawn: &Drawn<'_, '_, T>) {
        let view = drawn.view;
        let Self { marks, outlines, planes, .. } = self;
        marks.clear(drawn.rows.len(), view.size.width);
        outlines.clear();
        planes.clear();
        planes.extend((0..drawn.faces.len() as u32).map(|at| drawn.plane(at)));
        for (at, (&face, weights)) in (0..).zip(drawn.faces.iter().zip(drawn.weights)) {
            let is_outline =
                |k| view.is_silhouette(face as usize, k) || view.mesh.is_seam(face as usize, k);
            let outline: u8 = (0..3).map(|k| u8::from(is_outline(k)) << k).sum();
            let along_axis: u8 =
                (0..3).map(|k| u8::from(is_along_axis(weights.edges[k])) << k).sum();
            outlines.push(outline | along_axis << ALONG_AXIS);
            for corner in (0..3).filter(|k| outline >> k & 1 == 1) {
                let [rows, columns] = drawn.reach_of_edge(face, corner);
                let [one, x, y] = weights.edges[corner];
                let start = one + x * view.centers[0];
                for row in rows {
                    let line = [start + y * view.ys[row], x, y];
                    marks.mark(row - drawn.rows.start, near_line(line, columns.clone()));
                }
            }
            if view.corners_of(face as usize).iter().any(|corner| corner.is_beyond_depths()) {
                let [rows, columns] = drawn.reach(face);
                for row in rows {
                    let [depth, x, y] = drawn.depth(at, view.centers[0], view.ys[row]);
                    for end in [-S::ONE, S::ONE] {
                        let near = near_line([depth - end, x, y], columns.clone());
                        marks.mark(row - drawn.rows.start, near);
                    }
                }
            }
        }
    }

    /// Marks the pixels where surfaces may pass through each other.
    #[inline(always)]
    fn mark_crossings<T: Scalar<Wide = S>>(&mut self, drawn: &Drawn<'_, '_, T>) {
        let Self { marks, regions, firsts, sheets, blocks, planes, slabs, gathered, .. } = self;
        let (rows, width) = (drawn.rows.len(), drawn.view.size.width);
        regions.find(marks, rows, width);
        firsts.clear(rows, width);
        regions.mark_first(firsts);
        sheets.clear();
        sheets.resize(firsts.count(), 0);
        drawn.for_each_face(firsts, 1, [0..rows, 0..width], |face, at, a, _| {
            // One too many does no harm.
            let doubts = &planes[face as usize].edge_doubts;
            sheets[at] += u32::from((0..3).all(|k| a[k] >= -doubts[k]));
            true
        });
        if sheets.iter().all(|&sheets| sheets < 2) {
            return;
        }
        // The first pixels are not needed any more.
        let suspects = firsts;
        suspects.clear(rows, width);
        regions.mark_all(sheets, suspects);
        // Blocks first: most hold sheets that are far apart.
        blocks.clear(rows, width / BLOCK);
        for (row, block) in (0..rows).flat_map(|row| (0..width / BLOCK).map(move |at| (row, at))) {
            if suspects.has_all(row, block * BLOCK..(block + 1) * BLOCK) {
                blocks.mark(row, block..block + 1);
            }
        }
        gathered.for_each(drawn, blocks, BLOCK, |[row, block], center, faces| {
            slabs.clear();
            slabs.extend(faces.iter().map(|&face| drawn.slab(planes, face, 0, center, BLOCK)));
            if !may_cross(slabs) {
                suspects.unmark(row, block * BLOCK..(block + 1) * BLOCK);
            }
        });
        gathered.for_each(drawn, suspects, 1, |[row, column], center, faces| {
            slabs.clear();
            slabs.extend(faces.iter().map(|&face| drawn.slab(planes, face, 0, center, 1)));
            if may_cross(slabs) {
                marks.mark(row, column..column + 1);
            }
        });
    }

    /// Resolves a pixel of the band.
    #[inline(always)]
    fn resolve<T: Scalar<Wide = S>>(
        &mut self,
        drawn: &Drawn<'_, '_, T>,
        [row, column]: [usize; 2],
        [x, y]: [S; 2],
        faces: &[u32],
        pieces: &mut Pieces<S>,
    ) {
        let Self { candidates, visible, wide, border_sides, samples, .. } = self;
        let Self { moments, extents, order, planes, outlines, slabs, .. } = self;
        let row = drawn.rows.start + row;
        slabs.clear();
        slabs.extend(faces.iter().map(|&face| {
            let outline = outlines[face as usize];
            drawn.slab(planes, face, outline, [x, y], 1)
        }));
        if front_sheets(slabs) == Some(1) {
            return;
        }
        let candidate = |face: u32| {
            let outline = outlines[face as usize];
            let mut candidate = drawn.candidate(face, outline, x, y);
            if outline >> ALONG_AXIS != 0 {
                candidate.on_border = drawn.on_border(planes, face, outline >> ALONG_AXIS, [x, y]);
            }
            candidate
        };
        candidates.clear();
        visible.clear(S::ONE);
        border_sides.clear();
        slabs.retain(|slab| !slab.is_out());
        let mut is_crowded = false;
        for layer in layers(slabs) {
            is_crowded = candidates.len() + layer.len() > MOST_FACES;
            if !is_crowded {
                candidates.extend(layer.iter().map(|slab| candidate(slab.drawn)));
                is_crowded = !visible.add(candidates);
            }
            if is_crowded || visible.fills_pixel() {
                break;
            }
        }
        if is_crowded {
            candidates.clear();
            candidates.extend(faces.iter().map(|&face| candidate(face)));
        }
        // Where the wide pixel is crowded, the sides on the border stay as they are.
        let is_split = !is_crowded
            && visible.touches_border
            && find_border_sides(wide, candidates, slabs, candidate, border_sides);
        moments.clear();
        moments.resize(candidates.len(), Moments::default());
        extents.clear();
        let smallest = S::from_f64(4.0 * SMALLEST);
        if is_crowded {
            pieces.crowded += 1;
            extents.resize(candidates.len(), None);
            samples.find(candidates, moments, extents);
        } else {
            visible.add_moments(moments);
            let is_kept = |own: &Moments<S>| own.area() > smallest;
            extents.extend(moments.iter().map(|own| is_kept(own).then(|| Extent::of(own))));
            let is_dropped = |own: &&Moments<S>| own.area() > S::ZERO && !is_kept(own);
            pieces.dropped += moments.iter().filter(is_dropped).count();
        }
        order.clear();
        let all = 0..candidates.len() as u32;
        order.extend(all.filter(|&at| extents[at as usize].is_some()));
        // The largest first; of equal ones the lower face.
        order.sort_unstable_by(|&a, &b| {
            let area = |at: u32| moments[at as usize].area().to_f64();
            let face = |at: u32| candidates[at as usize].drawn;
            area(b).total_cmp(&area(a)).then(face(a).cmp(&face(b)))
        });
        let pixel = (row * drawn.view.size.width + column) as u32;
        let first = pieces.pieces.len();
        pieces.pixels.push(pixel);
        pieces.pieces.extend(order.iter().filter_map(|&at| {
            let (Candidate { drawn: face, edges, .. }, area) =
                (&candidates[at as usize], moments[at as usize].area());
            let extent = extents[at as usize]?;
            let corners = drawn.view.corners_of(drawn.faces[*face as usize] as usize);
            let barycentrics = barycentrics(edges, corners.map(|corner| corner.factor), &extent);
            Some(Piece { drawn: *face, area, extent, moves: !is_crowded, barycentrics })
        }));
        let face = |at: u32| candidates[at as usize].drawn;
        let mut keep = |piece: u32, side: Side<S>| {
            if drawn.view.needs {
                let source = side.source.map(face);
                pieces.segments.push(Segment { piece, side: Side { source, ..side } });
            }
        };
        let piece_of = |candidate: u32| order.iter().position(|&at| at == candidate);
        let mut keep_if_seen = |(candidate, side): (u32, Side<S>)| {
            if let Some(at) = piece_of(candidate) {
                keep(at as u32, side);
            }
        };
        if is_crowded {
            samples.sides.iter().copied().for_each(&mut keep_if_seen);
        } else if drawn.view.needs {
            let is_kept = |(_, side): &(u32, Side<S>)| !(is_split && side.is_on_border);
            visible.sides().filter(is_kept).for_each(&mut keep_if_seen);
        }
        let mut count = order.len() as u32;
        for &(candidate, side) in border_sides.iter() {
            if let Some(at) = piece_of(candidate) {
                keep(at as u32, side);
                continue;
            }
            let Candidate { drawn: face, edges, .. } = &candidates[candidate as usize];
            for (ends, place) in halves(side.ends) {
                let corners = drawn.view.corners_of(drawn.faces[*face as usize] as usize);
                let extent = Extent { centroid: place, covariance: [S::ZERO; 3] };
                let barycentrics =
                    barycentrics(edges, corners.map(|corner| corner.factor), &extent);
                pieces.pieces.push(Piece {
                    drawn: *face,
                    area: S::ZERO,
                    extent,
                    moves: false,
                    barycentrics,
                });
                keep(count, Side { ends, ..side });
                count += 1;
            }
        }
        if pieces.pieces.get(first).is_some_and(|piece| piece.area == S::ZERO) {
            pieces.unseen.push(pixel);
        }
        pieces.ends.push(pieces.pieces.len() as u32);
        if drawn.view.needs {
            pieces.segment_ends.push(pieces.segments.len() as u32);
        }
    }
}

/// Finds the sides on the border of a pixel that holds `slabs`, and what lies beside them; returns
/// whether it did so within the limits. `candidates` are those of the first layers, and may grow.
#[cold]
#[inline(never)]
fn find_border_sides<S: Scalar<Wide = S>>(
    wide: &mut Visible<S>,
    candidates: &mut Vec<Candidate<S>>,
    slabs: &[Slab<S>],
    candidate: impl Fn(u32) -> Candidate<S>,
    sides: &mut Vec<(u32, Side<S>)>,
) -> bool {
    wide.clear(S::from_f64(WIDER));
    let mut end = 0;
    for layer in layers(slabs) {
        let known = candidates.len().saturating_sub(end).min(layer.len());
        candidates.extend(layer[known..].iter().map(|slab| candidate(slab.drawn)));
        end += layer.len();
        if end > MOST_FACES || !wide.add(&candidates[..end]) {
            return false;
        }
        if wide.fills_pixel() {
            break;
        }
    }
    sides.extend(wide.sides().filter(|(_, side)| side.is_on_border).filter_map(|(at, side)| {
        let ends = clipped(side.ends, side.normal)?;
        Some((at, Side { ends, ..side }))
    }));
    true
}

/// Of `columns` those in whose pixels a line passes, in a row where it has the value `start` at the
/// centre of column 0 and changes by `x` with X and by `y` with Y; a few more perhaps.
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
