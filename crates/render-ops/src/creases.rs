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

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Scalar, Tensor, Var};

use crate::dispatch::dispatch_256;
use crate::error::RenderError;
use crate::homogeneous::{Vertex, determinant, edge};
use crate::mesh::{Adjacency, Mesh, Neighbor};
use crate::raster_options::{Cull, RasterOptions};
use crate::size::Size;
use crate::vertex_attributes::VertexAttributes;

/// Faces in one piece of work.
const FACES_PER_PIECE: usize = 1 << 11;

/// `mesh` with its creases as seams: the edges at which `attributes` bend or jump in an image of the vertices
/// `clip: [V, 4]`. Seams that the mesh has already stay. It allocates nine bytes per face.
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
        may_jump: !indices.is(mesh) || range.is_nan(),
    };
    Ok(surface.creases().map_or_else(|| mesh.clone(), |creases| mesh.with_more_seams(&creases)))
}

/// Values that are held against each other at the same time.
const AT_ONCE: usize = 64;

/// The largest range of a channel of `attributes: [A, C]`; NaN where an attribute is no number.
fn range<T: Scalar>(attributes: &[T], channels: usize) -> f64 {
    if !attributes.chunks(1024).all(|part| part.iter().fold(true, |all, x| all & x.is_finite())) {
        return f64::NAN;
    }
    // Of whole rows, and of many of them side by side.
    let width = channels * AT_ONCE.div_ceil(channels);
    let mut least: Vec<T> = attributes.iter().copied().cycle().take(width).collect();
    let mut most = least.clone();
    for values in attributes.chunks(width) {
        for ((least, most), &value) in least.iter_mut().zip(&mut most).zip(values) {
            *least = if value < *least { value } else { *least };
            *most = if value > *most { value } else { *most };
        }
    }
    let of_channel = |channel: usize| {
        let values = |ends: &[T]| -> Vec<f64> {
            ends.iter().skip(channel).step_by(channels).map(|end| end.to_f64()).collect()
        };
        let least = values(&least).into_iter().fold(f64::INFINITY, f64::min);
        values(&most).into_iter().fold(-f64::INFINITY, f64::max) - least
    };
    (0..channels.min(least.len())).map(of_channel).fold(0.0, f64::max)
}

/// What x, y and w are multiplied by, so that they are scaled, and about 1 at most: a mesh times a power of
/// two has the same creases.
fn scale<T: Scalar>(clip: &[[T; 4]], Size { width, height }: Size) -> [f64; 3] {
    let mut largest = [T::ZERO; 4];
    for vertex in clip {
        for (largest, entry) in largest.iter_mut().zip(vertex) {
            let size = entry.abs();
            *largest = if size > *largest { size } else { *largest };
        }
    }
    let [x, y, _, w] = largest.map(T::to_f64);
    let largest = x.max(y).max(w);
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
    /// Whether a value may jump at all: those at vertices are the same on both sides of an edge.
    may_jump: bool,
}

/// Faces, or edges, that are looked at side by side.
const LANES: usize = 4;

/// Faces whose edges are listed, so that lanes are full.
const FACES_AT_ONCE: usize = 64;

type Lanes = [f64; LANES];

/// Vertices side by side.
#[derive(Debug, Clone, Copy, Default)]
struct Points {
    x: Lanes,
    y: Lanes,
    w: Lanes,
}

impl Points {
    #[inline(always)]
    fn vertex(&self, lane: usize) -> Vertex<f64> {
        Vertex { x: self.x[lane], y: self.y[lane], z: 0.0, w: self.w[lane] }
    }
}

/// An edge from p to q.
#[derive(Debug, Clone, Copy, Default)]
struct SharedEdge {
    /// The face, and which of its corners faces the edge.
    face: usize,
    corner: usize,
    /// The vertices p, q, s and r.
    vertices: [u32; 4],
    /// Where the rows of the attributes start: of p, q, s and r, and of p and q in the face beyond.
    rows: [usize; 6],
}

/// Finds the determinants of the faces from `first` on.
struct Measure<'a, 's, T> {
    surface: &'a Surface<'s, T>,
    first: usize,
    sizes: &'a mut [f64],
}

