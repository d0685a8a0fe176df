//! What a caller can get wrong with rendering operations.

use std::borrow::Cow;

use bokashi_core::{Shape, TensorError};

use crate::size::Size;

/// An error of a rendering operation. Each message says the rule, then the value that broke it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// An error of the tape below.
    #[error(transparent)]
    Tensor(#[from] TensorError),

    /// An image has no pixels, or too many.
    #[error("an image needs at least one pixel and fewer than 2^32 - 1, got {size}")]
    ImageSize {
        /// The size given.
        size: Size,
    },

    /// A face refers to a vertex that does not exist.
    #[error("a face needs vertex indices below {vertex_count}, got {index} in face {face}")]
    FaceIndex {
        /// The face's index.
        face: usize,
        /// The vertex index given.
        index: u32,
        /// The number of vertices.
        vertex_count: usize,
    },

    /// An image of triangle ids refers to a face that does not exist.
    #[error(
        "a triangle id needs to be at most the number of faces, {faces}, got {id} at pixel {pixel}"
    )]
    TriangleId {
        /// The pixel.
        pixel: usize,
        /// The id given, the index of a face plus 1.
        id: u32,
        /// The number of faces.
        faces: usize,
    },

    /// Silhouettes are looked for in coverage that does not know which way faces turn.
    #[error(
        "{operation} needs to know which way faces turn: `coverage.with_orientations(&clip, cull)`"
    )]
    NoOrientations {
        /// The operation.
        operation: &'static str,
    },

    /// A mesh has too many faces or vertices for 32-bit indices.
    #[error("a mesh needs fewer than 2^31 faces and vertices, got {given}")]
    MeshSize {
        /// The number given.
        given: usize,
    },

    /// A vertex position is infinite or NaN.
    #[error("clip positions need to be finite, got ({x}, {y}, {z}, {w}) at vertex {vertex}")]
    Position {
        /// The vertex's index.
        vertex: usize,
        /// Clip x.
        x: f64,
        /// Clip y.
        y: f64,
        /// Clip z.
        z: f64,
        /// Clip w.
        w: f64,
    },

    /// An entry of a camera matrix is infinite or NaN.
    #[error("a camera matrix needs finite entries, got {value} in row {row}, column {column}")]
    Camera {
        /// The row.
        row: usize,
        /// The column.
        column: usize,
        /// The entry given.
        value: f64,
    },

    /// A quaternion that is not a rotation, even after normalization.
    #[error("a rotation needs a finite quaternion other than zero, got ({x}, {y}, {z}, {w})")]
    Rotation {
        /// Quaternion x.
        x: f64,
        /// Quaternion y.
        y: f64,
        /// Quaternion z.
        z: f64,
        /// Quaternion w.
        w: f64,
    },

    /// An input's shape breaks the operation's rule.
    #[error("{operation} needs {rule}, got shape {shape}")]
    Shape {
        /// The operation.
        operation: &'static str,
        /// The rule.
        rule: String,
        /// The shape given.
        shape: Shape,
    },

    /// Fragments with exact coverage have lost their weights.
    #[error(
        "{operation} needs a weight for each of the {pieces} pieces of exact coverage, got none"
    )]
    MissingWeights {
        /// The operation.
        operation: &'static str,
        /// Pieces of boundary pixels.
        pieces: usize,
    },

    /// An operation for one fragment per pixel was given exact coverage.
    #[error(
        "{operation} needs one fragment per pixel, got exact coverage with {pixels} boundary pixels"
    )]
    ExactCoverage {
        /// The operation.
        operation: &'static str,
        /// Pixels that were resolved into pieces.
        pixels: usize,
    },

    /// Exact coverage was asked for, and nobody said which attributes have creases.
    #[error(
        "rasterize with exact coverage needs the attributes that will be shown, \
         `options.creases(&[colors.into()])`, or `&[]` for none that varies, got options alone"
    )]
    UnnamedCreases,

    /// A range of faces ends before it begins, or beyond the mesh.
    #[error("a part of a mesh needs a range of its {faces} faces, got {start}..{end}")]
    MeshPart {
        /// The first face given.
        start: usize,
        /// The end given.
        end: usize,
        /// The number of faces.
        faces: usize,
    },

    /// A word that names no kind of silhouettes.
    #[error("silhouettes need to be aliased, antialias or exact, got {given:?}")]
    Silhouettes {
        /// The word given.
        given: String,
    },

    /// A word that names no kernel of a blur.
    #[error("a kernel needs to be unnormalized, sampled, discrete or disc, got {given:?}")]
    Kernel {
        /// The word given.
        given: String,
    },

    /// Layers in depth were asked for with exact coverage.
    #[error(
        "{operation} needs fragments at pixel centres, got exact coverage, \
         whose pieces say nothing of what lies behind them"
    )]
    ExactLayers {
        /// The operation.
        operation: &'static str,
    },

    /// There is no layer.
    #[error("{operation} needs at least one layer, got none")]
    NoLayers {
        /// The operation.
        operation: &'static str,
    },

    /// A layer covers a pixel that the layer in front does not.
    #[error(
        "layers need to follow each other from the front, \
         got layer {layer} at pixel {pixel}, where layer {} is not", layer - 1
    )]
    LayerPixel {
        /// The layer, from 0 on.
        layer: usize,
        /// The pixel, `row * width + column`.
        pixel: usize,
    },

    /// A layer is looked for behind a layer of another size.
    #[error("a layer needs the size of the layer in front, {expected}, got {given}")]
    LayerSize {
        /// The size of the layer in front.
        expected: Size,
        /// The size given.
        given: Size,
    },

    /// An index buffer has another number of faces than the mesh that it goes with.
    #[error("indices need one face per face of the mesh, {expected}, got {given}")]
    FaceCount {
        /// Faces of the mesh.
        expected: usize,
        /// Faces of the index buffer.
        given: usize,
    },

    /// A standard deviation that the blur is not defined for.
    #[error("gaussian_blur needs {rule}, got sigma {sigma}")]
    BadSigma {
        /// The rule.
        rule: &'static str,
        /// The standard deviation given, in pixels.
        sigma: f64,
    },

    /// A window radius or a tolerance that the blur is not defined for.
    #[error("gaussian_blur needs {rule}, got {value}")]
    BadRadius {
        /// The rule.
        rule: &'static str,
        /// The value given.
        value: f64,
    },

    /// A number that has to be finite is infinite or NaN.
    #[error("{operation} needs finite {what}, got {value} in row {row}")]
    NotFinite {
        /// The operation.
        operation: &'static str,
        /// What the number is, in the plural.
        what: &'static str,
        /// The row of the first axis that it is in.
        row: usize,
        /// The number given.
        value: f64,
    },

    /// A direction has no length.
    #[error("{operation} needs directions other than zero, got zero in row {row}")]
    Direction {
        /// The operation.
        operation: &'static str,
        /// The row of the direction.
        row: usize,
    },

    /// A texture cannot be looked up that way.
    #[error("{operation} needs {rule}, got {given}")]
    BadSampler {
        /// The operation.
        operation: &'static str,
        /// The rule.
        rule: &'static str,
        /// The number given.
        given: usize,
    },

    /// A depth that nothing in front of the eye has.
    #[error("depth_of_field needs depths from 0 up, got {depth} at pixel {pixel}")]
    Depth {
        /// The pixel, `row * width + column`.
        pixel: usize,
        /// The depth given.
        depth: f64,
    },

    /// A lens that the depth of field is not defined for.
    #[error("depth_of_field needs {rule}, got {value}")]
    BadLens {
        /// The rule.
        rule: &'static str,
        /// The value given.
        value: f64,
    },
}

