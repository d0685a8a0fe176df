//! What an image file says before its pixels.

use super::exif::Exif;
use super::turn::Turn;

/// What an image file says before its pixels.
pub(super) struct Header {
    /// Columns and rows.
    pub(super) size: [usize; 2],
    /// A colour profile, as ICC has them.
    pub(super) profile: Option<Vec<u8>>,
    /// Exif data.
    pub(super) exif: Option<Vec<u8>>,
}

impl Header {
    /// Of a format without colour profiles and Exif data.
    pub(super) const fn from_size(size: [usize; 2]) -> Self {
        Self { size, profile: None, exif: None }
    }

    /// The Exif data, where they can be read.
    pub(super) fn exif(&self) -> Option<Exif<'_>> {
        Exif::new(self.exif.as_deref()?)
    }

    /// How viewers turn the image, where its Exif data say so.
    pub(super) fn turn(&self) -> Option<Turn> {
        Turn::from_exif(self.exif()?.orientation()?)
    }
}