// Loops, and no closures, which would not be compiled for the vectors that were found.
impl<T: Scalar> pulp::WithSimd for Measure<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { surface, first, sizes } = self;
        for (chunk, sizes) in sizes.chunks_mut(LANES).enumerate() {
            let mut vertices = [[0; LANES]; 3];
            for lane in 0..LANES {
                // Lanes without a face have the last one once more.
                let face = first + chunk * LANES + lane.min(sizes.len() - 1);
                for k in 0..3 {
                    vertices[k][lane] = surface.mesh.faces()[face][k];
                }
            }
            let [p, q] = [surface.points(&vertices[0]), surface.points(&vertices[1])];
            let r = surface.points(&vertices[2]);
            let mut found = [0.0; LANES];
            for lane in 0..LANES {
                found[lane] = determinant(r.vertex(lane), edge(p.vertex(lane), q.vertex(lane)));
            }
            sizes.copy_from_slice(&found[..sizes.len()]);
        }
    }
}

/// Finds which edges of the faces from `first` on are creases, a bit for each by the corner that it faces. An
/// edge is left to the lower of its two faces.
struct Find<'a, 's, T> {
    surface: &'a Surface<'s, T>,
    adjacency: &'a Adjacency,
    sizes: &'a [f64],
    first: usize,
    seams: &'a mut [u8],
}

impl<T: Scalar> pulp::WithSimd for Find<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { surface, adjacency, sizes, first, seams } = self;
        let facing = match surface.cull {
            Cull::None => 0.0,
            Cull::Back => 1.0,
            Cull::Front => -1.0,
        };
        // Those behind the last one have been looked at, or are of no edge.
        let mut edges = [SharedEdge::default(); (3 * FACES_AT_ONCE).next_multiple_of(LANES)];
        for start in (0..seams.len()).step_by(FACES_AT_ONCE) {
            let mut count = 0;
            for face in first + start..first + seams.len().min(start + FACES_AT_ONCE) {
                for (corner, neighbor) in adjacency.neighbors(face).iter().enumerate() {
                    let Some(neighbor) = neighbor else { continue };
                    let other = neighbor.face as usize;
                    // None is looked for between faces that are not drawn.
                    let is_drawn = (facing * sizes[face] >= 0.0) | (facing * sizes[other] >= 0.0);
                    if other > face && is_drawn {
                        edges[count] = surface.shared_edge(face, corner, *neighbor);
                        count += 1;
                    }
                }
            }
            for some in 0..count.div_ceil(LANES) {
                let edges = &edges[some * LANES..][..LANES];
                let is_smooth = surface.are_smooth(edges, sizes);
                for (edge, is_smooth) in edges.iter().zip(is_smooth).take(count - some * LANES) {
                    seams[edge.face - first] |= u8::from(is_smooth < 0.0) << edge.corner;
                }
            }
        }
    }
}

