//! The faces of a band: which pixels they may reach into, and what they are around a pixel's centre.

use std::ops::Range;

use bokashi_core::Scalar;

use super::pixel_border::lies_on_border;
use super::pixel_mask::{Marked, PixelMask, stripe_shift, stripes_of};
use super::polygon::{Line, size};
use super::side_by_side::NO_FACE;
use super::visible::Candidate;
use crate::homogeneous::{Vertex, cross, edge_error_bound, extent};
use crate::rasterize::corner::Corner;
use crate::rasterize::prepared::{Prepared, Reach};
use crate::rasterize::setup::signed_edges;
use crate::size::Size;

/// Lines are looked for within this many times half a pixel's width: more than they can be off.
pub(super) const REACH: f64 = 1.0 + 1e-6;

/// What is known of a face of the band. The first three bits tell which edges are marked: those of the surface's
/// outline, and seams. The others follow.
pub(super) type FaceBits = u16;

/// Which edges of a face something holds of: a bit for each.
#[inline(always)]
pub(super) fn each_edge(holds: impl Fn(usize) -> bool) -> FaceBits {
    FaceBits::from(holds(0)) | FaceBits::from(holds(1)) << 1 | FaceBits::from(holds(2)) << 2
}

/// The first bit of a face's seams that are not of the outline: the surface goes on beyond them.
pub(super) const INNER_SEAM: u16 = 3;

/// The first bit of marked edges for which the face beyond stands: it is the lower of the two, and is drawn, too.
pub(super) const SECOND: u16 = 6;

/// The bit of a face with a vertex beyond the depth range.
pub(super) const BEYOND: u16 = 9;

/// The marked edges for which a face itself stands.
#[inline(always)]
pub(super) fn own_edges(bits: FaceBits) -> FaceBits {
    bits & !(bits >> SECOND) & 0b111
}

/// A band with the faces that were drawn in it.
pub(in crate::rasterize) struct BandFaces<'a, 'v, T: Scalar> {
    pub(in crate::rasterize) view: &'a Prepared<'v, T>,
    pub(in crate::rasterize) rows: Range<usize>,
    pub(in crate::rasterize) faces: &'a [u32],
    /// How far each reaches.
    pub(in crate::rasterize) reaches: &'a [Reach],
}

/// What is worked out of a face once, for all pixels.
pub(super) struct KnownFace<'a, S> {
    /// Its edge functions around the middle of the image, positive inside.
    pub(super) edges: &'a [Line<S>; 3],
    /// Which edges run along rows or columns.
    pub(super) along_axis: FaceBits,
    pub(super) errors: &'a DepthErrors<S>,
}

/// The box of a face's pixels, or of blocks of them.
pub(super) struct FaceBox<S> {
    /// Rows of the band.
    rows: Range<usize>,
    columns: Range<usize>,
    edges: [Line<S>; 3],
    /// How much the edge functions change from a block's centre to its corners.
    pub(super) reach: [S; 3],
}

impl<T: Scalar> BandFaces<'_, '_, T> {
    /// The X of the centre of the block `index` of a row, of `block` pixels.
    #[inline(always)]
    pub(super) fn center(&self, index: usize, block: usize) -> T::Wide {
        self.view.centers[index * block] + T::Wide::from_f64((block - 1) as f64)
    }

    /// The stripes of the image that each face may reach into, of `1 << shift` columns.
    #[inline(always)]
    pub(super) fn stripes(&self, shift: u32) -> impl Iterator<Item = u64> {
        (0..self.faces.len() as u32).map(
            #[inline(always)]
            move |band_face| {
                let [_, columns] = self.reach(band_face);
                stripes_of(columns, shift)
            },
        )
    }

