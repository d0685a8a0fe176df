//! What can be said of meshes and cameras before a fit: whether a surface is closed, whether a camera sees
//! it, and which files a mesh file names.

mod geometry;
mod named;
mod sight;

pub use self::geometry::Outline;
pub use self::named::named_files;
pub use self::sight::{gaze, share_seen};
