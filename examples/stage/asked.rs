//! What a sample is asked for.

use std::fmt;
use std::str::FromStr;

use bokashi::prelude::*;

/// What a sample is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asked {
    /// All that is random follows from it.
    pub seed: u64,
    /// How silhouettes look.
    pub silhouettes: Silhouettes,
    /// The most steps that a fit may take, where that is less than a sample needs: to see that it runs.
    pub most_steps: Option<u64>,
}

impl Asked {
    /// How many steps to take instead of `own`.
    pub fn steps(&self, own: u64) -> u64 {
        self.most_steps.map_or(own, |most| most.min(own))
    }
}

/// How silhouettes look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Silhouettes {
    /// A pixel shows what lies at its centre.
    Aliased,
    /// The same, with the pixels at silhouettes blended.
    Antialias,
    /// A pixel shows all that lies in it.
    Exact,
}

/// Their words on a command line.
const WORDS: [(&str, Silhouettes); 3] = [
    ("aliased", Silhouettes::Aliased),
    ("antialias", Silhouettes::Antialias),
    ("exact", Silhouettes::Exact),
];

impl Silhouettes {
    /// How to rasterize for them.
    pub fn options(self, size: Size) -> RasterOptions {
        let sampling = if self == Self::Exact { Sampling::Exact } else { Sampling::Center };
        RasterOptions::new(size).sampling(sampling)
    }

    /// How `mesh` is rasterized for them, as vertices `clip` in an image of `size`: where all of a pixel
    /// counts, the edges at which `colors` with the index buffer `indices` bend are seams.
    ///
    /// # Errors
    /// As [`mark_creases_indexed`].
    pub fn mesh<T: Scalar>(
        self,
        mesh: &Mesh,
        clip: Var<'_, T>,
        (colors, indices): (Var<'_, T>, &Mesh),
        size: Size,
    ) -> Result<Mesh, RenderError> {
        match self {
            Self::Exact => mark_creases_indexed(mesh, clip, colors, indices, size),
            _ => Ok(mesh.clone()),
        }
    }

    /// The picture of fragments that look like `values: [N, C]`, before `background`.
    ///
    /// # Errors
    /// As [`composite`] and [`antialias`].
    pub fn picture<'t, T: Scalar>(
        self,
        values: Var<'t, T>,
        fragments: &Fragments<'t, T>,
        background: Background<'t, T>,
    ) -> Result<Picture<'t, T>, RenderError> {
        let picture = composite(values, fragments, background)?;
        if self == Self::Antialias { antialias(picture) } else { Ok(picture.into()) }
    }
}

impl fmt::Display for Silhouettes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (word, _) = WORDS.iter().find(|(_, silhouettes)| silhouettes == self).expect("all");
        f.pad(word)
    }
}

impl FromStr for Silhouettes {
    type Err = FitError;

    fn from_str(text: &str) -> Result<Self, FitError> {
        let known = WORDS.iter().find(|(word, _)| *word == text);
        let rule = "one of aliased, antialias and exact";
        known.map(|&(_, found)| found).ok_or_else(|| FitError::setting("silhouettes", rule, text))
    }
}
