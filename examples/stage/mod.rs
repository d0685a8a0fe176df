//! What samples share: what they are asked for and what they find, meshes, textures, random numbers, figures
//! of merit, a fit that is watched, and surfaces and lights that don't change.

mod globe;
mod learn;
mod lens;
mod measure;
mod mesh;
mod outcome;
mod random;
mod request;
mod sky;
mod surface;

pub use globe::{globe, motley, substance};
pub use learn::learn;
pub use lens::mean_through_lens;
pub use measure::{
    VertexDistance, relative_error, root_mean_square, surface_distance, vertex_distance,
};
pub use mesh::{Boards, Object, Shape, ball, bunny, cluster, cube, planet, sphere};
pub use outcome::{Curve, Goal, Outcome};
pub use random::Random;
pub use request::Request;
pub use sky::{ConstantLights, column, sky};
pub use surface::ConstantSurface;
