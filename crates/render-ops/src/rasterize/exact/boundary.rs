//! The boundary pixels of a band: which they are, which faces they hold, and into which pieces they
//! fall.

use std::ops::Range;

use bokashi_core::Scalar;

use super::marks::Marks;
use super::mean::{Extent, barycentrics};
use super::polygon::{Line, Moments, value_at};
use super::samples::Samples;
use super::sheets::{REACH, Regions, Slab, front_sheets, layers, may_cross};
use super::visible::{Candidate, SMALLEST, Side, Visible};
use crate::homogeneous::{Vertex, cross, doubt};
use crate::rasterize::canvas::{View, sum_up};
use crate::rasterize::culling::{Corner, Fate};
use crate::rasterize::setup::Weights;

/// Where more faces may be seen in a pixel, it is resolved by samples.
const MOST_FACES: usize = 2048;

/// Pixels of a row that are asked at once whether sheets may cross in them.
const BLOCK: usize = 8;

/// A visible part of a face in a pixel.
#[derive(Debug, Clone, Copy)]
pub(in crate::rasterize) struct Piece<S> {
    /// The position of its face among those of the band.
    pub(in crate::rasterize) drawn: u32,
    /// Its area in scaled coordinates, in which a pixel has 4.
    pub(super) area: S,
    /// From the pixel's centre.
    pub(super) extent: Extent<S>,
    /// Whether its extent moves with its sides.
    pub(super) moves: bool,
    /// The means of the weights of its face's vertices 0 and 1.
    pub(in crate::rasterize) barycentrics: [S; 2],
}

impl<S: Scalar> Piece<S> {
    /// The share of the pixel that it covers.
    pub(in crate::rasterize) fn weight(&self) -> S {
        S::from_f64(0.25) * self.area
    }
}

/// A side of a piece that moves with a face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment<S> {
    /// The piece, counted from the pixel's first.
    pub(super) piece: u32,
    /// Its source tells faces by their positions among those of the band.
    pub(super) side: Side<S>,
}

/// What is found in the boundary pixels of a band.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct Pieces<S> {
    /// The pixels, in order.
    pub(in crate::rasterize) pixels: Vec<u32>,
    /// Where the pieces of each pixel end.
    pub(in crate::rasterize) ends: Vec<u32>,
    /// The pieces pixel by pixel, the largest first.
    pub(in crate::rasterize) pieces: Vec<Piece<S>>,
    /// Where the segments of each pixel end, and the segments; none where no gradient is asked for.
    pub(super) segment_ends: Vec<u32>,
    pub(super) segments: Vec<Segment<S>>,
    /// How many pieces were dropped.
    pub(in crate::rasterize) dropped: usize,
    /// How many pixels were resolved by samples.
    pub(in crate::rasterize) crowded: usize,
}

impl<S> Pieces<S> {
    /// The bytes that a backward pass reads.
    pub(in crate::rasterize) fn bytes(&self) -> usize {
        let places = self.pixels.len() + self.ends.len() + self.segment_ends.len();
        size_of::<u32>() * places
            + size_of::<Piece<S>>() * self.pieces.len()
            + size_of::<Segment<S>>() * self.segments.len()
    }

    fn clear(&mut self) {
        self.pixels.clear();
        self.ends.clear();
        self.pieces.clear();
        self.segment_ends.clear();
        self.segments.clear();
        self.dropped = 0;
        self.crowded = 0;
    }
}

/// The depths of a face, around the middle of the image.
#[derive(Debug)]
struct Plane<S> {
    /// Their coefficients.
    depth: Line<S>,
    /// The least and the largest one; of a face that may reach out of the depth range, all numbers.
    range: [S; 2],
    /// More than what its edge functions are off by anywhere, and what its depths are.
    edge_doubts: [S; 3],
    doubt: S,
}

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

/// A band with the faces that were drawn in it.
pub(in crate::rasterize) struct Drawn<'a, 'v, T: Scalar> {
    pub(in crate::rasterize) view: &'a View<'v, T>,
    pub(in crate::rasterize) rows: Range<usize>,
    pub(in crate::rasterize) faces: &'a [u32],
    pub(in crate::rasterize) weights: &'a [Weights<T::Wide>],
}

/// More pairs of a block and a face are not gathered at once, but for those of one row.
const MOST_PAIRS: usize = 1 << 22;

/// The faces that may reach into some pixels, or blocks of them.
#[derive(Debug, Default)]
struct Gathered {
    /// Blocks, by their number among them, with faces.
    pairs: Vec<[u32; 2]>,
    /// Where in `faces` those of each block end.
    ends: Vec<u32>,
    faces: Vec<u32>,
    /// The row and the column of each block.
    blocks: Vec<[usize; 2]>,
    /// Rows that are still to be gathered, the next ones last.
    open: Vec<Range<usize>>,
}

