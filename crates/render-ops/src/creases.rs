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
        let place = |k: usize| (0..3).find(|&corner| faces[other][corner] == faces[face][k % 3]);
        let (p, q) = (place(corner + 1)?, place(corner + 2)?);
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

#[cfg(test)]
mod tests {
    use bokashi_core::Tape;
    use proptest::array::{uniform3, uniform4};
    use proptest::prelude::*;

    use super::*;
    use crate::rasterize::rasterize;

    /// Two faces that share the edge from vertex 1 to vertex 2, and two colours per vertex.
    #[derive(Debug, Clone)]
    struct Pair {
        clip: [[f64; 4]; 4],
        colors: [[f64; 2]; 4],
        size: Size,
    }

    const FACES: [[u32; 3]; 2] = [[0, 1, 2], [2, 1, 3]];

    fn pair() -> impl Strategy<Value = Pair> {
        let vertex = (uniform3(-1.0..1.0), 0.2..4.0).prop_map(|([x, y, z], w)| [x, y, z, w]);
        let corner = move |x: f64, y: f64| {
            vertex
                .clone()
                .prop_map(move |[a, b, z, w]| [(x + 0.2 * a) * w, (y + 0.2 * b) * w, z * w, w])
        };
        let clip = [corner(-0.5, 0.0), corner(0.0, -0.5), corner(0.0, 0.5), corner(0.5, 0.0)];
        let sizes = (5..60_usize, 5..60_usize);
        (clip, uniform4(proptest::array::uniform2(0.0..1.0)), sizes).prop_map(
            |(clip, colors, (width, height))| Pair { clip, colors, size: Size { width, height } },
        )
    }

    impl Pair {
        fn marked(&self, tolerance: f64) -> Mesh {
            let tape = Tape::<f64>::new();
            let clip = tape.constant(&Tensor::from(self.clip));
            let colors = tape.constant(&Tensor::from(self.colors));
            let mesh = Mesh::new(FACES.to_vec(), 4).unwrap();
            let options = RasterOptions::new(self.size).crease_tolerance(tolerance);
            mark_creases(&mesh, clip, colors.into(), &options).unwrap()
        }

        fn has_crease(&self, tolerance: f64) -> bool {
            let mesh = self.marked(tolerance);
            assert_eq!(mesh.is_seam(0, 0), mesh.is_seam(1, 2));
            // No other edge has two faces.
            let others = [(0, 1), (0, 2), (1, 0), (1, 1)];
            assert!(others.iter().all(|&(face, corner)| !mesh.is_seam(face, corner)));
            mesh.is_seam(0, 0)
        }

        fn range(&self) -> f64 {
            let ends = |channel: usize| {
                let values = self.colors.map(|color| color[channel]);
                values.into_iter().fold(f64::MIN, f64::max)
                    - values.into_iter().fold(f64::MAX, f64::min)
            };
            ends(0).max(ends(1))
        }

        /// A colour of a face's plane at a place in pixels, perspective-correct.
        fn color(&self, face: usize, [x, y]: [f64; 2], channel: usize) -> f64 {
            let Size { width, height } = self.size;
            let (x, y) = (2.0 * x / width as f64 - 1.0, 2.0 * y / height as f64 - 1.0);
            let corners = FACES[face].map(|vertex| self.clip[vertex as usize]);
            let q = corners.map(|[cx, cy, _, w]| [cx - x * w, cy - y * w]);
            let a = [0, 1, 2].map(|k| {
                let ([px, py], [qx, qy]) = (q[(k + 1) % 3], q[(k + 2) % 3]);
                px * qy - py * qx
            });
            let colors = FACES[face].map(|vertex| self.colors[vertex as usize][channel]);
            let sum: f64 = a.iter().sum();
            (0..3).map(|k| a[k] * colors[k]).sum::<f64>() / sum
        }

        /// The largest jump of a slope at the ends of the edge, per pixel, by difference quotients.
        fn bend(&self) -> f64 {
            let Size { width, height } = self.size;
            let place = |[x, y, _, w]: [f64; 4]| {
                [0.5 * (x / w + 1.0) * width as f64, 0.5 * (y / w + 1.0) * height as f64]
            };
            let [p, q] = [1, 2].map(|k| place(self.clip[k]));
            let [x, y] = [q[0] - p[0], q[1] - p[1]];
            let across = [y / x.hypot(y), -x / x.hypot(y)];
            let slope = |face: usize, [x, y]: [f64; 2], channel: usize| {
                const STEP: f64 = 1e-6;
                let at = |step: f64| {
                    self.color(face, [x + step * across[0], y + step * across[1]], channel)
                };
                (at(STEP) - at(-STEP)) / (2.0 * STEP)
            };
            let jumps = [p, q].into_iter().flat_map(|end| {
                [0, 1].map(|channel| (slope(0, end, channel) - slope(1, end, channel)).abs())
            });
            jumps.fold(0.0, f64::max)
        }
    }

