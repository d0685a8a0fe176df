//! Scenes out of focus, and what a lens sees of them: the mean of pinhole pictures through its points, which is
//! the truth, `lens_picture`, and `depth_of_field`.

mod named;
mod scene;
mod truth;
mod ways;

pub use named::{Named, named};
pub use scene::{FAR, Frame, LensScene, SKY, UNIT};
pub use truth::{mean_through, pinhole, point, through};
pub use ways::{distances, draw, draw_samples, gather};
