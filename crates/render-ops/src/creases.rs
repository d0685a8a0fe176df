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

use std::borrow::Cow;

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Scalar, Tensor, Var};

use crate::dispatch::dispatch_256;
use crate::error::RenderError;
use crate::homogeneous::{Vertex, determinant, edge};
use crate::mesh::{Mesh, SharedEdge};
use crate::raster_options::{Cull, RasterOptions};
use crate::size::Size;
use crate::vertex_attributes::VertexAttributes;

/// Faces, or edges, in one piece of work.
const PER_PIECE: usize = 1 << 11;

/// `mesh` with its creases as seams: the edges at which `attributes` bend or jump in an image of the vertices
/// `clip: [V, 4]`. Seams that the mesh has already stay. It allocates two bytes per face and one per edge, and a
/// copy of attributes whose channels are no multiple of four.
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
    let blocks = blocks(attributes.data(), channels);
    let surface = Surface {
        mesh,
        indices: (!indices.is(mesh)).then_some(indices),
        clip,
        blocks: &blocks,
        blocks_per_row: channels.div_ceil(LANES),
        scale: scale(clip, size),
        // A pixel is two units wide.
        most_bend: 4.0 * tolerance * range,
        most_jump: 2.0 * tolerance * range,
    };
    Ok(mesh.with_more_seams(&surface.creases(cull)))
}

/// Values that are held against each other at the same time, and faces or edges that are looked at.
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

/// The blocks of the rows of `attributes: [A, C]`; the last one of a row is filled up with zeros, which jump nowhere.
fn blocks<T: Scalar>(attributes: &[T], channels: usize) -> Cow<'_, [[T; LANES]]> {
    if channels.is_multiple_of(LANES) {
        return Cow::Borrowed(attributes.as_chunks().0);
    }
    if channels == 3 {
        // Colours, normals and positions.
        let rows = attributes.as_chunks::<3>().0.iter();
        return Cow::Owned(rows.map(|&[a, b, c]| [a, b, c, T::ZERO]).collect());
    }
    let per_row = channels.div_ceil(LANES);
    let mut blocks = vec![[T::ZERO; LANES]; attributes.len() / channels * per_row];
    for (blocks, row) in blocks.chunks_exact_mut(per_row).zip(attributes.chunks_exact(channels)) {
        for (value, given) in blocks.as_flattened_mut().iter_mut().zip(row) {
            *value = *given;
        }
    }
    Cow::Owned(blocks)
}

/// A mesh with its attributes.
struct Surface<'a, T> {
    mesh: &'a Mesh,
    /// The index buffer of the attributes, where it is not the mesh's: only then a value may jump.
    indices: Option<&'a Mesh>,
    clip: &'a [[T; 4]],
    /// The attributes by blocks of channels, some for each row.
    blocks: &'a [[T; LANES]],
    blocks_per_row: usize,
    scale: [f64; 3],
    /// By how much a slope may jump at an edge that is no crease, in scaled coordinates.
    most_bend: f64,
    /// By how much a value may.
    most_jump: f64,
}

/// Faces, edges or channels that are looked at side by side.
const LANES: usize = 4;

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

/// Finds which faces are seen from the side that is drawn.
struct Judge<'a, 's, T> {
    surface: &'a Surface<'s, T>,
    /// The sign of the determinant of faces that are drawn.
    facing: f64,
    faces: &'a [[u32; 3]],
    are_drawn: &'a mut [bool],
}

// Loops, and no closures, which would not be compiled for the vectors that were found.
impl<T: Scalar> pulp::WithSimd for Judge<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { surface, facing, faces, are_drawn } = self;
        for (faces, are_drawn) in faces.chunks(AT_ONCE).zip(are_drawn.chunks_mut(AT_ONCE)) {
            let mut sizes = [0.0; AT_ONCE];
            for (group, sizes) in (0..faces.len().div_ceil(LANES)).zip(sizes.as_chunks_mut().0) {
                let group = &faces[group * LANES..];
                // Lanes without a face have vertex 0 three times.
                let mut filled = [[0; 3]; LANES];
                let some = group.first_chunk::<LANES>().unwrap_or_else(|| {
                    filled[..group.len()].copy_from_slice(group);
                    &filled
                });
                let mut vertices = [[0; LANES]; 3];
                for lane in 0..LANES {
                    for k in 0..3 {
                        vertices[k][lane] = some[lane][k];
                    }
                }
                let [p, q] = [surface.points(&vertices[0]), surface.points(&vertices[1])];
                let r = surface.points(&vertices[2]);
                let sizes: &mut Lanes = sizes;
                for lane in 0..LANES {
                    let line = edge(p.vertex(lane), q.vertex(lane));
                    sizes[lane] = facing * determinant(r.vertex(lane), line);
                }
            }
            for (is_drawn, size) in are_drawn.iter_mut().zip(sizes) {
                *is_drawn = size >= 0.0;
            }
        }
    }
}