    /// Calls `visit` with each face of the band in whose box of pixels a block of `block` pixels of a row is
    /// marked. `stripes` are those of each face. `some_rows` of the band and `some_columns` of blocks limit the search.
    /// Once `visit` returns false, the search ends.
    #[inline(always)]
    pub(super) fn for_each_face(
        &self,
        stripes: &[u64],
        marks: &PixelMask,
        block: usize,
        [some_rows, some_columns]: [Range<usize>; 2],
        mut visit: impl FnMut(u32, FaceBox<T::Wide>) -> bool,
    ) {
        let width = T::Wide::from_f64(block as f64);
        let blocks = self.view.size.width / block;
        let marked = marks.stripes(block, stripe_shift(self.view.size.width));
        for (index, &stripes) in stripes.iter().enumerate() {
            // Most faces are far from all marks.
            if stripes & marked == 0 {
                continue;
            }
            let [rows, columns] = self.reach(index as u32);
            let columns = (columns.start / block).max(some_columns.start)
                ..columns.end.div_ceil(block).min(blocks).min(some_columns.end);
            let rows = (rows.start - self.rows.start).max(some_rows.start)
                ..(rows.end - self.rows.start).min(some_rows.end);
            if !marks.has_some(rows.clone(), columns.clone()) {
                continue;
            }
            let edges = self.edges(index as u32);
            let reach =
                edges.map(|[_, x, y]| T::Wide::from_f64(REACH) * (width * x.abs() + y.abs()));
            if !visit(index as u32, FaceBox { rows, columns, edges, reach }) {
                return;
            }
        }
    }

    /// Calls `visit` with each marked block in the box of a face: with marked blocks of the same row, which number it;
    /// with its column; and with the face's edge functions at its centre.
    #[inline(always)]
    pub(super) fn for_each_block(
        &self,
        marks: &PixelMask,
        block: usize,
        FaceBox { rows, columns, edges, .. }: FaceBox<T::Wide>,
        mut visit: impl FnMut(&Marked, usize, [T::Wide; 3]),
    ) {
        marks.for_each_row_in(
            rows,
            columns,
            #[inline(always)]
            |row, marked| {
                let y = self.view.ys[self.rows.start + row];
                let of_row = edges.map(|[one, by_x, by_y]| [one + by_y * y, by_x]);
                marked.for_each(
                    #[inline(always)]
                    |column| {
                        let x = self.center(column, block);
                        let a = of_row.map(|[one, by_x]| one + by_x * x);
                        visit(&marked, column, a);
                    },
                );
            },
        );
    }

    /// The rows of the band and the columns that a face may reach into.
    #[inline(always)]
    pub(super) fn reach(&self, band_face: u32) -> [Range<usize>; 2] {
        let [columns, rows] = self.reaches[band_face as usize].touched.within(&self.rows);
        [rows, columns]
    }

    /// The same of the edge that faces corner `corner`.
    pub(super) fn reach_of_edge(&self, band_face: u32, corner: usize) -> [Range<usize>; 2] {
        let corners = self.view.corners_of(self.faces[band_face as usize] as usize);
        let ends = [&corners[(corner + 1) % 3], &corners[(corner + 2) % 3]];
        let [rows, columns] = self.reach(band_face);
        let Some([own_columns, own_rows]) = Corner::pixels_between(ends, self.view.size) else {
            return [rows, columns];
        };
        let both = |a: Range<usize>, b: Range<usize>| a.start.max(b.start)..a.end.min(b.end);
        [both(rows, own_rows), both(columns, own_columns)]
    }

    /// A face's vertices.
    #[inline(always)]
    pub(super) fn vertices(&self, band_face: u32) -> [Vertex<T::Wide>; 3] {
        let [p, q, r] = self.view.corners_of(self.faces[band_face as usize] as usize);
        [p.vertex, q.vertex, r.vertex]
    }

    /// A face's edge functions around the middle of the image, positive inside. They are worked out anew each time: most
    /// faces are far from all pixels that ask.
    #[inline(always)]
    pub(super) fn edges(&self, band_face: u32) -> [Line<T::Wide>; 3] {
        self.edges_of(band_face, &self.vertices(band_face))
    }

    /// [`BandFaces::edges`] of a face of these vertices.
    #[inline(always)]
    pub(super) fn edges_of(
        &self,
        band_face: u32,
        vertices: &[Vertex<T::Wide>; 3],
    ) -> [Line<T::Wide>; 3] {
        let face = self.faces[band_face as usize] as usize;
        signed_edges(vertices, self.view.orientations[face])
    }

