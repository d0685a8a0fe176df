//! Depth at fragments.
//!
//! # Forward and backward
//! `depth = z / w`, a quotient of two functions that are linear over the image: `face_quotients` with
//! `n = z` and `m = w`.
//!
//! # Where it is not smooth
//! Where the visible face changes.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020.

use bokashi_core::{Scalar, Var};

use crate::error::RenderError;
use crate::face_quotients::{Quotient, quotients};
use crate::fragments::Fragments;
use crate::homogeneous::Vertex;

/// Each fragment's depth z / w, -1 on the near plane and 1 on the far plane: `[N]`, differentiable
/// with respect to the clip positions that were rasterized. Distances are [`eye_depth`](crate::eye_depth()).
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
pub fn depth<'t, T: Scalar>(fragments: &Fragments<'t, T>) -> Result<Var<'t, T>, RenderError> {
    quotients::<T, Depth>(fragments)
}

struct Depth;

impl Quotient for Depth {
    const NAME: &'static str = "depth";

    #[inline(always)]
    fn terms<S: Scalar>(vertex: &Vertex<S>, _factor: S) -> [S; 2] {
        [vertex.z, vertex.w]
    }

    #[inline(always)]
    fn pull_back<S: Scalar>(bars: [S; 2]) -> [S; 2] {
        bars
    }

    /// What rasterization lets through lies between the planes.
    #[inline(always)]
    fn within_range<S: Scalar>(quotient: S) -> S {
        quotient.maximum_or_nan(-S::ONE).minimum_or_nan(S::ONE)
    }
}
