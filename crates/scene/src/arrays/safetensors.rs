//! Arrays by name in safetensors files, as fits are saved to and networks are exchanged in.
//!
//! # The file
//! The length of the header in eight bytes; the header, a JSON text with type, shape and place of each array,
//! and with texts by name as metadata; the numbers, side by side.
//!
//! # What is read
//! Truth values, whole numbers of 8 to 64 bits, floats of 16 to 64 bits and `bf16`. Arrays of other types,
//! of floats of 8 bits say, have a name and are refused when they are asked for. A
//! [`SceneFit`](crate::SceneFit) that was saved is such a file: its parameters are `raw/NAME`, before their
//! mappings.
//!
//! # What is written
//! Types with more bytes come first, so that each number lies at a multiple of its bytes; among them the order
//! is that of the arrays. The same arrays give the same bytes.
//!
//! # Source
//! The format's own page, <https://huggingface.co/docs/safetensors>.

use std::path::Path;

use bokashi_core::Shape;
use safetensors::tensor::{Metadata, SafeTensors, TensorInfo};
use serde::ser::{Serialize, SerializeMap as _, Serializer};

use super::array_file::{ArrayFile, Entry, location_of};
use super::number_type::{NumberType, foreign};
use super::raw_array::RawArray;
use crate::error::{Location, SceneError};
use crate::file::{read_file, write_file};

/// The name of the metadata in a header.
const METADATA: &str = "__metadata__";

/// The length of the header is so many bytes long, and a multiple of it.
const LENGTH: usize = 8;

/// The arrays and the metadata in the safetensors file at `path`.
///
/// # Errors
/// [`SceneError::Read`] where it can't be read; as [`read_safetensors_bytes`].
pub fn read_safetensors(path: impl AsRef<Path>) -> Result<ArrayFile, SceneError> {
    read_safetensors_bytes(&read_file(path.as_ref())?, &Location::new(path))
}

/// The arrays and the metadata in a safetensors file of these `bytes`, in the order of their numbers there;
/// those without entries by name. `location` names the file in errors.
///
/// # Errors
/// [`SceneError::Content`] for what is no safetensors file, and for numbers that are too few or too many.
pub fn read_safetensors_bytes(bytes: &[u8], location: &Location) -> Result<ArrayFile, SceneError> {
    let wrong = |error: &dyn std::fmt::Display| {
        SceneError::content(location.clone(), format!("a safetensors file is needed here: {error}"))
    };
    let (length, header) = SafeTensors::read_metadata(bytes).map_err(|error| wrong(&error))?;
    let numbers = &bytes[LENGTH + length..];
    let mut all: Vec<_> = header.tensors().into_iter().collect();
    all.sort_by(|(a, info), (b, other)| (info.data_offsets, a).cmp(&(other.data_offsets, b)));
    let mut file = ArrayFile::from_file(location.clone());
    for (name, info) in all {
        let entry = match NumberType::ALL.into_iter().find(|kind| kind.dtype() == info.dtype) {
            Some(kind) => {
                let array_location = location_of(location, &name);
                let (from, to) = info.data_offsets;
                let shape = Shape::from(info.shape.as_slice());
                Entry::Array(RawArray::from_file(
                    array_location,
                    kind,
                    shape,
                    numbers[from..to].to_vec(),
                )?)
            }
            None => Entry::Foreign(foreign(info.dtype)),
        };
        file.add_new(name, entry)?;
    }
    file.metadata.extend(header.metadata().clone().unwrap_or_default());
    Ok(file)
}

/// Writes arrays and metadata to the safetensors file at `path`, whole or not at all.
///
/// # Errors
/// As [`safetensors()`]; [`SceneError::Write`] where the file system refuses.
pub fn write_safetensors(path: impl AsRef<Path>, arrays: &ArrayFile) -> Result<(), SceneError> {
    write_file(path.as_ref(), &safetensors(arrays)?)
}

/// A safetensors file with these arrays and their metadata.
///
/// # Errors
/// [`SceneError::Content`] for an array called `__metadata__`, for more than 64 axes, and for a shape of
/// no entries whose other extents no index could count.
pub fn safetensors(arrays: &ArrayFile) -> Result<Vec<u8>, SceneError> {
    let wrong = |error: &dyn std::fmt::Display| {
        let message = format!("the safetensors file can't be made: {error}");
        SceneError::content(arrays.location().clone(), message)
    };
    let mut all = arrays.arrays()?;
    all.sort_by_key(|(_, array)| std::cmp::Reverse(array.number_type().bytes()));
    let (mut infos, mut end) = (Vec::new(), 0);
    for &(name, array) in &all {
        array.check_axes()?;
        if name == METADATA {
            return Err(wrong(&format!("no array of a safetensors file is called {METADATA:?}")));
        }
        let start = end;
        end += array.bytes().len();
        let (dtype, shape) = (array.number_type().dtype(), array.shape().to_vec());
        infos.push((name.to_owned(), TensorInfo { dtype, shape, data_offsets: (start, end) }));
    }
    // As readers will check it.
    Metadata::new(None, infos.clone()).map_err(|error| wrong(&error))?;
    let header = Header { arrays, infos: &infos };
    let mut header = serde_json::to_vec(&header).map_err(|error| wrong(&error))?;
    header.resize(header.len().next_multiple_of(LENGTH), b' ');
    let mut bytes = Vec::with_capacity(LENGTH + header.len() + end);
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(header);
    all.iter().for_each(|(_, array)| bytes.extend_from_slice(array.bytes()));
    Ok(bytes)
}

/// A header in a fixed order, which that of the crate `safetensors` has not.
struct Header<'a> {
    arrays: &'a ArrayFile,
    infos: &'a [(String, TensorInfo)],
}

impl Serialize for Header<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        if !self.arrays.metadata.is_empty() {
            map.serialize_entry(METADATA, &self.arrays.metadata)?;
        }
        self.infos.iter().try_for_each(|(name, info)| map.serialize_entry(name, info))?;
        map.end()
    }
}
