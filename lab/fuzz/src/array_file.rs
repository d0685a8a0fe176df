//! Arbitrary files as arrays.

use bokashi_scene::arrays::{
    ArrayFile, Packing, RawArray, npy, npz, read_npy_bytes, read_npz_bytes, read_safetensors_bytes,
    safetensors,
};
use bokashi_scene::{Location, SceneError};

use super::files::in_short;

/// Reads the arrays of the file that `bytes` are: an npz file where they begin as an archive does, an npy file
/// where they begin as such, and else a safetensors file. Returns the bytes of all numbers that were read.
pub fn array_file(bytes: &[u8]) -> usize {
    let place = Location::new("arrays");
    if bytes.starts_with(b"PK") {
        return arrays(bytes, read_npz_bytes, |all| npz(all, Packing::Stored));
    }
    if !bytes.starts_with(b"\x93NUMPY") {
        return arrays(bytes, read_safetensors_bytes, safetensors);
    }
    match read_npy_bytes(bytes, &place) {
        Ok(array) => {
            let written = npy(&array).expect("what was read can be written");
            let back = read_npy_bytes(&written, &place).expect("what was written can be read");
            assert_eq!(back, array);
            look(&array)
        }
        Err(error) => in_short(&error),
    }
}

/// Reads a file of several arrays, and those that it has from what is written of them.
fn arrays(
    bytes: &[u8],
    read: fn(&[u8], &Location) -> Result<ArrayFile, SceneError>,
    write: impl Fn(&ArrayFile) -> Result<Vec<u8>, SceneError>,
) -> usize {
    let place = Location::new("arrays");
    let file = match read(bytes, &place) {
        Ok(file) => file,
        Err(error) => return in_short(&error),
    };
    let mut own = ArrayFile::new();
    let mut reached = 0;
    for name in file.names() {
        match file.get(name) {
            Ok(array) => {
                reached += look(array);
                own.insert(name, array.clone());
            }
            Err(error) => reached += in_short(&error),
        }
    }
    let written = write(&own).expect("what was read can be written");
    let back = read(&written, &place).expect("what was written can be read");
    for name in own.names() {
        assert_eq!(back.get(name).expect(name), own.get(name).expect(name));
    }
    assert_eq!(back.names().len(), own.names().len());
    reached
}

/// What is read of an array has its shape. Returns how many bytes it has.
fn look(array: &RawArray) -> usize {
    if let Ok(tensor) = array.tensor::<f64>() {
        assert_eq!(tensor.shape(), array.shape());
    }
    if let Ok(rows) = array.indices::<3>() {
        assert_eq!(rows.len(), array.shape()[0]);
    }
    array.bytes().len()
}
