//! What can go wrong with a report.

use std::error::Error;
use std::io;
use std::path::PathBuf;

/// What can go wrong with a report.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// What was to be shown could not be made.
    #[error(transparent)]
    Content(Box<dyn Error + Send + Sync>),
    /// A figure could not be drawn.
    #[error("a figure could not be drawn: {0}")]
    Figure(String),
    /// The parts of a mesh do not fit each other.
    #[error("{0}")]
    Mesh(String),
    /// A picture is none, or could not be encoded.
    #[error("{0}")]
    Picture(String),
    /// A file could not be written.
    #[error("{path} could not be written: {error}", path = path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the file system said.
        error: io::Error,
    },
}

impl ReportError {
    /// An error of what was to be shown, whatever its type: for `map_err`.
    pub fn content(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Content(Box::new(error))
    }
}
