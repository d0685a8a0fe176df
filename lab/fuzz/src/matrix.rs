//! Arbitrary cameras and poses: project, then rasterize.

use std::cell::Cell;

use arbitrary::{Result, Unstructured};
use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::{
    Background, Mesh, Pose, antialias, composite, depth, interpolate, project, rasterize,
};
use glam::DMat4;

use super::mesh::{check_fragments, faces, size};
use super::number::{Range, in_either_precision};
use super::step::check;

/// Runs the camera, pose and mesh that `bytes` stand for; returns the number of fragments.
pub fn matrix(bytes: &[u8]) -> usize {
    in_either_precision(bytes, run::<f32>, run::<f64>)
}

fn run<T: Scalar>(bytes: &mut Unstructured<'_>) -> Result<usize> {
    let range = Range::choose::<T>(bytes)?;
    let mut entries = [0.0; 16];
    for entry in &mut entries {
        *entry = range.number(bytes)?;
    }
    let camera = DMat4::from_cols_array(&entries);
    let posed: bool = bytes.arbitrary()?;
    let size = size(bytes)?;
    let vertex_count = bytes.int_in_range(0..=8)?;
    let faces = faces(bytes, vertex_count)?;
    let Ok(mesh) = Mesh::new(faces, vertex_count) else { return Ok(0) };
    let inputs: [Tensor<T>; 4] = [
        range.tensor(bytes, &[vertex_count, 3])?,
        range.tensor(bytes, &[4])?,
        range.tensor(bytes, &[3])?,
        Tensor::from_flat_fn([vertex_count, 3], |k| T::from_f64((k % 5) as f64 / 4.0)),
    ];
    let upstream = |k: usize| T::from_f64(0.5 - (k % 3) as f64);
    let reached = Cell::new(0);
    check(&inputs, range.is_stated(), upstream, |_, inputs| {
        let &[positions, rotation, translation, colors] = inputs else {
            unreachable!("four inputs")
        };
        let pose = posed.then_some(Pose { rotation, translation });
        let clip = project(positions, &camera, pose)?;
        let fragments = rasterize(clip, &mesh, size)?;
        check_fragments(&fragments);
        reached.set(fragments.coverage.count());
        let surface = interpolate(colors, &fragments)?;
        // Darker with depth, so that depths have gradients too.
        let depth = depth(&fragments)?.reshape([fragments.coverage.count(), 1])?;
        antialias(composite(surface * depth, &fragments, Background::Zero)?)?.image()
    });
    Ok(reached.get())
}
