//! The image, and the part of it that is shown.

use std::ops::Range;

use super::blur::Part;
use super::rungs::MOST_HALVINGS;
use super::strips::ROWS;
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

    /// The share that a pixel has of a pixel of the image that is halved so often: a mean of those that there are.
    #[inline(always)]
    pub(super) fn mean_weight(&self, halvings: usize, [row, column]: [usize; 2]) -> f64 {
        let (first_row, first_column) =
            (row >> halvings << halvings, column >> halvings << halvings);
        let side = 1 << halvings;
        let Size { width, height } = self.size;
        if first_row + side <= height && first_column + side <= width {
            return MEAN_WEIGHTS[halvings];
        }
        let [rows, columns] = [height - first_row, width - first_column].map(|rest| rest.min(side));
        ((rows * columns) as f64).recip()
    }
}

/// The share of a pixel of an image that is halved so often.
const MEAN_WEIGHTS: [f64; MOST_HALVINGS + 1] =
    [1.0, 1.0 / 4.0, 1.0 / 16.0, 1.0 / 64.0, 1.0 / 256.0];