    /// Whether a vertex of a face lies before the near plane, beyond the far plane, or behind the eye.
    #[inline(always)]
    pub(super) fn is_beyond_depths(&self, band_face: u32) -> bool {
        let corners = || self.view.corners_of(self.faces[band_face as usize] as usize);
        !self.reaches[band_face as usize].is_tame && corners().iter().any(Corner::is_beyond_depths)
    }

    /// The depth's coefficients around the centre of a pixel.
    pub(super) fn depth(&self, band_face: u32, x: T::Wide, y: T::Wide) -> Line<T::Wide> {
        let vertices = self.vertices(band_face);
        let q = vertices.map(|vertex| vertex.relative_to(x, y));
        let edges = self.edges_of(band_face, &vertices);
        depth(&vertices, &self.edges_around(band_face, &edges, q))
    }

    /// A face around the centre of a pixel.
    #[inline(always)]
    pub(super) fn candidate(
        &self,
        band_face: u32,
        bits: FaceBits,
        [x, y]: [T::Wide; 2],
        KnownFace { edges, along_axis, errors }: KnownFace<'_, T::Wide>,
    ) -> Candidate<T::Wide> {
        let on_border = self.on_border(band_face, along_axis, [x, y]);
        let face = self.faces[band_face as usize] as usize;
        let [p, q, r] = self.view.corners_of(face);
        let (vertices, factors) = ([p.vertex, q.vertex, r.vertex], [p.factor, q.factor, r.factor]);
        let (adjacency, ends) = (self.view.mesh.adjacency(), bits & !(bits >> INNER_SEAM));
        let neighbors = [0, 1, 2].map(|k| match adjacency.neighbor(face, k) {
            // Across a seam inside the surface both faces still lie side by side.
            Some(neighbor) if ends >> k & 1 == 0 => neighbor.face() as u32,
            _ => NO_FACE,
        });
        let q = vertices.map(|vertex| vertex.relative_to(x, y));
        let edges = self.edges_around(band_face, edges, q);
        let depth = depth(&vertices, &edges);
        let reaches = q.map(|[x, y]| x.abs() + y.abs());
        let sizes = edges.map(size);
        let depth_error_bound = errors.in_pixel(&vertices, depth, reaches, sizes);
        let [a, b, c] = sizes;
        let [by_a, by_b, by_c] = errors.vertex_rounding;
        let tie_bound = depth_error_bound + (by_a * a + by_b * b + by_c * c);
        Candidate {
            band_face,
            factors,
            edges,
            depth,
            depth_error_bound,
            tie_bound,
            on_border,
            face: face as u32,
            neighbors,
        }
    }

    /// The edge functions of a face around the centre of a pixel, where its vertices relative to that are
    /// `q`, from those around the middle of the image.
    #[inline(always)]
    fn edges_around(
        &self,
        band_face: u32,
        edges: &[Line<T::Wide>; 3],
        q: [[T::Wide; 2]; 3],
    ) -> [Line<T::Wide>; 3] {
        let face = self.faces[band_face as usize] as usize;
        let sign = T::Wide::from_f64(f64::from(self.view.orientations[face]));
        let mut edges = *edges;
        for (k, edge) in edges.iter_mut().enumerate() {
            // From vertices relative to the pixel: `one + x X + y Y` of the image would cancel.
            edge[0] = sign * cross(q[(k + 1) % 3], q[(k + 2) % 3]);
        }
        edges
    }

    /// Which of a face's edges lie on the border of the pixel with the centre `center`: a bit for each of
    /// them. The bits of `along_axis` tell which edges run along rows or columns.
    #[inline(always)]
    fn on_border(&self, band_face: u32, along_axis: FaceBits, center: [T::Wide; 2]) -> u8 {
        match along_axis {
            0 => 0,
            some => self.some_on_border(band_face, some, center),
        }
    }

