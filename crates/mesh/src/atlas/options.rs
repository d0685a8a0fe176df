//! What is asked of an atlas.

use bokashi_core::TensorError;

/// The longest side of a texture, in texels.
const MOST_TEXELS: usize = 1 << 14;

/// How [`atlas`](crate::atlas()) makes texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct AtlasOptions {
    /// The texels along each side of the texture, from 1 to 2^14. Levels of detail lie evenly where it is a power of two.
    pub size: usize,
    /// The coarsest level of detail at which no sample mixes charts, 2 by default. Each doubles the gutters. Where charts
    /// would then cover less than three tenths of the texture, the atlas has fewer.
    pub levels: usize,
    /// How far normals of a chart's faces are from the chart's, in degrees: 50 at most by default, and below 90. The
    /// smaller, the more charts there are, and the more even are their texels.
    pub cone: f64,
}

impl AtlasOptions {
    /// Those of a texture with so many texels along each side.
    pub const fn new(size: usize) -> Self {
        Self { size, levels: 2, cone: 50.0 }
    }

    /// # Errors
    /// [`TensorError::Value`] for a size or a cone out of its range.
    pub(super) fn check(&self) -> Result<(), TensorError> {
        check_size("atlas", self.size)?;
        if self.cone > 0.0 && self.cone < 90.0 {
            return Ok(());
        }
        let rule = "a cone above 0 and below 90 degrees".into();
        Err(TensorError::Value { operation: "atlas", rule, value: self.cone })
    }
}

/// # Errors
/// [`TensorError::Value`] for a size out of its range.
pub(super) fn check_size(operation: &'static str, size: usize) -> Result<(), TensorError> {
    if (1..=MOST_TEXELS).contains(&size) {
        return Ok(());
    }
    Err(TensorError::Value { operation, rule: "a size from 1 to 2^14".into(), value: size as f64 })
}

/// How far from a point lie the texels that its samples of `level` are made of, in texels of level 0 along each axis.
///
/// A bilinear sample is made of texels of the level whose middles are less than one of their sides away, and each
/// reaches half a side further.
pub(super) fn reach(level: usize) -> f64 {
    1.5 * (1_u64 << level.min(32)) as f64
}
