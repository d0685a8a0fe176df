//! How viewers turn a photograph: what its Exif data say of it.
//!
//! # Source
//! The tag `Orientation` of Exif 2.32, 4.6.4.

use std::fmt;
use std::path::Path;

use super::samples::{Picture, Samples};
use crate::error::{Location, SceneError};
use crate::folder::Folder;

/// How viewers turn a photograph before they show it: the number of Exif data, 2 to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn(u16);

impl Turn {
    /// Nothing for an image that is shown as it is stored.
    pub(super) fn from_exif(orientation: u16) -> Option<Self> {
        matches!(orientation, 2..=8).then_some(Self(orientation))
    }

    /// Whether rows become columns.
    const fn swaps(self) -> bool {
        self.0 >= 5
    }

    /// The columns and rows of an image of this size once it is turned.
    pub fn size(self, [width, height]: [usize; 2]) -> [usize; 2] {
        if self.swaps() { [height, width] } else { [width, height] }
    }

    /// The image once it is turned.
    pub(super) fn apply(self, picture: &Picture) -> Picture {
        let Picture { width, height, channels, .. } = *picture;
        let stored = [width, height, channels];
        let samples = match &picture.samples {
            Samples::U8(samples) => Samples::U8(self.turned(samples, stored)),
            Samples::U16(samples) => Samples::U16(self.turned(samples, stored)),
            Samples::F32(samples) => Samples::F32(self.turned(samples, stored)),
        };
        let [width, height] = self.size([width, height]);
        Picture { width, height, channels, samples }
    }

    /// The samples of an image of so many columns, rows and channels once it is turned.
    fn turned<T: Copy>(self, samples: &[T], [width, height, channels]: [usize; 3]) -> Vec<T> {
        let [new_width, new_height] = self.size([width, height]);
        // Counted from the right or from below, in the image as it is stored.
        let [from_right, from_below] =
            [matches!(self.0, 2 | 3 | 7 | 8), matches!(self.0, 3 | 4 | 6 | 7)];
        let mut turned = Vec::with_capacity(samples.len());
        for row in 0..new_height {
            for column in 0..new_width {
                let [y, x] = if self.swaps() { [column, row] } else { [row, column] };
                let y = if from_below { height - 1 - y } else { y };
                let x = if from_right { width - 1 - x } else { x };
                let first = (y * width + x) * channels;
                turned.extend_from_slice(&samples[first..first + channels]);
            }
        }
        turned
    }
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            2 => "left to right, as in a mirror",
            3 => "by a half",
            4 => "upside down, as in a mirror",
            5 => "by a quarter to the right and then left to right",
            6 => "by a quarter to the right",
            7 => "by a quarter to the left and then left to right",
            _ => "by a quarter to the left",
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
        Self::decode(&folder.read(path)?, &Location::new(folder.join(path)))
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
        let (bytes, location) = (folder.read(path)?, Location::new(folder.join(path)));
        let picture = Self::decode(&bytes, &location)?;
        if [picture.width, picture.height] == [width, height] {
            return Ok(picture);
        }
        let rule = format!("an image has the size of its camera, {width} x {height}");
        let mut message = format!("{rule}, and this is {} x {}", picture.width, picture.height);
        if let Some(turn) = Self::decode_turn(&bytes, &location)? {
            message += &format!(
                "; viewers turn it {turn}, as its Exif data say, and cameras are those of the \
                 pixels as they are stored"
            );
        }
        Err(SceneError::content(location, message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_turn_puts_each_pixel_where_viewers_show_it() {
        // Two rows of three pixels of two channels: 0 1 2 above 3 4 5.
        let samples = Samples::U16((0..6).flat_map(|k| [k, 100 + k]).collect());
        let picture = Picture { width: 3, height: 2, channels: 2, samples };
        let rows: [(u16, usize, [u16; 6]); 7] = [
            (2, 3, [2, 1, 0, 5, 4, 3]),
            (3, 3, [5, 4, 3, 2, 1, 0]),
            (4, 3, [3, 4, 5, 0, 1, 2]),
            (5, 2, [0, 3, 1, 4, 2, 5]),
            (6, 2, [3, 0, 4, 1, 5, 2]),
            (7, 2, [5, 2, 4, 1, 3, 0]),
            (8, 2, [2, 5, 1, 4, 0, 3]),
        ];
        for (orientation, width, expected) in rows {
            let turned = Turn::from_exif(orientation).unwrap().apply(&picture);
            assert_eq!([turned.width, turned.height], [width, 6 / width], "{orientation}");
            let expected = expected.into_iter().flat_map(|k| [k, 100 + k]).collect();
            assert_eq!(turned.samples, Samples::U16(expected), "{orientation}");
        }
        assert_eq!([0, 1, 9, 6 << 8].map(Turn::from_exif), [None; 4]);
    }
}
