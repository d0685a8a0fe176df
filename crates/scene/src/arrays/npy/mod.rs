//! Arrays in NumPy's own format, npy.
//!
//! # The file
//! The bytes `\x93NUMPY`, the version in two bytes, the length of the header in two bytes (version 1.0) or
//! four (2.0 and 3.0), the header ([`header`]), and the numbers.
//!
//! # What is read
//! Versions 1.0, 2.0 and 3.0; truth values, whole numbers of 8 to 64 bits, floats of 16 to 64 bits, with the
//! lowest or the highest byte first; any order of axes in memory; shapes of 0 to 64 axes. The numbers end
//! where the file ends.
//!
//! # What is written
//! What `numpy.save` of NumPy 2 writes, byte for byte: version 1.0, row-major, the lowest byte first.
//!
//! # Source
//! NumPy's reference, `numpy.lib.format`.

mod header;

use std::borrow::Cow;
use std::path::Path;

use bokashi_core::Shape;

use self::header::{Element, Header};
use super::number_type::NumberType;
use super::raw_array::{RawArray, bytes_of, needed};
use crate::error::{Location, SceneError};
use crate::file::{read_file, write_file};

/// What every file begins with.
const MAGIC: &[u8] = b"\x93NUMPY";

/// The numbers begin at a multiple of this.
const ALIGNMENT: usize = 64;

/// The digits that a header has room for in its first extent, so that an array can grow in its file.
const DIGITS: usize = 21;

/// The array in the npy file at `path`.
///
/// # Errors
/// [`SceneError::Read`] where it can't be read; as [`read_npy_bytes`].
pub fn read_npy(path: impl AsRef<Path>) -> Result<RawArray, SceneError> {
    read_npy_bytes(&read_file(path.as_ref())?, &Location::new(path))
}

/// The array in an npy file of these `bytes`. `location` names the file in errors.
///
/// # Errors
/// [`SceneError::Content`] for what is no npy file, for numbers of a type that is not read, and where there
/// are more or fewer bytes than the shape needs.
pub fn read_npy_bytes(bytes: &[u8], location: &Location) -> Result<RawArray, SceneError> {
    match decode(bytes, location)? {
        Ok(array) => Ok(array),
        Err(foreign) => Err(SceneError::content(location.clone(), foreign)),
    }
}

/// Writes an array to the npy file at `path`, whole or not at all.
///
/// # Errors
/// As [`npy`]; [`SceneError::Write`] where the file system refuses.
pub fn write_npy(path: impl AsRef<Path>, array: impl Into<RawArray>) -> Result<(), SceneError> {
    write_file(path.as_ref(), &npy(&array.into())?)
}

/// An npy file with this array: the bytes that `numpy.save` would write.
///
/// # Errors
/// [`SceneError::Content`] for `bf16`, which NumPy does not have, and for more than 64 axes.
pub fn npy(array: &RawArray) -> Result<Vec<u8>, SceneError> {
    array.check_axes()?;
    let Some(code) = header::code(array.number_type()) else {
        let message = format!("NumPy has no numbers of {}: read them as f32", array.number_type());
        return Err(array.wrong(message));
    };
    let extents: Vec<_> = array.shape().iter().map(usize::to_string).collect();
    let shape = match &extents[..] {
        [] => "()".to_owned(),
        [only] => format!("({only},)"),
        all => format!("({})", all.join(", ")),
    };
    let mut header = format!("{{'descr': '{code}', 'fortran_order': False, 'shape': {shape}, }}");
    if let Some(first) = extents.first() {
        header.extend(std::iter::repeat_n(' ', DIGITS - first.len()));
    }
    // The magic, the version and the length, the header, and the newline at its end.
    let unpadded = MAGIC.len() + 4 + header.len() + 1;
    // A whole block where it would need none: so has NumPy.
    let padding = ALIGNMENT - unpadded % ALIGNMENT;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    // At most 64 extents of 20 digits.
    let length = (header.len() as u16).to_le_bytes();
    Ok([MAGIC, &[1, 0], &length, header.as_bytes(), array.bytes()].concat())
}

