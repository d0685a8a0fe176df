//! The paper's pipeline, from vertices to an image, as operations composed.

use bokashi_core::{Scalar, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Blur, Mesh, Picture, RasterOptions, Sampling, Size, antialias, composite,
    interpolate, mark_creases, project, rasterize,
};
use glam::DMat4;

use super::cube::{FACES, VERTEX_COUNT};
use super::settings::Silhouettes;

/// A cube in front of black, up to its vertices, colours, pose and sigma.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    mesh: Mesh,
    size: Size,
    silhouettes: Silhouettes,
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
        Ok(Self { mesh, size: Size::square(size), silhouettes, blur })
    }

    /// Records the picture of `vertices` and `colors`, `[8, 3]` each, before any blur.
    pub(crate) fn picture<'t, T: Scalar>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, T>,
        colors: Var<'t, T>,
    ) -> Result<Picture<'t, T>, FitError> {
        let clip = project(vertices, camera, None)?;
        let sampling = match self.silhouettes {
            Silhouettes::Aliased | Silhouettes::Antialias => Sampling::Center,
            Silhouettes::Exact => Sampling::Exact,
        };
        let options = RasterOptions::new(self.size).sampling(sampling);
        let mesh = match sampling {
            Sampling::Exact => mark_creases(&self.mesh, clip, colors, options)?,
            _ => self.mesh.clone(),
        };
        let fragments = rasterize(clip, &mesh, options)?;
        let surface = interpolate(colors, &fragments)?;
        let picture = composite(surface, &fragments, Background::Zero)?;
        Ok(match self.silhouettes {
            Silhouettes::Antialias => antialias(picture)?,
            Silhouettes::Aliased | Silhouettes::Exact => picture.into(),
        })
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
        match (&self.blur, sigma) {
            (Some(blur), Some(sigma)) => Ok(picture.blurred(sigma, blur)?),
            _ => Ok(picture.image()?),
        }
    }

    /// Records the squared error of the image, blurred by `sigma`, against `reference: [H, W, 3]`.
    pub(crate) fn blurred_squared_error<'t, T: Scalar>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, T>,
        colors: Var<'t, T>,
        sigma: Var<'t, T>,
        reference: &Tensor<T>,
    ) -> Result<Var<'t, T>, FitError> {
        let picture = self.picture(camera, vertices, colors)?;
        let blur = self.blur.as_ref().expect("a scene with a sigma has a blur");
        Ok(picture.blurred_squared_error(sigma, blur, reference)?)
    }
}
