//! Files as bytes: read up to a limit, written whole or not at all.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use bokashi_write::write_whole;

use crate::error::{Place, SceneError};

/// The largest file that is read, in bytes.
pub const MOST_BYTES: u64 = 4 << 30;

/// The bytes of the file at `path`.
///
/// # Errors
/// [`SceneError::Read`] where it can't be read, and for what is no regular file; [`SceneError::TooLarge`]
/// beyond [`MOST_BYTES`].
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_found(path, path)
}

/// The bytes of the file at `found`, which errors call `given`.
///
/// # Errors
/// As [`read_file`].
pub(crate) fn read_found(given: &Path, found: &Path) -> Result<Vec<u8>, SceneError> {
    let (bytes, _) = read_start(given, found, MOST_BYTES + 1)?;
    let length = bytes.len() as u64;
    if length > MOST_BYTES {
        let (place, what) = (Place::of(given), "bytes");
        return Err(SceneError::TooLarge { place, what, most: MOST_BYTES, found: length });
    }
    Ok(bytes)
}

/// The first `most` bytes of the file at `found`, which errors call `given`; and how long it is.
///
/// # Errors
/// [`SceneError::Read`], as [`read_file`].
pub(crate) fn read_start(
    given: &Path,
    found: &Path,
    most: u64,
) -> Result<(Vec<u8>, u64), SceneError> {
    let failed = |error| SceneError::Read { path: given.to_owned(), error };
    let known = found.metadata().map_err(failed)?;
    // A FIFO would wait for its writer for ever, and a device has no end.
    if !known.is_file() {
        return Err(failed(io::Error::other("it is no regular file")));
    }
    let mut bytes = Vec::new();
    let file = File::open(found).map_err(failed)?;
    file.take(most).read_to_end(&mut bytes).map_err(failed)?;
    Ok((bytes, known.len()))
}

/// Writes a file whole or not at all.
///
/// # Errors
/// [`SceneError::Write`] where the file system refuses.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
    write_whole(path, bytes).map_err(|error| SceneError::Write { path: path.to_owned(), error })
}

/// Whether a file of a folder can have this name.
pub(crate) fn is_file_name(name: &str) -> bool {
    !name.is_empty() && !name.contains(['/', '\\', '\0']) && name != "." && name != ".."
}
