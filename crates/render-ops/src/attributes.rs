//! Attributes of vertices, beside the fragments that show their faces.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Scalar, Shape};

use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::mesh::Mesh;

/// Which attributes each fragment's face has.
pub(crate) struct Attributes {
    /// Face k names the attributes of face k of the mesh that was rasterized.
    pub(crate) indices: Mesh,
    pub(crate) coverage: Arc<Coverage>,
}

impl Attributes {
    /// # Errors
    /// [`RenderError::FaceCount`] unless `indices` has as many faces as the mesh that was rasterized.
    pub(crate) fn new(indices: &Mesh, coverage: Arc<Coverage>) -> Result<Self, RenderError> {
        let [expected, given] = [coverage.mesh(), indices].map(|mesh| mesh.faces().len());
        if given != expected {
            return Err(RenderError::FaceCount { expected, given });
        }
        Ok(Self { indices: indices.clone(), coverage })
    }

    /// C of attributes of shape `[A, C]`, A being the number of vertices of the index buffer.
    ///
    /// # Errors
    /// [`RenderError::Shape`] for any other shape, and where C is 0.
    pub(crate) fn channels(
        &self,
        operation: &'static str,
        shape: &Shape,
    ) -> Result<usize, RenderError> {
        let vertices = self.indices.vertex_count();
        match **shape {
            [rows, channels] if rows == vertices && channels > 0 => Ok(channels),
            _ => Err(RenderError::Shape {
                operation,
                rule: format!("attributes of shape [{vertices}, C], C > 0"),
                shape: shape.clone(),
            }),
        }
    }

    /// Calls `work(fragments, corners, own)` for each face in each band: with its fragments, the
    /// attributes of its vertices, and the fragments' entries of `entries`. Each fragment has as many
    /// entries. Bands may be worked on at the same time.
    #[inline(always)]
    pub(crate) fn for_each_face_mut<T: Scalar>(
        &self,
        attributes: &[T],
        entries: &mut [T],
        channels: usize,
        work: impl Fn(Range<usize>, [&[T]; 3], &mut [T]) + Sync,
    ) {
        self.coverage.for_each_slot_mut(
            entries,
            #[inline(always)]
            |runs, slot, fragments, entries| {
                let corners = self.corners(attributes, channels, runs.face(slot));
                work(fragments, corners, entries);
            },
        );
    }

    /// The attributes of the vertices of a face.
    #[inline(always)]
    pub(crate) fn corners<'a, T>(
        &self,
        attributes: &'a [T],
        channels: usize,
        face: usize,
    ) -> [&'a [T]; 3] {
        self.indices.faces()[face]
            .map(|vertex| &attributes[vertex as usize * channels..][..channels])
    }
}
