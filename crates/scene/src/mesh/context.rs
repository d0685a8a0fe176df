//! The files that a mesh file names: they lie beside it, and in the scene's folder.

use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};

use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::memory::Memory;
use crate::mesh::notes::{self, Notes};
use crate::mesh::options::MeshOptions;
use crate::picture::Picture;

/// A mesh file's surroundings: other files, the images that were read, and notes.
#[derive(Debug)]
pub(super) struct MeshContext<'a> {
    folder: &'a Folder,
    /// The mesh file, as it was given.
    path: PathBuf,
    /// The images of files, each once.
    pub(super) images: Vec<Picture>,
    /// By the path without links, the number of the image; none where it can't be read.
    numbers: HashMap<PathBuf, Option<usize>>,
    pub(super) notes: Notes,
    pub(super) options: MeshOptions,
}

impl<'a> MeshContext<'a> {
    pub(super) fn new(folder: &'a Folder, path: &Path, options: MeshOptions) -> Self {
        let (images, numbers) = (Vec::new(), HashMap::new());
        Self { folder, path: path.to_owned(), images, numbers, notes: Notes::default(), options }
    }

    /// What the files of the folder have taken.
    pub(super) fn memory(&self) -> &'a Memory {
        self.folder.memory()
    }

    /// All of the mesh file.
    pub(super) fn location(&self) -> Location {
        Location::new(self.folder.join(&self.path))
    }

    /// A line of the mesh file.
    pub(super) fn line(&self, line: usize) -> Location {
        Location::line(self.folder.join(&self.path), line)
    }

    /// An error of the mesh file.
    pub(super) fn error(&self, message: impl fmt::Display) -> SceneError {
        SceneError::content(self.location(), message)
    }

    /// An error in a line of the mesh file.
    pub(super) fn error_in(&self, line: usize, message: impl fmt::Display) -> SceneError {
        SceneError::content(self.line(line), message)
    }

    /// The path of the file that the mesh file calls `name`, for messages and for reading. A backslash
    /// is a slash.
    pub(super) fn path_of(&self, name: &str) -> PathBuf {
        let parent = self.path.parent().unwrap_or(Path::new(""));
        parent.join(name.replace('\\', "/"))
    }

    /// Where the file called `name` lies, for messages.
    pub(super) fn location_of(&self, name: &str) -> Location {
        Location::new(self.folder.join(self.path_of(name)))
    }

    /// The path without links of the file called `name`, or nothing where there is no such file.
    pub(super) fn find(&self, name: &str) -> Result<Option<PathBuf>, SceneError> {
        match self.folder.find(self.path_of(name)) {
            Ok(path) => Ok(Some(path)),
            Err(SceneError::Read { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The bytes of the file called `name`.
    pub(super) fn read(&self, name: &str) -> Result<Vec<u8>, SceneError> {
        self.folder.read(self.path_of(name))
    }

    /// The number of the image in the file called `name`. A file that is missing or is no image that is read
    /// is noted and has none.
    pub(super) fn image(&mut self, name: &str) -> Result<Option<usize>, SceneError> {
        let Some(path) = self.find(name)? else {
            let name = notes::quoted(name);
            self.notes.add(format!("the image {name} is missing and was left out"));
            return Ok(None);
        };
        if let Some(&number) = self.numbers.get(&path) {
            return Ok(number);
        }
        let number =
            self.decode(&self.read(name)?, &self.location_of(name), &notes::quoted(name))?;
        self.numbers.insert(path, number);
        Ok(number)
    }

    /// The number of the image with these bytes, which notes call `name`.
    pub(super) fn decode(
        &mut self,
        bytes: &[u8],
        location: &Location,
        name: &str,
    ) -> Result<Option<usize>, SceneError> {
        match Picture::decode_within(bytes, self.memory(), location) {
            Ok(picture) => self.images.push(picture),
            Err(SceneError::Content { message, .. }) => {
                self.notes
                    .add(format!("the image {name} can't be read and was left out: {message}"));
                return Ok(None);
            }
            Err(error) => return Err(error),
        }
        for remark in Picture::remarks(bytes, location).unwrap_or_default() {
            self.notes.add(format!("the image {name}: {remark}"));
        }
        Ok(Some(self.images.len() - 1))
    }
}

/// A path of a line without quotation marks around it.
pub(super) fn unquoted(path: &str) -> &str {
    path.strip_prefix('"').and_then(|path| path.strip_suffix('"')).unwrap_or(path)
}
