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
}
