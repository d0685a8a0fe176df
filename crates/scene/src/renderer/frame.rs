//! The measures of a scene: where its middle is, how large it is, and what moves about where.

use bokashi_core::{Tensor, Var};
use bokashi_render_ops::camera::to_tensor;
use bokashi_render_ops::se3;
use glam::{DMat4, DVec3};

use crate::model::far_offset;
use crate::object::Object;
use crate::scene::Scene;
use crate::values::Recorded;

/// Measures of a scene as it was loaded.
///
/// Where the scene lies far from the origin, it is drawn nearer to it: `origin` is taken off all that has a place, so
/// that numbers of `f32` keep their bits.
pub(super) struct Frame {
    pub(super) origin: DVec3,
    /// Without the origin, as are `middles`.
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) near: f64,
    pub(super) far: f64,
    /// The middles of objects in the world.
    pub(super) middles: Vec<DVec3>,
}

impl Frame {
    pub(super) fn of(scene: &Scene) -> Self {
        let (center, radius) = scene.ball();
        let origin = far_offset([center - radius, center + radius]);
        let pipeline = &scene.description.pipeline;
        let middle = |object: &Object| object.extent().map_or(center, |[a, b]| 0.5 * (a + b));
        let middles = scene.objects.iter().map(|object| middle(object) - origin);
        Self {
            origin,
            center: center - origin,
            radius,
            near: pipeline.near.map_or(2e-3 * radius, |near| near.0),
            far: pipeline.far.map_or(f64::INFINITY, |far| far.0),
            middles: middles.collect(),
        }
    }

    /// `before`, and then a small motion about a place: `pose` has a translation in radii of the scene and a
    /// rotation.
    pub(super) fn moved<'t>(
        &self,
        pose: Var<'t, f32>,
        about: DVec3,
        before: &DMat4,
    ) -> Recorded<'t> {
        let radius = self.radius as f32;
        let tape = pose.tape();
        let units = Tensor::from([radius, radius, radius, 1.0, 1.0, 1.0]);
        let increment = pose.try_mul(tape.constant(&units))?;
        let moved = se3(increment, &(DMat4::from_translation(-about) * *before))?;
        let back = tape.constant(&to_tensor(&DMat4::from_translation(about)));
        Ok(back.matmul(moved)?)
    }
}
