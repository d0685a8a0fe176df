//! Attributes of vertices, and which of them each corner of a mesh has.

use bokashi_core::{Scalar, Var};

use crate::mesh::Mesh;

/// Attributes of the vertices of a mesh: colours, texture coordinates, normals. Made of a variable, or of one
/// and an index buffer: `colors.into()`, `(colors, &indices).into()`.
#[derive(Debug, Clone, Copy)]
pub struct VertexAttributes<'a, 't, T: Scalar> {
    /// The attributes, `[A, C]`.
    pub values: Var<'t, T>,
    /// Face k names the attributes of face k of the mesh. `None` is the mesh itself: vertex k has row k.
    pub indices: Option<&'a Mesh>,
}

impl<'t, T: Scalar> From<Var<'t, T>> for VertexAttributes<'_, 't, T> {
    fn from(values: Var<'t, T>) -> Self {
        Self { values, indices: None }
    }
}

impl<'a, 't, T: Scalar> From<(Var<'t, T>, &'a Mesh)> for VertexAttributes<'a, 't, T> {
    fn from((values, indices): (Var<'t, T>, &'a Mesh)) -> Self {
        Self { values, indices: Some(indices) }
    }
}
