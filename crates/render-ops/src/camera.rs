//! Camera matrices, from glam: a projection times a view is what [`project`](crate::project()) takes.
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

/// Right-handed, to OpenGL clip space: from the vertical field of view in radians, width over
/// height, and the distances of the near and far planes.
pub use glam::dcamera::rh::proj::opengl::perspective;
/// Right-handed, from an eye, the point that it looks at, and the direction that is up.
pub use glam::dcamera::rh::view::look_at_mat4 as look_at;
