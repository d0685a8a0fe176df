//! Triangle meshes that change: remeshing, subdivision, distances between surfaces, surfaces of fields.

mod box_tree;
mod connectivity;
mod crossing;
mod derived_mesh;
mod edges;
mod error;
mod field;
mod grid;
#[cfg(test)]
mod fixtures;
mod measures;
mod placed;
mod remesh;
mod rings;
mod smooth;
mod subdivide;
mod triangle;

pub use connectivity::Connectivity;
pub use derived_mesh::DerivedMesh;
pub use error::MeshError;
pub use field::{FieldSurface, extract_surface, field_surface};
pub use grid::Grid;
pub use measures::{self_intersections, signed_volume, surface_area};
pub use remesh::{EdgeLengths, RemeshOptions, remesh};
pub use smooth::{Smoothing, smooth};
pub use subdivide::{Subdivision, subdivide};