    proptest! {
        #[test]
        fn an_edge_is_a_crease_where_the_slope_jumps_by_more_than_eight_tolerances(pair in pair()) {
            let tolerance = pair.bend() / (8.0 * pair.range());
            prop_assert!(pair.has_crease(tolerance * (1.0 - 1e-4)));
            prop_assert!(!pair.has_crease(tolerance * (1.0 + 1e-4)));
        }

        #[test]
        fn what_is_linear_in_space_bends_nowhere_on_a_plane(pair in pair(), by in uniform4(-1.0..1.0)) {
            let mut flat = pair;
            // Vertex 3 in the plane of the others, in clip space, which is space, seen by a camera.
            let [a, b, c, _] = by;
            let mix = [1.0 - 0.5 * (a + b), 0.5 * a, 0.5 * b];
            flat.clip[3] =
                [0, 1, 2, 3].map(|k| (0..3).map(|at| mix[at] * flat.clip[at][k]).sum::<f64>());
            for color in 0..4 {
                let [x, y, z, w] = flat.clip[color];
                flat.colors[color] = [x + c * y, z - w];
            }
            // A vertex behind the eye has no place in the image.
            prop_assume!(flat.clip[3][3] > 1e-2);
            let is_wide = |face| determinant_of(&flat, face).abs() > 1e-2;
            prop_assume!(FACES.into_iter().all(is_wide) && flat.range() > 1e-2);
            prop_assert!(!flat.has_crease(1e-8));
        }

        #[test]
        fn a_mesh_times_a_power_of_two_has_the_same_creases(pair in pair(), power in -900..900_i32) {
            let tolerance = pair.bend() / (8.0 * pair.range());
            let mut scaled = pair.clone();
            scaled.clip = pair.clip.map(|vertex| vertex.map(|x| x * f64::powi(2.0, power)));
            for near in [1.0 - 1e-12, 1.0, 1.0 + 1e-12] {
                prop_assert_eq!(pair.has_crease(near * tolerance), scaled.has_crease(near * tolerance));
            }
        }
    }

    fn determinant_of(pair: &Pair, face: [u32; 3]) -> f64 {
        let [p, q, r] = face.map(|vertex| {
            let [x, y, z, w] = pair.clip[vertex as usize];
            Vertex { x, y, z, w }
        });
        determinant(p, edge(q, r))
    }

    fn square() -> Pair {
        let clip =
            [[-0.5, 0.0], [0.0, -0.5], [0.0, 0.5], [0.5, 0.0]].map(|[x, y]| [x, y, 0.0, 1.0]);
        Pair { clip, colors: [[0.0; 2]; 4], size: Size::square(8) }
    }

    #[test]
    fn an_edge_is_a_crease_where_the_value_jumps_by_more_than_two_tolerances() {
        let (pair, tape) = (square(), Tape::<f64>::new());
        let mesh = Mesh::new(FACES.to_vec(), 4).unwrap();
        let clip = tape.constant(&Tensor::from(pair.clip));
        // Each face has colours of its own, 0 and 1, and no slope.
        let indices = Mesh::new(vec![[0, 0, 0], [1, 1, 1]], 3).unwrap();
        let has_crease = |step: f64, tolerance: f64| {
            let values = tape.constant(&Tensor::from([[0.0], [step], [1.0]]));
            let options = RasterOptions::new(pair.size).crease_tolerance(tolerance);
            mark_creases(&mesh, clip, (values, &indices).into(), &options).unwrap().is_seam(0, 0)
        };
        assert!(has_crease(0.5, 0.24) && !has_crease(0.5, 0.26));
        // With vertices of their own at the edge they may be the same.
        assert!(!has_crease(0.0, 1e-9));
    }

    #[test]
    fn what_is_the_same_everywhere_bends_nowhere_and_what_is_no_number_everywhere() {
        let mut pair = square();
        pair.colors = [[0.3; 2]; 4];
        assert!(!pair.has_crease(1e-300));
        for odd in [f64::NAN, f64::INFINITY] {
            pair.colors[0][1] = odd;
            assert!(pair.has_crease(1e300));
        }
    }

