//! A cube whose sides have textures, where it is, and how far off another pose of it is.
//!
//! Each texture is a quarter of a wave per side and channel, in another direction for each. So a pixel's
//! centre is within a thousandth of its mean, and there is nothing that a filter would have to take away.

use std::f64::consts::PI;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_paper::FACES;
use bokashi_render_ops::camera::perspective;
use bokashi_render_ops::{Mesh, Size};
use glam::{DMat3, DMat4, DQuat, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::bench::scenes::uniform;

/// Texels along a side's chart. The charts lie side by side in one texture.
pub(super) const TEXELS: usize = 64;
pub(super) const SIDES: usize = 6;

/// From the camera to the middle of the scene, in sides of the cube: the paper's.
const DISTANCE: f64 = 3.5;
/// Half the image's width at the distance 1: the paper's.
const HALF_WIDTH: f64 = 0.4;

/// A start is turned by half of this to all of it, in degrees, about any axis.
pub(super) const MOST_DEGREES: f64 = 12.0;
/// A start is moved by half of this to all of it, in sides of the cube, in any direction.
pub(super) const MOST_MOVED: f64 = 0.2;

/// What is known of the cube before it is photographed.
pub(super) struct Object {
    pub(super) mesh: Mesh,
    /// `[8, 3]`, from -1/2 to 1/2.
    pub(super) positions: Tensor<f64>,
    /// `[24, 2]`: the corners of each side's chart, each a texel's centre.
    pub(super) coordinates: Tensor<f64>,
    /// Which of them the corners of faces have.
    pub(super) indices: Mesh,
    /// `[TEXELS, SIDES * TEXELS, 3]`.
    pub(super) texels: Tensor<f64>,
}

impl Object {
    pub(super) fn new() -> Result<Self, FitError> {
        let bit = |vertex: usize, axis: usize| (vertex >> (2 - axis) & 1) as f64;
        let (mut coordinates, mut indices) = (Vec::new(), Vec::new());
        for (side, faces) in FACES.chunks_exact(2).enumerate() {
            let [_, across, down] = axes(side);
            // The four vertices of the side, those of the first face first.
            let mut corners: Vec<u32> = faces[0].to_vec();
            corners.extend(faces[1].iter().filter(|vertex| !faces[0].contains(vertex)));
            for &vertex in &corners {
                let [s, t] = [across, down].map(|axis| bit(vertex as usize, axis));
                let [column, row] = texture_position(side, [s, t]);
                coordinates.extend([
                    (column + 0.5) / (SIDES * TEXELS) as f64,
                    (row + 0.5) / TEXELS as f64,
                ]);
            }
            let index_of = |vertex: u32| {
                let corner = corners.iter().position(|corner| *corner == vertex);
                (4 * side + corner.expect("it is a corner of the side")) as u32
            };
            indices.extend(faces.iter().map(|face| face.map(index_of)));
        }
        let width = SIDES * TEXELS;
        let texels = Tensor::from_flat_fn([TEXELS, width, 3], |k| {
            let (row, column, channel) = (k / 3 / width, k / 3 % width, k % 3);
            let (side, column) = (column / TEXELS, column % TEXELS);
            let [s, t] = [column, row].map(|texel| texel as f64 / (TEXELS - 1) as f64);
            let kind = (3 * side + channel) as f64;
            let (sine, cosine) = (2.4 * kind).sin_cos();
            0.5 + 0.4 * (0.5 * PI * (cosine * (s - 0.5) + sine * (t - 0.5)) + 1.7 * kind).sin()
        });
        Ok(Self {
            mesh: Mesh::new(FACES.to_vec(), 8)?,
            positions: Tensor::from_flat_fn([8, 3], |k| bit(k / 3, k % 3) - 0.5),
            coordinates: Tensor::new([4 * SIDES, 2], coordinates)?,
            indices: Mesh::new(indices, 4 * SIDES)?,
            texels,
        })
    }
}

/// The axis that a side stands on, and those along its chart's rows and columns. Sides are in the order of
/// `FACES`, two to an axis, the lower one first.
pub(super) fn axes(side: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| (side / 2 + k) % 3)
}

/// The column and row in the texture, from the first texel's centre, of a place on a side.
pub(super) fn texture_position(side: usize, [s, t]: [f64; 2]) -> [f64; 2] {
    let last = (TEXELS - 1) as f64;
    [(side * TEXELS) as f64 + s * last, t * last]
}

/// From where the cube is to clip space.
pub(super) fn camera() -> DMat4 {
    let away = DMat4::from_translation(DVec3::new(0.0, 0.0, -DISTANCE));
    perspective(2.0 * HALF_WIDTH.atan(), 1.0, 1.0, 50.0) * away
}

