//! The paper's cube, its camera and its poses.
//!
//! Vertices `{-1/2, 1/2}^3` in binary order (x outermost), 12 faces, colours = position + 1/2. The
//! camera looks along -z from a distance of 3.5 with near plane 1, far plane 50 and half-width 0.4
//! of the near plane.
//!
//! Everything random is drawn in `f64` by ChaCha8 and made with operations that IEEE 754 rounds
//! exactly, so that every machine and every precision sees the same start and the same poses.
//!
//! # Source
//! Random rotations: Marsaglia, *Choosing a point from the surface of a sphere*, Annals of
//! Mathematical Statistics 43(2), 1972: a point on the 3-sphere from two points in the unit disc.

use bokashi_core::Tensor;
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::outcome::Snapshot;

/// The faces of the cube, two per side.
pub const FACES: [[u32; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 6, 7],
    [4, 7, 5],
    [0, 4, 5],
    [0, 5, 1],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 5, 7],
    [1, 7, 3],
];

/// The number of vertices of the cube.
pub const VERTEX_COUNT: usize = 8;

/// The near plane's distance.
const NEAR: f64 = 1.0;
/// The far plane's distance.
const FAR: f64 = 50.0;
/// Half the width of the near plane, so that a cube in any pose fits in the image.
const HALF_WIDTH: f64 = 0.4;
/// From the camera to the centre of the cube.
const DISTANCE: f64 = 3.5;
/// Angles about x and y of the pose of experiment 5.2.
const FIXED_ANGLES: [f64; 2] = [0.6, 0.5];

/// The cube as it should be, with blur `sigma` in pixels.
pub fn truth(sigma: Option<f64>) -> Snapshot {
    // Entry 3 v + axis is bit 2 - axis of v.
    let bit = |k: usize| ((k / 3) >> (2 - k % 3)) as f64 % 2.0;
    Snapshot {
        step: 0,
        vertices: Tensor::from_flat_fn([VERTEX_COUNT, 3], |k| bit(k) - 0.5),
        colors: Tensor::from_flat_fn([VERTEX_COUNT, 3], bit),
        sigma,
    }
}

/// Where a fit of vertices and colours starts: the true vertices, each shifted by a uniform offset
/// in `[-1/2, 1/2]^3`, and uniform colours in `[0, 1]^3`.
pub fn random_start(seed: u64, sigma: Option<f64>) -> Snapshot {
    let mut generator = generator(seed, 0);
    let truth = truth(sigma);
    let vertices = truth.vertices.map(|x| x + uniform(&mut generator) - 0.5);
    let colors = truth.colors.map(|_: f64| uniform(&mut generator));
    Snapshot { vertices, colors, ..truth }
}

/// How the cube is turned in front of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    rotation: DMat3,
}

impl View {
    /// The pose of experiment 5.2.
    pub fn fixed() -> Self {
        Self::angles(FIXED_ANGLES)
    }

    /// Turned about y by the second angle, then about x by the first, in radians; positive angles
    /// turn z towards y and z towards x.
    pub fn angles([about_x, about_y]: [f64; 2]) -> Self {
        let rotation = DMat3::from_rotation_x(-about_x) * DMat3::from_rotation_y(about_y);
        Self { rotation }
    }

    /// A rotation uniform over all rotations: a function of the seed and the step alone.
    pub fn random(seed: u64, step: u64) -> Self {
        // Stream 0 makes the start.
        let mut generator = generator(seed, step.wrapping_add(1));
        let (x, y, _) = in_disc(&mut generator);
        let (u, v, squared) = in_disc(&mut generator);
        let scale = ((1.0 - (x * x + y * y)) / squared).sqrt();
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, scale * u, scale * v));
        Self { rotation }
    }

    /// Projection times view times model.
    pub fn camera(&self) -> DMat4 {
        let projection = DMat4::from_cols(
            DVec4::new(NEAR / HALF_WIDTH, 0.0, 0.0, 0.0),
            DVec4::new(0.0, NEAR / HALF_WIDTH, 0.0, 0.0),
            DVec4::new(0.0, 0.0, -(FAR + NEAR) / (FAR - NEAR), -1.0),
            DVec4::new(0.0, 0.0, -2.0 * FAR * NEAR / (FAR - NEAR), 0.0),
        );
        let view = DMat4::from_translation(DVec3::new(0.0, 0.0, -DISTANCE));
        projection * view * DMat4::from_mat3(self.rotation)
    }
}

/// The generator of `seed`; streams of one seed are independent.
fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream);
    generator
}

