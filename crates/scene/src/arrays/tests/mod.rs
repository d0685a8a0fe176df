//! What all files of arrays keep: every bit, and their temper whatever bytes they meet.

mod damaged;
#[cfg(feature = "image")]
mod images;
#[cfg(feature = "ndarray")]
mod ndarray;
mod npy;
#[cfg(feature = "npz")]
mod npz;
mod numbers;
mod safetensors;

use std::path::{Path, PathBuf};

use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::error::Location;

/// Where NumPy's files are; `tests/data/make_arrays.py` made them.
fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/arrays")
}

fn file(name: &str) -> Vec<u8> {
    std::fs::read(data().join(name)).unwrap()
}

fn location() -> Location {
    Location::new("file")
}

/// Shapes of up to five axes; many of them have no entries.
fn shapes() -> impl Strategy<Value = Vec<usize>> {
    vec(0_usize..5, 0..=5)
}

/// Arrays of any type and any bits: NaNs of all kinds, both zeros, denormals.
fn arrays() -> impl Strategy<Value = RawArray> {
    (proptest::sample::select(NumberType::ALL.to_vec()), shapes()).prop_flat_map(|(kind, shape)| {
        let size = shape.iter().product::<usize>() * kind.bytes();
        vec(bytes(), size).prop_map(move |mut bytes| {
            if kind == NumberType::Bool {
                bytes.iter_mut().for_each(|byte| *byte &= 1);
            }
            RawArray::new(kind, shape.as_slice(), bytes).unwrap()
        })
    })
}

/// Bytes whose extremes come often.
fn bytes() -> impl Strategy<Value = u8> {
    prop_oneof![Just(0), Just(0xff), Just(0x80), Just(0x7f), any::<u8>()]
}
