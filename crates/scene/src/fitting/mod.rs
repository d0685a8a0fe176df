//! Fits of scenes: stages, steps, and what came out.

mod alignment;
mod beginning;
mod fields;
mod fit;
mod held_out;
mod remeshing;
mod scores;
mod stage;
mod starts;
mod surfaces;
mod texturing;
mod transitions;

pub use self::fit::SceneFit;
pub use self::scores::{ViewComparison, ViewScore};
