//! Cameras, fixed or learnt: from the world to clip space.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::camera::{from_tensor, to_tensor};
use bokashi_render_ops::{
    Camera as Projection, affine_inverse, pinhole, project, transform_points,
};
use glam::DVec3;

use crate::cameras::{Camera, Distortion};
use crate::learnables::{
    CAMERAS, DISTORTION, Frame, INTRINSICS, Recorded, Values, scaled_intrinsics,
};

/// A view's camera at one size of its image.
pub(super) struct ViewCamera<'a> {
    pub(super) frame: &'a Frame,
    /// The view's index.
    pub(super) view: usize,
    /// Without the frame's origin, at the size that is drawn.
    pub(super) camera: Camera,
}

/// A camera's matrices in a step.
pub(super) struct StepCamera<'t> {
    tape: &'t Tape<f32>,
    /// From the world to the camera.
    view: Projection<'t, f32>,
    /// From the camera to clip space.
    lens: Projection<'t, f32>,
    /// The kind of lens, and its coefficients; `None` without.
    distortion: Option<(Distortion, Var<'t, f32>)>,
}

impl<'t> StepCamera<'t> {
    /// The eye in the world, `[3]`.
    pub(super) fn eye(&self) -> Result<Var<'t, f32>, FitError> {
        Ok(match self.view {
            Projection::Fixed(view) => {
                let eye = view.inverse().transform_point3(DVec3::ZERO).as_vec3();
                self.tape.constant(&Tensor::from(eye.to_array()))
            }
            Projection::Variable(view) => {
                affine_inverse(view)?.slice(1, 3..4)?.slice(0, 0..3)?.reshape([3])?
            }
        })
    }

    /// Vertices `world: [V, 3]` in clip space, `[V, 4]`.
    pub(super) fn clip(&self, world: Var<'t, f32>) -> Result<Var<'t, f32>, FitError> {
        let on_tape = |matrix: Projection<'t, f32>| match matrix {
            Projection::Fixed(matrix) => self.tape.constant(&to_tensor(&matrix)),
            Projection::Variable(matrix) => matrix,
        };
        let (view, lens) = (self.view, self.lens);
        Ok(match (self.distortion, view, lens) {
            (Some((kind, coefficients)), ..) => {
                let points = transform_points(world, on_tape(view))?;
                project(kind.bend(points, coefficients)?, lens, None)?
            }
            (None, Projection::Fixed(view), Projection::Fixed(lens)) => {
                project(world, &(lens * view), None)?
            }
            (None, ..) => project(world, on_tape(lens).matmul(on_tape(view))?, None)?,
        })
    }
}

impl ViewCamera<'_> {
    /// The matrices in a step.
    pub(super) fn in_step<'t>(&self, values: &Values<'t, '_>) -> Result<StepCamera<'t>, FitError> {
        let kind = self.camera.distortion;
        let distortion = match values.learnt(&DISTORTION, "") {
            None if kind.is_none() => None,
            Some(learnt) => Some((kind, learnt)),
            None => {
                let fixed = kind.coefficients();
                let fixed = Tensor::from_flat_fn([fixed.len()], |k| fixed[k] as f32);
                Some((kind, values.tape.constant(&fixed)))
            }
        };
        let (view, lens) = (self.view_matrix(values)?, self.lens_matrix(values)?);
        Ok(StepCamera { tape: values.tape, view, lens, distortion })
    }

    /// The focal length in pixels, the mean of those along x and y.
    pub(super) fn focal_length<'t>(&self, values: &Values<'t, '_>) -> Recorded<'t> {
        let Camera { size, intrinsics: fixed, .. } = self.camera;
        let intrinsics = match values.learnt(&INTRINSICS, "") {
            None => values.tape.constant(&Tensor::from(fixed.map(|number| number as f32))),
            Some(learnt) => scaled_intrinsics(fixed, size.width, learnt)?,
        };
        Ok(intrinsics.slice(0, 0..2)?.mean()?)
    }

    /// The view matrix: fixed, or a variable where cameras are learnt.
    fn view_matrix<'t>(&self, values: &Values<'t, '_>) -> Result<Projection<'t, f32>, FitError> {
        let fixed = &self.camera.view;
        let Some(increments) = values.learnt(&CAMERAS, "") else {
            return Ok(Projection::Fixed(*fixed));
        };
        let increment = increments.slice(0, self.view..self.view + 1)?.reshape([6])?;
        let pivot = self.frame.scene_pivot().seen_from(fixed);
        Ok(Projection::Variable(pivot.moved(increment, fixed)?))
    }

    /// The matrix from the camera's coordinates to clip space: fixed, or a variable where intrinsics are learnt.
    fn lens_matrix<'t>(&self, values: &Values<'t, '_>) -> Result<Projection<'t, f32>, FitError> {
        let [near, far] = [self.frame.near, self.frame.far];
        let Camera { size, intrinsics: fixed, .. } = self.camera;
        let Some(learnt) = values.learnt(&INTRINSICS, "") else {
            let tape = Tape::new();
            let matrix = pinhole(tape.constant(&Tensor::from(fixed)), size, near, far)?.value();
            return Ok(Projection::Fixed(from_tensor(&matrix)?));
        };
        let intrinsics = scaled_intrinsics(fixed, size.width, learnt)?;
        Ok(Projection::Variable(pinhole(intrinsics, size, near, far)?))
    }
}
