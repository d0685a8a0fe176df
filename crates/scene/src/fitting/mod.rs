//! Fits of scenes: stages, steps, and what came out.

mod fit;
mod remeshing;
mod scores;
mod stage;

pub use self::fit::SceneFit;
pub use self::scores::{SeenView, ViewScore};