/// Where the cube of a seed is, and where a fit starts.
pub(super) fn poses(seed: u64) -> [DMat4; 2] {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut number = || 2.0 * uniform(&mut generator) - 1.0;
    let turn = loop {
        let turn = DQuat::from_xyzw(number(), number(), number(), number());
        if (1e-3..1.0).contains(&turn.length_squared()) {
            break turn.normalize();
        }
    };
    let truth = DMat4::from_rotation_translation(
        turn,
        DVec3::new(0.2 * number(), 0.2 * number(), 0.4 * number()),
    );
    let mut off = |most: f64| {
        let direction = loop {
            let direction = DVec3::new(number(), number(), number());
            if (1e-3..1.0).contains(&direction.length_squared()) {
                break direction.normalize();
            }
        };
        most * (0.75 + 0.25 * number()) * direction
    };
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(off(MOST_DEGREES.to_radians())));
    let (rotation, translation) = (DMat3::from_mat4(truth), truth.w_axis.truncate());
    let start = DMat4::from_mat3_translation(turn * rotation, translation + off(MOST_MOVED));
    [truth, start]
}

/// How far a pose is off the true one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PoseError {
    pub(super) degrees: f64,
    /// Of the cube's middle, in its sides.
    pub(super) translation: f64,
    /// Of the vertices in the image, their mean.
    pub(super) pixels: f64,
}

impl PoseError {
    pub(super) fn new(pose: &DMat4, truth: &DMat4, size: Size) -> Self {
        let [one, other] = [pose, truth].map(|pose| DMat3::from_mat4(*pose));
        // The length of the difference of two rotations by an angle is sqrt(8) times the sine of its half;
        // no digits are lost where it is small.
        let apart: f64 = (one - other).to_cols_array().iter().map(|x| x * x).sum();
        let degrees = 2.0 * (0.125 * apart).sqrt().min(1.0).asin().to_degrees();
        let pixels = 0.5 * size.width as f64;
        let pixel_of = |pose: &DMat4, vertex: usize| {
            let corner = DVec3::from_array([2, 1, 0].map(|bit| (vertex >> bit & 1) as f64 - 0.5));
            let clip = camera() * *pose * corner.extend(1.0);
            pixels * clip.truncate().truncate() / clip.w
        };
        let distances =
            (0..8).map(|vertex| pixel_of(pose, vertex).distance(pixel_of(truth, vertex)));
        Self {
            degrees,
            translation: pose.w_axis.distance(truth.w_axis),
            pixels: distances.sum::<f64>() / 8.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_and_a_distance_are_found_however_small() {
        let [truth, start] = poses(3);
        let size = Size::square(64);
        assert_eq!(PoseError::new(&truth, &truth, size).pixels, 0.0);
        for degrees in [1e-9, 1e-3, 10.0, 180.0] {
            let turn = DMat4::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), f64::to_radians(degrees));
            let at = DMat4::from_translation(truth.w_axis.truncate());
            let found = PoseError::new(&(at * turn * at.inverse() * truth), &truth, size);
            assert!((found.degrees / degrees - 1.0).abs() < 1e-6, "{degrees}: {found:?}");
            assert!(found.translation < 1e-15, "{found:?}");
        }
        // A pixel to the right at the distance of the middle: the vertices about it move by as much.
        let unit = HALF_WIDTH * (DISTANCE - truth.w_axis.z) / 32.0;
        let moved = DMat4::from_translation(DVec3::new(unit, 0.0, 0.0)) * truth;
        let found = PoseError::new(&moved, &truth, size);
        assert!(found.degrees == 0.0 && (found.translation - unit).abs() < 1e-15, "{found:?}");
        assert!((0.95..1.15).contains(&found.pixels), "{found:?}");
        let found = PoseError::new(&start, &truth, size);
        assert!((0.5 * MOST_DEGREES..=MOST_DEGREES + 1e-9).contains(&found.degrees), "{found:?}");
        assert!((0.5 * MOST_MOVED..=MOST_MOVED + 1e-9).contains(&found.translation), "{found:?}");
    }

    #[test]
    fn a_chart_has_the_corners_of_its_side() {
        let object = Object::new().unwrap();
        for (at, (face, rows)) in object.mesh.faces().iter().zip(object.indices.faces()).enumerate()
        {
            let side = at / 2;
            let [normal, across, down] = axes(side);
            for (&vertex, &row) in face.iter().zip(rows) {
                let position = &object.positions.data()[3 * vertex as usize..][..3];
                assert_eq!(position[normal], (side % 2) as f64 - 0.5, "face {at}");
                let [column, line] =
                    texture_position(side, [position[across] + 0.5, position[down] + 0.5]);
                let found = &object.coordinates.data()[2 * row as usize..][..2];
                let width = (SIDES * TEXELS) as f64;
                assert!((found[0] * width - 0.5 - column).abs() < 1e-9, "face {at}");
                assert!((found[1] * TEXELS as f64 - 0.5 - line).abs() < 1e-9, "face {at}");
            }
        }
    }
}
