//! The measures of a scene, and what learnt numbers make of its places and cameras.
//!
//! Each formula stands here once. A step takes it in `f32` on its tape; what was learnt is put back by the same
//! formula in `f64`, on a tape of constants.

use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};
use bokashi_render_ops::camera::{from_tensor, to_tensor};
use bokashi_render_ops::{RenderError, se3};
use glam::{DMat4, DVec3};

use crate::model::far_offset;
use crate::object::Object;
use crate::scene::Scene;

/// Measures of a scene as it was loaded.
///
/// Where the scene lies far from the origin, it is drawn nearer to it: `origin` is taken off all that has a place, so
/// that numbers of `f32` keep their bits.
#[derive(Clone)]
pub(crate) struct Frame {
    pub(crate) origin: DVec3,
    pub(crate) radius: f64,
    pub(crate) near: f64,
    pub(crate) far: f64,
    /// Without the origin, as are `middles`.
    center: DVec3,
    /// The middles of objects in the world.
    middles: Vec<DVec3>,
}

/// What a learnt motion turns about, and the unit of its translations.
#[derive(Clone, Copy)]
pub(crate) struct Pivot {
    middle: DVec3,
    radius: f64,
}

impl Frame {
    pub(crate) fn new(scene: &Scene) -> Self {
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

    /// What the object with this index turns about, without the origin.
    pub(crate) fn object_pivot(&self, index: usize) -> Pivot {
        Pivot { middle: self.middles[index], radius: self.radius }
    }

    /// What the whole scene turns about, without the origin.
    pub(crate) fn scene_pivot(&self) -> Pivot {
        Pivot { middle: self.center, radius: self.radius }
    }
}

impl Pivot {
    /// The pivot after a translation by `origin`.
    pub(crate) fn shifted(self, origin: DVec3) -> Self {
        Self { middle: origin + self.middle, ..self }
    }

    /// The pivot in the coordinates of a camera with this view matrix.
    pub(crate) fn seen_from(self, view: &DMat4) -> Self {
        Self { middle: view.transform_point3(self.middle), ..self }
    }

    /// `before`, and then a small motion about the pivot, `[4, 4]`. The increment `x: [6]` has a translation in radii
    /// of the scene and a rotation in radians. With the pivot `p` and the radius `r`:
    /// `T(p) exp(diag(r, r, r, 1, 1, 1) x) T(-p) before`.
    ///
    /// # Errors
    /// As [`se3`].
    pub(crate) fn moved<'t, T: Scalar>(
        self,
        increment: Var<'t, T>,
        before: &DMat4,
    ) -> Result<Var<'t, T>, RenderError> {
        let radius = T::from_f64(self.radius);
        let tape = increment.tape();
        let units = Tensor::from([radius, radius, radius, T::ONE, T::ONE, T::ONE]);
        let increment = increment.try_mul(tape.constant(&units))?;
        let moved = se3(increment, &(DMat4::from_translation(-self.middle) * *before))?;
        let back = tape.constant(&to_tensor(&DMat4::from_translation(self.middle)));
        Ok(back.matmul(moved)?)
    }

    /// The matrix of the motion of an increment of six numbers: [`Pivot::moved`] on constants.
    ///
    /// # Errors
    /// As [`Pivot::moved`].
    pub(crate) fn motion(self, increment: &[f32]) -> Result<DMat4, RenderError> {
        let tape = Tape::<f64>::new();
        let increment = Tensor::from_flat_fn([6], |k| increment[k].into());
        from_tensor(&self.moved(tape.constant(&increment), &DMat4::IDENTITY)?.value())
    }
}

/// The intrinsics `[4]` of images of this width that `learnt: [4]` makes of (fx, fy, cx, cy): focal lengths times the
/// exponentials of its first two numbers, and a principal point that the others shift by shares of the width.
///
/// # Errors
/// `TensorError` for `learnt` of another shape.
pub(crate) fn scaled_intrinsics<'t, T: Scalar>(
    intrinsics: [f64; 4],
    width: usize,
    learnt: Var<'t, T>,
) -> Result<Var<'t, T>, TensorError> {
    let tape = learnt.tape();
    let [fx, fy, cx, cy] = intrinsics.map(T::from_f64);
    let focal = learnt.slice(0, 0..2)?.exp().try_mul(tape.constant(&Tensor::from([fx, fy])))?;
    let shift = learnt.slice(0, 2..4)? * T::from_f64(width as f64);
    let center = shift.try_add(tape.constant(&Tensor::from([cx, cy])))?;
    Var::concat(&[focal, center], 0)
}
