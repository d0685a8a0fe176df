//! Skins: vertices stand where their joints put them.
//!
//! `p' = M p` with `M = sum_j w_j W_j B_j`: W_j is the matrix of joint j to the world, B_j its inverse bind
//! matrix, and the weights w_j sum to 1. Normals go along by the inverse transpose of M, tangents by M.
//! The matrix of the node that shows the mesh counts for nothing, so what comes out stands in the world.
//!
//! # Source
//! Khronos Group, glTF 2.0 Specification, section 3.7.3.

use ::gltf::json::mesh::{Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DMat3, DMat4, DVec3};

use super::file::GltfFile;
use crate::error::SceneError;

/// So far from 1 a sum of weights may be by rounding to bytes: four halves of a 255th.
const ROUNDING: f64 = 2.0 / 255.0;

/// The joints of a skin.
#[derive(Debug)]
pub(super) struct Skin {
    number: usize,
    /// `W_j B_j`.
    joints: Vec<DMat4>,
}

/// The matrix of each vertex of a primitive.
#[derive(Debug)]
pub(super) struct Bend(Vec<DMat4>);

impl Skin {
    /// The skin with this number. `world` has the matrix of each node to the world.
    pub(super) fn new(
        number: usize,
        world: &[DMat4],
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Self, SceneError> {
        let count = file.root.skins.len();
        let Some(skin) = file.root.skins.get(number) else {
            return Err(
                file.error(format!("the file has {count} skins, and a node names {number}"))
            );
        };
        if skin.joints.is_empty() {
            return Err(
                file.error(format!("a skin has a joint or more, and skin {number} has none"))
            );
        }
        let mut joints = Vec::with_capacity(skin.joints.len());
        for joint in &skin.joints {
            let Some(matrix) = world.get(joint.value()) else {
                let (count, joint) = (world.len(), joint.value());
                let message = format!("skin {number} has the joint {joint}");
                return Err(file.error(format!("the file has {count} nodes, and {message}")));
            };
            joints.push(*matrix);
        }
        if let Some(index) = skin.inverse_bind_matrices {
            let rows = file.rows::<16>(index, &[16], false)?;
            if rows.len() < joints.len() {
                let (count, found) = (joints.len(), rows.len());
                let message = format!("skin {number} has {found} for {count} joints");
                return Err(
                    file.error(format!("each joint has an inverse bind matrix, and {message}"))
                );
            }
            for (joint, row) in joints.iter_mut().zip(rows) {
                *joint *= DMat4::from_cols_array(&row.map(f64::from));
            }
        }
        if let Some(joint) = joints.iter().position(|joint| !joint.is_finite()) {
            let message = format!("that of joint {joint} of skin {number} is not");
            return Err(file.error(format!("the matrix of a joint is finite, and {message}")));
        }
        Ok(Self { number, joints })
    }

    /// Adds the matrices and weights of a set of joints to the sums of vertices.
    ///
    /// # Errors
    /// The rule that is broken.
    fn add(
        &self,
        sums: &mut [(DMat4, f64)],
        joints: &[[u32; 4]],
        weights: &[[f32; 4]],
    ) -> Result<(), String> {
        let count = sums.len();
        for (what, found) in [("joints", joints.len()), ("weights", weights.len())] {
            if found != count {
                let rule = format!("there are as many {what} as positions, {count}");
                return Err(format!("{rule}, and these are {found}"));
            }
        }
        for (vertex, (joints, weights)) in joints.iter().zip(weights).enumerate() {
            for (&joint, &weight) in joints.iter().zip(weights) {
                // A weight that is NaN is refused, too.
                if !(weight >= 0.0 && weight.is_finite()) {
                    let rule = "a weight is finite and not below 0";
                    return Err(format!("{rule}, and one of vertex {vertex} is {weight}"));
                }
                if weight == 0.0 {
                    continue;
                }
                let Some(matrix) = self.joints.get(joint as usize) else {
                    let rule = format!("it has {} joints", self.joints.len());
                    return Err(format!("{rule}, and vertex {vertex} names joint {joint}"));
                };
                let (sum, total) = &mut sums[vertex];
                *sum += *matrix * f64::from(weight);
                *total += f64::from(weight);
            }
        }
        Ok(())
    }

    /// What the skin does to the `count` vertices of a primitive.
    pub(super) fn bend(
        &self,
        primitive: &Primitive,
        count: usize,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Bend, SceneError> {
        let number = self.number;
        let error = |file: &GltfFile<'_, '_>, rule: String| {
            Err(file.error(format!("skin {number}: {rule}")))
        };
        file.spend(count as u64, size_of::<(DMat4, f64)>())?;
        let mut sums = vec![(DMat4::ZERO, 0.0); count];
        let mut first = Vec::new();
        for set in 0.. {
            let named = |what: Semantic| primitive.attributes.get(&Checked::Valid(what)).copied();
            let (joints, weights) =
                match (named(Semantic::Joints(set)), named(Semantic::Weights(set))) {
                    (Some(joints), Some(weights)) => (joints, weights),
                    (None, None) if set > 0 => break,
                    (joints, _) => {
                        let lacks = if joints.is_some() { "WEIGHTS" } else { "JOINTS" };
                        let rule = "a primitive that a skin bends has joints and weights";
                        return error(file, format!("{rule}, and this lacks {lacks}_{set}"));
                    }
                };
            let joints = file.joints(joints)?;
            let weights = file.rows::<4>(weights, &[4], true)?;
            if let Err(rule) = self.add(&mut sums, &joints, &weights) {
                return error(file, rule);
            }
            if set == 0 {
                first.extend(joints.iter().map(|joints| joints[0]));
            }
        }
        let (mut scaled, mut unbound) = (0, 0);
        for ((sum, total), &joint) in sums.iter_mut().zip(&first) {
            if *total > 0.0 {
                scaled += usize::from((*total - 1.0).abs() > ROUNDING);
                *sum *= 1.0 / *total;
            } else {
                unbound += 1;
                *sum = self.joints.get(joint as usize).copied().unwrap_or(self.joints[0]);
            }
        }
        let notes = &mut file.context.notes;
        notes.count(
            "a vertex's weights of joints did not sum to 1, and were divided by their sum",
            scaled,
        );
        notes.count("a vertex without a weight of a joint goes with its first joint", unbound);
        Ok(Bend(sums.into_iter().map(|(matrix, _)| matrix).collect()))
    }
}

impl Bend {
    /// Where the vertices stand.
    pub(super) fn points(&self, rows: &mut [[f64; 3]]) {
        for (row, matrix) in rows.iter_mut().zip(&self.0) {
            *row = matrix.transform_point3(DVec3::from_array(*row)).to_array();
        }
    }

    /// Tangents of the bent surface.
    pub(super) fn tangents(&self, rows: &mut [[f64; 4]]) {
        for (row, matrix) in rows.iter_mut().zip(&self.0) {
            let [x, y, z, sign] = *row;
            let [x, y, z] = matrix.transform_vector3(DVec3::new(x, y, z)).to_array();
            // The bitangent goes with the surface, and the cross product the other way in a mirror.
            *row = [x, y, z, if matrix.determinant() < 0.0 { -sign } else { sign }];
        }
    }

    /// Normals of the bent surface.
    pub(super) fn normals(&self, rows: &mut [[f64; 3]]) {
        for (row, matrix) in rows.iter_mut().zip(&self.0) {
            let DMat3 { x_axis: a, y_axis: b, z_axis: c } = DMat3::from_mat4(*matrix);
            // The inverse transpose times the determinant.
            let cofactors = DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b));
            let sign = if a.dot(b.cross(c)) < 0.0 { -1.0 } else { 1.0 };
            *row = (cofactors * DVec3::from_array(*row) * sign).to_array();
        }
    }

    /// Whether most of the surface is mirrored: faces then run the other way.
    pub(super) fn is_mirrored(&self) -> bool {
        let mirrored = self.0.iter().filter(|matrix| matrix.determinant() < 0.0).count();
        2 * mirrored > self.0.len()
    }
}

/// Whether a primitive has joints or weights of joints.
pub(super) fn has_joints(primitive: &Primitive) -> bool {
    let is_of_joints = |what: &Checked<Semantic>| {
        matches!(what, Checked::Valid(Semantic::Joints(_) | Semantic::Weights(_)))
    };
    primitive.attributes.keys().any(is_of_joints)
}
