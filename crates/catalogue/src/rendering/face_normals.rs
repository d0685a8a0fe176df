//! Normals of closed meshes and loose faces.

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{Mesh, face_normals};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};
use crate::surfaces::{Surface, surfaces, vanishing};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("face_normals");
    let of = |surface: &Surface, positions: Input| {
        Case::new(FaceNormals { mesh: surface.mesh.clone() }, [positions])
    };
    for (kind, surfaces) in surfaces() {
        let cases = surfaces.prop_map(move |surface| of(&surface, surface.leaf()));
        let (small, large) = (Surface::sheet(1), Surface::sheet(48));
        entry.check(
            Check::from_cases(format!("face_normals of {kind}"), cases)
                .large(1, Just(of(&large, large.leaf())))
                .refuses(
                    "face_normals needs positions of shape [4, 3], got shape [5, 3]",
                    of(&small, leaf([5, 3], 1.0)),
                )
                .refuses(
                    "face_normals needs positions of shape [4, 3], got shape [12]",
                    of(&small, leaf([12], 1.0)),
                )
                .refuses(
                    "face_normals needs finite numbers in row 1 of the positions, got NaN",
                    of(&small, with_one([4, 3], 4, f64::NAN)),
                ),
        );
    }
    benchmark!(entry, "face_normals", |s| [s.positions], |x| face_normals(x[0], &s.mesh)?);
    entry
}

#[derive(Debug)]
struct FaceNormals {
    mesh: Mesh,
}

impl Subject for FaceNormals {
    /// Positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let normals = face_normals(inputs[0], &self.mesh)?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}
