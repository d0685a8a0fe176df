//! Errors of operations on meshes.

use bokashi_core::TensorError;
use bokashi_render_ops::RenderError;
use thiserror::Error;

/// An error of an operation on meshes.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A rendering operation, or the mesh itself, was refused.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A tensor operation was refused.
    #[error(transparent)]
    Tensor(#[from] TensorError),
    /// A grid has no cell, or too many points.
    #[error("a grid needs at least 2 points along each axis and fewer than 2^31 in all, got {} x {} x {}", shape[0], shape[1], shape[2])]
    GridShape {
        /// The points along x, y and z.
        shape: [usize; 3],
    },
    /// The points of a grid are not finite, or its spacing is not positive.
    #[error(
        "a grid needs finite points and a positive spacing, got origin {origin:?} and spacing {spacing}"
    )]
    GridPlace {
        /// The position of the first point.
        origin: [f64; 3],
        /// The distance between neighbours.
        spacing: f64,
    },
    /// A box ends below its start along an axis.
    #[error("a grid needs a box that starts below its end, got one from {low:?} to {high:?}")]
    GridBox {
        /// The least corner of the box.
        low: [f64; 3],
        /// The largest corner of the box.
        high: [f64; 3],
    },
    /// A value of a field is not finite.
    #[error("a field needs to be finite, got {value} at grid point {point:?}")]
    FieldValue {
        /// The place of the point along x, y and z.
        point: [usize; 3],
        /// The value.
        value: f64,
    },
    /// The position of a point of a grid is not finite.
    #[error("grid points need finite positions, got {position:?} at grid point {point:?}")]
    PointPosition {
        /// The place of the point along x, y and z.
        point: [usize; 3],
        /// The position.
        position: [f64; 3],
    },
    /// A texture has no room for all charts.
    #[error("an atlas of {charts} charts needs more texels than {size} x {size}")]
    AtlasSize {
        /// The texels along each side.
        size: usize,
        /// The number of charts.
        charts: usize,
    },
    /// A surface has no area.
    #[error("{operation} needs a face with an area, got none among {faces}")]
    NoArea {
        /// The operation.
        operation: &'static str,
        /// The number of faces.
        faces: usize,
    },
    /// A mesh has no faces.
    #[error("{operation} needs a mesh with faces, got none")]
    NoFaces {
        /// The operation.
        operation: &'static str,
    },
}
