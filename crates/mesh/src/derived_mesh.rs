//! A mesh whose vertices are weighted means of the vertices of another mesh.

use bokashi_core::{Scalar, SparseMatrix, Tensor, TensorError};
use bokashi_render_ops::Mesh;

use crate::error::MeshError;

/// A mesh whose vertices are weighted means of an old mesh's vertices.
#[derive(Debug, Clone)]
pub struct DerivedMesh<T> {
    /// The positions `[W, 3]` of its W vertices: the product of the weights and the old positions.
    pub positions: Tensor<T>,
    /// Its faces. Seams of the old mesh stay seams.
    pub mesh: Mesh,
    /// The weights of the old vertices, `[W, V]`; each row sums to 1.
    ///
    /// `weights.cast::<f32>().product(x)` is the [product](SparseMatrix::product) on a tape, for an `x: [V, C]` that
    /// is learnt.
    pub weights: SparseMatrix<f64>,
}

impl<T: Scalar> DerivedMesh<T> {
    pub(crate) fn new(
        positions: &Tensor<T>,
        mesh: Mesh,
        weights: SparseMatrix<f64>,
    ) -> Result<Self, MeshError> {
        Ok(Self { positions: product(&weights, positions)?, mesh, weights })
    }

    /// Carries values at the old vertices, `[V, ...]`, such as colours, over to the new ones: `[W, ...]`. At an old
    /// vertex that is kept, they keep their bits.
    ///
    /// # Errors
    /// [`TensorError::Shape`] unless there is a row for each old vertex.
    pub fn carry<U: Scalar>(&self, old: &Tensor<U>) -> Result<Tensor<U>, MeshError> {
        product(&self.weights, old)
    }
}

/// The weighted sums of the rows of `old: [V, ...]`.
fn product<T: Scalar>(
    weights: &SparseMatrix<f64>,
    old: &Tensor<T>,
) -> Result<Tensor<T>, MeshError> {
    let mut shape = old.shape().to_vec();
    if shape.first() != Some(&weights.columns()) {
        let rule = format!("a row for each of the {} old vertices", weights.columns()).into();
        let shape = old.shape().clone();
        return Err(TensorError::Shape { operation: "carry", rule, shape }.into());
    }
    let length: usize = shape[1..].iter().product();
    shape[0] = weights.rows();
    let mut data = Vec::with_capacity(weights.rows() * length);
    for row in 0..weights.rows() {
        let (columns, values) = weights.row(row);
        data.extend((0..length).map(|k| {
            if let ([column], [1.0]) = (columns, values) {
                return old.data()[*column as usize * length + k];
            }
            let sum = columns.iter().zip(values).fold(T::Wide::ZERO, |sum, (&column, &weight)| {
                sum + T::Wide::from_f64(weight) * old.data()[column as usize * length + k].widen()
            });
            T::narrow(sum)
        }));
    }
    Ok(Tensor::new(&shape[..], data)?)
}

/// The vertices of `count` that are kept, and `faces` with indices into this list of vertices.
pub(crate) fn kept_part(
    count: usize,
    is_kept: impl Fn(usize) -> bool,
    faces: impl Iterator<Item = [u32; 3]>,
) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut places = vec![0; count];
    let mut kept = Vec::new();
    for vertex in (0..count).filter(|vertex| is_kept(*vertex)) {
        places[vertex] = kept.len() as u32;
        kept.push(vertex as u32);
    }
    let faces = faces.map(|face| face.map(|vertex| places[vertex as usize])).collect();
    (kept, faces)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_of_kept_vertices_name_their_new_places() {
        let faces = [[5, 1, 4], [4, 1, 5]].into_iter();
        let (kept, faces) = kept_part(6, |vertex| ![0, 3].contains(&vertex), faces);
        assert_eq!((kept, faces), (vec![1, 2, 4, 5], vec![[3, 0, 2], [2, 0, 3]]));
    }

    #[test]
    fn rows_of_any_length_are_carried_over() {
        let weights =
            SparseMatrix::new(3, 2, [(0, 1, 1.0), (1, 0, 0.25), (1, 1, 0.75), (2, 0, 1.0)]);
        let mesh = Mesh::new(Vec::new(), 3).unwrap();
        let derived =
            DerivedMesh::new(&Tensor::<f64>::zeros([2, 3]), mesh, weights.unwrap()).unwrap();
        let old = Tensor::new([2, 2], vec![f32::INFINITY, 4.0, -0.0, 8.0]).unwrap();
        let carried = derived.carry(&old).unwrap();
        let expected = [-0.0, 8.0, f32::INFINITY, 7.0, f32::INFINITY, 4.0];
        assert_eq!(
            carried.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
            expected.map(f32::to_bits)
        );
        assert_eq!(
            derived.carry(&Tensor::<f64>::from([0.0, 4.0])).unwrap(),
            Tensor::from([4.0, 3.0, 0.0])
        );
        assert_eq!(**derived.carry(&Tensor::<f64>::zeros([2, 0])).unwrap().shape(), [3, 0]);
        let error = derived.carry(&Tensor::<f64>::zeros([3, 2])).unwrap_err();
        assert_eq!(
            error.to_string(),
            "carry needs a row for each of the 2 old vertices, got shape [3, 2]"
        );
        assert!(derived.carry(&Tensor::scalar(1.0)).is_err());
    }
}
