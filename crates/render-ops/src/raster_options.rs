//! How to rasterize, and how silhouettes look.

use std::fmt;
use std::str::FromStr;

use bokashi_core::Scalar;

use crate::error::RenderError;
use crate::size::Size;
use crate::vertex_attributes::VertexAttributes;

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
    ///
    /// Edges at which an attribute bends inside a surface are resolved where they are named:
    /// [`RasterOptions::creases`].
    Exact,
}

impl Sampling {
    /// Whether pixels fall into pieces.
    pub(crate) const fn has_pieces(self) -> bool {
        matches!(self, Self::Exact)
    }
}

/// How the silhouettes of surfaces look in a picture.
///
/// | | gradient of a silhouette | time |
/// |---|---|---|
/// | `Aliased` | none | least |
/// | `Antialias` | that of the blend; edges between pixel centres have none | a little more |
/// | `Exact` | true | 1.4 to 5 times as long |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Silhouettes {
    /// Pixels show what lies at their centres; edges move nothing.
    Aliased,
    /// The same, with pairs of pixels at silhouettes blended: fast, and blind to edges of faces that lie
    /// between pixel centres, as those of fine meshes do.
    Antialias,
    /// Pixels are means over what is visible in them, with the true gradient.
    #[default]
    Exact,
}

/// The words of [`Silhouettes`] in files and on command lines.
const WORDS: [(&str, Silhouettes); 3] = [
    ("aliased", Silhouettes::Aliased),
    ("antialias", Silhouettes::Antialias),
    ("exact", Silhouettes::Exact),
];

impl fmt::Display for Silhouettes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(WORDS[*self as usize].0)
    }
}

impl FromStr for Silhouettes {
    type Err = RenderError;

    fn from_str(word: &str) -> Result<Self, RenderError> {
        let known = WORDS.iter().find(|(known, _)| *known == word);
        known
            .map(|&(_, silhouettes)| silhouettes)
            .ok_or_else(|| RenderError::Silhouettes { given: word.to_owned() })
    }
}

/// How to rasterize.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterOptions {
    /// The image's size in pixels.
    pub size: Size,
    /// Which faces are left out by the side that they show.
    pub cull: Cull,
    /// What a pixel is the picture of.
    pub sampling: Sampling,
    /// Whether [`Fragments::picture`](crate::Fragments::picture) antialiases silhouettes where pixels show their
    /// centres.
    pub antialias: bool,
    /// How far a pixel that shows its centre may be off its mean because of an edge that is no crease, as a share
    /// of the attribute's range. The range is the largest of its channels'.
    pub crease_tolerance: f64,
    /// Lower where tests ask for it.
    #[doc(hidden)]
    pub limits: Limits,
}

/// How much exact coverage does at once. The results are the same to rounding, but where the last two
/// limits are reached (`exact::cells`).
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// A pixel is cut into four where a depth group holds more faces.
    pub faces: usize,
    /// The same of a cell within a pixel.
    pub faces_of_cell: usize,
    /// The same where polygons would be held against faces more often.
    pub cuts: usize,
    /// How often a pixel is cut.
    pub depth: u32,
    /// How much work a crowded pixel may be: as much as to hold so many polygons against faces.
    pub work: usize,
}

impl Limits {
    /// Those of [`RasterOptions::new`].
    pub const DEFAULT: Self =
        Self { faces: 256, faces_of_cell: 256, cuts: 1 << 18, depth: 12, work: 1 << 25 };
}

impl RasterOptions {
    /// Both sides of all faces at pixel centres, in an image of `size`. Silhouettes are
    /// [`Silhouettes::Antialias`], while those of `scene.toml` are [`Silhouettes::Exact`] by default. The
    /// tolerance of creases is 2e-3.
    pub const fn new(size: Size) -> Self {
        Self {
            size,
            cull: Cull::None,
            sampling: Sampling::Center,
            antialias: true,
            crease_tolerance: 2e-3,
            limits: Limits::DEFAULT,
        }
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

    /// The same with silhouettes of this kind: it sets `sampling` and `antialias`.
    #[must_use]
    pub const fn silhouettes(self, silhouettes: Silhouettes) -> Self {
        let (sampling, antialias) = match silhouettes {
            Silhouettes::Aliased => (Sampling::Center, false),
            Silhouettes::Antialias => (Sampling::Center, true),
            Silhouettes::Exact => (Sampling::Exact, false),
        };
        Self { sampling, antialias, ..self }
    }

    /// The same with another tolerance of creases.
    #[must_use]
    pub const fn crease_tolerance(self, crease_tolerance: f64) -> Self {
        Self { crease_tolerance, ..self }
    }

    /// These options, and the attributes that will be shown. With [`Sampling::Exact`] the edges at which one of
    /// them bends or jumps in the image are resolved like silhouettes, beside the seams that the mesh has. Name
    /// every attribute that is interpolated and varies over the surface. Without them the error of the gradient
    /// is some hundred times as large. `&[]` says that there are none.
    ///
    /// Which edges are creases is found anew for each image, and has no gradient. Attributes that are the same
    /// everywhere have no creases. Where an attribute is no number, all edges are, but for those between two
    /// culled faces. At pixel centres nothing is looked for.
    pub const fn creases<'a, 't, T: Scalar>(
        self,
        attributes: &'a [VertexAttributes<'a, 't, T>],
    ) -> Rasterization<'a, 't, T> {
        Rasterization { options: self, creases: Some(attributes) }
    }
}

/// What [`rasterize`](crate::rasterize()) is told: options, and the attributes whose creases count. See
/// [`RasterOptions::creases`]; without exact coverage the options or a size alone will do.
#[derive(Debug, Clone, Copy)]
pub struct Rasterization<'a, 't, T: Scalar> {
    pub(crate) options: RasterOptions,
    pub(crate) creases: Option<&'a [VertexAttributes<'a, 't, T>]>,
}

impl<T: Scalar> From<RasterOptions> for Rasterization<'_, '_, T> {
    fn from(options: RasterOptions) -> Self {
        Self { options, creases: None }
    }
}

impl<T: Scalar> From<Size> for Rasterization<'_, '_, T> {
    fn from(size: Size) -> Self {
        RasterOptions::new(size).into()
    }
}

impl From<Size> for RasterOptions {
    fn from(size: Size) -> Self {
        Self::new(size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_silhouettes_has_a_word() {
        for (word, silhouettes) in WORDS {
            assert_eq!(silhouettes.to_string(), word);
            assert_eq!(word.parse(), Ok(silhouettes));
        }
        let error = "soft".parse::<Silhouettes>().unwrap_err().to_string();
        assert_eq!(error, "silhouettes need to be aliased, antialias or exact, got \"soft\"");
    }
}
