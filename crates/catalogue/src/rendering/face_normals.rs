//! Normals of closed meshes and loose faces.

use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{Mesh, face_normals};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::leaf;
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
            Check::of_cases(format!("face_normals of {kind}"), cases)
                .large(1, Just(of(&large, large.leaf())))
                .refuses("another number of vertices", of(&small, leaf([5, 3], 1.0)))
                .refuses("points of four coordinates", of(&small, leaf([4, 4], 1.0)))
                .refuses("an infinite position", of(&small, leaf([4, 3], f64::INFINITY))),
        );
    }
    entry
}

#[derive(Debug)]
struct FaceNormals {
    mesh: Mesh,
}

impl Subject for FaceNormals {
    /// Positions.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let normals = face_normals(inputs[0], &self.mesh)?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}