    #[cold]
    #[inline(never)]
    fn some_on_border(&self, band_face: u32, some: FaceBits, center: [T::Wide; 2]) -> u8 {
        let edges = self.edges(band_face);
        let bounds = self.edge_error_bounds(band_face);
        let is_on_border =
            |k: &usize| some >> k & 1 == 1 && lies_on_border(edges[*k], center, bounds[*k]);
        (0..3).filter(is_on_border).map(|k| 1 << k).sum()
    }

    /// More than what a face's edge functions are off by anywhere in the image.
    #[inline(always)]
    pub(super) fn edge_error_bounds(&self, band_face: u32) -> [T::Wide; 3] {
        let [p, q, r] = self.vertices(band_face);
        [(q, r), (r, p), (p, q)].map(|(p, q)| edge_error_bound(p, q, self.view.size))
    }
}

/// `D = sum w_i a_i`, the same all over the image.
#[inline(always)]
pub(super) fn total<S: Scalar>([p, q, r]: &[Vertex<S>; 3], edges: &[Line<S>; 3]) -> S {
    p.w * edges[0][0] + q.w * edges[1][0] + r.w * edges[2][0]
}

/// The coefficients of z / w: `sum z_i a_i / D`.
#[inline(always)]
pub(super) fn depth<S: Scalar>(vertices: &[Vertex<S>; 3], edges: &[Line<S>; 3]) -> Line<S> {
    let [p, q, r] = vertices;
    let scale = S::ONE / total(vertices, edges);
    [0, 1, 2].map(|c| scale * (p.z * edges[0][c] + q.z * edges[1][c] + r.z * edges[2][c]))
}

/// What is known of the errors of a face's depth, whichever the pixel.
#[derive(Debug)]
pub(super) struct DepthErrors<S> {
    /// By this times its edge functions its depth may be off, since its vertices were rounded.
    pub(super) vertex_rounding: [S; 3],
    /// How large the coordinates of its vertices in the image are.
    extents: [S; 3],
    /// What the slopes of its edge functions are off by, times its vertices' z.
    of_slopes: S,
    /// Of so much its depth is a roundoff off.
    unit: S,
}

impl<S: Scalar> DepthErrors<S> {
    #[inline(always)]
    pub(super) fn new(
        vertices: &[Vertex<S>; 3],
        vertex_rounding: [S; 3],
        total: S,
        image: Size,
    ) -> Self {
        let extents = vertices.map(|vertex| {
            let [x, y] = extent(vertex, image);
            x.maximum_or_nan(y)
        });
        let of_slopes = (0..3)
            .map(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                let of_slopes = extents[j] * vertices[k].w.abs() + extents[k] * vertices[j].w.abs();
                vertices[i].z.abs() * of_slopes
            })
            .sum();
        let unit = S::from_f64(8.0 * f64::EPSILON) / total;
        Self { vertex_rounding, extents, of_slopes, unit }
    }

    /// More than what [`depth`] is off by in a pixel: much where a face is thin. `reaches` are sizes of the
    /// vertices relative to the pixel's centre, `sizes` those of the edge functions.
    ///
    /// Of an edge function with the ends p and q the value at the centre is off by some roundings of
    /// `extent_p reach_q + extent_q reach_p`, the slopes by those of `extent_p w_q + extent_q w_p`. So D is
    /// off, by which the depth's slopes are divided, and the depth d at the centre by
    /// `sum (z_i - d w_i) / D` of the values' bounds; and all sums are rounded.
    #[inline(always)]
    fn in_pixel(
        &self,
        vertices: &[Vertex<S>; 3],
        [middle, x, y]: Line<S>,
        reaches: [S; 3],
        sizes: [S; 3],
    ) -> S {
        let Self { extents, of_slopes, unit, .. } = *self;
        let slope = x.abs() + y.abs();
        let mut sum = of_slopes;
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let Vertex { z, w, .. } = vertices[i];
            let of_value = extents[j] * reaches[k] + extents[k] * reaches[j];
            sum += ((z - middle * w).abs() + slope * w.abs()) * of_value
                + (z.abs() + (middle * w).abs()) * sizes[i];
        }
        unit * sum
    }
}
