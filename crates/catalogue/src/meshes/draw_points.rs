//! Points drawn on a surface, which move with it.

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_mesh::draw_points;
use bokashi_render_ops::Mesh;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};
use crate::surfaces::{Surface, surfaces};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("draw_points");
    let of = |surface: &Surface, positions: Input| {
        Case::new(DrawPoints { mesh: surface.mesh.clone() }, [positions])
    };
    let (small, large) = (Surface::sheet(1), Surface::sheet(48));
    for (kind, surfaces) in surfaces() {
        let with_area = surfaces.prop_filter("an area", |surface| {
            let Input { tensor, .. } = surface.leaf();
            draw_points(&tensor, &surface.mesh, 1, 0).is_ok()
        });
        let cases = with_area.prop_map(move |surface| of(&surface, surface.leaf()));
        entry.check(
            Check::from_cases(format!("draw_points on {kind}"), cases)
                .large(1, Just(of(&large, large.leaf())))
                .refuses(
                    "draw_points needs positions of shape [4, 3], got shape [5, 3]",
                    of(&small, leaf([5, 3], 1.0)),
                )
                .refuses(
                    "draw_points needs finite numbers in row 1 of the positions, got NaN",
                    of(&small, with_one([4, 3], 4, f64::NAN)),
                )
                .refuses(
                    "draw_points needs a face with an area, got none among 2",
                    of(&small, Input::leaf(Tensor::zeros([4, 3]))),
                ),
        );
    }
    benchmark!(entry, "draw_points", |s| [s.positions], |x| {
        draw_points(&x[0].value(), &s.mesh, s.pixels(), 7)?.interpolate(x[0])?
    });
    entry
}

#[derive(Debug)]
struct DrawPoints {
    mesh: Mesh,
}

impl Subject for DrawPoints {
    /// Positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let drawn = draw_points(&inputs[0].value(), &self.mesh, 9, 5)?;
        let points = drawn.interpolate(inputs[0])?;
        Ok(Outcome::from(points).with_state(drawn.faces().to_vec()))
    }
}
