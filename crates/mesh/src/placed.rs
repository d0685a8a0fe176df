//! Checked positions, in `f64` and scaled by a power of two.

use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::glam::DVec3;

/// Checks that `tensor` is `[n, 3]`, with `n` as `count` says, and finite; `name` is the name of its rows.
///
/// # Errors
/// [`TensorError::Shape`] for another shape; [`TensorError::Value`] for a number that is not finite.
fn check<T: Scalar>(
    operation: &'static str,
    tensor: &Tensor<T>,
    name: &'static str,
    count: Option<usize>,
) -> Result<(), TensorError> {
    let shape = tensor.shape();
    if shape.len() != 2 || shape[1] != 3 || count.is_some_and(|count| shape[0] != count) {
        let rows = count.map_or("n".to_owned(), |count| count.to_string());
        let (rule, shape) = (format!("{name} of shape [{rows}, 3]").into(), shape.clone());
        return Err(TensorError::Shape { operation, rule, shape });
    }
    match tensor.data().iter().position(|entry| !entry.is_finite()) {
        None => Ok(()),
        Some(at) => {
            let rule = format!("finite numbers in row {} of the {name}", at / 3).into();
            Err(TensorError::Value { operation, rule, value: tensor.data()[at].to_f64() })
        }
    }
}

/// Checks that `positions` are those of the vertices of `mesh`, `[V, 3]`.
///
/// # Errors
/// [`TensorError::Shape`] for another shape; [`TensorError::Value`] for a number that is not finite.
pub(crate) fn check_positions<T: Scalar>(
    operation: &'static str,
    positions: &Tensor<T>,
    mesh: &Mesh,
) -> Result<(), TensorError> {
    check(operation, positions, "positions", Some(mesh.vertex_count()))
}

/// The rows of a tensor `[n, 3]`; `name` is their name.
///
/// # Errors
/// As [`check_positions`].
pub(crate) fn points<T: Scalar>(
    operation: &'static str,
    tensor: &Tensor<T>,
    name: &'static str,
) -> Result<Vec<DVec3>, TensorError> {
    check(operation, tensor, name, None)?;
    Ok(rows(tensor))
}

/// The positions `[V, 3]` of the vertices of `mesh`.
///
/// # Errors
/// As [`check_positions`].
pub(crate) fn vertices<T: Scalar>(
    operation: &'static str,
    positions: &Tensor<T>,
    mesh: &Mesh,
) -> Result<Vec<DVec3>, TensorError> {
    check_positions(operation, positions, mesh)?;
    Ok(rows(positions))
}

fn rows<T: Scalar>(tensor: &Tensor<T>) -> Vec<DVec3> {
    let rows = tensor.data().as_chunks::<3>().0.iter();
    rows.map(|row| DVec3::from_array(row.map(Scalar::to_f64))).collect()
}

/// Divides all points by one power of two, and returns that power. The points then lie within -2 and 2, so no product
/// of a few coordinates leaves the range of the numbers.
pub(crate) fn balance<const N: usize>(mut clouds: [&mut [DVec3]; N]) -> f64 {
    let all = clouds.iter().flat_map(|cloud| cloud.iter());
    let size = all.fold(0.0_f64, |size, point| size.max(point.abs().max_element()));
    // The power of two at or below the largest entry.
    let unit = f64::from_bits(size.to_bits() & f64::INFINITY.to_bits()).max(f64::MIN_POSITIVE);
    clouds.iter_mut().flat_map(|cloud| cloud.iter_mut()).for_each(|point| *point /= unit);
    unit
}

/// The positions of a mesh, [balanced](balance).
#[derive(Debug)]
pub(crate) struct Placed {
    /// The positions over `unit`, within -2 and 2.
    pub(crate) points: Vec<DVec3>,
    /// The power of two by which positions were divided.
    pub(crate) unit: f64,
}

impl Placed {
    /// Scales the positions `[V, 3]` of the vertices of `mesh`.
    ///
    /// # Errors
    /// As [`check_positions`].
    pub(crate) fn new<T: Scalar>(
        operation: &'static str,
        positions: &Tensor<T>,
        mesh: &Mesh,
    ) -> Result<Self, TensorError> {
        let mut points = vertices(operation, positions, mesh)?;
        let unit = balance([&mut points]);
        Ok(Self { points, unit })
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
    fn clouds_are_divided_by_one_number() {
        let (mut one, mut other) = (vec![DVec3::X], vec![-5.0 * DVec3::Y, DVec3::ZERO]);
        assert_eq!(balance([&mut one, &mut other]), 4.0);
        assert_eq!((one, other), (vec![0.25 * DVec3::X], vec![-1.25 * DVec3::Y, DVec3::ZERO]));
    }

    #[test]
    fn what_is_no_position_is_refused() {
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let said = |rows: &Tensor<f64>| Placed::new("remesh", rows, &mesh).unwrap_err().to_string();
        let message = "remesh needs positions of shape [3, 3], got shape [3, 2]";
        assert_eq!(said(&Tensor::zeros([3, 2])), message);
        let lost = Tensor::from_flat_fn([3, 3], |k| if k > 4 { f64::NAN } else { 0.0 });
        let message = "remesh needs finite numbers in row 1 of the positions, got NaN";
        assert_eq!(said(&lost), message);
    }
}
