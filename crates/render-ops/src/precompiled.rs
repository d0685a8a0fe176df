//! Every rendering operation, compiled for `f32` and for `f64`: see `bokashi_core::precompiled`.
//! Nobody calls these functions.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use glam::DMat4;

use crate::antialias::antialias;
use crate::background::Background;
use crate::depth::depth;
use crate::depth_of_field::{Lens, depth_of_field};
use crate::error::RenderError;
use crate::gaussian_blur::gaussian_blur;
use crate::interpolate::interpolate;
use crate::layer::layer;
use crate::mesh::Mesh;
use crate::project::{Pose, project};
use crate::rasterize::rasterize;
use crate::resolve::resolve;
use crate::size::Size;
use crate::taps::Blur;
use crate::target::Target;

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
    let clip = project(x, &DMat4::IDENTITY, Some(Pose { rotation: x, translation: x }))?;
    let fragments = rasterize(clip, &mesh, Size::square(1))?;
    let values = interpolate(x, &fragments)? + depth(&fragments)?;
    let layer = layer(values, &fragments, Background::Color(x))?.antialias(clip)?;
    layer.squared_error(&Target::new(&x.value(), &x.value())?)?;
    let image = antialias(resolve(values, &fragments, Background::Color(x))?, &fragments, clip)?;
    let image = gaussian_blur(image, x, &Blur::default())?;
    depth_of_field(image, x, x, x, &Lens::default())?;
    Ok(())
}
