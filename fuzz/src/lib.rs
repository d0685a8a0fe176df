//! What the fuzz targets do with their bytes. Each function decodes an input of one public entry
//! point, runs it, and panics where a promise is broken:
//!
//! - nothing panics, whatever the input: what cannot be done is an error;
//! - finite input within the stated range gives finite values and finite gradients;
//! - the same step on the same tape gives the same bits, though its buffers were used before.

mod image;
mod matrix;
mod mesh;
mod number;
mod step;

pub use image::image;
pub use matrix::matrix;
pub use mesh::mesh;
