//! How viewers turn a photograph: what its Exif data say of it.
//!
//! # Source
//! The tag `Orientation` of Exif 2.32, 4.6.4.

use std::fmt;
use std::path::Path;

use image::metadata::Orientation;

use super::samples::Picture;
use crate::error::{Place, SceneError};
use crate::folder::Folder;

/// How viewers turn a photograph before they show it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn(pub(super) Orientation);

impl Turn {
    /// Nothing for an image that is shown as it is stored.
    pub(super) fn of(orientation: Orientation) -> Option<Self> {
        (orientation != Orientation::NoTransforms).then_some(Self(orientation))
    }

    /// The columns and rows of an image of this size once it is turned.
    pub fn size(self, [width, height]: [usize; 2]) -> [usize; 2] {
        use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
        match self.0 {
            Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH => [height, width],
            _ => [width, height],
        }
    }
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            Orientation::NoTransforms => "not at all",
            Orientation::Rotate90 => "by a quarter to the right",
            Orientation::Rotate180 => "by a half",
            Orientation::Rotate270 => "by a quarter to the left",
            Orientation::FlipHorizontal => "left to right, as in a mirror",
            Orientation::FlipVertical => "upside down, as in a mirror",
            Orientation::Rotate90FlipH => "by a quarter to the right and then left to right",
            Orientation::Rotate270FlipH => "by a quarter to the left and then left to right",
        })
    }
}

impl Picture {
    /// The image of the file at `path`, as it is stored.
    ///
    /// # Errors
    /// As [`Folder::read`] and [`Picture::decode`].
    pub fn read(folder: &Folder, path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        Self::decode(&folder.read(path)?, &Place::of(folder.join(path)))
    }

    /// The image of a file whose camera has images of this size, as it is stored.
    ///
    /// Cameras of other programs are those of the pixels as they are stored: COLMAP, nerfstudio and
    /// instant-ngp turn no image.
    ///
    /// # Errors
    /// As [`Picture::read`]; [`SceneError::Content`] for an image of another size.
    pub fn read_sized(
        folder: &Folder,
        path: impl AsRef<Path>,
        [width, height]: [usize; 2],
    ) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let (bytes, place) = (folder.read(path)?, Place::of(folder.join(path)));
        let picture = Self::decode(&bytes, &place)?;
        if [picture.width, picture.height] == [width, height] {
            return Ok(picture);
        }
        let rule = format!("an image has the size of its camera, {width} x {height}");
        let mut said = format!("{rule}, and this is {} x {}", picture.width, picture.height);
        if let Some(turn) = Self::turn_of(&bytes, &place)? {
            said += &format!(
                "; viewers turn it {turn}, as its Exif data say, and cameras are those of the \
                 pixels as they are stored"
            );
        }
        Err(SceneError::content(place, said))
    }
}