impl RenderError {
    /// A number that breaks an operation's rule.
    pub(crate) fn value(
        operation: &'static str,
        rule: impl Into<Cow<'static, str>>,
        value: f64,
    ) -> Self {
        TensorError::Value { operation, rule: rule.into(), value }.into()
    }

    /// A shape that breaks an operation's rule.
    pub(crate) fn shape(operation: &'static str, rule: impl Into<String>, shape: &Shape) -> Self {
        Self::Shape { operation, rule: rule.into(), shape: shape.clone() }
    }
}

/// Here, and not with the rest of [`Size`]: an error holds one.
impl Size {
    /// The size itself.
    ///
    /// # Errors
    /// [`RenderError::ImageSize`] unless the pixels can be counted in 32 bits and there is one.
    pub(crate) fn checked(self) -> Result<Self, RenderError> {
        match self.width.checked_mul(self.height) {
            Some(pixels) if pixels > 0 && pixels < u32::MAX as usize => Ok(self),
            _ => Err(RenderError::ImageSize { size: self }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_without_pixels_or_with_too_many_is_refused() {
        for size in [Size::square(0), Size { width: 0, height: 5 }, Size::square(1 << 16)] {
            assert_eq!(size.checked(), Err(RenderError::ImageSize { size }));
        }
        assert!(Size::square(usize::MAX).checked().is_err());
        assert!(Size::square(1).checked().is_ok());
    }
}
