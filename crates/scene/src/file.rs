//! Files as bytes: read up to a limit, written whole or not at all.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use bokashi_write::{check_below, write_below, write_whole};

use crate::error::{Location, SceneError};

/// The largest file that is read, in bytes.
pub const MOST_BYTES: u64 = 4 << 30;

/// The bytes of the file at `path`.
///
/// # Errors
/// [`SceneError::Read`] where it can't be read, and for what is no regular file; [`SceneError::TooLarge`]
/// beyond [`MOST_BYTES`].
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_resolved(path, path)
}

/// The bytes of the file at `path`, which errors call `given`.
///
/// # Errors
/// As [`read_file`].
pub(crate) fn read_resolved(given: &Path, path: &Path) -> Result<Vec<u8>, SceneError> {
    let (bytes, _) = read_start(given, path, MOST_BYTES + 1)?;
    let length = bytes.len() as u64;
    if length > MOST_BYTES {
        let (location, what) = (Location::new(given), "bytes");
        return Err(SceneError::TooLarge { location, what, most: MOST_BYTES, found: length });
    }
    Ok(bytes)
}

/// The first `most` bytes of the file at `path`, which errors call `given`; and how long it is.
///
/// # Errors
/// [`SceneError::Read`], as [`read_file`].
pub(crate) fn read_start(
    given: &Path,
    path: &Path,
    most: u64,
) -> Result<(Vec<u8>, u64), SceneError> {
    let failed = |error| SceneError::Read { path: given.to_owned(), error };
    let metadata = path.metadata().map_err(failed)?;
    // A FIFO would wait for its writer for ever, and a device has no end.
    if !metadata.is_file() {
        return Err(failed(io::Error::other("it is no regular file")));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(most).read_to_end(&mut bytes).map_err(failed)?;
    Ok((bytes, metadata.len()))
}

/// Writes the file that the caller names whole or not at all.
///
/// # Errors
/// [`SceneError::Write`] where the file system refuses.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
    write_whole(path, bytes).map_err(|error| unwritten(path, error))
}

/// Writes a result to `path` below the folder `out`, whole or not at all; folders on the way are made. Returns
/// the whole path.
///
/// # Errors
/// [`SceneError::Write`] where the file system refuses, and where a link in `out` leads out of it.
pub fn write_result(
    out: &Path,
    path: impl AsRef<Path>,
    bytes: &[u8],
) -> Result<PathBuf, SceneError> {
    let path = path.as_ref();
    write_below(out, path, bytes).map_err(|error| unwritten(&out.join(path), error))
}

/// Whether [`write_result`] could write these files, before the work that makes them.
///
/// # Errors
/// As [`write_result`]; [`SceneError::Write`] for two results that would be one file.
pub(crate) fn check_results(out: &Path, paths: &[PathBuf]) -> Result<(), SceneError> {
    let mut seen = HashSet::new();
    for path in paths {
        let failed = |error| unwritten(&out.join(path), error);
        if !seen.insert(path) {
            return Err(failed(io::Error::other("two results have this name")));
        }
        check_below(out, path).map_err(failed)?;
    }
    Ok(())
}

pub(crate) fn unwritten(path: &Path, error: io::Error) -> SceneError {
    SceneError::Write { path: path.to_owned(), error }
}
