//! Tensors from and to the arrays of the crate `ndarray` (feature `ndarray`).

use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::RenderError;
use ndarray::{ArrayD, ArrayViewD, AsArray, Dimension, IxDyn};

use crate::error::SceneError;

/// The tensor of the same shape and entries, copied. The array may lie in memory in any order: transposed,
/// with steps, turned round.
///
/// ```
/// use bokashi_scene::arrays::tensor_of_ndarray;
/// use bokashi_scene::ndarray::array;
///
/// let matrix = array![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
/// assert_eq!(tensor_of_ndarray(matrix.t()).data(), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
/// ```
pub fn tensor_of_ndarray<'a, T: Scalar, D: Dimension>(array: impl AsArray<'a, T, D>) -> Tensor<T> {
    let array = array.into();
    // Entries in the order of their indices, wherever they lie.
    let entries = match array.as_slice() {
        Some(entries) => entries.to_vec(),
        None => array.iter().copied().collect(),
    };
    let tensor = Tensor::new(array.shape(), entries);
    tensor
        .unwrap_or_else(|error| unreachable!("an array has as many entries as its shape: {error}"))
}

/// The array of the same shape and entries, which share the tensor's buffer.
///
/// # Errors
/// [`SceneError::Render`] for a shape of no entries whose other extents are more than `ndarray` takes.
pub fn ndarray_view<T: Scalar>(tensor: &Tensor<T>) -> Result<ArrayViewD<'_, T>, SceneError> {
    let shape = tensor.shape();
    ArrayViewD::from_shape(IxDyn(shape), tensor.data()).map_err(|error| {
        let (operation, rule) = ("ndarray_view", format!("a shape that ndarray takes ({error})"));
        RenderError::Shape { operation, rule, shape: shape.clone() }.into()
    })
}

/// The array of the same shape and entries, copied.
///
/// # Errors
/// As [`ndarray_view`].
pub fn ndarray_of<T: Scalar>(tensor: &Tensor<T>) -> Result<ArrayD<T>, SceneError> {
    Ok(ndarray_view(tensor)?.into_owned())
}
