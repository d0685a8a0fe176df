//! Cameras of photographs, from the files in which other programs leave them.
//!
//! | file | written by | camera coordinates | first pixel |
//! |---|---|---|---|
//! | `transforms.json` | NeRF, instant-ngp, nerfstudio | OpenGL's, camera to world | corner at (0, 0) |
//! | `cameras`, `images` (`.txt`, `.bin`) | COLMAP | OpenCV's, world to camera | corner at (0, 0) |
//!
//! A [`Camera`] has OpenCV's conventions throughout: world to camera, and the first pixel's
//! *centre* at (0, 0). Files become that in one place, `camera.rs`. Images that are smaller than their
//! cameras by a whole factor scale them, in `camera_file.rs`.

mod camera;
mod camera_file;
mod colmap;
mod distortion;
mod keys;
mod rotation;
#[cfg(test)]
mod tests;
mod transforms;

pub use self::camera::{Camera, NamedView};
pub use self::camera_file::CameraFile;
pub use self::colmap::{ColmapPoint, find_colmap, read_colmap, read_colmap_points};
pub use self::distortion::Distortion;
pub use self::transforms::{read_transforms, transforms_json};