impl<T: Scalar> Surface<'_, T> {
    /// The creases, per face a bit for each corner whose edge is one; `None` where there is none.
    fn creases(&self) -> Option<Vec<u8>> {
        let (count, adjacency) = (self.mesh.faces().len(), self.mesh.adjacency());
        let mut sizes = vec![0.0; count];
        for_each_piece_mut(&mut sizes, FACES_PER_PIECE, |piece, sizes| {
            let first = piece * FACES_PER_PIECE;
            dispatch_256::<T, _>(Measure { surface: self, first, sizes });
        });
        let mut seams = vec![0_u8; count];
        for_each_piece_mut(&mut seams, FACES_PER_PIECE, |piece, seams| {
            let first = piece * FACES_PER_PIECE;
            dispatch_256::<T, _>(Find { surface: self, adjacency, sizes: &sizes, first, seams });
        });
        let mut has_creases = false;
        for face in 0..count {
            let bits = seams[face];
            if bits == 0 {
                continue;
            }
            has_creases = true;
            for corner in (0..3).filter(|corner| bits >> corner & 1 == 1) {
                if let Some(beyond) = adjacency.neighbor(face, corner) {
                    seams[beyond.face as usize] |= 1 << beyond.corner;
                }
            }
        }
        has_creases.then_some(seams)
    }

    #[inline(always)]
    fn shared_edge(&self, face: usize, corner: usize, neighbor: Neighbor) -> SharedEdge {
        let Neighbor { face: other, corner: third, is_opposite } = neighbor;
        let (other, third) = (other as usize, usize::from(third));
        let (p, q) = (NEXT[corner], NEXT[NEXT[corner]]);
        let (next, last) = (NEXT[third], NEXT[NEXT[third]]);
        let [p_beyond, q_beyond] = if is_opposite { [last, next] } else { [next, last] };
        let (own, beyond) = (self.mesh.faces()[face], self.mesh.faces()[other][third]);
        let vertices = [own[p], own[q], own[corner], beyond];
        let (own, beyond) = (self.indices.faces()[face], self.indices.faces()[other]);
        let rows = [own[p], own[q], own[corner], beyond[third], beyond[p_beyond], beyond[q_beyond]];
        let mut starts = [0; 6];
        for k in 0..6 {
            starts[k] = rows[k] as usize * self.channels;
        }
        SharedEdge { face, corner, vertices, rows: starts }
    }

    /// Positive where no attribute bends or jumps at an edge, and else negative.
    #[inline(always)]
    fn are_smooth(&self, edges: &[SharedEdge], sizes: &[f64]) -> Lanes {
        let (mut of_face, mut vertices) = ([0.0; LANES], [[0; LANES]; 4]);
        for lane in 0..LANES {
            of_face[lane] = sizes[edges[lane].face];
            for k in 0..4 {
                vertices[k][lane] = edges[lane].vertices[k];
            }
        }
        let [p, q] = [self.points(&vertices[0]), self.points(&vertices[1])];
        let [s, r] = [self.points(&vertices[2]), self.points(&vertices[3])];
        let (mut shares, mut slopes) = ([[0.0; LANES]; 3], [[0.0; LANES]; 2]);
        for lane in 0..LANES {
            let [p, q, s, r] = [p.vertex(lane), q.vertex(lane), s.vertex(lane), r.vertex(lane)];
            let line = edge(p, q);
            let [_, x, y] = line;
            let (inverse, r_size) = (1.0 / of_face[lane], determinant(r, line));
            let slope = (x * x + y * y).sqrt() / r_size;
            shares[0][lane] = inverse * determinant(r, edge(q, s));
            shares[1][lane] = inverse * determinant(r, edge(s, p));
            shares[2][lane] = inverse * r_size;
            slopes[0][lane] = slope * p.w;
            slopes[1][lane] = slope * q.w;
        }
        let (most_bend, most_jump) = (self.most_bend, self.most_jump);
        let mut is_smooth = [1.0; LANES];
        for channel in 0..self.channels {
            let values = &self.attributes[channel..];
            let [at_p, at_q] = [gather(values, edges, 0), gather(values, edges, 1)];
            let [at_s, at_r] = [gather(values, edges, 2), gather(values, edges, 3)];
            let [p_beyond, q_beyond] = if self.may_jump {
                [gather(values, edges, 4), gather(values, edges, 5)]
            } else {
                [at_p, at_q]
            };
            for lane in 0..LANES {
                let [p_value, q_value, s_value] = [at_p[lane], at_q[lane], at_s[lane]];
                let [p_other, q_other, r_value] = [p_beyond[lane], q_beyond[lane], at_r[lane]];
                let share = shares[2][lane];
                let from_p = shares[1][lane] * (q_value - p_value) + share * (s_value - p_value);
                let from_q = shares[0][lane] * (p_value - q_value) + share * (s_value - q_value);
                let p_bend = slopes[0][lane] * ((r_value - p_other) - from_p);
                let q_bend = slopes[1][lane] * ((r_value - q_other) - from_q);
                // Of what is no number nothing is known. An end behind the eye does not count.
                let holds = ((p_value - p_other).abs() <= most_jump)
                    & ((q_value - q_other).abs() <= most_jump)
                    & ((p_bend.abs() <= most_bend) | (p.w[lane] <= 0.0))
                    & ((q_bend.abs() <= most_bend) | (q.w[lane] <= 0.0));
                is_smooth[lane] = if holds { is_smooth[lane] } else { -1.0 };
            }
        }
        is_smooth
    }

    /// Some vertices.
    #[inline(always)]
    fn points(&self, vertices: &[u32; LANES]) -> Points {
        let mut rows = [[T::ZERO; LANES]; 3];
        for lane in 0..LANES {
            let [x, y, _, w] = self.clip[vertices[lane] as usize];
            (rows[0][lane], rows[1][lane], rows[2][lane]) = (x, y, w);
        }
        let [by_x, by_y, by_w] = self.scale;
        let mut points = Points::default();
        for lane in 0..LANES {
            points.x[lane] = by_x * rows[0][lane].to_f64();
            points.y[lane] = by_y * rows[1][lane].to_f64();
            points.w[lane] = by_w * rows[2][lane].to_f64();
        }
        points
    }
}

/// Of each edge the value of its row `row`.
#[inline(always)]
fn gather<T: Scalar>(values: &[T], edges: &[SharedEdge], row: usize) -> Lanes {
    let (mut found, mut wide) = ([T::ZERO; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        found[lane] = values[edges[lane].rows[row]];
    }
    for lane in 0..LANES {
        wide[lane] = found[lane].to_f64();
    }
    wide
}

/// The corner after a corner.
const NEXT: [usize; 3] = [1, 2, 0];
