//! Creases: edges at which what a picture shows bends or jumps.
//!
//! An attribute is linear over each face in space, so in a picture it bends at the faces' edges. Let an
//! edge run from p to q, with the faces (p, q, s) and (p, q, r) at it. In homogeneous coordinates the
//! corner r is `r = lambda_p p + lambda_q q + lambda_s s`. Continued beyond the edge, the attribute c of
//! the first face differs from that of the second face by a function that is zero on the edge. The slope
//! of that function in the image is, at p,
//!
//! ```text
//! w_p |grad a| / |D| |(c_r - c_p) - lambda_q (c_q - c_p) - lambda_s (c_s - c_p)|
//! ```
//!
//! Here `a` is the edge function from p to q, and D is the determinant of p, q and r. At q it is the same
//! with p and q exchanged.
//!
//! A pixel that is not resolved shows its centre. An edge through the centre, at which the slope jumps by
//! B per pixel, puts it up to B / 8 off its mean; an edge at which the value jumps by J, up to J / 2.

use bokashi_core::parallel::write_each;
use bokashi_core::{Scalar, Tensor, Var};

use crate::error::RenderError;
use crate::homogeneous::{Vertex, determinant, edge};
use crate::mesh::{Mesh, Neighbor};
use crate::raster_options::{Cull, RasterOptions};
use crate::size::Size;
use crate::vertex_attributes::VertexAttributes;

/// Faces in one piece of work.
const FACES_PER_PIECE: usize = 1 << 11;

/// `mesh` with its creases as seams: the edges at which `attributes` bend or jump in an image of the vertices
/// `clip: [V, 4]`. Seams that the mesh has already stay. It allocates a byte per face.
///
/// # Errors
/// - [`RenderError::FaceCount`] unless the index buffer has as many faces as the mesh.
/// - [`RenderError::Shape`] unless `clip` is `[V, 4]` with the mesh's number of vertices, and the
///   attributes `[A, C]` with that of their index buffer.
/// - `TensorError::Value` for a tolerance that is not positive.
pub(crate) fn mark_creases<T: Scalar>(
    mesh: &Mesh,
    clip: Var<'_, T>,
    attributes: VertexAttributes<'_, '_, T>,
    options: &RasterOptions,
) -> Result<Mesh, RenderError> {
    let VertexAttributes { values, indices } = attributes;
    marked(mesh, &clip.value(), &values.value(), indices.unwrap_or(mesh), options)
}

/// The operation whose options name attributes.
const NAME: &str = "rasterize";

/// [`mark_creases`], compiled once.
#[inline(never)]
fn marked<T: Scalar>(
    mesh: &Mesh,
    clip: &Tensor<T>,
    attributes: &Tensor<T>,
    indices: &Mesh,
    &RasterOptions { size, crease_tolerance: tolerance, cull, .. }: &RasterOptions,
) -> Result<Mesh, RenderError> {
    let [expected, given] = [mesh, indices].map(|mesh| mesh.faces().len());
    if given != expected {
        return Err(RenderError::FaceCount { expected, given });
    }
    let refused = |rule: String, tensor: &Tensor<T>| {
        Err(RenderError::Shape { operation: NAME, rule, shape: tensor.shape().clone() })
    };
    let (vertices, rows) = (mesh.vertex_count(), indices.vertex_count());
    if **clip.shape() != [vertices, 4] {
        return refused(format!("clip positions of shape [{vertices}, 4]"), clip);
    }
    let channels = match **attributes.shape() {
        [given, channels] if given == rows && channels > 0 => channels,
        _ => return refused(format!("attributes of shape [{rows}, C], C > 0"), attributes),
    };
    if tolerance.is_nan() || tolerance <= 0.0 {
        return Err(RenderError::value(NAME, "a positive tolerance of creases", tolerance));
    }
    let range = range(attributes.data(), channels);
    if range == 0.0 {
        return Ok(mesh.clone());
    }
    let clip = clip.data().as_chunks::<4>().0;
    let surface = Surface {
        mesh,
        indices,
        clip,
        attributes: attributes.data(),
        channels,
        cull,
        scale: scale(clip, size),
        // A pixel is two units wide.
        most_bend: 4.0 * tolerance * range,
        most_jump: 2.0 * tolerance * range,
    };
    let mut seams = vec![0_u8; expected];
    write_each(&mut seams, FACES_PER_PIECE, |face| surface.creases_of(face));
    let mut has_creases = false;
    for face in 0..expected {
        let bits = seams[face];
        for corner in (0..3).filter(|corner| bits >> corner & 1 == 1) {
            if let Some(Beyond { face, corners: [.., across], .. }) = surface.beyond(face, corner) {
                has_creases = true;
                seams[face] |= 1 << across;
            }
        }
    }
    Ok(if has_creases { mesh.with_more_seams(&seams) } else { mesh.clone() })
}

/// The largest range of a channel of `attributes: [A, C]`; NaN where an attribute is no number.
fn range<T: Scalar>(attributes: &[T], channels: usize) -> f64 {
    let mut ranges = vec![[f64::INFINITY, -f64::INFINITY]; channels];
    let mut are_numbers = true;
    for row in attributes.chunks_exact(channels) {
        for ([least, most], value) in ranges.iter_mut().zip(row) {
            let value = value.to_f64();
            (*least, *most) = (least.min(value), most.max(value));
            are_numbers &= value.is_finite();
        }
    }
    if !are_numbers {
        return f64::NAN;
    }
    ranges.iter().fold(0.0, |range, [least, most]| range.max(most - least))
}

