//! A sphere before a camera, and arrays of as many numbers as its image has pixels: what benchmarks are run on.

use std::f64::consts::PI;
use std::sync::Arc;

use bokashi_check::Refusal;
use bokashi_core::{Mask, Scalar, Tape, Tensor, Var};
use bokashi_fit::{RigidWeights, Rigidity, Topology};
use bokashi_mesh::Grid;
use bokashi_render_ops::{
    Background, Fragments, Mesh, RenderError, Size, Weighting, antialias, composite, differentials,
    interpolate, project, rasterize, vertex_normals,
};
use glam::dcamera::rh::proj::opengl::perspective;
use glam::{DMat4, DVec3};

/// The inputs of all benchmarks in one size, every number exact in `f32`.
#[derive(Debug)]
pub struct Setting {
    pub(crate) mesh: Mesh,
    pub(crate) camera: DMat4,
    pub(crate) size: Size,
    /// Which vertices share an edge, and the mesh as it was before it moved.
    pub(crate) topology: Topology,
    pub(crate) rigidity: Rigidity,
    /// A grid of at most as many points as there are pixels, a sphere's signed distance at them, and offsets.
    pub(crate) grid: Grid,
    pub(crate) field: Tensor<f64>,
    pub(crate) offsets: Tensor<f64>,
    /// `[V, 3]`, `[V, 3]`, `[V, 2]` and `[V, 3]`.
    pub(crate) positions: Tensor<f64>,
    pub(crate) normals: Tensor<f64>,
    pub(crate) coordinates: Tensor<f64>,
    pub(crate) colors: Tensor<f64>,
    /// `[V, 4]`; for each fragment `[N, 2]`, `[N, 3]`, `[N, 2, 2]`, the differentials of the barycentrics, and
    /// `[N]`.
    pub(crate) clip: Tensor<f64>,
    pub(crate) barycentrics: Tensor<f64>,
    pub(crate) surface: Tensor<f64>,
    pub(crate) slopes: Tensor<f64>,
    pub(crate) alphas: Tensor<f64>,
    /// Images `[H, W, 3]` without and with blended edges; and `[H, W]`, entries in [1/2, 2].
    pub(crate) aliased: Tensor<f64>,
    pub(crate) image: Tensor<f64>,
    pub(crate) distances: [Tensor<f64>; 2],
    /// Normals, tangents and map values, one for each pixel.
    pub(crate) frames: [Tensor<f64>; 3],
    /// Base colours, roughness and metallic, one for each pixel; and the strength of a light.
    pub(crate) material: [Tensor<f64>; 4],
    /// Texels, coordinates of pixels on a wall that leans back, and their differentials.
    pub(crate) texture: [Tensor<f64>; 3],
    /// The texels of a cube map; a direction and a level for each pixel.
    pub(crate) cube: [Tensor<f64>; 3],
    /// `[H W / WIDTH, WIDTH]`, entries in [-2, 2]; and in [1/2, 2].
    pub(crate) signed: Tensor<f64>,
    pub(crate) positive: Tensor<f64>,
    /// Two entries of three of these.
    pub(crate) mask: Mask,
    /// Their rows backwards; and a sum for each row, six rows to a sum, as faces meet in a vertex.
    pub(crate) backwards: Arc<[u32]>,
    pub(crate) spread: Arc<[u32]>,
    /// `[WIDTH, WIDTH]`.
    pub(crate) square: Tensor<f64>,
    /// `[n, 3]`, with at least as many entries as there are pixels, in [-2, 2]; and `[3]`.
    pub(crate) vectors: [Tensor<f64>; 2],
    pub(crate) row: Tensor<f64>,
    /// `[4, 4]`, a motion and a scale; and `[8, 4, 4]`, the same with other translations.
    pub(crate) affine: Tensor<f64>,
    pub(crate) instances: Tensor<f64>,
}

/// An affine matrix.
const AFFINE: [f64; 16] =
    [0.5, -0.25, 0.125, 1.0, 0.25, 0.75, 0.5, -2.0, -0.5, 0.25, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0];

/// The second extent of the tensors.
pub(crate) const WIDTH: usize = 16;

