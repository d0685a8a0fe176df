//! The vertices of a primitive in a pose.
//!
//! Morph targets come first: `p + sum_k w_k d_k` of positions, normals and tangents. What a skin does to that
//! is in [`skins`](super::skins). Targets of weight 0, and colours or coordinates of targets, are noted.

use std::rc::Rc;

use ::gltf::json::Index;
use ::gltf::json::accessor::Accessor;
use ::gltf::json::mesh::{MorphTarget, Primitive};

use super::file::GltfFile;
use super::poses::Pose;
use super::skins::{Skin, has_joints};
use crate::error::SceneError;

/// The rows of an accessor, which primitives share.
pub(super) type Rows<const N: usize> = Rc<Vec<[f32; N]>>;

/// What a pose moves.
#[derive(Debug)]
pub(super) struct Vertices {
    pub(super) positions: Rows<3>,
    pub(super) normals: Option<Rows<3>>,
    pub(super) tangents: Option<Rows<4>>,
    /// Whether most of them are mirrored: faces then run the other way.
    pub(super) is_mirrored: bool,
}

/// A primitive of a file in a pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Posed<'r> {
    pub(super) primitive: &'r Primitive,
    pub(super) pose: &'r Pose,
    pub(super) skins: &'r [Skin],
}

impl<'r> Posed<'r> {
    fn targets(self) -> &'r [MorphTarget] {
        self.primitive.targets.as_deref().unwrap_or_default()
    }

    /// The targets that count, with their weights.
    fn weighted(self) -> impl Iterator<Item = (f64, &'r MorphTarget)> {
        let weights = self.pose.weights.iter().map(|&weight| f64::from(weight));
        weights.zip(self.targets()).filter(|(weight, _)| *weight != 0.0)
    }

    /// Whether the pose moves vertices.
    pub(super) fn moves(self) -> bool {
        self.pose.skin.is_some() || self.weighted().next().is_some()
    }

    /// Where the pose has the vertices.
    pub(super) fn vertices(
        self,
        vertices: Vertices,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Vertices, SceneError> {
        self.note(file);
        if !self.moves() {
            return Ok(vertices);
        }
        let count = vertices.positions.len();
        let attributes = 1
            + usize::from(vertices.normals.is_some())
            + 2 * usize::from(vertices.tangents.is_some());
        // In f64, and rounded again.
        file.spend(count as u64, attributes * size_of::<[f64; 6]>())?;
        let mut positions = wide(&vertices.positions);
        let mut normals = vertices.normals.as_ref().map(|rows| wide(rows));
        let mut tangents = vertices.tangents.as_ref().map(|rows| wide(rows));
        for (weight, target) in self.weighted() {
            add(weight, target.positions, Some(&mut positions), file)?;
            add(weight, target.normals, normals.as_mut(), file)?;
            add(weight, target.tangents, tangents.as_mut(), file)?;
        }
        let mut is_mirrored = false;
        if let Some(skin) = self.pose.skin {
            let bend = self.skins[skin].bend(self.primitive, count, file)?;
            bend.points(&mut positions);
            normals.iter_mut().for_each(|rows| bend.normals(rows));
            tangents.iter_mut().for_each(|rows| bend.tangents(rows));
            is_mirrored = bend.is_mirrored();
        }
        let normals = normals.map(|mut rows| {
            rows.iter_mut().for_each(|row| normalize(row));
            narrow(&rows)
        });
        let tangents = tangents.map(|mut rows| {
            rows.iter_mut().for_each(|row| normalize(&mut row[..3]));
            narrow(&rows)
        });
        Ok(Vertices { positions: narrow(&positions), normals, tangents, is_mirrored })
    }

    /// Says which targets count, and what of the pose the primitive lacks.
    fn note(self, file: &mut GltfFile<'_, '_>) {
        let notes = &mut file.context.notes;
        let (all, applied) = (self.targets().len(), self.weighted().count());
        if applied > 0 {
            let rule = "morph targets were applied, with the weights of the file";
            notes.add(format!("{applied} of {all} {rule}"));
        }
        notes.count("a morph target without a weight was left out", all - applied);
        if self.pose.weights.len() > all {
            notes.add("weights without a morph target were left out");
        }
        if self.pose.skin.is_none() && has_joints(self.primitive) {
            notes.add("joints were left out: no node gives the mesh a skin");
        }
    }
}

/// Adds what a target has, times its weight, to rows.
fn add<const N: usize>(
    weight: f64,
    target: Option<Index<Accessor>>,
    rows: Option<&mut Vec<[f64; N]>>,
    file: &mut GltfFile<'_, '_>,
) -> Result<(), SceneError> {
    let Some(index) = target else { return Ok(()) };
    let Some(rows) = rows else {
        file.note("what a morph target does to an attribute that a mesh lacks was left out");
        return Ok(());
    };
    let moves: Vec<[f32; 3]> = file.rows(index, &[3], false)?;
    if moves.len() != rows.len() {
        let rule = format!("a morph target has a row for each of {} vertices", rows.len());
        return Err(file.error(format!("{rule}, and this has {}", moves.len())));
    }
    for (row, moves) in rows.iter_mut().zip(moves) {
        for (x, d) in row.iter_mut().zip(moves) {
            *x += weight * f64::from(d);
        }
    }
    Ok(())
}

fn wide<const N: usize>(rows: &[[f32; N]]) -> Vec<[f64; N]> {
    rows.iter().map(|row| row.map(f64::from)).collect()
}

fn narrow<const N: usize>(rows: &[[f64; N]]) -> Rows<N> {
    rows.iter().map(|row| row.map(|number| number as f32)).collect::<Vec<_>>().into()
}

/// A vector of length 1 in the same direction: its numbers may be too small for `f32`. Without one NaN.
fn normalize(row: &mut [f64]) {
    let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
    row.iter_mut().for_each(|x| *x /= length);
}
