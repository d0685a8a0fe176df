//! The whole pipeline, from positions to a blurred picture.

mod extremes;

use bokashi_check::strategy::{camera, closed_mesh, number, tensor, unit_quaternion};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Kernel, Mesh, Pose, Radius, Size, gaussian_blur, interpolate,
    project, rasterize,
};
use glam::DMat4;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::blends;
use crate::entry::Entry;
use crate::inputs::wide;
use crate::scenes::size;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("pipeline").with_extremes(extremes::EXTREMES);
    let pipeline = Check::from_cases("the whole pipeline", pipelines(size(11, 8)));
    entry.check(pipeline.large(2, pipelines(size(190, 150))));
    entry
}

#[derive(Debug)]
struct Pipeline {
    mesh: Mesh,
    camera: [[f64; 4]; 4],
    blur: Blur,
    size: Size,
}

impl Subject for Pipeline {
    /// Positions, rotation, translation, colours, background and sigma.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let &[positions, rotation, translation, colors, background, sigma] = inputs else {
            return Err("six inputs".into());
        };
        let camera = DMat4::from_cols_array_2d(&self.camera);
        let clip = project(positions, &camera, Some(Pose { rotation, translation }))?;
        let fragments = rasterize(clip, &self.mesh, self.size)?;
        let choices = blends::choices(&fragments, &wide(clip));
        let surface = interpolate(colors, &fragments)?;
        let picture = fragments.picture(surface, Background::Color(background))?;
        let image = gaussian_blur(picture.image()?, sigma, &self.blur)?;
        let ids = fragments.coverage.triangle_ids();
        Ok(Outcome::from(image.square()).with_state(ids).with_state(choices))
    }
}

/// Pipelines of any closed mesh, camera and blur, on an image of one size.
fn pipelines(size: Size) -> impl Strategy<Value = Case> {
    let blurs = select(vec![
        Blur { radius: Radius::Fixed(4), ..Blur::default() },
        Blur { kernel: Kernel::Unnormalized, border: Border::Zero, radius: Radius::Fixed(3) },
        Blur { border: Border::Clamp, radius: Radius::Fixed(12), ..Blur::default() },
    ]);
    let view = (closed_mesh(), camera(), unit_quaternion(), blurs);
    let looks = (vec(number(), 96), tensor([3], number()), tensor([3], number()), 0.4..2.0);
    (view, looks).prop_map(move |((mesh, camera, q, blur), (colors, shift, back, sigma))| {
        let vertices = mesh.positions.len();
        let inputs = [
            Tensor::from_flat_fn([vertices, 3], |k| mesh.positions[k / 3][k % 3]),
            Tensor::from_flat_fn([4], |k| q[k]),
            shift.map(|entry| 0.1 * entry),
            Tensor::from_flat_fn([vertices, 3], |k| colors[k]),
            back,
            Tensor::scalar(sigma),
        ];
        let mesh = Mesh::new(mesh.faces, vertices).unwrap();
        Case::new(Pipeline { mesh, camera, blur, size }, inputs.map(Input::leaf))
    })
}