/// Finds which edges are creases. None is looked for between faces that are not drawn.
struct Find<'a, 's, T> {
    surface: &'a Surface<'s, T>,
    are_drawn: &'a [bool],
    edges: &'a [SharedEdge],
    are_creases: &'a mut [bool],
}

impl<T: Scalar> pulp::WithSimd for Find<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { surface, are_drawn, edges, are_creases } = self;
        let parts = edges.chunks(AT_ONCE).zip(are_creases.chunks_mut(AT_ONCE));
        for (edges, are_creases) in parts {
            let mut listed = [0; AT_ONCE + LANES];
            let mut count = 0;
            for (index, edge) in edges.iter().enumerate() {
                listed[count] = index;
                let [own, other] = edge.faces.map(|face| are_drawn[face as usize]);
                count += usize::from(own | other);
            }
            // Lanes without an edge look at the last one again.
            for lane in 1..LANES {
                listed[count + lane - 1] = listed[count.saturating_sub(1)];
            }
            for group in 0..count.div_ceil(LANES) {
                let listed = &listed[group * LANES..][..LANES];
                let mut some = [&edges[0]; LANES];
                for lane in 0..LANES {
                    some[lane] = &edges[listed[lane]];
                }
                let are_smooth = surface.are_smooth(some);
                for lane in 0..LANES {
                    are_creases[listed[lane]] = !are_smooth[lane];
                }
            }
        }
    }
}

/// What makes bends of the values at some edges.
#[derive(Debug, Clone, Copy, Default)]
struct Bends {
    /// `lambda_q`, `lambda_s`, and the sum of all three.
    by_q: Lanes,
    by_s: Lanes,
    sum: Lanes,
    /// The slopes of the edges' functions at p and at q; 0 behind the eye, where none counts.
    at_p: Lanes,
    at_q: Lanes,
}

