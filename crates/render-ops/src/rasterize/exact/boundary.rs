//! The boundary pixels of a band: which they are, which faces they hold, and into which pieces they
//! fall.

use std::ops::Range;

use bokashi_core::Scalar;

use super::drawn::{Drawn, Plane};
use super::gathered::Gathered;
use super::marks::Marks;
use super::mean::{Extent, barycentrics};
use super::pieces::{Piece, Pieces, Segment};
use super::polygon::{Line, Moments};
use super::samples::Samples;
use super::sheets::{REACH, Regions, Slab, front_sheets, layers, may_cross};
use super::visible::{Candidate, SMALLEST, Side, Visible};

/// Where more faces may be seen in a pixel, it is resolved by samples.
const MOST_FACES: usize = 2048;

/// Pixels of a row that are asked at once whether sheets may cross in them.
const BLOCK: usize = 8;

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
    samples: Samples<S>,
    moments: Vec<Moments<S>>,
    extents: Vec<Option<Extent<S>>>,
    order: Vec<u32>,
    /// Per face of the band: bit k, whether edge k is one of a surface's outline, or a seam.
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
            let outline = (0..3).map(|k| u8::from(is_outline(k)) << k).sum();
            outlines.push(outline);
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
        let Self { candidates, visible, samples, moments, extents, order, .. } = self;
        let Self { planes, outlines, slabs, .. } = self;
        let row = drawn.rows.start + row;
        slabs.clear();
        slabs.extend(faces.iter().map(|&face| {
            let outline = outlines[face as usize];
            drawn.slab(planes, face, outline, [x, y], 1)
        }));
        if front_sheets(slabs) == Some(1) {
            return;
        }
        let candidate = |face: u32| drawn.candidate(face, outlines[face as usize], x, y);
        candidates.clear();
        visible.clear();
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
        pieces.pixels.push((row * drawn.view.size.width + column) as u32);
        pieces.pieces.extend(order.iter().filter_map(|&at| {
            let (Candidate { drawn: face, edges, .. }, area) =
                (&candidates[at as usize], moments[at as usize].area());
            let extent = extents[at as usize]?;
            let corners = drawn.view.corners_of(drawn.faces[*face as usize] as usize);
            let barycentrics = barycentrics(edges, corners.map(|corner| corner.factor), &extent);
            Some(Piece { drawn: *face, area, extent, moves: !is_crowded, barycentrics })
        }));
        pieces.ends.push(pieces.pieces.len() as u32);
        if !drawn.view.needs {
            return;
        }
        let face = |at: u32| candidates[at as usize].drawn;
        let mut keep = |(candidate, side): (u32, Side<S>)| {
            let Some(at) = order.iter().position(|&at| at == candidate) else { return };
            let source = side.source.map(face);
            pieces.segments.push(Segment { piece: at as u32, side: Side { source, ..side } });
        };
        if is_crowded {
            samples.sides.iter().copied().for_each(&mut keep);
        } else {
            visible.sides().for_each(&mut keep);
        }
        pieces.segment_ends.push(pieces.segments.len() as u32);
    }
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
