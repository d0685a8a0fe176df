//! What samples share and what is no part of a pipeline.

mod globe;
mod measure;
mod mesh;
mod random;

pub use globe::{globe, motley};
pub use measure::{VertexDistance, psnr, root_mean_square, vertex_distance};
pub use mesh::{Shape, cube, sphere};
pub use random::Random;
