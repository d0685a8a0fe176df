//! A camera in OpenCV's conventions, and what brings others to it.
//!
//! # Source
//! The pinhole and the lens of OpenCV's module `calib3d`; `docs/notation.md`, Cameras.

use std::path::PathBuf;

use bokashi_render_ops::Size;
use bokashi_render_ops::camera::{fisheye_angle, opencv_to_opengl_pose, opengl_to_opencv_pose};
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};

use super::distortion::Distortion;

/// From the corner of the first pixel to its centre.
const HALF: f64 = 0.5;

/// A camera that stands somewhere in the world: OpenCV's conventions throughout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Of its images.
    pub size: Size,
    /// (fx, fy, cx, cy) in pixels. The centre of the first pixel is (0, 0).
    pub intrinsics: [f64; 4],
    /// Of the lens.
    pub distortion: Distortion,
    /// World to camera coordinates: x right, y down, z forward. A rotation and a translation.
    pub view: DMat4,
}

/// A photograph and its camera.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedView {
    /// The image's name in the file of cameras; no two views of a file have the same.
    pub name: String,
    /// The image's file, relative to the scene's folder; absolute where the file of cameras has it
    /// so.
    pub image: PathBuf,
    /// The mask's file, as `image`, where the file of cameras names one.
    pub mask: Option<PathBuf>,
    /// The camera.
    pub camera: Camera,
}

impl Camera {
    /// A camera without distortion that stands at the origin and looks along z.
    pub const fn new(size: Size, intrinsics: [f64; 4]) -> Self {
        Self { size, intrinsics, distortion: Distortion::NONE, view: DMat4::IDENTITY }
    }

    /// This camera where a pose of OpenCV's convention, camera to world, has it.
    pub fn with_opencv_pose(self, pose: DMat4) -> Self {
        Self { view: inverse(pose), ..self }
    }

    /// This camera where a pose of OpenGL's convention (x right, y up, z backward), camera to
    /// world, has it.
    pub fn with_opengl_pose(self, pose: DMat4) -> Self {
        self.with_opencv_pose(opengl_to_opencv_pose(pose))
    }

    /// This camera with the view of a unit quaternion and a translation, world to camera, OpenCV's
    /// convention.
    pub fn with_rotation_and_translation(self, rotation: DQuat, translation: DVec3) -> Self {
        Self { view: DMat4::from_rotation_translation(rotation, translation), ..self }
    }

    /// The pose, camera to world, of OpenCV's convention.
    pub fn opencv_pose(&self) -> DMat4 {
        inverse(self.view)
    }

    /// The pose, camera to world, of OpenGL's convention.
    pub fn opengl_pose(&self) -> DMat4 {
        opencv_to_opengl_pose(self.opencv_pose())
    }

    /// Whether all of its numbers are finite, those of its pose too.
    pub fn is_finite(&self) -> bool {
        let numbers = self.intrinsics.iter().chain(self.distortion.coefficients());
        numbers.into_iter().all(|number| number.is_finite())
            && self.view.is_finite()
            && self.opencv_pose().is_finite()
    }

    /// Where a point of the world is seen, in OpenCV's pixels: 1/2 less than the pixels of this
    /// project. None where the camera can't see: in the plane of a pinhole and behind it, and
    /// beyond where the formula of the lens holds.
    pub fn pixel(&self, point: DVec3) -> Option<DVec2> {
        self.pixels()(point)
    }

    /// [`Camera::pixel`] for many points: what they have in common is worked out once.
    pub fn pixels(&self) -> impl Fn(DVec3) -> Option<DVec2> {
        let (view, shows) = (self.view, self.distortion.shows());
        let [fx, fy, cx, cy] = self.intrinsics;
        move |point| {
            let shown = shows(view.transform_point3(point))?;
            Some(DVec2::new(fx * shown.x + cx, fy * shown.y + cy))
        }
    }

    /// The angle in radians between the axis and what is seen so many pixels from the principal
    /// point along x, or with `k = 1` along y. Only a fisheye's lens is minded. None beyond where
    /// its formula holds.
    pub fn angle_at(&self, k: usize, pixels: f64) -> Option<f64> {
        let radius = pixels / self.intrinsics[k];
        match self.distortion {
            Distortion::Fisheye(coefficients) => {
                fisheye_angle(radius.abs(), coefficients).map(|angle| angle.copysign(radius))
            }
            _ => Some(radius.atan()),
        }
    }

    /// The camera of the same images, made larger or smaller.
    pub fn resized(&self, size: Size) -> Self {
        let share = |new: usize, old: usize| new as f64 / old as f64;
        let by = [share(size.width, self.size.width), share(size.height, self.size.height)];
        let [fx, fy, cx, cy] = self.intrinsics;
        let center = |c: f64, by: f64| (c + HALF) * by - HALF;
        let intrinsics = [fx * by[0], fy * by[1], center(cx, by[0]), center(cy, by[1])];
        Self { size, intrinsics, ..*self }
    }

    /// The camera of images with a `k`-th of the rows and columns, each pixel the mean of a block. What is left
    /// at the right and below is cut off, but for an image that is smaller than a block.
    pub fn scaled(&self, k: usize) -> Self {
        let Size { width, height } = self.size;
        let k = k.max(1);
        let size = Size { width: (width / k).max(1), height: (height / k).max(1) };
        let k = k as f64;
        let [fx, fy, cx, cy] = self.intrinsics;
        let [cx, cy] = [cx, cy].map(|c| (c + HALF) / k - HALF);
        Self { size, intrinsics: [fx / k, fy / k, cx, cy], ..*self }
    }
}

/// Intrinsics of a file in which the first pixel's corner is (0, 0), in OpenCV's pixels.
pub(super) fn from_corner([fx, fy, cx, cy]: [f64; 4]) -> [f64; 4] {
    [fx, fy, cx - HALF, cy - HALF]
}

/// Intrinsics as files have them in which the first pixel's corner is (0, 0).
pub(super) fn to_corner([fx, fy, cx, cy]: [f64; 4]) -> [f64; 4] {
    [fx, fy, cx + HALF, cy + HALF]
}

/// The inverse of a linear map and a translation.
fn inverse(map: DMat4) -> DMat4 {
    let linear = DMat3::from_mat4(map).inverse();
    let translation = -(linear * map.w_axis.truncate());
    DMat4::from_cols(
        linear.x_axis.extend(0.0),
        linear.y_axis.extend(0.0),
        linear.z_axis.extend(0.0),
        translation.extend(1.0),
    )
}
