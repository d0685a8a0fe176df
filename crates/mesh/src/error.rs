//! What is refused.

use bokashi_core::TensorError;
use bokashi_render_ops::RenderError;
use thiserror::Error;

/// Why a mesh or a number was refused.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Faces that are no mesh.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A tensor of the wrong shape.
    #[error(transparent)]
    Tensor(#[from] TensorError),
    /// A grid without a cell, or with too many points.
    #[error("a grid needs at least 2 points along each axis and fewer than 2^31 in all, got {} x {} x {}", shape[0], shape[1], shape[2])]
    GridShape {
        /// The points along x, y and z.
        shape: [usize; 3],
    },
    /// A grid that stands nowhere.
    #[error(
        "a grid needs finite points and a positive spacing, got origin {origin:?} and spacing {spacing}"
    )]
    GridPlace {
        /// Where its first point would stand.
        origin: [f64; 3],
        /// The distance between neighbours.
        spacing: f64,
    },
    /// A box with an end below its start.
    #[error("a grid needs a box that starts below its end, got one from {low:?} to {high:?}")]
    GridBox {
        /// Where it would start.
        low: [f64; 3],
        /// Where it would end.
        high: [f64; 3],
    },
    /// A number of a field that is none.
    #[error("a field needs to be finite, got {value} at grid point {point:?}")]
    FieldValue {
        /// The place of the point along x, y and z.
        point: [usize; 3],
        /// The number.
        value: f64,
    },
    /// A point of a grid that stands nowhere.
    #[error("grid points need finite positions, got {position:?} at grid point {point:?}")]
    PointPosition {
        /// The place of the point along x, y and z.
        point: [usize; 3],
        /// Where it would stand.
        position: [f64; 3],
    },
    /// A texture without room for all charts.
    #[error("an atlas of {charts} charts needs more texels than {size} x {size}")]
    AtlasSize {
        /// The texels along each side.
        size: usize,
        /// How many charts there are.
        charts: usize,
    },
    /// A surface without an area.
    #[error("{operation} needs a face with an area, got none among {faces}")]
    NoArea {
        /// The operation.
        operation: &'static str,
        /// How many faces there are.
        faces: usize,
    },
    /// A mesh without faces.
    #[error("{operation} needs a mesh with faces, got none")]
    NoFaces {
        /// The operation.
        operation: &'static str,
    },
}
