//! Images as files hold them: PNG, JPEG, OpenEXR and Radiance's.
//!
//! # What is read
//! - PNG of 8 or 16 bits. Palettes and fewer bits become 8 bits; a transparent colour becomes
//!   opacity.
//! - JPEG. An image with four inks becomes red, green and blue.
//! - OpenEXR: the first part with the channels R, G, B, and maybe A and others; or Y and A; or a
//!   single channel of any name; or the only layer that has R, G and B, as `ViewLayer.Combined.R`.
//!   A is opacity. What lies outside the display window is left out, what the file lacks is 0.
//! - Radiance's `.hdr` and `.pic`. What their header says was multiplied is divided out.
//!
//! The format is told by the first bytes. An image is read as it is stored: what Exif data say of its
//! orientation is told by [`Picture::decode_turn`], and done by [`Picture::decode_upright`] alone.
//!
//! # What is left out
//! Colour profiles, chromaticities and gamma: what a file's numbers mean is the caller's choice,
//! see [`ColorSpace`]. Animations beyond their first image, other layers and levels of OpenEXR.
//! [`Picture::remarks`] tells of what a file has of these. OpenEXR's subsampled channels and its
//! compressions DWAA and DWAB are refused. Opacity is not divided out of OpenEXR's colours, which it has
//! multiplied.
//!
//! # Sources
//! PNG, W3C Recommendation, third edition; ITU-T T.81; the OpenEXR file layout of openexr.com; Ward,
//! *Radiance file formats*.

#[cfg(feature = "image")]
mod buffers;
mod color;
mod decode;
mod exif;
mod header;
mod jpeg_file;
mod mask;
mod open_exr;
mod png_file;
mod radiance;
mod reduced;
mod remarks;
mod samples;
#[cfg(test)]
mod tests;
mod turn;
mod usual;

pub use self::color::{ColorSpace, Depth};
pub use self::mask::{Mask, MaskKind};
pub(crate) use self::reduced::reduced;
pub use self::samples::{MOST_SAMPLES, Picture, Samples, is_guarded};
pub use self::turn::Turn;
