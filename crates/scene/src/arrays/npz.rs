//! Arrays by name in NumPy's archives, npz: a zip file with an npy file for each array (feature `npz`).
//!
//! # What is read
//! Archives of `numpy.savez` and `numpy.savez_compressed`: files that are stored or deflated, with the
//! checksums that zip has. The name of an array is that of its file without `.npy`. What is no npy file, and
//! what holds no numbers, has a name and is refused when it is asked for.
//!
//! # Trust
//! Sizes that an archive claims are not believed: files are unpacked as far as they go, all of them together
//! to [`MOST_BYTES`] at most. Files may not share bytes of the archive.

use std::io::{Cursor, Read as _, Write as _};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::array_file::{ArrayFile, Entry, location_of};
use super::npy;
use crate::error::{Location, SceneError};
use crate::file::{MOST_BYTES, read_file, write_file};

/// How arrays lie in an archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Packing {
    /// As they are, as `numpy.savez` has them.
    #[default]
    Stored,
    /// Compressed, as `numpy.savez_compressed` has them. Floats seldom become much smaller.
    Deflated,
}

/// What the files of arrays end in.
const ENDING: &str = ".npy";

/// The arrays in the npz file at `path`.
///
/// # Errors
/// [`SceneError::Read`] where it can't be read; as [`read_npz_bytes`].
pub fn read_npz(path: impl AsRef<Path>) -> Result<ArrayFile, SceneError> {
    read_npz_bytes(&read_file(path.as_ref())?, &Location::new(path))
}

/// The arrays in an npz file of these `bytes`. `location` names the file in errors.
///
/// # Errors
/// [`SceneError::Content`] for what is no zip file or a broken one, for a broken npy file in it, for a name
/// that is there twice, and for one that no file in a folder could have; [`SceneError::TooLarge`] beyond
/// [`MOST_BYTES`] of unpacked files.
pub fn read_npz_bytes(bytes: &[u8], location: &Location) -> Result<ArrayFile, SceneError> {
    unpacked(bytes, location, MOST_BYTES)
}

/// The arrays of an archive whose files have at most so many bytes together.
pub(super) fn unpacked(
    bytes: &[u8],
    location: &Location,
    most: u64,
) -> Result<ArrayFile, SceneError> {
    let wrong = |message: String| SceneError::content(location.clone(), message);
    let broken =
        |error: &dyn std::fmt::Display| wrong(format!("the archive can't be read: {error}"));
    if !bytes.starts_with(b"PK") {
        return Err(wrong("an npz file is a zip archive, and this is none".to_owned()));
    }
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| broken(&error))?;
    if archive.has_duplicate_names() {
        return Err(wrong(
            "a name is that of one array, and this archive has one twice".to_owned(),
        ));
    }
    if archive.has_overlapping_entries().map_err(|error| broken(&error))? {
        let rule = "each file of an archive has bytes of its own";
        return Err(wrong(format!("{rule}, and some of these share theirs")));
    }
    let mut file = ArrayFile::from_file(location.clone());
    let mut left = most;
    for index in 0..archive.len() {
        let mut packed = archive.by_index(index).map_err(|error| broken(&error))?;
        let name = packed.name().map_err(|error| broken(&error))?.into_owned();
        if packed.is_dir() {
            continue;
        }
        let name = match name.strip_suffix(ENDING) {
            Some(name) => name.to_owned(),
            None => {
                check_name(&name).map_err(&wrong)?;
                let message =
                    format!("the arrays of an npz file end in {ENDING}, and this does not");
                file.add_new(name, Entry::Foreign(message))?;
                continue;
            }
        };
        check_name(&name).map_err(&wrong)?;
        let mut unpacked = Vec::new();
        let read = packed.by_ref().take(left + 1).read_to_end(&mut unpacked);
        let array_location = location_of(location, &name);
        if let Err(error) = read {
            let message = format!("the file can't be unpacked: {error}");
            return Err(SceneError::content(array_location, message));
        }
        let Some(rest) = left.checked_sub(unpacked.len() as u64) else {
            let (location, what) = (location.clone(), "bytes of unpacked arrays");
            return Err(SceneError::TooLarge { location, what, most, found: most + 1 });
        };
        left = rest;
        let entry = match npy::decode(&unpacked, &array_location)? {
            Ok(array) => Entry::Array(array),
            Err(foreign) => Entry::Foreign(foreign),
        };
        file.add_new(name, entry)?;
    }
    Ok(file)
}

/// Writes arrays to the npz file at `path`, whole or not at all.
///
/// # Errors
/// As [`npz`]; [`SceneError::Write`] where the file system refuses.
pub fn write_npz(
    path: impl AsRef<Path>,
    arrays: &ArrayFile,
    packing: Packing,
) -> Result<(), SceneError> {
    write_file(path.as_ref(), &npz(arrays, packing)?)
}

/// An npz file with these arrays, in order: the same bytes for the same arrays.
///
/// # Errors
/// [`SceneError::Content`] for a name that no file in a folder could have, for `bf16`, and for metadata, which
/// an npz file has no place for.
pub fn npz(arrays: &ArrayFile, packing: Packing) -> Result<Vec<u8>, SceneError> {
    let wrong = |message: String| SceneError::content(arrays.location().clone(), message);
    if let Some(key) = arrays.metadata.keys().next() {
        return Err(wrong(format!("an npz file has no metadata, and there is {key:?}")));
    }
    let failed =
        |error: &dyn std::fmt::Display| wrong(format!("the archive can't be made: {error}"));
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, array) in arrays.arrays()? {
        check_name(name).map_err(&wrong)?;
        let bytes = npy::npy(array)?;
        let options = SimpleFileOptions::default()
            .compression_method(match packing {
                Packing::Stored => CompressionMethod::Stored,
                Packing::Deflated => CompressionMethod::Deflated,
            })
            // As `numpy.savez` has it: the first that a zip file can have.
            .last_modified_time(DateTime::DEFAULT)
            .large_file(u32::try_from(bytes.len()).is_err());
        archive.start_file(format!("{name}{ENDING}"), options).map_err(|error| failed(&error))?;
        archive.write_all(&bytes).map_err(|error| failed(&error))?;
    }
    Ok(archive.finish().map_err(|error| failed(&error))?.into_inner())
}

/// Whether a file in a folder can have this name, wherever somebody unpacks the archive.
fn check_name(name: &str) -> Result<(), String> {
    let is_plain = |part: &str| !matches!(part, "" | "." | "..");
    let is_odd = |letter: char| letter.is_control() || matches!(letter, '\\' | ':');
    match name.split('/').all(is_plain) && !name.contains(is_odd) {
        true => Ok(()),
        false => {
            let rule = "the name of an array in an npz file is that of a file in a folder";
            Err(format!("{rule}, and there is {name:?}"))
        }
    }
}
