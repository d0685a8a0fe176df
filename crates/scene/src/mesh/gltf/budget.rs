//! How much memory a file may ask for.
//!
//! A short glTF file can name one large part very often: an accessor in many primitives, a mesh in many
//! nodes. Files that share parts for a purpose stay far below this bound.

use crate::error::{Location, SceneError};

/// Bytes of memory that each byte of the file and its buffers allows.
const BYTES_OF_A_BYTE: u64 = 32;
/// Bytes of memory that every file may ask for.
const BASE: u64 = 64 << 20;

/// Bytes of memory that are left to a file.
#[derive(Debug)]
pub(super) struct Budget {
    most: u64,
    spent: u64,
    /// Bytes that were read, and those of them that images have.
    read: u64,
    of_images: u64,
}

impl Budget {
    /// That of a file of so many bytes.
    pub(super) fn new(bytes: usize) -> Self {
        let mut budget = Self { most: BASE, spent: 0, read: 0, of_images: 0 };
        budget.earn(bytes);
        budget
    }

    /// Another file of so many bytes was read.
    pub(super) fn earn(&mut self, bytes: usize) {
        self.read = self.read.saturating_add(bytes as u64);
        self.most = self.most.saturating_add((bytes as u64).saturating_mul(BYTES_OF_A_BYTE));
    }

    /// Refuses what takes more memory than is left: `count` parts of `bytes` each.
    pub(super) fn spend(
        &mut self,
        count: u64,
        bytes: usize,
        location: &Location,
    ) -> Result<(), SceneError> {
        self.spent = self.spent.saturating_add(count.saturating_mul(bytes as u64));
        check("bytes of meshes in a file of this length", self.most, self.spent, location)
    }

    /// Refuses images that together have more bytes than were read: they overlap. A few bytes of an image
    /// may be very many pixels.
    pub(super) fn spend_image(
        &mut self,
        bytes: usize,
        location: &Location,
    ) -> Result<(), SceneError> {
        self.of_images = self.of_images.saturating_add(bytes as u64);
        check("bytes of images in a file of this length", self.read, self.of_images, location)
    }
}

fn check(what: &'static str, most: u64, found: u64, location: &Location) -> Result<(), SceneError> {
    match found > most {
        true => Err(SceneError::TooLarge { location: location.clone(), what, most, found }),
        false => Ok(()),
    }
}
