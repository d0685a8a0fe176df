//! The folder of a scene: its files are read from nowhere else.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use pathdiff::diff_paths;

use crate::error::{Location, SceneError};
use crate::file::{read_resolved, read_start};
use crate::memory::Memory;

/// A byte order mark in UTF-8.
const MARK: &[u8] = &[0xef, 0xbb, 0xbf];

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
    /// What was read of it, by the paths of files: see [`Folder::files_read`].
    read: Arc<Mutex<BTreeMap<PathBuf, String>>>,
    /// What its files have taken.
    memory: Memory,
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
        Ok(Self { given, root, read: Arc::default(), memory: Memory::default() })
    }

    /// The same folder, of whose files nothing has taken memory yet.
    pub(crate) fn anew(&self) -> Self {
        Self { memory: Memory::default(), ..self.clone() }
    }

    /// What its files have taken.
    pub(crate) fn memory(&self) -> &Memory {
        &self.memory
    }

    /// The folder's path, as it was given.
    pub fn path(&self) -> &Path {
        &self.given
    }

    /// The way here from another folder, or the whole path where there is none.
    ///
    /// # Errors
    /// [`SceneError::Read`] where the other folder can't be found.
    pub(crate) fn seen_from(&self, other: &Path) -> Result<PathBuf, SceneError> {
        let failed = |error| SceneError::Read { path: other.to_owned(), error };
        let way = diff_paths(&self.root, fs::canonicalize(other).map_err(failed)?);
        Ok(way.unwrap_or_else(|| self.root.clone()))
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
        let path = fs::canonicalize(&given);
        let path = path.map_err(|error| SceneError::Read { path: given.clone(), error })?;
        match path.starts_with(&self.root) {
            true => Ok(path),
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
    /// beyond [`MOST_BYTES`](crate::MOST_BYTES).
    pub fn read(&self, path: impl AsRef<Path>) -> Result<Vec<u8>, SceneError> {
        let given = self.join(path.as_ref());
        let file = self.find(path)?;
        let bytes = read_resolved(&given, &file)?;
        let relative = file.strip_prefix(&self.root).unwrap_or(&file).to_owned();
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        read.insert(
            relative,
            format!("{} bytes, checksum {:08x}", bytes.len(), crc32fast::hash(&bytes)),
        );
        Ok(bytes)
    }

    /// All files whose bytes were read, by this folder and its copies: their paths here, and their lengths
    /// and checksums in words.
    pub(crate) fn files_read(&self) -> BTreeMap<PathBuf, String> {
        self.read.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The length and checksum of the file at `path`, in words.
    ///
    /// # Errors
    /// As [`Folder::read`].
    pub(crate) fn digest(&self, path: impl AsRef<Path>) -> Result<String, SceneError> {
        Ok(digest(&read_resolved(&self.join(path.as_ref()), &self.find(path)?)?))
    }

    /// The first `most` bytes of the file at `path`, and how long it is.
    ///
    /// # Errors
    /// As [`Folder::find`]; [`SceneError::Read`] for what is no regular file.
    pub fn read_start(
        &self,
        path: impl AsRef<Path>,
        most: u64,
    ) -> Result<(Vec<u8>, u64), SceneError> {
        let given = self.join(path.as_ref());
        let file = self.find(path)?;
        read_start(&given, &file, most)
    }

    /// The text of the file at `path`. A byte order mark before it, as programs of Windows write one, is left out.
    ///
    /// # Errors
    /// As [`Folder::read`]; [`SceneError::Content`] for what is not UTF-8.
    pub fn read_text(&self, path: impl AsRef<Path>) -> Result<String, SceneError> {
        let location = Location::new(self.join(path.as_ref()));
        let mut bytes = self.read(path)?;
        if bytes.starts_with(MARK) {
            bytes.drain(..MARK.len());
        }
        let text = String::from_utf8(bytes);
        text.map_err(|error| SceneError::content(location, format!("text is UTF-8: {error}")))
    }
}

fn digest(bytes: &[u8]) -> String {
    format!("{} bytes, checksum {:08x}", bytes.len(), crc32fast::hash(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_in_the_folder_are_read() {
        let directory = tempfile::tempdir().unwrap();
        let inside = directory.path().join("scene");
        fs::create_dir_all(inside.join("images")).unwrap();
        fs::write(inside.join("images/a"), "a").unwrap();
        fs::write(directory.path().join("secret"), "s").unwrap();
        let folder = Folder::new(&inside).unwrap();
        assert_eq!(folder.read("images/a").unwrap(), b"a");
        assert_eq!(folder.read("images/../images/a").unwrap(), b"a");
        fs::write(inside.join("long"), "abcdef").unwrap();
        assert_eq!(folder.read_start("long", 4).unwrap(), (b"abcd".to_vec(), 6));
        assert_eq!(folder.read(inside.join("images/a")).unwrap(), b"a");
        for path in ["../secret", "images/../../secret"] {
            assert!(matches!(folder.read(path), Err(SceneError::Outside { .. })), "{path}");
            let start = folder.read_start(path, 1);
            assert!(matches!(start, Err(SceneError::Outside { .. })), "{path}");
        }
        let absolute = folder.read(directory.path().join("secret"));
        assert!(matches!(absolute, Err(SceneError::Outside { .. })));
        assert!(matches!(folder.read("missing"), Err(SceneError::Read { .. })));
        assert!(matches!(folder.read("images"), Err(SceneError::Read { .. })));
    }

    #[test]
    fn a_byte_order_mark_is_no_text() {
        let directory = tempfile::tempdir().unwrap();
        fs::write(directory.path().join("a.json"), "\u{feff}{}").unwrap();
        fs::write(directory.path().join("b.json"), "{}\u{feff}").unwrap();
        let folder = Folder::new(directory.path()).unwrap();
        assert_eq!(folder.read_text("a.json").unwrap(), "{}");
        assert_eq!(folder.read_text("b.json").unwrap(), "{}\u{feff}");
    }

    #[test]
    fn there_is_a_way_from_one_folder_to_another() {
        let directory = tempfile::tempdir().unwrap();
        let (scene, out) = (directory.path().join("scene"), directory.path().join("results/out"));
        for folder in [&scene.join("out"), &out] {
            fs::create_dir_all(folder).unwrap();
        }
        let folder = Folder::new(&scene).unwrap();
        assert_eq!(folder.seen_from(&scene.join("out")).unwrap(), Path::new(".."));
        assert_eq!(folder.seen_from(&out).unwrap(), Path::new("../../scene"));
        assert_eq!(folder.seen_from(&scene).unwrap(), Path::new(""));
        assert!(folder.seen_from(&directory.path().join("missing")).is_err());
    }

    #[test]
    fn a_bare_name_stays_one() {
        for given in ["", ".", "./"] {
            let folder = Folder::new(given).unwrap();
            assert_eq!(folder.join("Cargo.toml"), Path::new("Cargo.toml"), "{given:?}");
            assert!(folder.read("Cargo.toml").unwrap().starts_with(b"[package]"), "{given:?}");
            let message = folder.read("missing").unwrap_err().to_string();
            assert!(message.starts_with("missing could not be read"), "{message}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_that_leave_the_folder_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let inside = directory.path().join("scene");
        fs::create_dir_all(&inside).unwrap();
        fs::write(directory.path().join("secret"), "s").unwrap();
        std::os::unix::fs::symlink("../secret", inside.join("link")).unwrap();
        let found = Folder::new(&inside).unwrap().read("link");
        assert!(matches!(found, Err(SceneError::Outside { .. })), "{found:?}");
    }
}
