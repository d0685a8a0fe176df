//! Fragments: the covered samples of an image alone, as tensors.
//!
//! Between vertices and pixels stand fragments. Whatever is computed on a surface is ordinary
//! tensor arithmetic on `[N, C]`, and costs nothing where there is no surface.

use std::fmt;
use std::sync::Arc;

use bokashi_core::{Scalar, Var};

use crate::mesh::Mesh;
use crate::size::Size;

/// What [`rasterize`](crate::rasterize()) gives: N covered samples in the order of their pixels,
/// row by row from the top.
#[derive(Clone)]
pub struct Fragments<'t, T: Scalar> {
    /// The perspective-correct weights of each fragment's face's vertices 0 and 1; that of
    /// vertex 2 is what is missing to 1. Shape `[N, 2]`, differentiable.
    pub barycentrics: Var<'t, T>,
    /// Each fragment's depth z / w, -1 on the near plane and 1 on the far plane. Shape `[N]`,
    /// differentiable.
    pub depth: Var<'t, T>,
    /// Which face each fragment lies on, and which pixel it belongs to.
    pub coverage: Arc<Coverage>,
}

impl<T: Scalar> fmt::Debug for Fragments<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fragments").field("coverage", &self.coverage).finish_non_exhaustive()
    }
}

/// Which faces cover which pixels: whole numbers, so not differentiable by type.
#[derive(Debug, Clone)]
pub struct Coverage {
    pub(crate) mesh: Mesh,
    pub(crate) size: Size,
    pub(crate) faces: Vec<u32>,
    pub(crate) pixels: Vec<u32>,
    pub(crate) fragment_of_pixel: Vec<u32>,
    pub(crate) culled: Culled,
}

/// How many faces were not drawn, and why.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Culled {
    /// Faces whose area is zero within rounding, or that repeat a vertex.
    pub degenerate: usize,
    /// Faces wholly outside the view: beside the image, behind the eye, or outside the depth range.
    pub outside: usize,
    /// Faces that turn the side away that [`Cull`](crate::Cull) names.
    pub facing: usize,
}

/// Stands for "no fragment" in the map from pixels.
pub(crate) const NO_FRAGMENT: u32 = u32::MAX;

impl Coverage {
    /// The number of fragments, N.
    pub fn count(&self) -> usize {
        self.faces.len()
    }

    /// The mesh that was rasterized.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The size of the image.
    pub fn size(&self) -> Size {
        self.size
    }

    /// The index of each fragment's face.
    pub fn faces(&self) -> &[u32] {
        &self.faces
    }

    /// Each fragment's pixel, `row * width + column`.
    pub fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    /// The fragment of `pixel`, where it is covered.
    pub fn fragment_at(&self, pixel: usize) -> Option<usize> {
        let fragment = self.fragment_of_pixel[pixel];
        (fragment != NO_FRAGMENT).then_some(fragment as usize)
    }

    /// Per pixel, row by row from the top: the index of its face plus 1, or 0 for the background.
    pub fn triangle_ids(&self) -> Vec<u32> {
        (0..self.size.pixels())
            .map(|pixel| self.fragment_at(pixel).map_or(0, |fragment| self.faces[fragment] + 1))
            .collect()
    }

    /// How many faces were not drawn, and why.
    pub fn culled(&self) -> Culled {
        self.culled
    }
}