/// A multiple of 2^-53, uniform in [0, 1).
fn uniform(generator: &mut impl Rng) -> f64 {
    (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// A point uniform in the unit disc without its centre, and its squared distance from there.
fn in_disc(generator: &mut impl Rng) -> (f64, f64, f64) {
    loop {
        let x = 2.0 * uniform(generator) - 1.0;
        let y = 2.0 * uniform(generator) - 1.0;
        let squared = x * x + y * y;
        if squared > 0.0 && squared < 1.0 {
            return (x, y, squared);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_takes_vertices_to_the_clip_positions_of_the_golden_case() {
        // The first, the second and the last vertex of golden/cube_16.json.
        let golden = [
            (0, [-1.6962601256182197, -1.3126899766719824, 1.4792092409257411, 3.381985349124731]),
            (1, [-0.4976962791077122, -0.07388900578665303, 0.725345826416723, 2.6576852057729297]),
            (7, [1.6962601256182197, 1.3126899766719824, 1.7248723917273208, 3.618014650875269]),
        ];
        let vertices = truth(None).vertices;
        let camera = View::fixed().camera();
        for (vertex, expected) in golden {
            let position = &vertices.data()[3 * vertex..][..3];
            let clip = camera * DVec3::from_slice(position).extend(1.0);
            assert!((clip - DVec4::from_array(expected)).abs().max_element() < 1e-14, "{clip}");
        }
    }

    #[test]
    fn colors_are_positions_plus_a_half_and_no_vertex_is_named_twice() {
        let truth = truth(Some(2.0));
        assert_eq!(truth.vertices.data()[..6], [-0.5, -0.5, -0.5, -0.5, -0.5, 0.5]);
        assert_eq!(truth.vertices.data()[21..], [0.5, 0.5, 0.5]);
        assert_eq!(truth.colors, truth.vertices.map(|x: f64| x + 0.5));
        assert_eq!(truth.sigma, Some(2.0));
        // A closed surface: every edge has two faces, and V - E + F = 2.
        assert_eq!(crate::scenes::edges().len(), 18);
        assert_eq!(VERTEX_COUNT + FACES.len() - 18, 2);
    }

    #[test]
    fn poses_are_rotations_and_a_function_of_seed_and_step() {
        for step in 0..100 {
            let view = View::random(7, step);
            let should_be_one = view.rotation * view.rotation.transpose();
            assert!(should_be_one.abs_diff_eq(DMat3::IDENTITY, 1e-14));
            assert!((view.rotation.determinant() - 1.0).abs() < 1e-14);
            assert_eq!(view, View::random(7, step));
            assert_ne!(view, View::random(7, step + 1));
            assert_ne!(view, View::random(8, step));
        }
    }

    #[test]
    fn poses_are_uniform_over_rotations() {
        // Over uniform rotations every entry has mean 0 and mean square 1/3, and the angle's
        // density (1 - cos a) / pi gives the trace 1 + 2 cos a a mean square of 1.
        let n = 20_000;
        let (mut sum, mut squares, mut trace_squares) = ([0.0; 9], [0.0; 9], 0.0);
        for step in 0..n {
            let entries = View::random(1, step).rotation.to_cols_array();
            for k in 0..9 {
                sum[k] += entries[k] / n as f64;
                squares[k] += entries[k] * entries[k] / n as f64;
            }
            trace_squares += (entries[0] + entries[4] + entries[8]).powi(2) / n as f64;
        }
        // Five standard deviations of the means.
        assert!(sum.iter().all(|mean| mean.abs() < 5.0 * (1.0_f64 / 3.0 / n as f64).sqrt()));
        assert!(squares.iter().all(|mean| (mean - 1.0 / 3.0).abs() < 5.0 * 0.3 / 141.0));
        assert!((trace_squares - 1.0).abs() < 5.0 * 1.5 / 141.0, "{trace_squares}");
    }

    #[test]
    fn starts_lie_within_half_a_side_of_the_truth_and_differ_by_seed() {
        let truth = truth(None);
        let mut widest = 0.0_f64;
        for seed in 0..50 {
            let start = random_start(seed, None);
            for (x, true_x) in start.vertices.data().iter().zip(truth.vertices.data()) {
                assert!((x - true_x).abs() <= 0.5);
                widest = widest.max((x - true_x).abs());
            }
            assert!(start.colors.data().iter().all(|color| (0.0..1.0).contains(color)));
            assert_ne!(start.vertices, random_start(seed + 1, None).vertices);
        }
        assert!(widest > 0.49);
    }
}
