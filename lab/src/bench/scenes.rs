//! The scenes whose times are compared with those of other renderers: a coloured cube and spheres,
//! seen by the camera of the paper's experiment 5.2.

use std::f64::consts::PI;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_paper::{FACES, View, truth};
use bokashi_render_ops::{Mesh, Size};
use glam::{DMat4, DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A mesh with a colour per vertex before a camera.
#[derive(Debug, Clone)]
pub struct Scene {
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    /// `[V, 3]`.
    pub(crate) positions: Tensor<f64>,
    /// `[V, 3]`.
    pub(crate) colors: Tensor<f64>,
    pub(crate) camera: DMat4,
    pub(crate) size: Size,
    /// Whether the creases of its colours are resolved, beside the seams that the mesh has.
    pub(crate) has_creases: bool,
}

/// The radius of the spheres.
const RADIUS: f64 = 0.8;

impl Scene {
    fn new(
        name: String,
        faces: Vec<[u32; 3]>,
        positions: Tensor<f64>,
        colors: Tensor<f64>,
        pixels: usize,
    ) -> Result<Self, FitError> {
        let mesh = Mesh::new(faces, positions.shape()[0])?;
        let (camera, size) = (View::fixed().camera(), Size::square(pixels));
        Ok(Self { name, mesh, positions, colors, camera, size, has_creases: false })
    }

    /// The largest scene of the table, 80,064 faces in 1024 x 1024 pixels, its adjacency built.
    pub(crate) fn largest() -> Result<Self, FitError> {
        let scene = Self::sphere("sphere80k", 288, 140, 1024)?;
        scene.mesh.adjacency();
        Ok(scene)
    }

    /// Its name: the mesh, and the pixels along a side.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The cube, 12 faces, in `pixels` x `pixels`.
    pub(crate) fn cube(pixels: usize) -> Result<Self, FitError> {
        let truth = truth(None);
        let name = format!("cube@{pixels}");
        Self::new(name, FACES.to_vec(), truth.vertices, truth.colors, pixels)
    }

    /// A sphere of `around` x `along` quads, those at the poles triangles: `2 around (along - 1)`
    /// faces, in `pixels` x `pixels`.
    pub(crate) fn sphere(
        name: &str,
        around: usize,
        along: usize,
        pixels: usize,
    ) -> Result<Self, FitError> {
        let (faces, positions) = bokashi_catalogue::setting::sphere(RADIUS, around, along);
        let colors = positions.map(|x: f64| x / (2.0 * RADIUS) + 0.5);
        Self::new(format!("{name}@{pixels}"), faces, positions, colors, pixels)
    }

    /// The same in `pixels` x `pixels`.
    pub(crate) fn with_pixels(&self, pixels: usize) -> Self {
        Self { size: Size::square(pixels), ..self.clone() }
    }

    /// Positions shifted, each coordinate by up to `largest` either way: the same for one seed.
    pub(crate) fn shifted(&self, largest: f64, seed: u64) -> Tensor<f64> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        self.positions.map(|x: f64| x + largest * (2.0 * uniform(&mut generator) - 1.0))
    }

    /// Positions shifted within the image plane, their depths as they are, so that either pixel
    /// coordinate moves by a normally distributed number of standard deviation `pixels`.
    pub(crate) fn jittered(&self, pixels: f64, seed: u64) -> Tensor<f64> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        // Box and Muller: a pair of independent normal deviates from a pair of uniform ones.
        let mut deviates = move || {
            let radius = pixels * (-2.0 * (1.0 - uniform(&mut generator)).ln()).sqrt();
            radius * DVec2::from_angle(2.0 * PI * uniform(&mut generator))
        };
        let back = self.camera.inverse();
        let size = DVec2::new(self.size.width as f64, self.size.height as f64);
        let mut positions = self.positions.clone();
        for position in positions.data_mut().as_chunks_mut::<3>().0 {
            let point = DVec3::from_array(*position);
            let w = (self.camera * point.extend(1.0)).w;
            // Pixels per unit of x / w are half the width: this is the shift of x and y.
            let clip = deviates() * 2.0 * w / size;
            *position = (point + (back * clip.extend(0.0).extend(0.0)).truncate()).to_array();
        }
        positions
    }
}

