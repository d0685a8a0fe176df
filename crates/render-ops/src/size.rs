//! The size of an image, and where its pixel centres are.
//!
//! Geometry is done in *scaled* normalized device coordinates: x times the width and y times the
//! height. The image is `[-W, W] x [-H, H]`, y up, and a pixel is 2 units wide. So every pixel centre
//! is a whole number, free of rounding.

use std::fmt;

use bokashi_core::Scalar;

/// The size of an image in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// `side` columns and rows.
    pub const fn square(side: usize) -> Self {
        Self { width: side, height: side }
    }

    /// The number of pixels.
    pub const fn pixels(self) -> usize {
        self.width * self.height
    }

    /// The row and the column of `pixel`.
    #[inline(always)]
    pub(crate) fn row_and_column(self, pixel: usize) -> [usize; 2] {
        // Pixels are counted in 32 bits, whose division takes half the time.
        let (pixel, width) = (pixel as u32, self.width as u32);
        [(pixel / width) as usize, (pixel % width) as usize]
    }

    /// The scaled coordinates of the centre of `pixel`.
    #[inline(always)]
    pub(crate) fn center<S: Scalar>(self, pixel: usize) -> [S; 2] {
        let [row, column] = self.row_and_column(pixel);
        [self.center_x(column), self.center_y(row)]
    }

    /// [`Self::center`], for loops that become vectors, which cannot divide whole numbers.
    #[inline(always)]
    pub(crate) fn center_in_lanes<S: Scalar>(self, pixel: u32) -> [S; 2] {
        let (pixel, [width, height]) =
            (f64::from(pixel), [extent(self.width), extent(self.height)]);
        // A pixel has 32 bits and the quotient 53, so it is never rounded up to the next row.
        let row = (pixel / width).floor();
        let column = pixel - row * width;
        [S::from_f64(2.0 * column + 1.0 - width), S::from_f64(height - (2.0 * row + 1.0))]
    }

    /// The width and the height as numbers.
    #[inline(always)]
    pub(crate) fn extents<S: Scalar>(self) -> [S; 2] {
        [self.width, self.height].map(|pixels| S::from_f64(extent(pixels)))
    }

    /// The scaled x of the centres of column `column`.
    pub(crate) fn center_x<S: Scalar>(self, column: usize) -> S {
        S::from_f64(center(column) - extent(self.width))
    }

    /// The scaled y of the centres of row `row`, row 0 on top.
    pub(crate) fn center_y<S: Scalar>(self, row: usize) -> S {
        S::from_f64(extent(self.height) - center(row))
    }
}

/// Twice the place of the centre of row or column `index` in pixels.
fn center(index: usize) -> f64 {
    2.0 * extent(index) + 1.0
}

/// A number of rows or columns: they are counted in 32 bits, whose conversion takes a third of the
/// instructions.
fn extent(pixels: usize) -> f64 {
    f64::from(pixels as u32)
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixel_centres_lie_symmetrically_with_row_zero_on_top() {
        let size = Size { width: 4, height: 3 };
        let xs: Vec<f64> = (0..4).map(|column| size.center_x(column)).collect();
        let ys: Vec<f64> = (0..3).map(|row| size.center_y(row)).collect();
        assert_eq!(xs, [-3.0, -1.0, 1.0, 3.0]);
        assert_eq!(ys, [2.0, 0.0, -2.0]);
    }

    #[test]
    fn centres_in_lanes_are_the_same_at_both_ends_of_rows() {
        for width in [1, 2, 3, 5, 7, 1000, 1023, 65_535, 65_537, 1 << 20, u32::MAX as usize / 3] {
            let rows = (u32::MAX as usize - 1) / width;
            let size = Size { width, height: rows };
            let of_rows = [0, 1, 2, rows / 3, rows / 2 + 1, rows - 1].map(|row| row.min(rows - 1));
            let ends = of_rows.map(|row| [row * width, row * width + width - 1]);
            for pixel in ends.into_iter().flatten() {
                let expected: [f64; 2] = size.center(pixel);
                let found = size.center_in_lanes::<f64>(pixel as u32);
                assert_eq!(found, expected, "{pixel} of {size}");
            }
        }
    }
}