/// What x, y and w are multiplied by, so that they are scaled, and about 1 at most: a mesh times a power of
/// two has the same creases.
fn scale<T: Scalar>(clip: &[[T; 4]], Size { width, height }: Size) -> [f64; 3] {
    let largest = clip.iter().flat_map(|&[x, y, _, w]| [x, y, w]);
    let largest = largest.map(|entry| entry.to_f64().abs()).fold(0.0, f64::max);
    let power = f64::powi(2.0, -(largest.log2().floor() as i32).clamp(-1000, 1000));
    [power * width as f64, power * height as f64, power]
}

/// A mesh with its attributes.
struct Surface<'a, T> {
    mesh: &'a Mesh,
    indices: &'a Mesh,
    clip: &'a [[T; 4]],
    attributes: &'a [T],
    channels: usize,
    cull: Cull,
    scale: [f64; 3],
    /// By how much a slope may jump at an edge that is no crease, in scaled coordinates.
    most_bend: f64,
    /// By how much a value may.
    most_jump: f64,
}

/// The face beyond an edge, and which of its corners are the edge's ends and the third corner.
#[derive(Debug, Clone, Copy)]
struct Beyond {
    face: usize,
    /// Whether it runs through the edge the other way.
    is_opposite: bool,
    corners: [usize; 3],
}

/// An edge from p to q.
struct SharedEdge {
    /// The corners p, q and s of a face at it, and their determinant.
    corners: [Vertex<f64>; 3],
    size: f64,
    /// The edge function from p to q.
    line: [f64; 3],
    /// The third corner of the face beyond, and its determinant with p and q.
    r: Vertex<f64>,
    r_size: f64,
}

impl<'a, T: Scalar> Surface<'a, T> {
    /// Which edges of a face are creases, a bit for each by the corner that it faces. An edge is left to the
    /// lower of its two faces.
    fn creases_of(&self, face: usize) -> u8 {
        let vertices = self.mesh.faces()[face].map(|vertex| self.vertex(vertex));
        let rows = self.indices.faces()[face].map(|row| self.row(row));
        let size = determinant(vertices[2], edge(vertices[0], vertices[1]));
        let is_culled = |size: f64| match self.cull {
            Cull::None => false,
            Cull::Back => size < 0.0,
            Cull::Front => size > 0.0,
        };
        let is_crease = |&corner: &usize| {
            let Some(beyond) = self.beyond(face, corner) else { return false };
            let Beyond { face: other, is_opposite, corners: [p, q, third] } = beyond;
            let turned = [1, 2, 0].map(|k| (corner + k) % 3);
            let corners = turned.map(|k| vertices[k]);
            let line = edge(corners[0], corners[1]);
            let r = self.vertex(self.mesh.faces()[other][third]);
            let r_size = determinant(r, line);
            if is_culled(size) && is_culled(if is_opposite { -r_size } else { r_size }) {
                return false;
            }
            let others = [p, q, third].map(|k| self.row(self.indices.faces()[other][k]));
            let shared = SharedEdge { corners, size, line, r, r_size };
            self.bends_or_jumps(&shared, turned.map(|k| rows[k]), others)
        };
        (0..3).filter(is_crease).map(|corner| 1 << corner).sum()
    }

    /// Whether attributes bend or jump at an edge, from the rows of p, q and s, and of p, q and r.
    #[inline(always)]
    fn bends_or_jumps(&self, edge_of: &SharedEdge, values: [&[T]; 3], others: [&[T]; 3]) -> bool {
        let &SharedEdge { corners: [p, q, s], size, line, r, r_size } = edge_of;
        // Of what is no number nothing is known.
        let is_most = |change: f64, most: f64| change.abs() <= most;
        let jumps = (0..2).any(|end| {
            let mut pairs = values[end].iter().zip(others[end]);
            pairs.any(|(a, b)| !is_most(a.to_f64() - b.to_f64(), self.most_jump))
        });
        let inverse = 1.0 / size;
        let shares = [(q, s), (s, p)].map(|(a, b)| inverse * determinant(r, edge(a, b)));
        let share = inverse * r_size;
        let slope = (line[1] * line[1] + line[2] * line[2]).sqrt() / r_size;
        jumps
            || [p.w, q.w].into_iter().enumerate().filter(|&(_, w)| w > 0.0).any(|(end, w)| {
                (0..self.channels).any(|channel| {
                    let beyond = |rows: [&[T]; 3], k: usize| {
                        rows[k][channel].to_f64() - rows[end][channel].to_f64()
                    };
                    let continued =
                        shares[1 - end] * beyond(values, 1 - end) + share * beyond(values, 2);
                    !is_most(slope * w * (beyond(others, 2) - continued), self.most_bend)
                })
            })
    }

    /// The face beyond the edge that faces a corner of a face, where it is the higher one.
    #[inline(always)]
    fn beyond(&self, face: usize, corner: usize) -> Option<Beyond> {
        let faces = self.mesh.faces();
        let Neighbor { face: other, is_opposite } = self.mesh.adjacency().neighbor(face, corner)?;
        let other = other as usize;
        if other < face {
            return None;
        }
        let corner_of =
            |k: usize| (0..3).find(|&corner| faces[other][corner] == faces[face][k % 3]);
        let (p, q) = (corner_of(corner + 1)?, corner_of(corner + 2)?);
        Some(Beyond { face: other, is_opposite, corners: [p, q, 3 - p - q] })
    }

    #[inline(always)]
    fn vertex(&self, vertex: u32) -> Vertex<f64> {
        let [x, y, z, w] = self.clip[vertex as usize].map(T::to_f64);
        let [by_x, by_y, by_w] = self.scale;
        Vertex { x: by_x * x, y: by_y * y, z, w: by_w * w }
    }

    #[inline(always)]
    fn row(&self, row: u32) -> &'a [T] {
        &self.attributes[row as usize * self.channels..][..self.channels]
    }
}