impl Gathered {
    /// Finds those of the marked blocks of `block` pixels in some rows of the band; returns whether
    /// they are not too many.
    #[inline(always)]
    fn find<T: Scalar>(
        &mut self,
        drawn: &Drawn<'_, '_, T>,
        marks: &Marks,
        block: usize,
        rows: Range<usize>,
    ) -> bool {
        let first = marks.count_before(rows.start);
        let count = marks.count_before(rows.end) - first;
        let most = if rows.len() > 1 { MOST_PAIRS } else { usize::MAX };
        let Self { pairs, ends, faces, .. } = self;
        pairs.clear();
        ends.clear();
        ends.resize(count + 1, 0);
        drawn.for_each_face(marks, block, rows, |face, number, a, reach| {
            if (0..3).all(|k| a[k] + reach[k] >= T::Wide::ZERO) {
                pairs.push([(number - first) as u32, face]);
                ends[number - first + 1] += 1;
            }
            pairs.len() <= most
        });
        if pairs.len() > most {
            return false;
        }
        sum_up(ends);
        faces.clear();
        faces.resize(pairs.len(), 0);
        // Where the next face of each block goes; in the end, where its last one went.
        for &[number, face] in pairs.iter() {
            let place = &mut ends[number as usize];
            faces[*place as usize] = face;
            *place += 1;
        }
        true
    }

    /// Calls `visit` with the row and the column of each marked block of `block` pixels of a row, with
    /// its centre, and with the faces that may reach into it.
    #[inline(always)]
    fn for_each<T: Scalar>(
        &mut self,
        drawn: &Drawn<'_, '_, T>,
        marks: &mut Marks,
        block: usize,
        mut visit: impl FnMut([usize; 2], [T::Wide; 2], &[u32]),
    ) {
        marks.count();
        self.open.push(0..drawn.rows.len());
        while let Some(rows) = self.open.pop() {
            if !self.find(drawn, marks, block, rows.clone()) {
                let middle = rows.start + rows.len() / 2;
                self.open.extend([middle..rows.end, rows.start..middle]);
                continue;
            }
            let mut found = std::mem::take(&mut self.blocks);
            found.clear();
            for row in rows {
                marks.for_each(row, |column| found.push([row, column]));
            }
            for (at, &[row, column]) in found.iter().enumerate() {
                let center = [drawn.center(column, block), drawn.view.ys[drawn.rows.start + row]];
                visit([row, column], center, self.faces_of(at));
            }
            self.blocks = found;
        }
    }

    /// The faces of the marked block `at`, in their order.
    fn faces_of(&self, at: usize) -> &[u32] {
        let first = at.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.faces[first as usize..self.ends[at] as usize]
    }
}

impl<T: Scalar> Drawn<'_, '_, T> {
    /// The X of the centre of the block `at` of a row, of `block` pixels.
    #[inline(always)]
    fn center(&self, at: usize, block: usize) -> T::Wide {
        self.view.centers[at * block] + T::Wide::from_f64((block - 1) as f64)
    }

    /// Calls `visit(face, at, a, reach)` for each face and each marked block of `block` pixels of a row
    /// in the box of its pixels, in some rows of the band, both by their numbers, with the face's
    /// edge functions at the block's centre and how much they change from there to its corners; until
    /// it returns false, to the end of that row.
    #[inline(always)]
    fn for_each_face(
        &self,
        marks: &Marks,
        block: usize,
        some: Range<usize>,
        mut visit: impl FnMut(u32, usize, [T::Wide; 3], [T::Wide; 3]) -> bool,
    ) {
        let some = self.rows.start + some.start..self.rows.start + some.end;
        let width = T::Wide::from_f64(block as f64);
        let blocks = self.view.size.width / block;
        for (at, (&face, weights)) in (0..).zip(self.faces.iter().zip(self.weights)) {
            let [rows, columns] = self.reach(face);
            let columns = columns.start / block..columns.end.div_ceil(block).min(blocks);
            let reach = weights
                .edges
                .map(|[_, x, y]| T::Wide::from_f64(REACH) * (width * x.abs() + y.abs()));
            for row in rows.start.max(some.start)..rows.end.min(some.end) {
                let y = self.view.ys[row];
                let mut goes_on = true;
                marks.for_each_in(row - self.rows.start, columns.clone(), |column, number| {
                    let x = self.center(column, block);
                    let a = weights.edges.map(|[one, by_x, by_y]| one + by_x * x + by_y * y);
                    goes_on &= visit(at, number, a, reach);
                });
                if !goes_on {
                    return;
                }
            }
        }
    }

    /// The rows of the band and the columns that a face may reach into.
    fn reach(&self, face: u32) -> [Range<usize>; 2] {
        let Fate::Drawn { columns: [left, right], rows: [top, bottom] } =
            self.view.verdicts[face as usize].fate
        else {
            unreachable!("only faces that are drawn are on the lists");
        };
        let rows = self.rows.start.max(top as usize)..self.rows.end.min(bottom as usize + 1);
        [rows, left as usize..right as usize + 1]
    }

