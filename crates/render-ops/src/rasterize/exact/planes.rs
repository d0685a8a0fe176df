//! The depths of a band's faces as planes over the image: worked out for the faces that a pixel asks about.

use bokashi_core::Scalar;

use super::band_faces::{
    BandFaces, DepthErrors, FaceBits, KnownFace, REACH, depth, each_edge, total,
};
use super::depth_intervals::{DepthInterval, FaceInBlock};
use super::pixel_border::is_along_axis;
use super::polygon::{Line, value_at};
use crate::homogeneous::Vertex;

/// Stands for "no plane yet".
const NONE: u32 = u32::MAX;

/// The depths of a face, around the middle of the image.
#[derive(Debug)]
struct Plane<S> {
    /// Their coefficients.
    depth: Line<S>,
    /// The least and the largest one; of a face that may reach out of the depth range, all numbers.
    range: [S; 2],
    /// More than what its depths are off by in the face, where they are in the depth range. Unless the face
    /// may reach out of that range, the rounding of its vertices is part of it.
    error_bound: S,
    /// Its edge functions, and more than what these are off by anywhere in the image.
    edges: [Line<S>; 3],
    edge_error_bounds: [S; 3],
    errors: DepthErrors<S>,
    /// Which edges run along rows or columns.
    along_axis: FaceBits,
}

/// The planes of a band's faces. Most faces are far from all pixels that ask.
#[derive(Debug, Default)]
pub(super) struct Planes<S> {
    planes: Vec<Plane<S>>,
    /// Per face of the band: its plane.
    of_band_face: Vec<u32>,
}

impl<S: Scalar<Wide = S>> Planes<S> {
    /// Forgets all; there are `faces` faces now.
    pub(super) fn clear(&mut self, faces: usize) {
        self.planes.clear();
        self.of_band_face.clear();
        self.of_band_face.resize(faces, NONE);
    }

    /// The plane of a face of the band.
    #[inline(always)]
    fn plane_of<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        band_face: u32,
    ) -> &Plane<S> {
        let index = &mut self.of_band_face[band_face as usize];
        if *index == NONE {
            // Worked out when a pixel asks first.
            *index = self.planes.len() as u32;
            Plane::add(&mut self.planes, band, band_face);
        }
        &self.planes[*index as usize]
    }

    /// The depths of a face of the band in a block of `width` pixels of a row.
    #[inline(always)]
    pub(super) fn interval<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        face: u32,
        center: [S; 2],
        width: usize,
    ) -> DepthInterval<S> {
        let Plane {
            depth: [one, x, y],
            range: [least, most],
            error_bound,
            ref edges,
            ref errors,
            ..
        } = *self.plane_of(band, face);
        let mut error_bound = error_bound;
        let depth = value_at([one, x, y], center);
        let width = S::from_f64(width as f64);
        // From the centre of the block: `width` units to its left and right ends, and 1 up and down.
        let reach = width * x.abs() + y.abs();
        if least < -S::from_f64(f64::MAX) {
            // This face may reach out of the depth range: what its vertices' rounding does grows with the edge
            // functions, and is not bounded by what it does at the vertices.
            error_bound += (0..3)
                .map(|k| {
                    let change = width * edges[k][1].abs() + edges[k][2].abs();
                    errors.vertex_rounding[k] * (value_at(edges[k], center).abs() + change)
                })
                .sum();
        }
        let nearest = (depth - reach).maximum_or_nan(least) - error_bound;
        let farthest = (depth + reach).minimum_or_nan(most) + error_bound;
        // Of what is no number nothing is known.
        let infinity = S::from_f64(f64::INFINITY);
        let [nearest, farthest] =
            if nearest <= farthest { [nearest, farthest] } else { [-infinity, infinity] };
        DepthInterval { face, nearest, farthest }
    }

    /// Of a face whose plane is known.
    #[inline(always)]
    pub(super) fn known(&self, band_face: u32) -> KnownFace<'_, S> {
        let Plane { edges, along_axis, errors, .. } =
            &self.planes[self.of_band_face[band_face as usize] as usize];
        KnownFace { edges, along_axis: *along_axis, errors }
    }

    /// What a face of the band, of which `bits` are known, is in a block of `width` pixels of a row. Few faces
    /// are asked, so it is not worked out along with the depths.
    #[inline(always)]
    pub(super) fn in_block<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        band_face: u32,
        bits: FaceBits,
        center: [S; 2],
        width: usize,
    ) -> FaceInBlock {
        let Plane { edges, edge_error_bounds: bounds, .. } = self.plane_of(band, band_face);
        let width = S::from_f64(width as f64);
        let (mut covers, mut ends) = (true, false);
        for (k, &edge) in edges.iter().enumerate() {
            let (value, change) = (value_at(edge, center), width * edge[1].abs() + edge[2].abs());
            covers &= value >= -bounds[k];
            ends |= bits >> k & 1 == 1 && value.abs() <= S::from_f64(REACH) * change;
        }
        FaceInBlock { covers, ends }
    }
}

