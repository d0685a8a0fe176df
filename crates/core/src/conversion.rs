//! Tensors of arrays, slices and vectors, and back.
//!
//! Rows of any fixed width become a matrix, so vectors of another crate come by way of their arrays:
//! `points.iter().map(|point| point.to_array()).collect::<Tensor<f64>>()` is `[n, 3]`.

use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::tensor::Tensor;

/// `[]`.
impl<T: Scalar> From<T> for Tensor<T> {
    fn from(entry: T) -> Self {
        Self::scalar(entry)
    }
}

/// `[n]`; the buffer is the vector's.
impl<T: Scalar> From<Vec<T>> for Tensor<T> {
    fn from(entries: Vec<T>) -> Self {
        Self::from_parts([entries.len()].into(), entries.into())
    }
}

/// `[n]`.
impl<T: Scalar> From<&[T]> for Tensor<T> {
    fn from(entries: &[T]) -> Self {
        entries.to_vec().into()
    }
}

/// `[N]`.
impl<T: Scalar, const N: usize> From<[T; N]> for Tensor<T> {
    fn from(entries: [T; N]) -> Self {
        entries.to_vec().into()
    }
}

/// `[n, N]`, a row per array.
impl<T: Scalar, const N: usize> From<&[[T; N]]> for Tensor<T> {
    fn from(rows: &[[T; N]]) -> Self {
        Self::from_parts([rows.len(), N].into(), rows.as_flattened().to_vec().into())
    }
}

/// `[n, N]`, a row per array.
impl<T: Scalar, const N: usize> From<Vec<[T; N]>> for Tensor<T> {
    fn from(rows: Vec<[T; N]>) -> Self {
        rows.as_slice().into()
    }
}

/// `[M, N]`, a row per array.
impl<T: Scalar, const M: usize, const N: usize> From<[[T; N]; M]> for Tensor<T> {
    fn from(rows: [[T; N]; M]) -> Self {
        rows.as_slice().into()
    }
}

/// `[n]`.
impl<T: Scalar> FromIterator<T> for Tensor<T> {
    fn from_iter<I: IntoIterator<Item = T>>(entries: I) -> Self {
        Vec::from_iter(entries).into()
    }
}

/// `[n, N]`, a row per array.
impl<T: Scalar, const N: usize> FromIterator<[T; N]> for Tensor<T> {
    fn from_iter<I: IntoIterator<Item = [T; N]>>(rows: I) -> Self {
        Vec::from_iter(rows).into()
    }
}

/// The entries, row-major.
impl<T: Scalar> AsRef<[T]> for Tensor<T> {
    fn as_ref(&self) -> &[T] {
        self.data()
    }
}

/// The entries, row-major; copied where the buffer is shared.
impl<T: Scalar> From<Tensor<T>> for Vec<T> {
    fn from(tensor: Tensor<T>) -> Self {
        let (_, data) = tensor.into_parts();
        data.into_vec()
    }
}

/// The rows of a matrix `[n, N]`.
///
/// # Errors
/// [`TensorError::Shape`] for any other shape.
impl<T: Scalar, const N: usize> TryFrom<&Tensor<T>> for Vec<[T; N]> {
    type Error = TensorError;

    fn try_from(tensor: &Tensor<T>) -> Result<Self, TensorError> {
        match **tensor.shape() {
            [_, columns] if columns == N => Ok(tensor.data().as_chunks().0.to_vec()),
            _ => Err(TensorError::Shape {
                operation: "rows",
                rule: format!("shape [n, {N}]").into(),
                shape: tensor.shape().clone(),
            }),
        }
    }
}

/// The rows of a matrix `[n, N]`.
///
/// # Errors
/// [`TensorError::Shape`] for any other shape.
impl<T: Scalar, const N: usize> TryFrom<Tensor<T>> for Vec<[T; N]> {
    type Error = TensorError;

    fn try_from(tensor: Tensor<T>) -> Result<Self, TensorError> {
        (&tensor).try_into()
    }
}
