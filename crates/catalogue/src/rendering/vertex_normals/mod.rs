//! Normals at vertices, by area and by angle.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{Mesh, Weighting, vertex_normals};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};
use crate::surfaces::{Surface, surfaces, vanishing};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("vertex_normals").with_extremes(extremes::EXTREMES);
    for weighting in [Weighting::Area, Weighting::Angle] {
        let of = move |surface: &Surface, positions: Input| {
            Case::new(VertexNormals { mesh: surface.mesh.clone(), weighting }, [positions])
        };
        for (kind, surfaces) in surfaces() {
            let cases = surfaces.prop_map(move |surface| of(&surface, surface.leaf()));
            let (small, large) = (Surface::sheet(1), Surface::sheet(48));
            entry.check(
                Check::from_cases(format!("vertex_normals of {kind}, {weighting:?}"), cases)
                    .large(1, Just(of(&large, large.leaf())))
                    .refuses(
                        "vertex_normals needs positions of shape [4, 3], got shape [3, 3]",
                        of(&small, leaf([3, 3], 1.0)),
                    )
                    .refuses(
                        "vertex_normals needs finite numbers in row 0 of the positions, got inf",
                        of(&small, leaf([4, 3], f64::INFINITY)),
                    )
                    .refuses(
                        "vertex_normals needs finite numbers in row 2 of the positions, got NaN",
                        of(&small, with_one([4, 3], 7, f64::NAN)),
                    ),
            );
        }
    }
    benchmark!(entry, "vertex_normals, by area", |s| [s.positions], |x| {
        vertex_normals(x[0], &s.mesh, Weighting::Area)?
    });
    benchmark!(entry, "vertex_normals, by angle", |s| [s.positions], |x| {
        vertex_normals(x[0], &s.mesh, Weighting::Angle)?
    });
    entry
}

#[derive(Debug)]
struct VertexNormals {
    mesh: Mesh,
    weighting: Weighting,
}

impl Subject for VertexNormals {
    /// Positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let normals = vertex_normals(inputs[0], &self.mesh, self.weighting)?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}
