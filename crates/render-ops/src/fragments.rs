//! Fragments: the covered samples of an image alone, as tensors.
//!
//! Between vertices and pixels stand fragments. Whatever is computed on a surface is ordinary
//! tensor arithmetic on `[N, C]`, and costs nothing where there is no surface.

use std::fmt;
use std::sync::Arc;

use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};

use crate::coverage::Coverage;
use crate::error::RenderError;

/// The fragments of a rasterized mesh: N covered samples, as tensors.
///
/// Fragments at pixel centres come first. They are ordered by bands of rows from the top, in a band by
/// face, and within a face by pixel; [`Coverage::pixels`] lists their pixels. With exact coverage the
/// pieces of boundary pixels follow, in an order of the same kind.
///
/// A field can be exchanged for another of the same shape on the same tape; operations refuse anything
/// else.
#[derive(Clone)]
pub struct Fragments<'t, T: Scalar> {
    /// The perspective-correct weights of vertices 0 and 1 of each fragment's face; vertex 2 has what is
    /// missing to 1. Shape `[N, 2]`, differentiable.
    pub barycentrics: Var<'t, T>,
    /// With exact coverage, the share of its pixel that each of the K pieces covers. Fragments at pixel
    /// centres have weight 1, which is not stored. Shape `[K]`, differentiable.
    pub weight: Option<Var<'t, T>>,
    /// The clip positions that were rasterized. Shape `[V, 4]`.
    pub clip: Var<'t, T>,
    /// Which face each fragment lies on, and which pixel it belongs to.
    pub coverage: Arc<Coverage>,
}

impl<T: Scalar> fmt::Debug for Fragments<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fragments").field("coverage", &self.coverage).finish_non_exhaustive()
    }
}

impl<'t, T: Scalar> Fragments<'t, T> {
    /// The coverage, where the fragments are whole and on `tape`.
    ///
    /// # Errors
    /// [`TensorError::ForeignVariable`] for fragments of another tape; [`RenderError::Shape`] for
    /// barycentrics that are not one row per fragment, positions not one per vertex, or weights not
    /// one per piece; [`RenderError::MissingWeights`] where these are missing.
    pub(crate) fn checked_coverage(
        &self,
        operation: &'static str,
        tape: &'t Tape<T>,
    ) -> Result<Arc<Coverage>, RenderError> {
        let variables = [Some(self.barycentrics), Some(self.clip), self.weight];
        if variables.iter().flatten().any(|variable| !std::ptr::eq(variable.tape(), tape)) {
            return Err(TensorError::ForeignVariable { operation }.into());
        }
        let (count, vertices) = (self.coverage.count(), self.coverage.mesh().vertex_count());
        let refused = |rule: String, variable: Var<'t, T>| {
            Err(RenderError::Shape { operation, rule, shape: variable.shape() })
        };
        if *self.barycentrics.shape() != [count, 2] {
            return refused(format!("barycentrics of shape [{count}, 2]"), self.barycentrics);
        }
        if *self.clip.shape() != [vertices, 4] {
            return refused(format!("clip positions of shape [{vertices}, 4]"), self.clip);
        }
        let pieces = count - self.coverage.centers();
        match self.weight {
            None if self.coverage.is_exact() => {
                return Err(RenderError::MissingWeights { operation, pieces });
            }
            Some(weight) if *weight.shape() != [pieces] => {
                return refused(format!("weights of shape [{pieces}]"), weight);
            }
            _ => {}
        }
        Ok(Arc::clone(&self.coverage))
    }
}

impl<T: Scalar> Fragments<'_, T> {
    /// The fragments without their tape, for other steps and other tapes: of geometry that does not
    /// change, which need be rasterized once. It copies nothing.
    pub fn constant(&self) -> ConstantFragments<T> {
        ConstantFragments {
            barycentrics: self.barycentrics.value(),
            weight: self.weight.map(Var::value),
            clip: self.clip.value(),
            coverage: Arc::clone(&self.coverage),
        }
    }
}

/// The fragments of geometry that does not change, which outlive a step: see [`Fragments::constant`].
#[derive(Clone)]
pub struct ConstantFragments<T: Scalar> {
    barycentrics: Tensor<T>,
    weight: Option<Tensor<T>>,
    clip: Tensor<T>,
    coverage: Arc<Coverage>,
}

impl<T: Scalar> fmt::Debug for ConstantFragments<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ConstantFragments")
            .field("coverage", &self.coverage)
            .finish_non_exhaustive()
    }
}

impl<T: Scalar> ConstantFragments<T> {
    /// The fragments on `tape`, as constants: every operation takes them, and none computes a gradient
    /// of the geometry. It copies nothing.
    pub fn on<'t>(&self, tape: &'t Tape<T>) -> Fragments<'t, T> {
        Fragments {
            barycentrics: tape.constant(&self.barycentrics),
            weight: self.weight.as_ref().map(|weight| tape.constant(weight)),
            clip: tape.constant(&self.clip),
            coverage: Arc::clone(&self.coverage),
        }
    }

    /// Which face each fragment lies on, and which pixel it belongs to.
    pub fn coverage(&self) -> &Arc<Coverage> {
        &self.coverage
    }
}
