//! Positions as they are computed with.

use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::glam::DVec3;

/// The positions of a mesh, divided by a power of two so that no product of them leaves the range of numbers.
#[derive(Debug)]
pub(crate) struct Placed {
    /// Within -2 and 2.
    pub(crate) points: Vec<DVec3>,
    /// What they were divided by.
    pub(crate) unit: f64,
}

impl Placed {
    /// The positions `[V, 3]` of the vertices of `mesh`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for another shape; [`TensorError::Value`] for a position that is not finite.
    pub(crate) fn new<T: Scalar>(
        operation: &'static str,
        positions: &Tensor<T>,
        mesh: &Mesh,
    ) -> Result<Self, TensorError> {
        let count = mesh.vertex_count();
        if **positions.shape() != [count, 3] {
            let rule = format!("positions of shape [{count}, 3]").into();
            return Err(TensorError::Shape { operation, rule, shape: positions.shape().clone() });
        }
        let mut size = 0.0_f64;
        for entry in positions.data() {
            if !entry.is_finite() {
                let (rule, value) = ("finite positions".into(), entry.to_f64());
                return Err(TensorError::Value { operation, rule, value });
            }
            size = size.max(entry.to_f64().abs());
        }
        // The power of two at or below the largest entry.
        let unit = f64::from_bits(size.to_bits() & f64::INFINITY.to_bits()).max(f64::MIN_POSITIVE);
        let rows = positions.data().as_chunks::<3>().0;
        let points = rows.iter().map(|row| DVec3::from_array(row.map(|x| x.to_f64() / unit)));
        Ok(Self { points: points.collect(), unit })
    }

    pub(crate) fn corners(&self, face: [u32; 3]) -> [DVec3; 3] {
        face.map(|vertex| self.points[vertex as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_any_scale_have_the_same_points() {
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let rows = Tensor::from_flat_fn([3, 3], |k| k as f64 - 3.5);
        let points = Placed::new("test", &rows, &mesh).unwrap().points;
        for exponent in [-1000, 40, 1000] {
            let scaled = rows.map(|x| x * 2_f64.powi(exponent));
            let placed = Placed::new("test", &scaled, &mesh).unwrap();
            assert_eq!((placed.points, placed.unit), (points.clone(), 2_f64.powi(exponent + 2)));
        }
        assert_eq!(
            Placed::new("test", &rows.map(|_| 0.0), &mesh).unwrap().points,
            [DVec3::ZERO; 3]
        );
    }

    #[test]
    fn what_is_no_position_is_refused() {
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let said = |rows: &Tensor<f64>| Placed::new("remesh", rows, &mesh).unwrap_err().to_string();
        let message = "remesh needs positions of shape [3, 3], got shape [3, 2]";
        assert_eq!(said(&Tensor::zeros([3, 2])), message);
        assert_eq!(said(&Tensor::full([3, 3], f64::NAN)), "remesh needs finite positions, got NaN");
    }
}