impl Setting {
    /// A sphere of 1024 faces in `pixels` x `pixels`, a multiple of 4 from 32 up.
    ///
    /// # Errors
    /// As [`Self::with_sphere`].
    pub fn new(pixels: usize) -> Result<Self, Refusal> {
        Self::with_sphere(32, 17, pixels)
    }

    /// A [`sphere`] of `around` x `along` quads in `pixels` x `pixels`, a multiple of 4 from 32 up.
    ///
    /// # Errors
    /// What an operation refuses: an image without pixels.
    pub fn with_sphere(around: usize, along: usize, pixels: usize) -> Result<Self, Refusal> {
        let (faces, positions) = sphere(0.8, around, along);
        let positions = single(positions);
        let count = positions.shape()[0];
        let mesh = Mesh::new(faces, count)?;
        let size = Size::square(pixels);
        let turn = DMat4::from_rotation_x(-0.6) * DMat4::from_rotation_y(0.5);
        let view = DMat4::from_translation(DVec3::new(0.0, 0.0, -3.5)) * turn;
        let camera = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 50.0) * view;

        let tape = Tape::new();
        let at = tape.constant(&positions);
        let colors = single(positions.map(|x| x / 1.6 + 0.5));
        let clip = project(at, &camera, None)?;
        let fragments = rasterize(clip, &mesh, size)?;
        let surface = interpolate(tape.constant(&colors), &fragments)?;
        let composite = composite(surface, &fragments, Background::Zero)?;
        let image = antialias(composite.clone())?.image()?;
        let normals = vertex_normals(at, &mesh, Weighting::Angle)?;

        let mut state = 1_u64;
        let mut uniform = move |low: f64, high: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            f64::from((low + (high - low) * (state >> 40) as f64 / 16_777_216.0) as f32)
        };
        let mut of =
            |shape: &[usize], low, high| Tensor::from_flat_fn(shape, |_| uniform(low, high));
        let (all, rows) = (size.pixels(), size.pixels() / WIDTH);
        let topology = Topology::new(mesh.faces(), count)?;
        let rest = positions.map(|x: f64| x + 0.125 * x * x);
        let sums = rows as u32 / 6 + 1;
        let side = (2..).take_while(|side| side * side * side <= all).last().unwrap_or(2);
        let grid = Grid::new([side; 3], [-1.0; 3], 2.0 / (side - 1) as f64)?;
        Ok(Self {
            rigidity: Rigidity::new(&topology, &rest, RigidWeights::Cotangent)?,
            field: single(grid.sampled(|[x, y, z]| (x * x + y * y + z * z).sqrt() - 0.75)),
            offsets: of(&[grid.point_count(), 3], -0.01, 0.01),
            grid,
            topology,
            camera,
            size,
            normals: single(normals.value()),
            coordinates: Tensor::from_fn([count, 2], |[v, k]| positions[[v, k]]),
            colors,
            slopes: single(differentials(&fragments)?.value()),
            alphas: of(&[fragments.coverage.count()], 0.0, 1.0),
            clip: single(clip.value()),
            barycentrics: single(fragments.barycentrics.value()),
            surface: single(surface.value()),
            aliased: single(composite.image()?.value()),
            image: single(image.value()),
            distances: [(); 2].map(|()| of(&[pixels, pixels], 0.5, 2.0)),
            frames: [3, 4, 3].map(|width| of(&[all, width], -1.0, 1.0)),
            material: [
                of(&[all, 3], 0.0, 1.0),
                of(&[all], 0.05, 1.0),
                of(&[all], 0.0, 1.0),
                Tensor::from([1.0, 2.0, 3.0]),
            ],
            cube: [
                of(&[6, pixels / 4, pixels / 4, 3], 0.0, 1.0),
                of(&[all, 3], -1.0, 1.0),
                of(&[all], 0.0, 2.0),
            ],
            signed: of(&[rows, WIDTH], -2.0, 2.0),
            positive: of(&[rows, WIDTH], 0.5, 2.0),
            mask: Mask::from_flat_fn([rows, WIDTH], |k| k % 3 > 0),
            backwards: (0..rows as u32).rev().collect(),
            spread: (0..rows as u32).map(|row| row * 7919 % sums).collect(),
            square: of(&[WIDTH, WIDTH], -1.0, 1.0),
            vectors: [(); 2].map(|()| of(&[all.div_ceil(3), 3], -2.0, 2.0)),
            row: of(&[3], -1.0, 1.0),
            affine: Tensor::from_flat_fn([4, 4], |k| AFFINE[k]),
            instances: Tensor::from_flat_fn([8, 4, 4], |k| match k % 16 {
                3 => (k / 16) as f64,
                entry => AFFINE[entry],
            }),
            texture: wall(pixels, uniform),
            mesh,
            positions,
        })
    }

    /// The fragments of the sphere, of vertices that stay where they are.
    pub(crate) fn fragments<'t, T: Scalar>(
        &self,
        clip: Var<'t, T>,
    ) -> Result<Fragments<'t, T>, RenderError> {
        rasterize(clip.detach(), &self.mesh, self.size)
    }

    /// The number of pixels, and of entries of the tensors.
    pub fn pixels(&self) -> usize {
        self.size.pixels()
    }
}

