//! A mesh that is the surface of a field, whose numbers are learnt: its topology changes where they change signs.
//!
//! # Formula
//! `u` are the numbers that are learnt, one for each point of a grid, in cells: at its start the distance from the mesh,
//! below 0 inside, cut off at 3. The field is `f = S^n u`, where `S` takes means over neighbours with the weights
//! 1, 2 and 1 along each axis: so a step of one number is a smooth bump. At the border of the grid `f` is at least 1,
//! so that the surface is closed. The vertex between the points a and b has the colour
//! `c_b + (c_a - c_b) f_b / (f_b - f_a)`, as far from theirs as it stands from them.

mod distances;

use std::sync::Arc;

use bokashi_core::{Tensor, Var};
use bokashi_fit::FitError;
use bokashi_mesh::{Grid, MeshError, field_surface};
use bokashi_render_ops::Mesh;

use self::distances::{colors_near, signed_distances};

/// The farthest from the surface that a field knows, in cells. Farther away signs change as fast as here.
const FARTHEST: usize = 3;
/// How much larger than the mesh its grid is, on each side, as a share of the longest one.
const MARGIN: f64 = 0.1;
/// Where the field need not be larger; it is far below any number that is learnt.
const NOWHERE: f32 = -1e30;

/// The field of a mesh.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub(crate) grid: Grid,
    /// `u`, in cells, `[nx, ny, nz]`.
    pub(crate) values: Tensor<f32>,
    /// Colours at the points, `[P, 3]`.
    pub(crate) colors: Option<Tensor<f32>>,
    /// `n`.
    smoothing: usize,
    /// What the field is at least, `[nx, ny, nz]`.
    least: Tensor<f32>,
}

/// The surface of a field in a step.
pub(crate) struct FieldSurface<'t> {
    pub(crate) mesh: Mesh,
    /// `[V, 3]`.
    pub(crate) positions: Var<'t, f32>,
    /// At its vertices, `[V, 3]`.
    pub(crate) colors: Option<Var<'t, f32>>,
    /// The field, `[P]`.
    pub(crate) field: Var<'t, f32>,
}

impl Field {
    /// The field of a closed mesh, over a grid with so many cells along the longest side; `colors` are at its vertices,
    /// `[V, 3]`.
    ///
    /// # Errors
    /// [`MeshError`] for positions that are no numbers, or lie in one point.
    pub(crate) fn from_surface(
        positions: &Tensor<f32>,
        mesh: &Mesh,
        colors: Option<&Tensor<f32>>,
        cells: usize,
        smoothing: usize,
    ) -> Result<Self, MeshError> {
        let corner = |least: bool| {
            [0, 1, 2].map(|axis| {
                let all = positions.data().iter().skip(axis).step_by(3).map(|&x| f64::from(x));
                if least {
                    all.fold(f64::INFINITY, f64::min)
                } else {
                    all.fold(f64::NEG_INFINITY, f64::max)
                }
            })
        };
        let (low, high) = (corner(true), corner(false));
        let margin = MARGIN * (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let grid = Grid::around(low.map(|x| x - margin), high.map(|x| x + margin), cells)?;
        let values = signed_distances(&grid, positions, mesh, FARTHEST)?;
        let colors = colors.map(|colors| colors_near(&grid, &values, positions, mesh, colors));
        let [nx, ny, nz] = grid.shape();
        let is_border = |[i, j, k]: [usize; 3]| {
            [i, j, k].contains(&0) || i + 1 == nx || j + 1 == ny || k + 1 == nz
        };
        let least =
            Tensor::from_fn(grid.shape(), |place| if is_border(place) { 1.0 } else { NOWHERE });
        Ok(Self { grid, values, colors: colors.transpose()?, smoothing, least })
    }

    /// The surface of the field with these `values`, `[nx, ny, nz]`, and its colours, where there are `colors` at the
    /// points, `[P, 3]`. `name` is the mesh's.
    ///
    /// # Errors
    /// [`FitError::Setting`] for a field that is nowhere inside.
    pub(crate) fn surface<'t>(
        &self,
        values: Var<'t, f32>,
        colors: Option<Var<'t, f32>>,
        name: &str,
    ) -> Result<FieldSurface<'t>, FitError> {
        let tape = values.tape();
        let mut field = values;
        for _ in 0..self.smoothing {
            for axis in 0..3 {
                field = mean_along(field, axis)?;
            }
        }
        let field = field.maximum(tape.constant(&self.least))?;
        let surface = field_surface(field, None, &self.grid).map_err(FitError::operation)?;
        if surface.mesh.faces().is_empty() {
            let rule = "a field that is learnt";
            return Err(FitError::setting(rule, "a point inside", format!("none of {name:?}")));
        }
        let count = self.grid.point_count();
        let field = field.reshape([count, 1])?;
        let ends = |k: usize| -> Arc<[u32]> { surface.edges.iter().map(|edge| edge[k]).collect() };
        let colors = colors.map(|colors| {
            let (a, b) = (ends(0), ends(1));
            let [of_a, of_b] = [field.gather_rows(&a)?, field.gather_rows(&b)?];
            let [color_a, color_b] = [colors.gather_rows(&a)?, colors.gather_rows(&b)?];
            let share = of_b.try_div(of_b.try_sub(of_a)?)?;
            color_b.try_add(color_a.try_sub(color_b)?.try_mul(share)?)
        });
        let (mesh, positions) = (surface.mesh, surface.positions);
        let (colors, field) = (colors.transpose()?, field.reshape([count])?);
        Ok(FieldSurface { mesh, positions, colors, field })
    }
}

/// Means along an axis with the weights 1, 2 and 1; beyond the border stands what is at it.
fn mean_along(x: Var<'_, f32>, axis: usize) -> Result<Var<'_, f32>, bokashi_core::TensorError> {
    let extent = x.shape()[axis];
    let part = |range| x.slice(axis, range);
    let before = Var::concat(&[part(0..1)?, part(0..extent - 1)?], axis)?;
    let after = Var::concat(&[part(1..extent)?, part(extent - 1..extent)?], axis)?;
    (x * 0.5).try_add(before.try_add(after)? * 0.25)
}