impl<S: Scalar<Wide = S>> Plane<S> {
    /// Adds that of a face of the band. Compiled once, for it is asked for in many places, and once for each face.
    #[inline(never)]
    fn add<T: Scalar<Wide = S>>(
        planes: &mut Vec<Self>,
        band: &BandFaces<'_, '_, T>,
        band_face: u32,
    ) {
        let vertices = band.vertices(band_face);
        let edges = band.edges_of(band_face, &vertices);
        let depth = depth(&vertices, &edges);
        let edge_error_bounds = band.edge_error_bounds(band_face);
        // Of z / w = sum z_i a_i / D, D = sum w_i a_i, the a_i are off by their bounds; in the depth
        // range z / w counts at most once.
        let off = |k: usize| (vertices[k].z.abs() + vertices[k].w.abs()) * edge_error_bounds[k];
        let total = total(&vertices, &edges).abs();
        let mut error_bound = S::from_f64(2.0) * (off(0) + off(1) + off(2)) / total;
        // `z = d_0 w + d_x x + d_y y` holds at the vertices; what is missing of it at vertex i adds a_i / D
        // times as much to the depth. At vertex i a_i is D / w_i, and the others are 0.
        let [one, by_x, by_y] = depth.map(S::abs);
        let unit = S::from_f64(unit_roundoff::<T>());
        let missing = vertices.map(|Vertex { x, y, z, w }| {
            unit * (z.abs() + one * w.abs() + by_x * x.abs() + by_y * y.abs())
        });
        let vertex_rounding = missing.map(|missing| missing / total);
        // Within the depth range the depth of a point of the face lies between those of its vertices.
        let range = if band.is_beyond_depths(band_face) {
            let infinity = S::from_f64(f64::INFINITY);
            [-infinity, infinity]
        } else {
            let at_vertex = |k: usize| missing[k] / vertices[k].w;
            error_bound += at_vertex(0).maximum_or_nan(at_vertex(1)).maximum_or_nan(at_vertex(2));
            let [p, q, r] = vertices.map(|vertex| vertex.z / vertex.w);
            [p.minimum_or_nan(q).minimum_or_nan(r), p.maximum_or_nan(q).maximum_or_nan(r)]
        };
        let along_axis = each_edge(|k| is_along_axis(edges[k]));
        let errors = DepthErrors::new(&vertices, vertex_rounding, total, band.view.size);
        planes.push(Self {
            depth,
            edges,
            range,
            edge_error_bounds,
            error_bound,
            along_axis,
            errors,
        });
    }
}

/// By which share of its size a vertex's coordinate was rounded at most.
#[inline(always)]
fn unit_roundoff<T: Scalar>() -> f64 {
    let single = 0.5 * f64::from(f32::EPSILON);
    let is_single = T::from_f64(1.0 + 0.5 * single).to_f64() == 1.0;
    if is_single { single } else { 0.5 * f64::EPSILON }
}
