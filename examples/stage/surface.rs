//! What a camera sees, for fits of how it looks alone.

use bokashi::glam::DVec3;
use bokashi::prelude::*;

use super::mesh::Object;

/// The surface that a camera sees, as numbers that don't change.
#[derive(Debug, Clone)]
pub struct ConstantSurface {
    /// The fragments.
    pub fragments: ConstantFragments<f32>,
    /// Their normals, `[N, 3]`.
    pub normals: Tensor<f32>,
    /// The ways to the eye, `[N, 3]`.
    pub views: Tensor<f32>,
    /// Texture coordinates, `[N, 2]`.
    pub places: Tensor<f32>,
}

impl ConstantSurface {
    /// `object` from `eye`, seen towards 0.
    ///
    /// # Errors
    /// As [`rasterize`].
    pub fn new(object: &Object, eye: DVec3, options: RasterOptions) -> Result<Self, RenderError> {
        let tape = Tape::new();
        let Object { shape, normals, places } = object;
        let view = look_at(eye, DVec3::ZERO, eye.any_orthogonal_vector());
        let camera = perspective(0.7, 1.0, 0.1, 10.0) * view;
        let vertices = tape.constant(&shape.vertices);
        let clip = project(vertices, &camera, None)?;
        let shown = [normals, places].map(|rows| tape.constant(rows).into());
        let fragments = rasterize(clip, &shape.mesh, options.creases(&shown))?;
        let eye = tape.constant(&Tensor::from(eye.as_vec3().to_array()));
        Ok(Self {
            normals: interpolate(tape.constant(normals), &fragments)?.value(),
            views: (eye - interpolate(vertices, &fragments)?).value(),
            places: interpolate(tape.constant(places), &fragments)?.value(),
            fragments: fragments.constant(),
        })
    }
}
