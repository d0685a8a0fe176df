//! Smoothing of positions: each vertex toward the mean of its neighbours.
//!
//! # Formulas
//! A step moves all vertices at once, `x_i <- x_i + s (m_i - x_i)`, with `m_i` the mean of the neighbours. A boundary
//! is smoothed along itself. Repeated, it shrinks what is round. Taubin's second step with `s < 0` swells it again.
//! Both multiply waves of an eigenvalue k of the Laplacian by `(1 - a k) (1 + b k)`, near 1 for small k.
//!
//! # Source
//! Taubin, *A Signal Processing Approach to Fair Surface Design*, SIGGRAPH 1995.

use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::sides;
use bokashi_render_ops::glam::DVec3;

use crate::error::MeshError;
use crate::placed::Placed;
use crate::rings::Rings;

/// A rule of smoothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Smoothing {
    /// Moves a vertex by this share of the way to the mean of its neighbours, from 0 to 1.
    Laplacian(f64),
    /// Moves a vertex toward the mean of its neighbours, then away from their new mean: the surface shrinks less.
    Taubin {
        /// The share of the way there, from 0 to 1.
        shrink: f64,
        /// The share of the way back, from 0 to 1; a little more than `shrink`.
        swell: f64,
    },
}

impl Smoothing {
    /// Taubin's rule with the shares 0.5 and 0.53.
    pub const TAUBIN: Self = Self::Taubin { shrink: 0.5, swell: 0.53 };

    /// The shares of one iteration.
    fn shares(self) -> Result<Vec<f64>, TensorError> {
        let given = match self {
            Self::Laplacian(share) => vec![share],
            Self::Taubin { shrink, swell } => vec![shrink, swell],
        };
        if let Some(&value) = given.iter().find(|share| !(0.0..=1.0).contains(*share)) {
            let rule = "shares from 0 to 1".into();
            return Err(TensorError::Value { operation: "smooth", rule, value });
        }
        Ok(given.into_iter().zip([1.0, -1.0]).map(|(share, sign)| share * sign).collect())
    }
}

/// Smooths `positions: [V, 3]`, without a tape. Vertices at which boundaries meet, and those without a face, stay.
///
/// # Errors
/// [`TensorError::Shape`] unless there is a position for each vertex; [`TensorError::Value`] for one that is not
/// finite, for a share outside 0 to 1, and where steps that swell leave the range of the numbers.
pub fn smooth<T: Scalar>(
    positions: &Tensor<T>,
    mesh: &Mesh,
    smoothing: Smoothing,
    iterations: usize,
) -> Result<Tensor<T>, MeshError> {
    let placed = Placed::new("smooth", positions, mesh)?;
    let shares = smoothing.shares()?;
    let rings = Rings::new(mesh, &sides(mesh.faces()));
    let (mut points, mut moved) = (placed.points, Vec::new());
    for share in (0..iterations).flat_map(|_| shares.iter().copied()) {
        moved.clear();
        moved.extend(points.iter().enumerate().map(|(vertex, &point)| {
            let neighbors = rings.neighbors(vertex);
            if neighbors.is_empty() {
                return point;
            }
            let sum = neighbors.iter().map(|it| points[*it as usize]).sum::<DVec3>();
            point + share * (sum / neighbors.len() as f64 - point)
        }));
        std::mem::swap(&mut points, &mut moved);
    }
    let entry = |k: usize| T::from_f64(points[k / 3][k % 3] * placed.unit);
    let smoothed = Tensor::from_flat_fn(positions.shape(), entry);
    if let Some(lost) = smoothed.data().iter().find(|entry| !entry.is_finite()) {
        let (rule, value) = ("shares that keep positions finite".into(), lost.to_f64());
        return Err(TensorError::Value { operation: "smooth", rule, value }.into());
    }
    Ok(smoothed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{sheet, sphere};
    use crate::measures::signed_volume;

    #[test]
    fn noise_goes_and_taubin_keeps_the_volume() {
        let (plain, noisy) = (sphere(12), sphere(12).shaken(0.02, 7));
        let volume = |positions: &Tensor<f64>| signed_volume(positions, &plain.mesh()).unwrap();
        let roughness = |positions: &Tensor<f64>| {
            let rows = positions.data().as_chunks::<3>().0;
            let radii: Vec<_> = rows.iter().map(|row| DVec3::from_array(*row).length()).collect();
            let mean = radii.iter().sum::<f64>() / radii.len() as f64;
            let squares = radii.iter().map(|radius| (radius - mean).powi(2)).sum::<f64>();
            (squares / radii.len() as f64).sqrt()
        };
        let smoothed = |how| smooth(&noisy.positions(), &noisy.mesh(), how, 10).unwrap();
        let taubin = smoothed(Smoothing::TAUBIN);
        let (before, after) = (roughness(&noisy.positions()), roughness(&taubin));
        assert!(after < 0.5 * before, "{after} {before}");
        let ratio = volume(&taubin) / volume(&plain.positions());
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
        let ratio = volume(&smoothed(Smoothing::Laplacian(0.5))) / volume(&plain.positions());
        assert!(ratio < 0.95, "{ratio}");
    }

    #[test]
    fn a_step_is_the_one_worked_out_by_hand() {
        // A sheet with its middle lifted: it falls to the mean of six neighbours.
        let mut model = sheet(2);
        model.points[4].z = 1.0;
        let smoothed =
            smooth(&model.positions(), &model.mesh(), Smoothing::Laplacian(0.5), 1).unwrap();
        assert_eq!(smoothed[[4, 2]], 0.5);
        // A corner goes halfway to the middle of the two beside it, whatever lies inside.
        assert_eq!([smoothed[[0, 0]], smoothed[[0, 1]], smoothed[[0, 2]]], [0.125, 0.125, 0.0]);
    }

    #[test]
    fn what_cannot_be_smoothed_stays_or_is_refused() {
        let mesh = Mesh::new(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]], 6).unwrap();
        let positions = Tensor::from_flat_fn([6, 3], |k| k as f64 * k as f64);
        let smoothed = smooth(&positions, &mesh, Smoothing::TAUBIN, 3).unwrap();
        for vertex in [0, 1, 5] {
            assert!((0..3).all(|axis| smoothed[[vertex, axis]] == positions[[vertex, axis]]));
        }
        let error = smooth(&positions, &mesh, Smoothing::Laplacian(1.5), 3).unwrap_err();
        assert_eq!(error.to_string(), "smooth needs shares from 0 to 1, got 1.5");
        let swell = Smoothing::Taubin { shrink: 0.0, swell: 1.0 };
        let error = smooth(&positions, &mesh, swell, 100_000).unwrap_err();
        assert!(error.to_string().starts_with("smooth needs shares that keep"), "{error}");
    }
}
