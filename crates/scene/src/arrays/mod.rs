//! Arrays from and to other programs and crates.
//!
//! | from and to | how |
//! |---|---|
//! | vectors, slices | `Tensor::from`, `Vec::from`: see [`Tensor`](crate::Tensor) |
//! | `.npy` of NumPy | [`read_npy`], [`write_npy`] |
//! | `.npz` of NumPy | `read_npz`, `write_npz`, with the feature `npz` |
//! | `.safetensors` | [`read_safetensors`], [`write_safetensors`] |
//! | crate `ndarray` | `tensor_of_ndarray`, `ndarray_view`, `ndarray_of`, with the feature `ndarray` |
//! | vectors and matrices of [glam] | [`tensor_of_rows`], [`rows_of`] |
//! | images of the crate `image` | `tensor_of_image`, `image_of`, with the feature `image` |
//!
//! A file's array is a [`RawArray`], with numbers of any type; an [`ArrayFile`] has several by name.
//! [`RawArray::tensor`] makes a tensor of it, and never rounds.
//!
//! ```
//! use bokashi_scene::arrays::{npy, read_npy_bytes};
//! use bokashi_scene::{Location, Tensor};
//!
//! let tensor = Tensor::from([[1.0, 2.0], [3.0, 4.0]]);
//! let bytes = npy(&(&tensor).into())?;
//! assert_eq!(read_npy_bytes(&bytes, &Location::new("a.npy"))?.tensor::<f64>()?, tensor);
//! # Ok::<(), bokashi_scene::SceneError>(())
//! ```

mod array_file;
#[cfg(feature = "image")]
mod images;
#[cfg(feature = "ndarray")]
mod ndarray;
mod npy;
#[cfg(feature = "npz")]
mod npz;
mod number_type;
mod raw_array;
mod rows;
mod safetensors;
#[cfg(test)]
mod tests;

pub use self::array_file::ArrayFile;
#[cfg(feature = "image")]
pub use self::images::{image_of, tensor_of_image};
#[cfg(feature = "ndarray")]
pub use self::ndarray::{ndarray_of, ndarray_view, tensor_of_ndarray};
pub use self::npy::{npy, read_npy, read_npy_bytes, write_npy};
#[cfg(feature = "npz")]
pub use self::npz::{Packing, npz, read_npz, read_npz_bytes, write_npz};
pub use self::number_type::NumberType;
pub use self::raw_array::RawArray;
pub use self::rows::{Row, rows_of, tensor_of_rows};
pub use self::safetensors::{
    read_safetensors, read_safetensors_bytes, safetensors, write_safetensors,
};
