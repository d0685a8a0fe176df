//! A geometry's points and normals in the world, for formats that have no matrices.

use glam::{DMat3, DMat4, DVec3};

use super::check::location;
use crate::error::SceneError;
use crate::model::Geometry;

/// The positions of a geometry where `place` leads them.
///
/// # Errors
/// [`SceneError::Content`] for one that is not finite there.
pub(super) fn points(geometry: &Geometry, place: &DMat4) -> Result<Vec<DVec3>, SceneError> {
    let all = geometry.positions.iter().enumerate().map(|(k, &position)| {
        let point = place.transform_point3(DVec3::from(position.map(f64::from)));
        match point.is_finite() {
            true => Ok(point),
            false => {
                let rule = "has finite positions in the world";
                let found = format!("number {k} is {:?}", point.to_array());
                let message = format!("the mesh {:?} {rule}, and {found}", geometry.name);
                Err(SceneError::content(location(), message))
            }
        }
    });
    all.collect()
}

/// How a place turns normals: as the inverse transpose, which keeps them normal to the surface.
#[derive(Debug)]
pub(super) struct NormalTurn(DMat3);

impl NormalTurn {
    pub(super) fn new(place: &DMat4) -> Self {
        Self(DMat3::from_mat4(*place).inverse().transpose())
    }

    /// Whether normals stay as they are.
    pub(super) fn is_none(&self) -> bool {
        self.0 == DMat3::IDENTITY
    }

    /// A unit normal in the world: the bits of `normal` where nothing turns it, and 0 where the place is flat.
    pub(super) fn turned(&self, normal: [f32; 3]) -> [f64; 3] {
        let normal = normal.map(f64::from);
        match self.is_none() {
            true => normal,
            false => (self.0 * DVec3::from(normal)).normalize_or_zero().to_array(),
        }
    }
}

/// The order of the corners of a face: a mirror turns faces around.
pub(super) fn corner_order(place: &DMat4) -> [usize; 3] {
    if place.determinant() < 0.0 { [0, 2, 1] } else { [0, 1, 2] }
}
