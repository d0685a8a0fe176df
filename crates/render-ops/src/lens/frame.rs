//! The image, and the part of it that is shown.

use std::ops::Range;

use crate::defocus::{Part, ROWS};
use crate::size::Size;

/// The part of the image that is shown: without the margin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub(super) size: Size,
    pub(super) margin: usize,
}

impl Frame {
    pub(super) fn rows(&self, band: usize) -> Range<usize> {
        band * ROWS..((band + 1) * ROWS).min(self.size.height)
    }

    /// The rows and columns that band `band` of what is shown has.
    pub(super) fn shown(&self, band: usize) -> Part {
        let Size { width, height } = self.size;
        let start = self.margin + band * ROWS;
        [start..(start + ROWS).min(height - self.margin), self.margin..width - self.margin]
    }

    /// The size without the margin.
    pub(super) fn shown_size(&self) -> Size {
        let Size { width, height } = self.size;
        Size { width: width - 2 * self.margin, height: height - 2 * self.margin }
    }
}