    #[test]
    fn ends_behind_the_eye_do_not_count() {
        let mut pair = square();
        pair.colors = [[0.0; 2], [1.0; 2], [0.0; 2], [0.0; 2]];
        assert!(pair.has_crease(1e-2));
        let behind = |w: [f64; 2]| {
            let mut pair = pair.clone();
            (pair.clip[1][3], pair.clip[2][3]) = (w[0], w[1]);
            pair.has_crease(1e-2)
        };
        assert!(behind([-1.0, 1.0]) && behind([1.0, -1.0]) && !behind([-1.0, -1.0]));
    }

    proptest! {
        /// Whichever way each of two faces turns.
        #[test]
        fn only_between_faces_that_are_not_drawn_no_crease_is_looked_for(
            pair in pair(),
            turned: [bool; 2],
            mirrored: bool,
            cull in prop_oneof![Just(Cull::Back), Just(Cull::Front)],
        ) {
            let mut pair = pair;
            if mirrored {
                pair.clip.iter_mut().for_each(|[x, ..]| *x = -*x);
            }
            let mut faces = FACES;
            for (face, turned) in faces.iter_mut().zip(turned) {
                if turned {
                    face.swap(0, 1);
                }
            }
            let mesh = Mesh::new(faces.to_vec(), 4).unwrap();
            let tape = Tape::<f64>::new();
            let clip = tape.constant(&Tensor::from(pair.clip.map(|[x, y, _, w]| [x, y, 0.0, w])));
            let colors = tape.constant(&Tensor::from(pair.colors));
            let options = RasterOptions::new(pair.size).cull(cull);
            let not_drawn = rasterize(clip, &mesh, options).unwrap().coverage.culled().facing;
            let all = mark_creases(&mesh, clip, colors.into(), &pair.size.into()).unwrap();
            let drawn = mark_creases(&mesh, clip, colors.into(), &options).unwrap();
            for (face, corner) in (0..2).flat_map(|face| [0, 1, 2].map(|corner| (face, corner))) {
                let expected = all.is_seam(face, corner) && not_drawn < 2;
                prop_assert_eq!(drawn.is_seam(face, corner), expected);
            }
        }
    }

    #[test]
    fn seams_of_the_mesh_stay() {
        let pair = square();
        let tape = Tape::<f64>::new();
        let mesh = Mesh::new(FACES.to_vec(), 4).unwrap().with_seams(|face, k| (face, k) == (0, 1));
        let clip = tape.constant(&Tensor::from(pair.clip));
        for color in [0.0, 1.0] {
            let colors = tape.constant(&Tensor::from([[0.0], [0.0], [0.0], [color]]));
            let marked = mark_creases(&mesh, clip, colors.into(), &pair.size.into()).unwrap();
            assert!(marked.is_seam(0, 1) && marked.is_seam(0, 0) == (color > 0.0));
            // They share what was built for the mesh.
            assert!(std::ptr::eq(mesh.adjacency(), marked.adjacency()));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let tape = Tape::<f64>::new();
        let mesh = Mesh::new(FACES.to_vec(), 4).unwrap();
        let clip = tape.constant(&Tensor::zeros([4, 4]));
        let message = |clip, shape: [usize; 2], indices: &Mesh, tolerance: f64| {
            let colors = tape.constant(&Tensor::zeros(shape));
            let options = RasterOptions::new(Size::square(4)).crease_tolerance(tolerance);
            let attributes = (colors, indices).into();
            mark_creases(&mesh, clip, attributes, &options).unwrap_err().to_string()
        };
        let few = Mesh::new(vec![[0, 1, 2]], 4).unwrap();
        assert_eq!(
            message(clip, [4, 3], &few, 1e-3),
            "indices need one face per face of the mesh, 2, got 1"
        );
        assert_eq!(
            message(tape.constant(&Tensor::zeros([3, 4])), [4, 3], &mesh, 1e-3),
            "rasterize needs clip positions of shape [4, 4], got shape [3, 4]"
        );
        for shape in [[5, 3], [4, 0]] {
            assert_eq!(
                message(clip, shape, &mesh, 1e-3),
                format!("rasterize needs attributes of shape [4, C], C > 0, got shape {shape:?}")
            );
        }
        for tolerance in [0.0, -1.0, f64::NAN] {
            assert_eq!(
                message(clip, [4, 3], &mesh, tolerance),
                format!("rasterize needs a positive tolerance of creases, got {tolerance}")
            );
        }
    }
}
