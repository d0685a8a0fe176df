//! Every operation on meshes, compiled for `f32` and for `f64`: see `bokashi_core::precompiled`.
//! Nobody calls these functions.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::Mesh;

use crate::distances::{PointDistance, chamfer_distance, draw_points};
use crate::error::MeshError;
use crate::field::field_surface;
use crate::grid::Grid;

macro_rules! for_each_precision {
    ($($name:ident: $t:ty),*) => {
        $(pub fn $name(tape: &Tape<$t>) -> Result<(), MeshError> {
            every_operation(tape.constant(&Tensor::zeros([])))
        })*
    };
}

for_each_precision!(f32_operations: f32);
#[cfg(feature = "precompiled-f64")]
for_each_precision!(f64_operations: f64);

fn every_operation<T: Scalar>(x: Var<'_, T>) -> Result<(), MeshError> {
    let grid = Grid::new([2; 3], [0.0; 3], 1.0)?;
    let surface = field_surface(x, Some(x), &grid)?;
    let mesh = Mesh::new(Vec::new(), 0)?;
    let points = draw_points(&surface.positions.value(), &mesh, 0, 0)?.interpolate(x)?;
    chamfer_distance(points, x, PointDistance::Squared)?;
    Ok(())
}
