//! What the operations are run on.

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Weighting, antialias, composite, differentials, vertex_normals,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::pipeline::drawn;
use crate::bench::scenes::Scene;

/// What the operations are run on, every number exact in f32.
pub(super) struct Inputs {
    pub(super) scene: Scene,
    pub(super) positions: Tensor<f64>,
    /// `[V, 3]` and `[V, 2]`.
    pub(super) normals: Tensor<f64>,
    pub(super) coordinates: Tensor<f64>,
    /// Normals, tangents and map values, one for each pixel.
    pub(super) frames: [Tensor<f64>; 3],
    /// Base colours, roughness and metallic, one for each pixel; and the strength of a light.
    pub(super) material: [Tensor<f64>; 4],
    pub(super) clip: Tensor<f64>,
    pub(super) barycentrics: Tensor<f64>,
    pub(super) colors: Tensor<f64>,
    pub(super) surface: Tensor<f64>,
    /// `[N, 2, 2]`, the differentials of the barycentrics.
    pub(super) slopes: Tensor<f64>,
    /// `[N]`, one for each fragment.
    pub(super) alphas: Tensor<f64>,
    /// Texels, coordinates of pixels on a wall that leans back, and their differentials.
    pub(super) texture: [Tensor<f64>; 3],
    /// The texels of a cube map; a direction and a level for each pixel.
    pub(super) cube: [Tensor<f64>; 3],
    pub(super) aliased: Tensor<f64>,
    pub(super) image: Tensor<f64>,
    /// `[H, W]`, entries in [1/2, 2].
    pub(super) distances: Tensor<f64>,
    pub(super) other_distances: Tensor<f64>,
    /// `[H W, WIDTH]`, entries in [-2, 2].
    pub(super) signed: Tensor<f64>,
    /// The same in [1/2, 2].
    pub(super) positive: Tensor<f64>,
    /// `[WIDTH, WIDTH]`.
    pub(super) square: Tensor<f64>,
    /// `[n, 3]`, with at least as many entries, in [-2, 2].
    pub(super) vectors: [Tensor<f64>; 2],
    /// `[3]`.
    pub(super) row: Tensor<f64>,
    /// `[4, 4]`, a motion and a scale.
    pub(super) affine: Tensor<f64>,
    /// `[8, 4, 4]`, the same with other translations.
    pub(super) instances: Tensor<f64>,
}

/// An affine matrix.
const AFFINE: [f64; 16] =
    [0.5, -0.25, 0.125, 1.0, 0.25, 0.75, 0.5, -2.0, -0.5, 0.25, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0];

/// The second extent of the tensors.
pub(super) const WIDTH: usize = 16;

