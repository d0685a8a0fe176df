//! What can go wrong with files of a scene.

use std::fmt;
use std::io;
use std::path::PathBuf;

pub use bokashi_description::Location;
use bokashi_description::{DescriptionError, shortened, shortened_path};
use bokashi_fit::FitError;
use bokashi_mesh::MeshError;
use bokashi_render_ops::RenderError;

/// A number of bytes for people.
fn bytes(count: u64) -> String {
    let units = [(40, "TiB"), (30, "GiB"), (20, "MiB"), (10, "KiB")];
    match units.into_iter().find(|(power, _)| count >> power > 0) {
        Some((power, unit)) => format!("{:.1} {unit}", count as f64 / (1_u64 << power) as f64),
        None => format!("{count} bytes"),
    }
}

/// What can go wrong with files of a scene. Each message says the rule, then the value that broke it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file could not be read.
    #[error("{path} could not be read: {error}", path = shortened_path(path))]
    Read {
        /// The file.
        path: PathBuf,
        /// What the file system said.
        error: io::Error,
    },
    /// A file could not be written.
    #[error("{path} could not be written: {error}", path = shortened_path(path))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the file system said.
        error: io::Error,
    },
    /// A file that the scene names does not lie in the scene's folder.
    #[error("files lie in the scene's folder {folder}; {path} does not", path = shortened_path(path), folder = shortened_path(folder))]
    Outside {
        /// The file.
        path: PathBuf,
        /// The folder.
        folder: PathBuf,
    },
    /// A file would take more memory than a scene may.
    #[error("{location}: at most {most} {what} are read, and there are {found}")]
    TooLarge {
        /// The file.
        location: Location,
        /// What there is too much of.
        what: &'static str,
        /// How many there may be.
        most: u64,
        /// How many there are.
        found: u64,
    },
    /// What is made of a file would take more memory than [`memory_limit`](crate::memory_limit) allows.
    #[error("{location}: {what} needs {found} of memory, and {left} of {most} are left (`--memory` allows more)", found = bytes(*found), left = bytes(*left), most = bytes(*most))]
    Memory {
        /// The file.
        location: Location,
        /// What needs it.
        what: String,
        /// How many bytes it needs.
        found: u64,
        /// How many are left.
        left: u64,
        /// The limit.
        most: u64,
    },
    /// A file does not hold what it should.
    #[error("{location}: {message}")]
    Content {
        /// Where.
        location: Location,
        /// The rule, and what broke it.
        message: String,
    },
    /// A fit went wrong.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A rendering operation went wrong.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A surface can't be made, or not be changed.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl SceneError {
    /// A file that does not hold what it should.
    pub(crate) fn content(location: Location, message: impl fmt::Display) -> Self {
        Self::Content { location, message: shortened(&message.to_string()).into_owned() }
    }
}

impl From<DescriptionError> for SceneError {
    fn from(error: DescriptionError) -> Self {
        match error {
            DescriptionError::TooLarge { location, what, most, found } => {
                Self::TooLarge { location, what, most, found }
            }
            DescriptionError::Content { location, message } => Self::Content { location, message },
            // The enum may grow; its messages begin with their places.
            other => {
                Self::Content { location: Location::new("scene.toml"), message: other.to_string() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_messages_and_paths_lose_their_middle() {
        const LONGEST: usize = 1000;
        let long = "ä".repeat(5000);
        let error = SceneError::content(Location::line(&long, 7), format!("a {long} z"));
        let message = error.to_string();
        assert!(
            message.starts_with("ää") && message.contains("ä:7: a ä") && message.ends_with("ä z")
        );
        assert_eq!(message.chars().count(), 2 * (LONGEST + 5) + 4);
        let error = SceneError::Read { path: long.into(), error: io::ErrorKind::NotFound.into() };
        assert!(error.to_string().chars().count() < LONGEST + 100);
    }

    #[test]
    fn bytes_are_shown_in_units() {
        assert_eq!(bytes(1023), "1023 bytes");
        assert_eq!(bytes(3 << 29), "1.5 GiB");
        assert_eq!(bytes(1 << 20), "1.0 MiB");
    }
}
