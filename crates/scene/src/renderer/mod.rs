//! From the numbers of a scene to pictures.
//!
//! All objects are drawn as one mesh, so that one visibility decides what is in front. Each material is
//! looked up at its own fragments alone, and light is worked out once for all of them.

mod drawing;
mod frame;
mod kept;
mod lighting;
mod looks;
mod normals;
mod parts;
mod sight;
#[cfg(test)]
mod tests;

pub use drawing::{Drawn, Renderer};