impl Inputs {
    pub(super) fn new(pixels: usize) -> Result<Self, FitError> {
        let scene = Scene::sphere("sphere", 32, 17, pixels)?;
        let mut generator = ChaCha8Rng::seed_from_u64(0);
        let mut uniform = move |low: f64, high: f64| {
            let share = f64::from(generator.next_u32() >> 8) / 16_777_216.0;
            f64::from((low + (high - low) * share) as f32)
        };
        let single = |tensor: Tensor<f32>| tensor.cast();
        let tape = Tape::new();
        let (positions, colors) = (scene.positions.cast(), scene.colors.cast());
        let (at, tinted) = (tape.constant(&positions), tape.constant(&colors));
        let drawn = drawn(&scene, scene.size.into(), at, tinted)?;
        let composite = composite(drawn.surface, &drawn.fragments, Background::Zero)?;
        let image = antialias(composite.clone())?.image()?;
        let rows = pixels * pixels / WIDTH;
        let normals = vertex_normals(at, &scene.mesh, Weighting::Angle)?;
        let vertices = scene.mesh.vertex_count();
        let coordinate = |k: usize| positions.data()[k / 2 * 3 + k % 2];
        let coordinates = Tensor::from_flat_fn([vertices, 2], coordinate);
        let mut vectors =
            |width| Tensor::from_flat_fn([pixels * pixels, width], |_| uniform(-1.0, 1.0));
        let frames = [vectors(3), vectors(4), vectors(3)];
        let directions = vectors(3);
        let count = drawn.fragments.coverage.count();
        Ok(Self {
            slopes: single(differentials(&drawn.fragments)?.value()),
            alphas: Tensor::from_flat_fn([count], |_| uniform(0.0, 1.0)),
            texture: wall(pixels, &mut uniform),
            cube: [
                Tensor::from_flat_fn([6, pixels / 4, pixels / 4, 3], |_| uniform(0.0, 1.0)),
                directions,
                Tensor::from_flat_fn([pixels * pixels], |_| uniform(0.0, 2.0)),
            ],
            normals: single(normals.value()),
            coordinates: single(coordinates),
            frames,
            material: [
                Tensor::from_flat_fn([pixels * pixels, 3], |_| uniform(0.0, 1.0)),
                Tensor::from_flat_fn([pixels * pixels], |_| uniform(0.05, 1.0)),
                Tensor::from_flat_fn([pixels * pixels], |_| uniform(0.0, 1.0)),
                Tensor::from([1.0, 2.0, 3.0]),
            ],
            positions: single(positions),
            clip: single(drawn.clip.value()),
            barycentrics: single(drawn.fragments.barycentrics.value()),
            colors: single(colors),
            surface: single(drawn.surface.value()),
            aliased: single(composite.image()?.value()),
            image: single(image.value()),
            distances: Tensor::from_flat_fn([pixels, pixels], |_| uniform(0.5, 2.0)),
            other_distances: Tensor::from_flat_fn([pixels, pixels], |_| uniform(0.5, 2.0)),
            signed: Tensor::from_flat_fn([rows, WIDTH], |_| uniform(-2.0, 2.0)),
            positive: Tensor::from_flat_fn([rows, WIDTH], |_| uniform(0.5, 2.0)),
            square: Tensor::from_flat_fn([WIDTH, WIDTH], |_| uniform(-1.0, 1.0)),
            vectors: [(); 2].map(|()| {
                let rows = (pixels * pixels).div_ceil(3);
                Tensor::from_flat_fn([rows, 3], |_| uniform(-2.0, 2.0))
            }),
            row: Tensor::from_flat_fn([3], |_| uniform(-1.0, 1.0)),
            affine: Tensor::from_flat_fn([4, 4], |k| AFFINE[k]),
            instances: Tensor::from_flat_fn([8, 4, 4], |k| match k % 16 {
                3 => (k / 16) as f64,
                entry => AFFINE[entry],
            }),
            scene,
        })
    }
}

/// Texels `[S, S, 3]` for as many pixels, and what each pixel of a wall sees of them: coordinates, and
/// how they change from pixel to pixel. Footprints are one to four texels wide, and two to three times
/// as long.
pub(crate) fn wall(pixels: usize, mut uniform: impl FnMut(f64, f64) -> f64) -> [Tensor<f64>; 3] {
    let single = |x: f64| f64::from(x as f32);
    let extent = pixels as f64;
    let at = |k: usize| [(k % pixels) as f64 / extent, (k / pixels) as f64 / extent];
    let texels = Tensor::from_flat_fn([pixels, pixels, 3], |_| uniform(0.0, 1.0));
    let places = Tensor::from_fn([pixels * pixels, 2], |[k, c]| {
        let [x, y] = at(k);
        single([(0.8 + y) * (x - 0.3), 2.0 * y * (1.0 + y) + 0.3 * x][c])
    });
    let footprints = Tensor::from_fn([pixels * pixels, 2, 2], |[k, c, axis]| {
        let [x, y] = at(k);
        let slope = [[0.8 + y, x - 0.3], [0.3, 2.0 + 4.0 * y]][c][axis];
        single(slope / extent)
    });
    [texels, places, footprints]
}