    /// The same of the edge that faces corner `corner`.
    fn reach_of_edge(&self, face: u32, corner: usize) -> [Range<usize>; 2] {
        let corners = self.view.corners_of(face as usize);
        let ends = [corners[(corner + 1) % 3], corners[(corner + 2) % 3]];
        let [rows, columns] = self.reach(face);
        let Some([own_columns, own_rows]) = Corner::pixels_between(ends, self.view.size) else {
            return [rows, columns];
        };
        let both = |a: Range<usize>, b: Range<usize>| a.start.max(b.start)..a.end.min(b.end);
        [both(rows, own_rows), both(columns, own_columns)]
    }

    /// The depth's coefficients around the centre of a pixel.
    fn depth(&self, drawn: u32, x: T::Wide, y: T::Wide) -> Line<T::Wide> {
        self.candidate(drawn, 0, x, y).depth
    }

    /// A face around the centre of a pixel.
    #[inline(always)]
    fn candidate(&self, drawn: u32, outline: u8, x: T::Wide, y: T::Wide) -> Candidate<T::Wide> {
        let face = self.faces[drawn as usize] as usize;
        let vertices = self.view.corners_of(face).map(|corner| corner.vertex);
        let sign = T::Wide::from_f64(f64::from(self.view.verdicts[face].orientation));
        let q = vertices.map(|vertex| vertex.relative_to(x, y));
        let mut edges = self.weights[drawn as usize].edges;
        for (k, edge) in edges.iter_mut().enumerate() {
            edge[0] = sign * cross(q[(k + 1) % 3], q[(k + 2) % 3]);
        }
        Candidate { drawn, edges, depth: depth(&vertices, &edges), outline }
    }
}

/// The coefficients of z / w: `sum z_i a_i / D`, `D = sum w_i a_i` at any point.
#[inline(always)]
fn depth<S: Scalar>(vertices: &[Vertex<S>; 3], edges: &[[S; 3]; 3]) -> [S; 3] {
    let [p, q, r] = vertices;
    let scale = S::ONE / (p.w * edges[0][0] + q.w * edges[1][0] + r.w * edges[2][0]);
    [0, 1, 2].map(|c| scale * (p.z * edges[0][c] + q.z * edges[1][c] + r.z * edges[2][c]))
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
        drawn.for_each_face(firsts, 1, 0..rows, |face, at, a, _| {
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

impl<T: Scalar> Drawn<'_, '_, T> {
    /// That of a face of the band.
    #[inline(always)]
    fn plane(&self, at: u32) -> Plane<T::Wide> {
        let corners = self.view.corners_of(self.faces[at as usize] as usize);
        let vertices = corners.map(|corner| corner.vertex);
        let edges = &self.weights[at as usize].edges;
        let depth = depth(&vertices, edges);
        let [p, q, r] = vertices;
        let edge_doubts = [(q, r), (r, p), (p, q)].map(|(p, q)| doubt(p, q, self.view.size));
        let infinity = T::Wide::from_f64(f64::INFINITY);
        if corners.iter().any(|corner| corner.is_beyond_depths()) {
            return Plane { depth, range: [-infinity, infinity], edge_doubts, doubt: infinity };
        }
        let [least, most] = {
            let [p, q, r] = vertices.map(|vertex| vertex.z / vertex.w);
            [p.lesser(q).lesser(r), p.greater(q).greater(r)]
        };
        // Of z / w = sum z_i a_i / D, D = sum w_i a_i, where the a_i are off by their doubts.
        let noise: T::Wide = (0..3).map(|k| vertices[k].w * edge_doubts[k]).sum();
        let total: T::Wide = (0..3).map(|k| vertices[k].w * edges[k][0]).sum();
        let doubt = T::Wide::from_f64(4.0) * least.abs().greater(most.abs()) * noise / total.abs();
        Plane { depth, range: [least, most], edge_doubts, doubt }
    }

    /// That of a face of the band, with the edges `outline` of a surface's outline, in a block of
    /// `width` pixels of a row.
    #[inline(always)]
    fn slab(
        &self,
        planes: &[Plane<T::Wide>],
        drawn: u32,
        outline: u8,
        center: [T::Wide; 2],
        width: usize,
    ) -> Slab<T::Wide> {
        let Plane { depth: [one, x, y], range: [least, most], edge_doubts, doubt } =
            &planes[drawn as usize];
        let depth = value_at([*one, *x, *y], center);
        let width = T::Wide::from_f64(width as f64);
        let reach = width * x.abs() + y.abs();
        let (mut covers, mut ends) = (true, false);
        for (k, &edge) in self.weights[drawn as usize].edges.iter().enumerate() {
            let (value, change) = (value_at(edge, center), width * edge[1].abs() + edge[2].abs());
            covers &= value >= -edge_doubts[k];
            ends |= outline >> k & 1 == 1 && value.abs() <= T::Wide::from_f64(REACH) * change;
        }
        let nearest = (depth - reach).greater(*least) - *doubt;
        let farthest = (depth + reach).lesser(*most) + *doubt;
        // Of what is no number nothing is known.
        let infinity = T::Wide::from_f64(f64::INFINITY);
        let [nearest, farthest] =
            if nearest <= farthest { [nearest, farthest] } else { [-infinity, infinity] };
        Slab { drawn, nearest, farthest, covers, ends }
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
