//! How a texture is looked up.

use bokashi_core::{Scalar, Var};

/// Which texels a sample is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TextureFilter {
    /// The nearest texel of the nearest level: a step function of coordinates and level, which get no
    /// gradient.
    Nearest,
    /// The four texels around the coordinates, of the nearest level. The level gets no gradient.
    Bilinear,
    /// The four texels around the coordinates, of the two nearest levels.
    #[default]
    Trilinear,
    /// Trilinear samples side by side along the longer axis of a pixel's footprint, on a finer level:
    /// `probes` at most, from 1 to [`MOST_PROBES`]. It needs [`Detail::Differentials`].
    Anisotropic {
        /// The most samples.
        probes: usize,
    },
}

/// The most probes of [`TextureFilter::Anisotropic`].
pub const MOST_PROBES: usize = 8;

impl TextureFilter {
    /// The most probes of a sample.
    pub(super) fn probes(self) -> usize {
        match self {
            Self::Anisotropic { probes } => probes,
            _ => 1,
        }
    }

    /// Whether two neighbouring levels are mixed.
    pub(super) fn mixes_levels(self) -> bool {
        matches!(self, Self::Trilinear | Self::Anisotropic { .. })
    }
}

/// What lies beyond the border of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TextureBorder {
    /// The texture, again and again.
    #[default]
    Wrap,
    /// The texture, mirrored about its border, again and again.
    Mirror,
    /// The nearest texel of the border.
    Clamp,
    /// Zeros.
    Zero,
}

/// How to look a texture up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sampler {
    /// Which texels a sample is made of.
    pub filter: TextureFilter,
    /// What lies beyond the borders along u and along v. A cube map has none.
    pub borders: [TextureBorder; 2],
    /// The coarsest level that may be used; the coarsest that there is by default.
    pub coarsest: Option<usize>,
}

impl Sampler {
    /// Trilinear samples of a texture that repeats.
    pub const fn new() -> Self {
        Self { filter: TextureFilter::Trilinear, borders: [TextureBorder::Wrap; 2], coarsest: None }
    }

    /// The same with another `filter`.
    #[must_use]
    pub const fn filter(self, filter: TextureFilter) -> Self {
        Self { filter, ..self }
    }

    /// The same with another `border` along both axes.
    #[must_use]
    pub const fn border(self, border: TextureBorder) -> Self {
        self.borders([border; 2])
    }

    /// The same with other `borders` along u and along v.
    #[must_use]
    pub const fn borders(self, borders: [TextureBorder; 2]) -> Self {
        Self { borders, ..self }
    }

    /// The same without the levels that are coarser than `level`.
    #[must_use]
    pub const fn coarsest(self, level: usize) -> Self {
        Self { coarsest: Some(level), ..self }
    }
}

/// Which level of detail a sample is taken from. Level 0 has the texels as they are; each further
/// level has half as many along each axis.
#[derive(Debug, Clone, Copy)]
pub enum Detail<'t, T: Scalar> {
    /// Level 0.
    Finest,
    /// The level that is given: `[N]`, or `[]` for all samples. What lies outside the levels that
    /// there are is taken as the nearest of them, without a gradient.
    Level(Var<'t, T>),
    /// The level whose texels are as large as a pixel's footprint on the texture.
    Differentials {
        /// How the coordinates change from pixel to pixel: `[N, 2, 2]`, or `[N, 3, 2]` for
        /// directions. See [`interpolate_differentials`](crate::interpolate_differentials()).
        differentials: Var<'t, T>,
        /// Added to the level: `[N]`, or `[]` for all samples. Below 0 the picture is sharper.
        bias: Option<Var<'t, T>>,
    },
}
