//! What a new scene's folder was given, so that it can be taken back.

use std::fs;
use std::path::{Path, PathBuf};

use bokashi_write::write_below;

use crate::failure::Failure;

/// The files and folders that were made.
#[derive(Debug)]
pub(super) struct Made<'d> {
    folder: &'d Path,
    files: Vec<PathBuf>,
    /// Outer ones first.
    folders: Vec<PathBuf>,
}

impl<'d> Made<'d> {
    pub(super) fn new(folder: &'d Path) -> Self {
        Self { folder, files: Vec::new(), folders: Vec::new() }
    }

    /// Writes the file at `path` in the folder, whole or not at all.
    ///
    /// # Errors
    /// [`Failure::Work`] where the file system refuses, and where a link leads out of the folder.
    pub(super) fn write(&mut self, path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), Failure> {
        let target = self.folder.join(path.as_ref());
        let is_missing = |path: &&Path| fs::symlink_metadata(path).is_err();
        let above: Vec<_> = target.ancestors().skip(1).take_while(is_missing).collect();
        self.folders.extend(above.iter().rev().map(|&path| path.to_owned()));
        if is_missing(&&*target) {
            self.files.push(target.clone());
        }
        let failed = |error| Failure::Work(format!("{}: {error}", target.display()));
        write_below(self.folder, path, bytes).map(drop).map_err(failed)
    }

    /// Takes everything back. What can't be removed stays, and so does a folder that has other files by now.
    pub(super) fn undo(self) {
        for file in &self.files {
            let _ = fs::remove_file(file);
        }
        for folder in self.folders.iter().rev() {
            let _ = fs::remove_dir(folder);
        }
    }
}
