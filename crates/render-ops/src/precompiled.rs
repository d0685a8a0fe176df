//! Every rendering operation, compiled for `f32` and for `f64`: see `bokashi_core::precompiled`.
//! Nobody calls these functions.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use glam::DMat4;

use crate::antialias::antialias;
use crate::background::Background;
use crate::border::Border;
use crate::composite::composite;
use crate::depth::depth;
use crate::depth_of_field::{Lens, depth_of_field};
use crate::downsample::downsample;
use crate::error::RenderError;
use crate::face_normals::face_normals;
use crate::filter::Filter;
use crate::gaussian_blur::gaussian_blur;
use crate::interpolate::interpolate;
use crate::mesh::Mesh;
use crate::perturbed_normals::perturbed_normals;
use crate::pixel_loss::PixelLoss;
use crate::project::{Pose, project};
use crate::rasterize::rasterize;
use crate::reference::Reference;
use crate::size::Size;
use crate::tangents::tangents;
use crate::taps::Blur;
use crate::transform_normals::transform_normals;
use crate::vertex_normals::{Weighting, vertex_normals};

macro_rules! for_each_precision {
    ($($name:ident: $t:ty),*) => {
        $(pub fn $name(tape: &Tape<$t>) -> Result<(), RenderError> {
            every_operation(tape.constant(&Tensor::zeros([])))
        })*
    };
}

for_each_precision!(f32_operations: f32, f64_operations: f64);

fn every_operation<T: Scalar>(x: Var<'_, T>) -> Result<(), RenderError> {
    let mesh = Mesh::new(Vec::new(), 0)?;
    face_normals(x, &mesh)?;
    let normals = vertex_normals(x, &mesh, Weighting::Area)?;
    let tangents = tangents(x, transform_normals(normals, x)?, x, &mesh, &mesh)?;
    perturbed_normals(normals, tangents, x)?;
    let clip = project(x, &DMat4::IDENTITY, Some(Pose { rotation: x, translation: x }))?;
    let fragments = rasterize(clip, &mesh, Size::square(1))?;
    let values = interpolate(x, &fragments)? + depth(&fragments)?;
    let picture = antialias(composite(values, &fragments, Background::Color(x))?)?;
    picture.squared_error(&Reference::new(&x.value(), &x.value())?)?;
    picture.loss(&PixelLoss::new(&x.value(), &x.value(), |x, _| Ok(x))?)?;
    let image = gaussian_blur(picture.image()?, x, &Blur::default())?;
    let image = downsample(image, 1, &Filter::Mitchell, Border::Mirror)?;
    depth_of_field(image, x, x, x, &Lens::default())?;
    Ok(())
}
