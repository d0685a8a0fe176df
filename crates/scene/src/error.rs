//! What can go wrong with files of a scene.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use bokashi_fit::FitError;
use bokashi_render_ops::RenderError;

/// A place in a file: the file, and where that is known a line and a column, both from 1 on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub path: PathBuf,
    /// The line.
    pub line: Option<usize>,
    /// The column, in characters.
    pub column: Option<usize>,
}

impl Place {
    /// All of a file.
    pub fn of(path: impl AsRef<Path>) -> Self {
        Self { path: path.as_ref().to_owned(), line: None, column: None }
    }

    /// A line of a file.
    pub fn line(path: impl AsRef<Path>, line: usize) -> Self {
        Self { line: Some(line), ..Self::of(path) }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        let numbers = [self.line, self.column].into_iter().map_while(|number| number);
        numbers.into_iter().try_for_each(|number| write!(f, ":{number}"))
    }
}

/// What can go wrong with files of a scene. Each message says the rule, then the value that broke it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file could not be read.
    #[error("{path} could not be read: {error}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the file system said.
        error: io::Error,
    },
    /// A file could not be written.
    #[error("{path} could not be written: {error}", path = path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the file system said.
        error: io::Error,
    },
    /// A file that the scene names does not lie in the scene's folder.
    #[error("files lie in the scene's folder {folder}; {path} does not", path = path.display(), folder = folder.display())]
    Outside {
        /// The file.
        path: PathBuf,
        /// The folder.
        folder: PathBuf,
    },
    /// A file would take more memory than a scene may.
    #[error("{place}: at most {most} {what} are read, and there are {found}")]
    TooLarge {
        /// The file.
        place: Place,
        /// What there is too much of.
        what: &'static str,
        /// How many there may be.
        most: u64,
        /// How many there are.
        found: u64,
    },
    /// A file does not hold what it should.
    #[error("{place}: {message}")]
    Content {
        /// Where.
        place: Place,
        /// The rule, and what broke it.
        message: String,
    },
    /// A fit went wrong.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A rendering operation went wrong.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl SceneError {
    /// A file that does not hold what it should.
    pub(crate) fn content(place: Place, message: impl fmt::Display) -> Self {
        Self::Content { place, message: message.to_string() }
    }
}
