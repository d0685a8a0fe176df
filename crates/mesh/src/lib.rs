//! Triangle meshes that change: remeshing, subdivision, distances between surfaces, surfaces of fields.

mod distances;
mod error;
mod field;
mod grid;
// Unit tests compile what they call.
#[cfg(all(feature = "precompiled", not(test)))]
#[doc(hidden)]
pub mod precompiled;

pub use distances::{
    FScore, NearestPoints, PointDistance, SurfacePoints, chamfer_distance, draw_points, f_score,
    nearest_on_surface, nearest_points, normal_consistency,
};
pub use error::MeshError;
pub use field::{FieldSurface, extract_surface, field_surface};
pub use grid::Grid;
