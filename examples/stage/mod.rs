//! What samples share: what they are asked for and what they find, meshes, textures, random numbers, figures
//! of merit, a fit that is watched, and surfaces and lights that don't change.

mod asked;
mod found;
mod globe;
mod learn;
mod measure;
mod mesh;
mod random;
mod sky;
mod surface;

pub use asked::Asked;
pub use found::{Curve, Found, Goal};
pub use globe::{globe, motley, substance};
pub use learn::learn;
pub use measure::{
    VertexDistance, relative_error, root_mean_square, surface_distance, vertex_distance,
};
pub use mesh::{Boards, Object, Shape, ball, bunny, cluster, cube, planet, sphere};
pub use random::Random;
pub use sky::{StillLights, column, sky};
pub use surface::StillSurface;
