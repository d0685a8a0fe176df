//! The mean square of a Laplacian: `L = (1 / V) sum_i |(M v)_i|^2`, a composition.

use bokashi_core::{Scalar, SparseMatrix, TensorError, Var};

/// The mean over rows of `|(M v)_i|^2`, for positions or other numbers at vertices, `[V]` or `[V, C]`; returns `[]`. M
/// is a Laplacian of the [`Topology`](crate::Topology). It is 0 without a row.
///
/// With the uniform Laplacian it draws each vertex to the mean of its neighbours, also along the surface. With the
/// cotangent Laplacian of a rest shape it draws vertices mostly across the surface.
///
/// # Errors
/// [`TensorError::Shape`] unless `vertices` has a row for each column of the matrix.
pub fn laplacian_error<'t, T: Scalar>(
    vertices: Var<'t, T>,
    laplacian: &SparseMatrix<T>,
) -> Result<Var<'t, T>, TensorError> {
    let share = T::ONE / T::from_f64(laplacian.rows().max(1) as f64);
    Ok(laplacian.product(vertices)?.square().sum() * share)
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;
    use crate::topology::Topology;

    #[test]
    fn the_error_is_the_mean_square_of_the_distance_to_the_neighbours() {
        let topology = Topology::new(&[[0, 1, 2]], 4).unwrap();
        let tape = Tape::<f64>::new();
        let rows = [0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 9.0, 9.0];
        let v = tape.leaf(&Tensor::new([4, 2], rows.to_vec()).unwrap());
        // Distances (-1.5, -1.5), (3, -1.5), (-1.5, 3), and none.
        let error = laplacian_error(v, &topology.uniform_laplacian()).unwrap();
        assert_eq!(error.item(), (4.5 + 11.25 + 11.25) / 4.0);
        let gradient = error.backward().unwrap().get_or_zeros(v);
        // 2 / V L^T L v, at vertex 0 by x: (-1.5 - (3 - 1.5) / 2) / 2.
        assert_eq!(gradient[[0, 0]], -1.125);
        assert_eq!((gradient[[3, 0]], gradient[[3, 1]]), (0.0, 0.0));
        let none = Topology::new(&[], 0).unwrap().uniform_laplacian();
        let empty = tape.leaf(&Tensor::zeros([0, 3]));
        assert_eq!(laplacian_error(empty, &none).unwrap().item(), 0.0);
        assert!(laplacian_error(empty, &topology.uniform_laplacian()).is_err());
    }
}
