//! How to rasterize.

use crate::size::Size;

/// Which faces are left out by the side that they show. The front is the side from which the
/// vertices run counter-clockwise on the screen, y up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cull {
    /// Both sides are drawn.
    #[default]
    None,
    /// Faces seen from the back are not drawn: for closed opaque meshes with the front outside,
    /// whose pictures it does not change.
    Back,
    /// Faces seen from the front are not drawn.
    Front,
}

/// What a pixel is the picture of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    /// What lies at its centre.
    #[default]
    Center,
    /// All that lies in it: a pixel that an edge of the surface, an occlusion or an intersection
    /// crosses falls into pieces, each with its share of the pixel and its mean barycentrics. Both
    /// move with the vertices, so silhouettes have their true gradient and need no antialiasing.
    /// `docs/exact-coverage.md` has the derivation.
    Exact,
    /// As [`Sampling::Exact`] where a surface ends before the background, else as
    /// [`Sampling::Center`]: for silhouette masks. How much of a pixel is covered is exact, and so is its
    /// gradient. Folds, seams and intersections in front of a surface that fills the pixel are left alone,
    /// which on fine meshes are most of the cost.
    ///
    /// What is covered of a pixel is one piece, and of no place in it. So such fragments show one colour:
    /// attributes that vary over the surface, depths and differentials are refused
    /// ([`RenderError::Outline`](crate::RenderError::Outline)).
    Outline,
}

impl Sampling {
    /// Whether pixels fall into pieces.
    pub(crate) const fn has_pieces(self) -> bool {
        !matches!(self, Self::Center)
    }
}

/// How to rasterize.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RasterOptions {
    /// The image's size in pixels.
    pub size: Size,
    /// Which faces are left out by the side that they show.
    pub cull: Cull,
    /// What a pixel is the picture of.
    pub sampling: Sampling,
    /// Lower where tests ask for it.
    pub(crate) limits: Limits,
}

/// How much exact coverage does at once. The results are the same to rounding, but where the last two
/// limits are reached (`exact::cells`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Limits {
    /// A pixel or a cell of one is cut into four where a depth group holds more faces.
    pub(crate) faces: usize,
    pub(crate) faces_of_cell: usize,
    /// The same where polygons would be held against faces more often.
    pub(crate) cuts: usize,
    /// How often a pixel is cut.
    pub(crate) depth: u32,
    /// How much work a crowded pixel may be: as much as to hold so many polygons against faces.
    pub(crate) work: usize,
}

impl Limits {
    pub(crate) const DEFAULT: Self =
        Self { faces: 256, faces_of_cell: 256, cuts: 1 << 18, depth: 12, work: 1 << 25 };
}

impl RasterOptions {
    /// Both sides of all faces at pixel centres, in an image of `size`.
    pub const fn new(size: Size) -> Self {
        Self { size, cull: Cull::None, sampling: Sampling::Center, limits: Limits::DEFAULT }
    }

    /// The same without the faces that `cull` names.
    #[must_use]
    pub const fn cull(self, cull: Cull) -> Self {
        Self { cull, ..self }
    }

    /// The same with another `sampling`.
    #[must_use]
    pub const fn sampling(self, sampling: Sampling) -> Self {
        Self { sampling, ..self }
    }
}

impl From<Size> for RasterOptions {
    fn from(size: Size) -> Self {
        Self::new(size)
    }
}
