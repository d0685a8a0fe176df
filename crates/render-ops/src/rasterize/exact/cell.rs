//! Cells: a pixel, and the rectangles that it is cut into where it is crowded.

use bokashi_core::Scalar;

use super::polygon::{Line, value_at};

/// Where a cell is cut, as a share of its extent. A side of a face that lies on the cut itself would be
/// lost: on both sides of the cut nothing but the cell's own border is there. Sides lie on halves, thirds
/// and other simple shares of pixels by design, but on this number only by accident.
const CUT: f64 = 0.506_180_339_887_498_9;

/// A rectangle around or in a pixel, in scaled coordinates from its centre.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell<S> {
    pub(super) low: [S; 2],
    pub(super) high: [S; 2],
}

impl<S: Scalar> Cell<S> {
    /// All that lies within `reach` of the pixel's centre: with 1 the pixel.
    #[inline(always)]
    pub(super) fn around_center(reach: S) -> Self {
        Self { low: [-reach; 2], high: [reach; 2] }
    }

    /// Its width and its height.
    #[inline(always)]
    fn extent(&self) -> [S; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    #[inline(always)]
    pub(super) fn area(&self) -> S {
        let [width, height] = self.extent();
        width * height
    }

    /// Half the length of its border.
    #[inline(always)]
    pub(super) fn half_border(&self) -> S {
        let [width, height] = self.extent();
        width + height
    }

    #[inline(always)]
    pub(super) fn center(&self) -> [S; 2] {
        let half = S::from_f64(0.5);
        [half * (self.low[0] + self.high[0]), half * (self.low[1] + self.high[1])]
    }

    /// By how much a line's values change from the centre to the farthest corner.
    #[inline(always)]
    pub(super) fn change(&self, [_, x, y]: Line<S>) -> S {
        let [width, height] = self.extent();
        S::from_f64(0.5) * (width * x.abs() + height * y.abs())
    }

    /// The least and the largest value of a line.
    #[inline(always)]
    pub(super) fn range(&self, line: Line<S>) -> [S; 2] {
        let (value, change) = (value_at(line, self.center()), self.change(line));
        [value - change, value + change]
    }

    /// The four parts that it is cut into.
    pub(super) fn quarters(&self) -> [Self; 4] {
        let Self { low, high } = *self;
        let [x, y] = [0, 1].map(|axis| low[axis] + S::from_f64(CUT) * (high[axis] - low[axis]));
        [
            Self { low, high: [x, y] },
            Self { low: [x, low[1]], high: [high[0], y] },
            Self { low: [low[0], y], high: [x, high[1]] },
            Self { low: [x, y], high },
        ]
    }
}
