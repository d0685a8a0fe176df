//! What the fuzz targets do with their bytes. Each function decodes an input of one public entry
//! point, runs it, and panics where a promise is broken:
//!
//! - nothing panics, whatever the input: what cannot be done is an error;
//! - finite input within the stated range gives finite values and finite gradients;
//! - what was read from a file is written to the same bytes, however often;
//! - what was read of a mesh, an image or cameras of others is finite, names no part that is not there, and
//!   comes back from the file that is written of it; so do arrays, to the bit;
//! - a file is refused in a few words;
//! - a picture before a colour is that before an image of the colour, with the same squared error;
//! - the same step on the same tape gives the same bits, though its buffers were used before.

mod array_file;
mod camera_file;
mod discrete;
mod files;
mod image;
mod image_file;
mod matrix;
mod mesh;
mod mesh_file;
mod number;
mod picture;
mod saved;
mod scene_file;
mod step;

pub use array_file::array_file;
pub use camera_file::camera_file;
pub use discrete::discrete;
pub use files::let_guarded_panics_pass;
pub use image::image;
pub use image_file::image_file;
pub use matrix::matrix;
pub use mesh::mesh;
pub use mesh_file::mesh_file;
pub use picture::pictures;
pub use saved::saved;
pub use scene_file::scene_file;
