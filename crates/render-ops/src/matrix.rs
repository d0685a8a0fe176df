//! Matrices of four rows and four columns, as arrays of rows.

use bokashi_core::Scalar;

use crate::error::RenderError;

/// By rows.
pub(crate) type Matrix4<S> = [[S; 4]; 4];

/// The matrix of 16 entries, row-major, with more digits.
pub(crate) fn from_entries<T: Scalar>(entries: &[T]) -> Matrix4<T::Wide> {
    std::array::from_fn(|row| std::array::from_fn(|k| entries[4 * row + k].widen()))
}

/// `A B`.
#[inline]
pub(crate) fn product<S: Scalar>(a: &Matrix4<S>, b: &Matrix4<S>) -> Matrix4<S> {
    entry_by_entry(|row, column| dot(a[row], b.map(|row| row[column])))
}

/// `A^T B`.
#[inline]
pub(crate) fn transposed_product<S: Scalar>(a: &Matrix4<S>, b: &Matrix4<S>) -> Matrix4<S> {
    entry_by_entry(|row, column| dot(a.map(|r| r[row]), b.map(|r| r[column])))
}

/// `A B^T`.
#[inline]
pub(crate) fn product_transposed<S: Scalar>(a: &Matrix4<S>, b: &Matrix4<S>) -> Matrix4<S> {
    entry_by_entry(|row, column| dot(a[row], b[column]))
}

/// Adds `B` to `A`.
pub(crate) fn add<S: Scalar>(a: &mut Matrix4<S>, b: &Matrix4<S>) {
    a.iter_mut().flatten().zip(b.iter().flatten()).for_each(|(a, &b)| *a += b);
}

fn entry_by_entry<S: Scalar>(entry: impl Fn(usize, usize) -> S) -> Matrix4<S> {
    std::array::from_fn(|row| std::array::from_fn(|column| entry(row, column)))
}

fn dot<S: Scalar>(a: [S; 4], b: [S; 4]) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// Writes a matrix to its 16 entries.
pub(crate) fn write<T: Scalar>(matrix: &Matrix4<T::Wide>, entries: &mut [T]) {
    let entry = |k: usize| T::narrow(matrix[k / 4][k % 4]);
    entries.iter_mut().enumerate().for_each(|(k, to)| *to = entry(k));
}

/// # Errors
/// [`RenderError::Camera`] for an entry that is not finite, in a list of matrices, row-major.
pub(crate) fn check_finite<T: Scalar>(entries: &[T]) -> Result<(), RenderError> {
    match entries.iter().position(|entry| !entry.is_finite()) {
        None => Ok(()),
        Some(index) => {
            let (row, column) = (index / 4 % 4, index % 4);
            Err(RenderError::Camera { row, column, value: entries[index].to_f64() })
        }
    }
}

/// # Errors
/// [`bokashi_core::TensorError::Value`] for a matrix whose last row is not (0, 0, 0, 1): it would
/// need a division.
pub(crate) fn check_affine<T: Scalar>(
    operation: &'static str,
    entries: &[T],
) -> Result<(), RenderError> {
    let last = &entries[12..16];
    let expected = [T::ZERO, T::ZERO, T::ZERO, T::ONE];
    match last.iter().zip(expected).find(|(entry, expected)| *entry != expected) {
        None => Ok(()),
        Some((entry, _)) => {
            let rule = "a matrix with the last row (0, 0, 0, 1)";
            Err(RenderError::value(operation, rule, entry.to_f64()))
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat4;

    use super::*;

    fn rows(matrix: DMat4) -> Matrix4<f64> {
        matrix.transpose().to_cols_array_2d()
    }

    #[test]
    fn products_are_glams() {
        let matrix = |seed: usize| {
            DMat4::from_cols_array(&std::array::from_fn(|k| ((k * 7 + seed) % 11) as f64 - 4.0))
        };
        let (a, b) = (matrix(2), matrix(5));
        assert_eq!(product(&rows(a), &rows(b)), rows(a * b));
        assert_eq!(transposed_product(&rows(a), &rows(b)), rows(a.transpose() * b));
        assert_eq!(product_transposed(&rows(a), &rows(b)), rows(a * b.transpose()));
    }

    #[test]
    fn an_entry_that_is_not_finite_is_named_in_any_matrix_of_a_list() {
        let mut entries = [0.0; 32];
        assert_eq!(check_finite(&entries), Ok(()));
        entries[16 + 9] = f64::INFINITY;
        let error = RenderError::Camera { row: 2, column: 1, value: f64::INFINITY };
        assert_eq!(check_finite(&entries), Err(error));
    }
}
