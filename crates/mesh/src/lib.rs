//! Triangle meshes that change: remeshing, subdivision, distances between surfaces, surfaces of fields.

mod box_tree;
mod connectivity;
mod crossing;
mod derived_mesh;
mod distances;
mod edges;
mod error;
mod field;
#[cfg(test)]
mod fixtures;
mod grid;
mod measures;
mod placed;
// Unit tests compile what they call.
#[cfg(all(feature = "precompiled", not(test)))]
#[doc(hidden)]
pub mod precompiled;
mod remesh;
mod rings;
mod smooth;
mod subdivide;
mod triangle;

pub use connectivity::Connectivity;
pub use derived_mesh::DerivedMesh;
pub use distances::{
    FScore, NearestPoints, PointDistance, SurfacePoints, chamfer_distance, draw_points, f_score,
    nearest_on_surface, nearest_points, normal_consistency,
};
pub use error::MeshError;
pub use field::{FieldSurface, extract_surface, field_surface};
pub use grid::Grid;
pub use measures::{self_intersections, signed_volume, surface_area};
pub use remesh::{EdgeLengths, RemeshOptions, remesh};
pub use smooth::{Smoothing, smooth};
pub use subdivide::{Subdivision, subdivide};