/// A multiple of 2^-53, uniform in [0, 1).
pub(crate) fn uniform(generator: &mut impl Rng) -> f64 {
    (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// The scenes of the table, smallest first.
pub fn scenes() -> Result<Vec<Scene>, FitError> {
    Ok(vec![
        Scene::cube(32)?,
        Scene::cube(256)?,
        Scene::cube(1024)?,
        Scene::sphere("sphere1k", 32, 17, 256)?,
        Scene::sphere("sphere20k", 144, 70, 512)?,
        Scene::largest()?,
    ])
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use bokashi_core::Tape;
    use bokashi_render_ops::{Cull, RasterOptions, project, rasterize};
    use glam::DVec4;

    use super::*;

    #[test]
    fn scenes_have_the_faces_of_their_names() {
        let counts = scenes().unwrap().into_iter().map(|scene| {
            (scene.name, scene.mesh.faces().len(), scene.mesh.vertex_count(), scene.size.width)
        });
        let expected = [
            ("cube@32", 12, 8, 32),
            ("cube@256", 12, 8, 256),
            ("cube@1024", 12, 8, 1024),
            ("sphere1k@256", 1024, 514, 256),
            ("sphere20k@512", 19872, 9938, 512),
            ("sphere80k@1024", 80064, 40034, 1024),
        ];
        let expected = expected.map(|(name, f, v, px)| (name.to_owned(), f, v, px));
        assert_eq!(counts.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn surfaces_are_closed_and_turn_their_front_outside() {
        for scene in scenes().unwrap() {
            // Every edge has two faces, which run along it in opposite directions.
            let mut edges = BTreeMap::new();
            for &[a, b, c] in scene.mesh.faces() {
                for edge in [[a, b], [b, c], [c, a]] {
                    assert_eq!(edges.insert(edge, ()), None, "{} {edge:?}", scene.name);
                }
            }
            assert!(edges.keys().all(|&[a, b]| edges.contains_key(&[b, a])), "{}", scene.name);
            let tape = Tape::new();
            let clip = project(tape.constant(&scene.positions), &scene.camera, None).unwrap();
            let ids = |cull| {
                let options = RasterOptions::new(scene.size).cull(cull);
                rasterize(clip, &scene.mesh, options).unwrap().coverage.triangle_ids()
            };
            let all = ids(Cull::None);
            assert_eq!(ids(Cull::Back), all, "{}", scene.name);
            let covered = all.iter().filter(|&&id| id > 0).count() as f64 / all.len() as f64;
            assert!((0.2..0.3).contains(&covered), "{} covers {covered}", scene.name);
        }
    }

    #[test]
    fn jitter_moves_pixels_by_its_deviation_and_no_depth() {
        let scene = Scene::sphere("sphere1k", 32, 17, 256).unwrap();
        let clip = |positions: &Tensor<f64>| -> Vec<DVec4> {
            let points = positions.data().as_chunks::<3>().0.iter();
            points.map(|&point| scene.camera * DVec3::from_array(point).extend(1.0)).collect()
        };
        let jittered = scene.jittered(0.3, 0);
        let mut shifts: Vec<f64> = Vec::new();
        for (before, after) in clip(&scene.positions).into_iter().zip(clip(&jittered)) {
            assert!((after.w - before.w).abs() < 1e-14 && (after.z - before.z).abs() < 1e-14);
            let shift = 128.0 * (after / after.w - before / before.w);
            shifts.extend([shift.x, shift.y]);
        }
        let moment = |order: i32| {
            shifts.iter().map(|shift| shift.powi(order)).sum::<f64>() / shifts.len() as f64
        };
        // Of 1028 normal deviates; the kurtosis of uniform ones is 1.8.
        assert!(moment(1).abs() < 0.03, "{}", moment(1));
        assert!((moment(2).sqrt() - 0.3).abs() < 0.02, "{}", moment(2).sqrt());
        let kurtosis = moment(4) / moment(2).powi(2);
        assert!((2.5..3.5).contains(&kurtosis), "{kurtosis}");
        // The same share of a larger image is the same shift in the world.
        assert_eq!(jittered, scene.with_pixels(1024).jittered(4.0 * 0.3, 0));
    }
}
