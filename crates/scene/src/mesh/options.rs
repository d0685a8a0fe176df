//! What a caller says about a mesh file.

use crate::picture::ColorSpace;

/// What holds for a mesh file beside what it says itself. By default nothing does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MeshOptions {
    /// How its numbers of vertex colours stand for light. By default as its format has it: sRGB in OBJ and
    /// PLY, linear in glTF.
    pub vertex_color_space: Option<ColorSpace>,
    /// Whether vertices in one place are one vertex. By default they are in PLY and glTF, which double vertices
    /// where texture coordinates, normals or materials have a seam. In OBJ vertices have numbers, and those of
    /// one number are one.
    pub weld: Option<bool>,
}
