//! The paper's experiments on a cube, built only from the public interface of the operations.
//!
//! [`run_cube`] does one fit and returns its [`Outcome`]; [`picture`] and [`outline`] draw what a
//! [`Snapshot`] of it holds. The feature `page` has the report of a set of fits.

mod alternative;
mod automorphism;
mod cube;
mod experiment;
mod first_order;
mod outcome;
#[cfg(feature = "page")]
pub mod page;
mod picture;
mod pipeline;
mod saving;
mod scene;
mod second_order;
mod settings;
mod views;

pub use alternative::{Alternative, Choice, alternatives};
pub use automorphism::automorphisms;
pub use bokashi_render_ops::{Kernel, Silhouettes};
pub use cube::{FACES, VERTEX_COUNT, View, random_start, truth};
pub use experiment::run_cube;
pub use outcome::{Outcome, Progress, Record, STUCK, Snapshot};
pub use picture::{edges, outline, picture};
pub use pipeline::{CubeMeasure, CubePipeline};
pub use saving::{Saving, run_cube_saving};
pub use settings::{CubeSettings, Experiment, Precision, Preset, Rates};
pub use views::CubeViews;
