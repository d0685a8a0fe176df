//! What can be said of meshes and cameras before a fit: whether a surface is closed, whether a camera sees
//! it, how its lens bends it, and which files a mesh file names.

mod geometry;
mod lens;
mod named;

pub use self::geometry::MeshSummary;
pub use self::lens::{BentEdge, lens_note, most_bent_edges};
pub use self::named::named_files;
