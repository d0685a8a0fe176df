//! The folder of a scene: its files are read from nowhere else.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::error::{Place, SceneError};

/// The largest file that is read, in bytes.
pub const MOST_BYTES: u64 = 4 << 30;

/// A folder, and all that is read of it.
///
/// Paths are relative to it, or absolute and in it. Links are followed before that is checked. So a file
/// of somebody else's can't make a program read what lies elsewhere.
#[derive(Debug, Clone)]
pub struct Folder {
    /// As it was given, for messages.
    given: PathBuf,
    /// Without links.
    root: PathBuf,
}

impl Folder {
    /// The folder at `path`.
    ///
    /// # Errors
    /// [`SceneError::Read`] where it can't be found, or is no folder.
    pub fn new(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        // The parent of a bare file name is the folder where the program runs.
        let given = match path.as_ref() {
            path if path.as_os_str().is_empty() => PathBuf::from("."),
            path => path.to_owned(),
        };
        let failed = |error| SceneError::Read { path: given.clone(), error };
        let root = fs::canonicalize(&given).map_err(failed)?;
        if !root.is_dir() {
            return Err(failed(io::ErrorKind::NotADirectory.into()));
        }
        Ok(Self { given, root })
    }

    /// The folder's path, as it was given.
    pub fn path(&self) -> &Path {
        &self.given
    }

    /// Where a file of this folder lies, for messages and for [`Folder::read`]. In the folder where the
    /// program runs that is the plain `path`.
    pub fn join(&self, path: impl AsRef<Path>) -> PathBuf {
        match self.is_here() {
            true => path.as_ref().to_owned(),
            false => self.given.join(path),
        }
    }

    /// Whether it is the folder where the program runs: in messages its name says nothing.
    fn is_here(&self) -> bool {
        self.given == Path::new(".")
    }

    /// The file at `path` without links.
    ///
    /// # Errors
    /// [`SceneError::Read`] where it can't be found; [`SceneError::Outside`] where it lies elsewhere.
    pub fn find(&self, path: impl AsRef<Path>) -> Result<PathBuf, SceneError> {
        let given = self.join(path);
        let found = fs::canonicalize(&given);
        let found = found.map_err(|error| SceneError::Read { path: given.clone(), error })?;
        match found.starts_with(&self.root) {
            true => Ok(found),
            false => {
                let folder = if self.is_here() { &self.root } else { &self.given };
                Err(SceneError::Outside { path: given, folder: folder.clone() })
            }
        }
    }

    /// The bytes of the file at `path`.
    ///
    /// # Errors
    /// As [`Folder::find`]; [`SceneError::Read`] for what is no regular file; [`SceneError::TooLarge`]
    /// beyond [`MOST_BYTES`].
    pub fn read(&self, path: impl AsRef<Path>) -> Result<Vec<u8>, SceneError> {
        let given = self.join(path.as_ref());
        let found = self.find(path)?;
        let failed = |error| SceneError::Read { path: given.clone(), error };
        // A FIFO would wait for its writer for ever, and a device has no end.
        if !fs::metadata(&found).map_err(failed)?.is_file() {
            return Err(failed(io::Error::other("it is no regular file")));
        }
        let mut bytes = Vec::new();
        let file = File::open(&found).map_err(failed)?;
        file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
        let length = bytes.len() as u64;
        if length > MOST_BYTES {
            let (place, what) = (Place::of(given), "bytes");
            return Err(SceneError::TooLarge { place, what, most: MOST_BYTES, found: length });
        }
        Ok(bytes)
    }

    /// The text of the file at `path`.
    ///
    /// # Errors
    /// As [`Folder::read`]; [`SceneError::Content`] for what is not UTF-8.
    pub fn read_text(&self, path: impl AsRef<Path>) -> Result<String, SceneError> {
        let place = Place::of(self.join(path.as_ref()));
        let text = String::from_utf8(self.read(path)?);
        text.map_err(|error| SceneError::content(place, format!("text is UTF-8: {error}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_in_the_folder_are_read() {
        let place = tempfile::tempdir().unwrap();
        let inside = place.path().join("scene");
        fs::create_dir_all(inside.join("images")).unwrap();
        fs::write(inside.join("images/a"), "a").unwrap();
        fs::write(place.path().join("secret"), "s").unwrap();
        let folder = Folder::new(&inside).unwrap();
        assert_eq!(folder.read("images/a").unwrap(), b"a");
        assert_eq!(folder.read("images/../images/a").unwrap(), b"a");
        assert_eq!(folder.read(inside.join("images/a")).unwrap(), b"a");
        for path in ["../secret", "images/../../secret"] {
            assert!(matches!(folder.read(path), Err(SceneError::Outside { .. })), "{path}");
        }
        let absolute = folder.read(place.path().join("secret"));
        assert!(matches!(absolute, Err(SceneError::Outside { .. })));
        assert!(matches!(folder.read("missing"), Err(SceneError::Read { .. })));
        assert!(matches!(folder.read("images"), Err(SceneError::Read { .. })));
    }

    #[test]
    fn a_bare_name_stays_one() {
        for given in ["", ".", "./"] {
            let folder = Folder::new(given).unwrap();
            assert_eq!(folder.join("Cargo.toml"), Path::new("Cargo.toml"), "{given:?}");
            assert!(folder.read("Cargo.toml").unwrap().starts_with(b"[package]"), "{given:?}");
            let said = folder.read("missing").unwrap_err().to_string();
            assert!(said.starts_with("missing could not be read"), "{said}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_that_leave_the_folder_are_refused() {
        let place = tempfile::tempdir().unwrap();
        let inside = place.path().join("scene");
        fs::create_dir_all(&inside).unwrap();
        fs::write(place.path().join("secret"), "s").unwrap();
        std::os::unix::fs::symlink("../secret", inside.join("link")).unwrap();
        let found = Folder::new(&inside).unwrap().read("link");
        assert!(matches!(found, Err(SceneError::Outside { .. })), "{found:?}");
    }
}
