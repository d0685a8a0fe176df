//! From the numbers of a scene to pictures.
//!
//! All objects are drawn as one mesh, so that one visibility decides what is in front. Each material is
//! looked up at its own fragments alone, and light is worked out once for all of them.

mod drawing;
mod fields;
mod fragment_cache;
mod lens;
mod lighting;
mod maps;
mod margin;
mod materials;
mod normals;
mod parts;
#[cfg(test)]
mod tests;
mod view_camera;

pub use drawing::{Drawn, Renderer};
pub(crate) use fields::{OnSurfaces, SeenPoint, field_name};
