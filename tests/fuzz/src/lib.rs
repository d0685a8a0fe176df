//! What the fuzz targets do with their bytes. Each function decodes an input of one public entry
//! point, runs it, and panics where a promise is broken:
//!
//! - nothing panics, whatever the input: what cannot be done is an error;
//! - finite input within the stated range gives finite values and finite gradients;
//! - what was read from a file is written to the same bytes, however often;
//! - a picture before a colour is that before an image of the colour, with the same squared error;
//! - the same step on the same tape gives the same bits, though its buffers were used before.

mod discrete;
mod image;
mod matrix;
mod mesh;
mod number;
mod picture;
mod saved;
mod step;

pub use discrete::discrete;
pub use image::image;
pub use matrix::matrix;
pub use mesh::mesh;
pub use picture::pictures;
pub use saved::saved;