impl<T: Scalar> Surface<'_, T> {
    /// Of each edge that two faces share whether it is a crease.
    fn creases(&self, cull: Cull) -> Vec<bool> {
        let (faces, edges) = (self.mesh.faces(), self.mesh.shared_edges());
        let mut are_drawn = vec![true; faces.len()];
        if cull != Cull::None {
            let facing = if cull == Cull::Back { 1.0 } else { -1.0 };
            for_each_piece_mut(&mut are_drawn, PER_PIECE, |piece, are_drawn| {
                let faces = &faces[piece * PER_PIECE..][..are_drawn.len()];
                dispatch_256::<T, _>(Judge { surface: self, facing, faces, are_drawn });
            });
        }
        let mut are_creases = vec![false; edges.len()];
        for_each_piece_mut(&mut are_creases, PER_PIECE, |piece, are_creases| {
            let edges = &edges[piece * PER_PIECE..][..are_creases.len()];
            dispatch_256::<T, _>(Find { surface: self, are_drawn: &are_drawn, edges, are_creases });
        });
        are_creases
    }

    #[inline(always)]
    fn bends(&self, edges: [&SharedEdge; LANES]) -> Bends {
        let mut points = [Points::default(); 4];
        for k in 0..4 {
            let mut vertices = [0; LANES];
            for lane in 0..LANES {
                vertices[lane] = edges[lane].vertices[k];
            }
            points[k] = self.points(&vertices);
        }
        let [p, q, s, r] = points;
        let mut bends = Bends::default();
        for lane in 0..LANES {
            let [p, q, s, r] = [p.vertex(lane), q.vertex(lane), s.vertex(lane), r.vertex(lane)];
            let line = edge(p, q);
            let [_, x, y] = line;
            let (inverse, r_size) = (1.0 / determinant(s, line), determinant(r, line));
            let slope = (x * x + y * y).sqrt() / r_size;
            let across = edge(r, s);
            let [by_p, by_q] =
                [-inverse * determinant(q, across), inverse * determinant(p, across)];
            let by_s = inverse * r_size;
            bends.by_q[lane] = by_q;
            bends.by_s[lane] = by_s;
            bends.sum[lane] = by_p + by_q + by_s;
            let [at_p, at_q] = [slope * p.w, slope * q.w];
            bends.at_p[lane] = if p.w > 0.0 { at_p } else { 0.0 };
            bends.at_q[lane] = if q.w > 0.0 { at_q } else { 0.0 };
        }
        bends
    }

    /// At which edges no attribute bends or jumps.
    #[inline(always)]
    fn are_smooth(&self, edges: [&SharedEdge; LANES]) -> [bool; LANES] {
        let bends = self.bends(edges);
        // 1 where a channel is smooth, and else -1.
        let mut channels = [[1.0; LANES]; LANES];
        for at in 0..self.blocks_per_row {
            for lane in 0..LANES {
                let found = self.smooth_channels(edges[lane], at, &bends, lane);
                for k in 0..LANES {
                    let known = channels[lane][k];
                    channels[lane][k] = if found[k] < known { found[k] } else { known };
                }
            }
        }
        let mut are_smooth = [false; LANES];
        for lane in 0..LANES {
            let [a, b, c, d] = channels[lane];
            are_smooth[lane] = (a > 0.0) & (b > 0.0) & (c > 0.0) & (d > 0.0);
        }
        are_smooth
    }

    /// Which channels of block `at` are smooth at an edge, that of a lane of the bends.
    #[inline(always)]
    fn smooth_channels(&self, edge: &SharedEdge, at: usize, bends: &Bends, lane: usize) -> Lanes {
        let (by_q, by_s, sum) = (bends.by_q[lane], bends.by_s[lane], bends.sum[lane]);
        let (at_p, at_q) = (bends.at_p[lane], bends.at_q[lane]);
        let (most_bend, most_jump) = (self.most_bend, self.most_jump);
        let (mut rows, mut beyond) = (edge.vertices, None);
        if let Some(indices) = self.indices {
            let [p, q, s, r, p_beyond, q_beyond] = edge.corners_of(indices.faces());
            (rows, beyond) = ([p, q, s, r], Some([p_beyond, q_beyond]));
        }
        let [p, q] = [self.block(rows[0], at), self.block(rows[1], at)];
        let [s, r] = [self.block(rows[2], at), self.block(rows[3], at)];
        let (mut p_beyond, mut q_beyond, mut found) = (p, q, [1.0; LANES]);
        // Of what is no number nothing is known.
        if let Some(beyond) = beyond {
            (p_beyond, q_beyond) = (self.block(beyond[0], at), self.block(beyond[1], at));
            for k in 0..LANES {
                let holds = ((p[k] - p_beyond[k]).abs() <= most_jump)
                    & ((q[k] - q_beyond[k]).abs() <= most_jump);
                found[k] = if holds { 1.0 } else { -1.0 };
            }
        }
        for k in 0..LANES {
            let along = q[k] - p[k];
            let from_p = by_q * along + by_s * (s[k] - p[k]);
            // From q: `lambda_p (c_p - c_q) + lambda_s (c_s - c_q)`.
            let from_q = from_p - sum * along;
            let p_bend = at_p * ((r[k] - p_beyond[k]) - from_p);
            let q_bend = at_q * ((r[k] - q_beyond[k]) - from_q);
            let holds = (p_bend.abs() <= most_bend) & (q_bend.abs() <= most_bend);
            found[k] = if holds { found[k] } else { -1.0 };
        }
        found
    }

    /// A block of a row.
    #[inline(always)]
    fn block(&self, row: u32, at: usize) -> Lanes {
        let values = &self.blocks[row as usize * self.blocks_per_row + at];
        let mut block = [0.0; LANES];
        for lane in 0..LANES {
            block[lane] = values[lane].to_f64();
        }
        block
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
