//! Images as files hold them: PNG, JPEG and OpenEXR.
//!
//! # What is read
//! - PNG of 8 or 16 bits. Palettes and fewer bits become 8 bits; a transparent colour becomes
//!   opacity.
//! - JPEG. An image with four inks becomes red, green and blue.
//! - OpenEXR: the first layer with the channels R, G, B, and maybe A and others; or Y and A; or a
//!   single channel of any name. A is opacity. What lies outside the display window is left out,
//!   what the file lacks is 0.
//!
//! The format is told by the first bytes. An orientation in Exif data is applied.
//!
//! # What is left out
//! Colour profiles, chromaticities and gamma: what a file's numbers mean is the caller's choice,
//! see [`ColorSpace`]. Animations beyond their first image, other layers and levels of OpenEXR, its
//! subsampled channels and its compressions DWAA and DWAB. Opacity is not divided out of OpenEXR's
//! colours, which it has multiplied.
//!
//! # Sources
//! PNG, W3C Recommendation, third edition; ITU-T T.81; the OpenEXR file layout of openexr.com.

mod buffers;
mod color;
mod decode;
mod encode;
mod open_exr;
mod samples;
#[cfg(test)]
mod tests;

pub use self::color::{ColorSpace, Depth};
pub use self::samples::{MOST_SAMPLES, Picture, Samples, is_guarded};
