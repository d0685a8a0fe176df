//! Triangle meshes that change: remeshing, subdivision, distances between surfaces, surfaces of fields.

mod error;
mod field;
mod grid;

pub use error::MeshError;
pub use field::{FieldSurface, extract_surface, field_surface};
pub use grid::Grid;
