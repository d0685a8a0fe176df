//! Cameras: matrices that are fixed, from glam, and matrices on the tape, whose parameters are learnt.
//!
//! A fixed camera is a `DMat4`, a projection times a view, and [`project`](crate::project()) takes it:
//!
//! ```
//! use bokashi_render_ops::camera::{look_at, perspective};
//! use bokashi_render_ops::glam::DVec3;
//!
//! // 45 degrees high, square, from 0.1 to 100 units away, from 4 units before the origin.
//! let projection = perspective(45_f64.to_radians(), 1.0, 0.1, 100.0);
//! let camera = projection * look_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y);
//! let origin = camera * DVec3::ZERO.extend(1.0);
//! assert_eq!((origin.x, origin.y, origin.w), (0.0, 0.0, 4.0));
//! ```
//!
//! On the tape [`pinhole`] or [`orthographic`] makes a projection of intrinsics in pixels, and [`rigid`]
//! or [`se3`] a view. They multiply by `matmul`, and `project` takes the product:
//!
//! ```
//! use bokashi_core::{Tape, Tensor};
//! use bokashi_render_ops::{Size, pinhole, project, rigid};
//!
//! let tape = Tape::<f64>::new();
//! let intrinsics = tape.leaf(&Tensor::from([80.0, 80.0, 31.5, 23.5]));
//! let rotation = tape.leaf(&Tensor::from([0.0, 0.0, 0.0, 1.0]));
//! let translation = tape.leaf(&Tensor::from([0.0, 0.0, 4.0]));
//! let projection = pinhole(intrinsics, Size { width: 64, height: 48 }, 0.1, 100.0)?;
//! let camera = projection.matmul(rigid(rotation, translation)?)?;
//! let positions = tape.constant(&Tensor::zeros([1, 3]));
//! let clip = project(positions, camera, None)?;
//! // The principal point is the middle of the image, and the origin lies 4 units before the camera.
//! assert_eq!(clip.value().data()[..2], [0.0, 0.0]);
//! assert_eq!(clip.value().data()[3], 4.0);
//! # Ok::<(), bokashi_render_ops::RenderError>(())
//! ```
//!
//! A view of OpenGL's convention becomes one of OpenCV's, as [`pinhole`] expects it, by
//! [`opengl_to_opencv_view`]. `docs/notation.md` has all conventions in one table.

mod affine_inverse;
mod bend;
mod conventions;
mod distort;
mod distortion;
mod equidistant;
mod fisheye;
mod orthographic;
mod pinhole;
mod rigid;
mod screen;
mod se3;
mod stumpff;
mod turning;
mod undistorted;

pub use self::affine_inverse::affine_inverse;
pub use self::conventions::{
    from_tensor, opencv_to_opengl_pose, opencv_to_opengl_view, opengl_to_opencv_pose,
    opengl_to_opencv_view, to_tensor,
};
pub use self::distort::distort;
pub use self::distortion::distortion_radius;
pub use self::equidistant::{fisheye_angle, fisheye_limit, fisheye_radius};
pub use self::fisheye::fisheye;
pub use self::orthographic::orthographic;
pub use self::pinhole::pinhole;
pub use self::rigid::rigid;
pub use self::se3::se3;
pub use self::undistorted::undistorted;
/// Right-handed, to OpenGL clip space: from the vertical field of view in radians, width over
/// height, and the distances of the near and far planes.
pub use glam::dcamera::rh::proj::opengl::perspective;
/// Right-handed, from an eye, the point that it looks at, and the direction that is up. Its camera
/// coordinates are OpenGL's.
pub use glam::dcamera::rh::view::look_at_mat4 as look_at;
