//! The paper's pipeline, from vertices to an image, as operations composed.

use bokashi_core::{Scalar, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Blur, Mesh, Picture, PixelLoss, RasterOptions, Silhouettes, Size, project, render,
};
use glam::DMat4;

use super::cube::{FACES, VERTEX_COUNT};

/// A cube in front of black, up to its vertices, colours, pose and sigma.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    mesh: Mesh,
    options: RasterOptions,
    blur: Option<Blur>,
}

impl Scene {
    /// A scene in images of `size` times `size` pixels.
    pub(crate) fn new(
        size: usize,
        silhouettes: Silhouettes,
        blur: Option<Blur>,
    ) -> Result<Self, FitError> {
        let mesh = Mesh::new(FACES.to_vec(), VERTEX_COUNT)?;
        let options = RasterOptions::new(Size::square(size)).silhouettes(silhouettes);
        Ok(Self { mesh, options, blur })
    }

    /// The picture of `vertices` and `colors`, `[8, 3]` each, before any blur.
    fn picture<'t, T: Scalar>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, T>,
        colors: Var<'t, T>,
    ) -> Result<Picture<'t, T>, FitError> {
        let clip = project(vertices, camera, None)?;
        Ok(render(clip, &self.mesh, colors, self.options, Background::Zero)?)
    }

    /// Records the image, `[H, W, 3]`, of `vertices` and `colors`, `[8, 3]` each, blurred by
    /// `sigma`, `[]`, where the scene has a blur and there is a sigma.
    pub(crate) fn image<'t, T: Scalar>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, T>,
        colors: Var<'t, T>,
        sigma: Option<Var<'t, T>>,
    ) -> Result<Var<'t, T>, FitError> {
        let picture = self.picture(camera, vertices, colors)?;
        Ok(match (&self.blur, sigma) {
            (Some(blur), Some(sigma)) => picture.blurred(sigma, blur).image()?,
            _ => picture.image()?,
        })
    }

    /// Records the loss of the image of [`Scene::image`].
    pub(crate) fn loss<'t, T: Scalar>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, T>,
        colors: Var<'t, T>,
        sigma: Option<Var<'t, T>>,
        loss: &PixelLoss<T>,
    ) -> Result<Var<'t, T>, FitError> {
        let picture = self.picture(camera, vertices, colors)?;
        Ok(match (&self.blur, sigma) {
            (Some(blur), Some(sigma)) => picture.blurred(sigma, blur).loss(loss)?,
            _ => picture.loss(loss)?,
        })
    }
}
