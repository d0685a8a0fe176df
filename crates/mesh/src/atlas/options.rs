//! Options of an atlas.

use bokashi_core::TensorError;

/// The longest side of a texture, in texels.
const MOST_TEXELS: usize = 1 << 14;

/// Options of [`atlas`](crate::atlas()).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct AtlasOptions {
    /// The number of texels along each side of the texture, from 1 to 2^14. With a power of two, texels of all levels
    /// of detail align.
    pub size: usize,
    /// The coarsest level of detail at which no sample mixes charts, 2 by default. Each level doubles the gutters. The
    /// atlas has fewer levels where charts would cover less than three tenths of the texture.
    pub levels: usize,
    /// The largest angle between a face's normal and its chart's axis, in degrees: 50 by default, and below 90. With a
    /// smaller angle there are more charts, and their texels have more equal areas.
    pub cone: f64,
}

impl AtlasOptions {
    /// Options for a texture with `size` texels along each side.
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

/// The distance along each axis, in texels of level 0, within which lie all texels that a sample of `level` is made of.
///
/// A bilinear sample reads texels of its level whose middles are less than one side away. Each of them reaches half a
/// side further.
pub(super) fn reach(level: usize) -> f64 {
    1.5 * (1_u64 << level.min(32)) as f64
}
