//! Meshes of a scene: from a file, or a shape to start from.

use std::path::PathBuf;

use glam::{DMat4, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::{Count, Finite, Positive, Share};
use crate::views::ColorSpaceName;

/// A mesh, and where it stands.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshEntry {
    /// What other entries call it; by default the file's name without its ending, or the shape's.
    pub name: Option<String>,
    /// OBJ with MTL, PLY, glTF or GLB.
    pub file: Option<PathBuf>,
    /// A shape to start from, in place of a file: of radius or half side 1, around the origin.
    pub shape: Option<Shape>,
    /// About how many faces the shape has.
    pub faces: Option<Count>,
    /// Of a hull, the least share of the views that agree that a place belongs to it; by default 0.8. Others may have a
    /// wrong mask or camera.
    pub agreement: Option<Share>,
    /// How the file's numbers of vertex colours stand for light. By default sRGB for OBJ and PLY, and linear
    /// for glTF.
    pub vertex_color_space: Option<ColorSpaceName>,
    /// Whether vertices of the file in one place are one vertex. By default those of PLY and glTF are, which
    /// double vertices where texture coordinates, normals or materials have a seam; those of OBJ have numbers.
    pub weld: Option<bool>,
    /// Where it stands.
    #[serde(default)]
    pub place: Placement,
    /// Further places of the same mesh. Each has all of `place` before it.
    #[serde(default)]
    pub instances: Vec<Placement>,
    /// What it is made of, in place of what its file says.
    #[serde(default)]
    pub material: MaterialEntry,
}

/// A built-in mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// Of radius 1.
    Sphere,
    /// From -1 to 1.
    Cube,
    /// From -1 to 1 in x and y, seen from +z.
    Plane,
    /// What the masks of all views allow that are not held out, where they see it.
    Hull,
}

/// A motion and a scale: first the scale, then the rotation, then the translation.
#[derive(Debug, Clone, Copy, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// How many times as large.
    pub scale: Option<Positive>,
    /// A quaternion x, y, z, w of any length but 0.
    pub rotation: Option<Rotation>,
    /// In units of the scene.
    pub translation: Option<[Finite; 3]>,
}

/// A quaternion of any length but 0.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(try_from = "[Finite; 4]", into = "[f64; 4]")]
#[schemars(with = "[Finite; 4]")]
pub struct Rotation(pub DQuat);

impl From<Rotation> for [f64; 4] {
    fn from(rotation: Rotation) -> Self {
        rotation.0.to_array()
    }
}

impl TryFrom<[Finite; 4]> for Rotation {
    type Error = String;

    fn try_from(given: [Finite; 4]) -> Result<Self, String> {
        let numbers = given.map(|number| number.0);
        // By the largest entry first: squares of tiny ones are 0.
        let largest = numbers.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
        match largest > 0.0 {
            true => Ok(Self(DQuat::from_array(numbers.map(|x| x / largest)).normalize())),
            false => Err(format!("a rotation has a length above 0, and this is {numbers:?}")),
        }
    }
}

impl Placement {
    /// The matrix, from the mesh's own coordinates to the world's.
    pub fn matrix(&self) -> DMat4 {
        let scale = self.scale.map_or(1.0, |scale| scale.0);
        let rotation = self.rotation.map_or(DQuat::IDENTITY, |rotation| rotation.0);
        let translation = self.translation.map_or(DVec3::ZERO, |t| DVec3::from(t.map(|x| x.0)));
        DMat4::from_scale_rotation_translation(DVec3::splat(scale), rotation, translation)
    }
}

/// What a surface is made of.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialEntry {
    /// A linear colour.
    pub base_color: Option<[Share; 3]>,
    /// An image of base colours.
    pub texture: Option<PathBuf>,
    /// A texture to start from, of so many texels along a side, all of the base colour. The mesh needs
    /// texture coordinates.
    pub texture_size: Option<Count>,
    /// Colours at vertices to start from, all of the base colour, where the mesh has none.
    #[serde(default)]
    pub vertex_colors: bool,
    /// An image of normals in tangent space, as glTF has them: x along u, y upwards in the image. The mesh
    /// needs texture coordinates.
    pub normals: Option<PathBuf>,
    /// From 0, a mirror, to 1, rough.
    pub roughness: Option<Share>,
    /// From 0, a dielectric, to 1, a metal.
    pub metallic: Option<Share>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placement_scales_turns_and_moves_in_this_order() {
        let placement: Placement =
            toml::from_str("scale = 2\nrotation = [0, 0, 7e-200, 7e-200]\ntranslation = [1, 0, 0]")
                .unwrap();
        let found = placement.matrix().transform_point3(DVec3::X);
        assert!(found.abs_diff_eq(DVec3::new(1.0, 2.0, 0.0), 1e-12), "{found}");
        assert_eq!(Placement::default().matrix(), DMat4::IDENTITY);
    }
}
