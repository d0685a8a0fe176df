//! Files that are copied into the folder of a new scene.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use bokashi_scene::{Folder, Location, Picture, SceneError};
use bokashi_write::{check_below, resolved};

use super::made::Made;
use crate::failure::Failure;

/// What is to be copied, and where to.
#[derive(Debug)]
pub(super) struct Copies<'d> {
    folder: &'d Path,
    /// By the place in the folder, where a file comes from.
    all: BTreeMap<PathBuf, Origin>,
}

/// Where a file comes from.
#[derive(Debug)]
enum Origin {
    /// It is that file, byte by byte.
    Copy(PathBuf),
    /// It is a PNG of that image, turned as viewers turn it.
    Upright(PathBuf),
}

impl Origin {
    /// The bytes of the file.
    fn bytes(&self) -> Result<Vec<u8>, Failure> {
        let (Self::Copy(from) | Self::Upright(from)) = self;
        let failed = |error: &dyn Display| Failure::Work(format!("{}: {error}", from.display()));
        let bytes = fs::read(from).map_err(|error| failed(&error))?;
        match self {
            Self::Copy(_) => Ok(bytes),
            Self::Upright(_) => {
                let location = Location::new(from);
                let picture = Picture::decode_upright(&bytes, &location);
                let png = picture.and_then(|picture| picture.encode_png(&location));
                png.map_err(|error| Failure::Work(error.to_string()))
            }
        }
    }
}

impl<'d> Copies<'d> {
    pub(super) fn new(folder: &'d Path) -> Self {
        Self { folder, all: BTreeMap::new() }
    }

    /// Where the files of `source` are in the scene's folder: where they lie, if that is in it already, or
    /// else `usual`.
    pub(super) fn home(&self, source: &Folder, usual: &str) -> PathBuf {
        let inside = || {
            let (path, root) = (resolved(source.path()).ok()?, resolved(self.folder).ok()?);
            path.strip_prefix(root).ok().map(Path::to_owned)
        };
        inside().unwrap_or_else(|| PathBuf::from(usual))
    }

    /// Adds the file at `path` in `source`; it keeps that path below `home`. Returns where it will be.
    ///
    /// # Errors
    /// As [`Folder::find`]; [`SceneError::Content`] for a name that a scene's file can't have.
    pub(super) fn add(
        &mut self,
        source: &Folder,
        path: &Path,
        home: &Path,
    ) -> Result<PathBuf, SceneError> {
        let from = source.find(path)?;
        if !from.is_file() {
            let error = io::Error::other("it is no regular file");
            return Err(SceneError::Read { path: source.join(path), error });
        }
        // Relative, also where a file of cameras has it absolute.
        let root = resolved(source.path()).unwrap_or_default();
        let inside = path.strip_prefix(source.path()).or_else(|_| path.strip_prefix(root));
        let path = match path.is_absolute() {
            true => inside.unwrap_or(path),
            false => path,
        };
        let to = plain(&home.join(path));
        if to.to_str().is_none() {
            let message = "names in a scene are UTF-8, and this is not".to_owned();
            return Err(SceneError::Content { location: Location::new(from), message });
        }
        self.all.insert(to.clone(), Origin::Copy(from));
        Ok(to)
    }

    /// Adds the image at `path` in `source` as a PNG that is turned as viewers turn it. Returns where it will be:
    /// images of a scene are as they are stored.
    ///
    /// # Errors
    /// As [`Copies::add`].
    pub(super) fn add_upright(
        &mut self,
        source: &Folder,
        path: &Path,
        home: &Path,
    ) -> Result<PathBuf, SceneError> {
        let plain = self.add(source, path, home)?;
        let Some(Origin::Copy(from)) = self.all.remove(&plain) else { return Ok(plain) };
        let stem = plain.file_stem().unwrap_or_default().to_string_lossy();
        let upright = plain.with_file_name(format!("{stem}-upright.png"));
        self.all.insert(upright.clone(), Origin::Upright(from));
        Ok(upright)
    }

    /// How many files are copied.
    pub(super) fn count(&self) -> usize {
        self.all.len()
    }

    /// Leaves out what is there already.
    ///
    /// # Errors
    /// [`Failure::Use`] where another file is in the place of a copy, or a link leads out of the folder.
    pub(super) fn check(&mut self) -> Result<(), Failure> {
        for to in self.all.keys() {
            check_below(self.folder, to).map_err(|error| {
                Failure::Use(format!("new needs places in its folder for copies: {error}"))
            })?;
        }
        let mut taken = None;
        self.all.retain(|to, from| {
            let target = self.folder.join(to);
            if fs::symlink_metadata(&target).is_err() {
                return true;
            }
            let is_itself =
                |from: &Path| fs::canonicalize(&target).is_ok_and(|target| target == from);
            let is_same = matches!(from, Origin::Copy(from) if is_itself(from))
                || fs::read(&target)
                    .is_ok_and(|there| from.bytes().is_ok_and(|bytes| bytes == there));
            if !is_same {
                taken.get_or_insert(target);
            }
            !is_same
        });
        match taken {
            None => Ok(()),
            Some(target) => {
                let rule = "new needs a folder without other files where copies go";
                Err(Failure::Use(format!("{rule}, and {} is there", target.display())))
            }
        }
    }

    /// Copies all, each file whole or not at all.
    ///
    /// # Errors
    /// [`Failure::Work`] where a file can't be read or written.
    pub(super) fn write(&self, made: &mut Made<'_>) -> Result<(), Failure> {
        for (to, from) in &self.all {
            made.write(to, &from.bytes()?)?;
        }
        Ok(())
    }
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::Normal(part) => plain.push(part),
            Component::ParentDir => drop(plain.pop()),
            _ => {}
        }
    }
    plain
}