/// The same numbers, exact in `f32`.
fn single(tensor: Tensor<f64>) -> Tensor<f64> {
    tensor.map(|x| f64::from(x as f32))
}

/// A sphere around the origin of `around` x `along` quads, those at the poles triangles: its faces, with their
/// fronts outside, `2 around (along - 1)` of them, and its positions `[V, 3]`.
pub fn sphere(radius: f64, around: usize, along: usize) -> (Vec<[u32; 3]>, Tensor<f64>) {
    let count = 2 + around * (along - 1);
    let positions = Tensor::from_fn([count, 3], |[vertex, axis]| {
        if vertex == 0 || vertex + 1 == count {
            return [0.0, 0.0, if vertex == 0 { radius } else { -radius }][axis];
        }
        let (ring, k) = ((vertex - 1) / around + 1, (vertex - 1) % around);
        let (sine, cosine) = (PI * ring as f64 / along as f64).sin_cos();
        let (y, x) = (2.0 * PI * k as f64 / around as f64).sin_cos();
        radius * [sine * x, sine * y, cosine][axis]
    });
    let (last, around) = (count as u32 - 1, around as u32);
    // The first vertex of a ring, and the one after vertex k of it.
    let first = |ring: u32| 1 + ring * around;
    let next = |k: u32| (k + 1) % around;
    let mut faces = Vec::with_capacity(2 * around as usize * (along - 1));
    faces.extend((0..around).map(|k| [0, 1 + k, 1 + next(k)]));
    for ring in 0..along as u32 - 2 {
        let (upper, lower) = (first(ring), first(ring + 1));
        for k in 0..around {
            faces.push([upper + k, lower + k, lower + next(k)]);
            faces.push([upper + k, lower + next(k), upper + next(k)]);
        }
    }
    let upper = first(along as u32 - 2);
    faces.extend((0..around).map(|k| [upper + k, last, upper + next(k)]));
    (faces, positions)
}

/// Texels `[S, S, 3]` for as many pixels, and what each pixel of a wall sees of them: coordinates, and
/// how they change from pixel to pixel. Footprints are one to four texels wide, and two to three times
/// as long.
pub fn wall(pixels: usize, mut uniform: impl FnMut(f64, f64) -> f64) -> [Tensor<f64>; 3] {
    let extent = pixels as f64;
    let at = |k: usize| [(k % pixels) as f64 / extent, (k / pixels) as f64 / extent];
    let texels = Tensor::from_flat_fn([pixels, pixels, 3], |_| uniform(0.0, 1.0));
    let coordinates = Tensor::from_fn([pixels * pixels, 2], |[k, c]| {
        let [x, y] = at(k);
        [(0.8 + y) * (x - 0.3), 2.0 * y * (1.0 + y) + 0.3 * x][c]
    });
    let footprints = Tensor::from_fn([pixels * pixels, 2, 2], |[k, c, axis]| {
        let [x, y] = at(k);
        [[0.8 + y, x - 0.3], [0.3, 2.0 + 4.0 * y]][c][axis] / extent
    });
    [texels, single(coordinates), single(footprints)]
}
