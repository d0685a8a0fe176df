//! What samples share and what is no part of a pipeline.

mod measure;
mod mesh;
mod random;

pub use measure::{VertexDistance, psnr, vertex_distance};
pub use mesh::{Shape, cube, sphere};
pub use random::Random;
