//! The file of a scene, with which what is wrong is said.

use std::path::{Path, PathBuf};

use toml::Spanned;

use crate::description::ColorSpaceName;
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::picture::{ColorSpace, Picture};

/// What a scene's file says, and where it says it.
pub(super) struct Source {
    pub(super) folder: Folder,
    pub(super) path: PathBuf,
    pub(super) text: String,
}

impl Source {
    /// Where an entry stands.
    pub(super) fn location<T>(&self, entry: &Spanned<T>) -> Location {
        Location::from_byte(&self.text, &self.path, entry.span().start)
    }

    /// What is wrong with an entry.
    pub(super) fn wrong<T>(
        &self,
        entry: &Spanned<T>,
        message: impl std::fmt::Display,
    ) -> SceneError {
        SceneError::content(self.location(entry), message)
    }

    /// Refuses an entry that takes more memory than a scene may.
    pub(super) fn at_most<T>(
        &self,
        entry: &Spanned<T>,
        what: &'static str,
        most: u64,
        found: u64,
    ) -> Result<(), SceneError> {
        match found > most {
            true => Err(SceneError::TooLarge { location: self.location(entry), what, most, found }),
            false => Ok(()),
        }
    }

    /// The picture of a file.
    pub(super) fn image(&self, file: &Path) -> Result<Picture, SceneError> {
        Picture::read(&self.folder, file)
    }
}

/// A colour space by its name in a scene.
pub(super) fn color_space(name: ColorSpaceName) -> ColorSpace {
    match name {
        ColorSpaceName::Srgb => ColorSpace::Srgb,
        ColorSpaceName::Linear => ColorSpace::Linear,
    }
}
