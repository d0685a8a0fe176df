//! Layers: the pixels of a picture that can differ from its background.
//!
//! Most of a picture is often background, and most losses are sums over pixels. A layer holds the
//! values of the covered pixels, and once it is antialiased those of its *rim*: the uncovered
//! pixels beside a silhouette. What is computed on a layer costs nothing elsewhere.

use std::sync::Arc;

use bokashi_core::{Scalar, Var};

use crate::background::Background;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::fragments::Fragments;

/// The pixels of a picture that can differ from its background, with the background.
#[derive(Debug, Clone)]
pub struct Layer<'t, T: Scalar> {
    /// The values of the fragments, in their order, and then of the rim. Shape `[P, C]`,
    /// differentiable.
    pub values: Var<'t, T>,
    /// What is seen elsewhere.
    pub background: Background<'t, T>,
    pub(crate) coverage: Arc<Coverage>,
    /// The pixels of the rim, in order, once the layer is antialiased.
    pub(crate) rim: Option<Arc<Vec<u32>>>,
}

/// The layer of fragment values `[N, C]` before a background.
///
/// # Errors
/// [`RenderError::Shape`] unless the values are `[N, C]`, C > 0, with N the number of fragments, and
/// for fragments that are not whole. `TensorError::ForeignVariable` for variables of several tapes.
pub fn layer<'t, T: Scalar>(
    values: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    background: Background<'t, T>,
) -> Result<Layer<'t, T>, RenderError> {
    let coverage = fragments.checked_coverage("resolve", values.tape())?;
    let (count, shape) = (coverage.count(), values.shape());
    match *shape {
        [rows, channels] if rows == count && channels > 0 => {}
        _ => {
            let rule = format!("values of shape [{count}, C], C > 0");
            return Err(RenderError::Shape { operation: "resolve", rule, shape });
        }
    }
    Ok(Layer { values, background, coverage, rim: None })
}