/// The array, or why its numbers are not read.
///
/// # Errors
/// [`SceneError::Content`] for bytes that are no npy file.
pub(super) fn decode(
    bytes: &[u8],
    location: &Location,
) -> Result<Result<RawArray, String>, SceneError> {
    let wrong = |message: String| SceneError::content(location.clone(), message);
    let (text, numbers) = split(bytes).map_err(wrong)?;
    let Header { element, is_fortran, shape } = header::parse(&text).map_err(wrong)?;
    let (kind, is_big_endian) = match element {
        Element::Number { kind, is_big_endian } => (kind, is_big_endian),
        Element::Foreign(message) => return Ok(Err(message)),
    };
    let shape = Shape::from(shape.as_slice());
    if bytes_of(kind, &shape) != Some(numbers.len()) {
        let rule = format!("an array of shape {shape} has {}", needed(kind, &shape));
        return Err(wrong(format!("{rule}, and {} bytes follow the header", numbers.len())));
    }
    let mut numbers = numbers.to_vec();
    if is_big_endian {
        numbers.chunks_exact_mut(kind.bytes()).for_each(<[u8]>::reverse);
    }
    if is_fortran && !numbers.is_empty() {
        numbers = row_major(kind, &shape, &numbers);
    }
    RawArray::from_file(location.clone(), kind, shape, numbers).map(Ok)
}

/// The text of the header, and the bytes after it.
fn split(bytes: &[u8]) -> Result<(Cow<'_, str>, &[u8]), String> {
    let Some(rest) = bytes.strip_prefix(MAGIC) else {
        let first: Vec<String> = bytes.iter().take(6).map(|byte| format!("{byte:02x}")).collect();
        let rule = "an npy file begins with the bytes 93 4e 55 4d 50 59";
        return Err(format!("{rule}, and this with {:?}", first.join(" ")));
    };
    let cut_short = || "an npy file has a whole header, and this ends before".to_owned();
    let (&[major, minor], rest) = rest.split_first_chunk().ok_or_else(cut_short)?;
    let (length, rest) = match (major, minor) {
        (1, 0) => {
            let (length, rest) = rest.split_first_chunk().ok_or_else(cut_short)?;
            (u32::from(u16::from_le_bytes(*length)), rest)
        }
        (2 | 3, 0) => {
            let (length, rest) = rest.split_first_chunk().ok_or_else(cut_short)?;
            (u32::from_le_bytes(*length), rest)
        }
        _ => {
            let rule = "versions 1.0, 2.0 and 3.0 of npy are read";
            return Err(format!("{rule}, and this is {major}.{minor}"));
        }
    };
    let (text, numbers) = rest.split_at_checked(length as usize).ok_or_else(cut_short)?;
    let text = match major {
        // Latin-1, whose letters are the first 256 of Unicode.
        1 | 2 => text.iter().map(|&byte| char::from(byte)).collect::<String>().into(),
        _ => match str::from_utf8(text) {
            Ok(text) => text.into(),
            Err(error) => return Err(format!("the header of an npy 3.0 is UTF-8: {error}")),
        },
    };
    Ok((text, numbers))
}

/// Numbers whose first axis runs fastest, in the order in which the last one does.
fn row_major(kind: NumberType, shape: &Shape, bytes: &[u8]) -> Vec<u8> {
    let size = kind.bytes();
    // How far a step along each axis leads.
    let strides: Vec<_> = shape
        .iter()
        .scan(size, |stride, &extent| {
            let step = *stride;
            *stride *= extent;
            Some(step)
        })
        .collect();
    let (mut index, mut start) = (vec![0; shape.rank()], 0);
    let mut ordered = Vec::with_capacity(bytes.len());
    while ordered.len() < bytes.len() {
        ordered.extend_from_slice(&bytes[start..start + size]);
        for axis in (0..shape.rank()).rev() {
            index[axis] += 1;
            start += strides[axis];
            if index[axis] < shape[axis] {
                break;
            }
            start -= strides[axis] * shape[axis];
            index[axis] = 0;
        }
    }
    ordered
}
