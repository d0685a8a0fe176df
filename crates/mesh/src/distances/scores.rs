//! Scores of how alike two surfaces are, without gradients.

use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::glam::DVec3;

use super::nearest::{nearest_of, nearest_on_surface};
use super::surface_points::{SurfacePoints, draw_points};
use crate::error::MeshError;
use crate::placed::Placed;
use crate::triangle::area_vector;

/// The F-score of a cloud of points against the true one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FScore {
    /// The share of found points that are near a true one.
    pub precision: f64,
    /// The share of true points that are near a found one.
    pub recall: f64,
    /// The harmonic mean of precision and recall, or 0 where both are 0.
    pub score: f64,
}

/// The F-score of `found: [n, 3]` against `truth: [m, 3]`: a point is near where some point of the other cloud is
/// at most `threshold` away.
///
/// # Errors
/// `TensorError::Shape` unless the shapes are these, with n and m from 1 up; `TensorError::Value` for a number that is
/// not finite, and for a threshold below 0.
pub fn f_score<T: Scalar>(
    found: &Tensor<T>,
    truth: &Tensor<T>,
    threshold: f64,
) -> Result<FScore, MeshError> {
    const NAME: &str = "f_score";
    if threshold.is_nan() || threshold < 0.0 {
        let rule = "a threshold from 0 up".into();
        return Err(TensorError::Value { operation: NAME, rule, value: threshold }.into());
    }
    let share = |of: &Tensor<T>, other: &Tensor<T>| {
        let distances = nearest_of(NAME, of, other)?.distances;
        let near = distances.iter().filter(|&&distance| distance <= threshold).count();
        Ok::<_, MeshError>(near as f64 / distances.len() as f64)
    };
    let (precision, recall) = (share(found, truth)?, share(truth, found)?);
    let sum = precision + recall;
    let score = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
    Ok(FScore { precision, recall, score })
}

/// The normal consistency of two surfaces, from 0 to 1.
///
/// `count` points are drawn on one surface. The normal n at each is compared with the normal m at the nearest point of
/// the other surface, by `|n . m|`. The result is the mean over these points and as many drawn on the other surface.
///
/// Which way the surfaces face does not matter, as in Mescheder et al., *Occupancy networks*, CVPR 2019. Faces
/// without an area are left out.
///
/// # Errors
/// As [`draw_points`] for either surface, and `TensorError::Value` where no points are asked for.
pub fn normal_consistency<T: Scalar>(
    one: (&Tensor<T>, &Mesh),
    other: (&Tensor<T>, &Mesh),
    count: usize,
    seed: u64,
) -> Result<f64, MeshError> {
    if count == 0 {
        let rule = "points from 1 up".into();
        return Err(TensorError::Value { operation: NORMALS, rule, value: 0.0 }.into());
    }
    let [one, other] = [Oriented::new(one)?, Oriented::new(other)?];
    Ok(0.5 * (one.agreement(&other, count, seed)? + other.agreement(&one, count, seed)?))
}

const NORMALS: &str = "normal_consistency";

/// A surface whose faces all have an area, with their unit normals.
struct Oriented<'a, T> {
    positions: &'a Tensor<T>,
    mesh: Mesh,
    normals: Vec<DVec3>,
}

impl<'a, T: Scalar> Oriented<'a, T> {
    fn new((positions, mesh): (&'a Tensor<T>, &Mesh)) -> Result<Self, MeshError> {
        let placed = Placed::new(NORMALS, positions, mesh)?;
        let oriented = mesh.faces().iter().filter_map(|&face| {
            let normal = area_vector(placed.corners(face));
            let length = normal.length();
            (length > 0.0).then(|| (face, normal / length))
        });
        let (faces, normals): (Vec<_>, Vec<_>) = oriented.unzip();
        if faces.is_empty() {
            return Err(MeshError::NoArea { operation: NORMALS, faces: mesh.faces().len() });
        }
        Ok(Self { positions, mesh: Mesh::new(faces, mesh.vertex_count())?, normals })
    }

    /// The mean of `|n . m|` over points drawn on this surface.
    fn agreement(&self, other: &Self, count: usize, seed: u64) -> Result<f64, MeshError> {
        let drawn: SurfacePoints<T> = draw_points(self.positions, &self.mesh, count, seed)?;
        let points = drawn.interpolated(self.positions)?;
        let (nearest, _) = nearest_on_surface(&points, other.positions, &other.mesh)?;
        let pairs = drawn.faces().iter().zip(nearest.faces().iter());
        let cosine =
            |(&a, &b): (&u32, &u32)| self.normals[a as usize].dot(other.normals[b as usize]).abs();
        Ok(pairs.map(cosine).sum::<f64>() / count as f64)
    }
}
