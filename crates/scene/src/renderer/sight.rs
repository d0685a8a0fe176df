//! Cameras, fixed or learnt: from the world to clip space.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::camera::{from_tensor, to_tensor};
use bokashi_render_ops::{
    Camera as Projection, Size, affine_inverse, pinhole, project, transform_points,
};
use glam::DVec3;

use super::frame::Frame;
use crate::cameras::{Camera, Distortion};
use crate::values::Values;

/// A view's camera at one size of its image.
pub(super) struct Sight<'a> {
    pub(super) frame: &'a Frame,
    /// The view's number.
    pub(super) view: usize,
    /// At the size that is drawn.
    pub(super) camera: Camera,
}

/// A camera's matrices in a step.
pub(super) struct Seen<'t> {
    tape: &'t Tape<f32>,
    /// From the world to the camera.
    view: Projection<'t, f32>,
    /// From the camera to clip space.
    lens: Projection<'t, f32>,
    /// The kind of lens, and its coefficients; `None` without.
    distortion: Option<(Distortion, Var<'t, f32>)>,
}

impl<'t> Seen<'t> {
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
                let seen = transform_points(world, on_tape(view))?;
                project(kind.bend(seen, coefficients)?, lens, None)?
            }
            (None, Projection::Fixed(view), Projection::Fixed(lens)) => {
                project(world, &(lens * view), None)?
            }
            (None, ..) => project(world, on_tape(lens).matmul(on_tape(view))?, None)?,
        })
    }
}

impl Sight<'_> {
    /// The matrices in a step.
    pub(super) fn seen<'t>(&self, values: &Values<'t, '_>) -> Result<Seen<'t>, FitError> {
        let tape = values.tape;
        let kind = self.camera.distortion;
        let distortion = match values.learnt("distortion") {
            None if kind.is_none() => None,
            Some(learnt) => Some((kind, learnt)),
            None => {
                let own = kind.coefficients();
                let own = Tensor::from_flat_fn([own.len()], |k| own[k] as f32);
                Some((kind, tape.constant(&own)))
            }
        };
        let (view, lens) = (self.view_matrix(values)?, self.lens_matrix(values, self.camera.size)?);
        Ok(Seen { tape, view, lens, distortion })
    }

    /// The view matrix: fixed, or a variable where cameras are learnt.
    fn view_matrix<'t>(&self, values: &Values<'t, '_>) -> Result<Projection<'t, f32>, FitError> {
        let own = &self.camera.view;
        let Some(increments) = values.learnt("cameras") else {
            return Ok(Projection::Fixed(*own));
        };
        let increment = increments.slice(0, self.view..self.view + 1)?.reshape([6])?;
        // About the middle of the scene, along the camera's axes: what moves the picture and what changes its
        // size are then different numbers.
        let about = own.transform_point3(self.frame.center);
        Ok(Projection::Variable(self.frame.moved(increment, about, own)?))
    }

    /// The matrix from the camera's coordinates to clip space.
    fn lens_matrix<'t>(
        &self,
        values: &Values<'t, '_>,
        size: Size,
    ) -> Result<Projection<'t, f32>, FitError> {
        let [near, far] = [self.frame.near, self.frame.far];
        let own = self.camera.intrinsics;
        let Some(learnt) = values.learnt("intrinsics") else {
            let tape = Tape::new();
            let matrix = pinhole(tape.constant(&Tensor::from(own)), size, near, far)?.value();
            return Ok(Projection::Fixed(from_tensor(&matrix)?));
        };
        // Focal lengths by factors, the principal point by shares of the image's width.
        let tape = values.tape;
        let [fx, fy, cx, cy] = own.map(|x| x as f32);
        let focal = learnt.slice(0, 0..2)?.exp().try_mul(tape.constant(&Tensor::from([fx, fy])))?;
        let shift = learnt.slice(0, 2..4)? * size.width as f32;
        let center = shift.try_add(tape.constant(&Tensor::from([cx, cy])))?;
        let intrinsics = Var::concat(&[focal, center], 0)?;
        Ok(Projection::Variable(pinhole(intrinsics, size, near, far)?))
    }
}
