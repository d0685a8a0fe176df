//! Triangle meshes that change: remeshing, subdivision, distances between surfaces, surfaces of fields.

mod error;

pub use error::MeshError;
