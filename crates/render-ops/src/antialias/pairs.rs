//! The pairs of neighbouring pixels that a silhouette may pass between, its face covering one of the two.
//!
//! A silhouette lies on the line `a + b c + d r = 0`, with columns c and rows r of pixel centres. Where it
//! runs more across rows than along them it meets row r at `c = -(a + d r) / b`, and may pass between pixels
//! beside each other; else it meets column c at `r = -(a + b c) / d`. A run of the face has a pair beside it at
//! either end, and two pairs below or above it in each column. In most columns the line is far away, and these are
//! not visited. So the cost is that of the runs of faces with silhouettes, and of the pairs.

use std::ops::Range;

use bokashi_core::Scalar;

use crate::homogeneous::{Vertex, edge, extent};
use crate::size::Size;

/// How far beyond the two pixel centres a crossing may lie, in pixels, and still count: rounding
/// moves an edge that passes through a centre to either side of it. Then it is clamped.
pub(super) const SLACK: f64 = 1.0 / 16.0;

/// A pixel and its right or its lower neighbour, of which a face covers one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) row: u32,
    pub(super) column: u32,
    /// Whether the other pixel lies below, not on the right.
    pub(super) below: bool,
    /// Whether the face covers the first pixel, not the second.
    pub(super) covers_first: bool,
}

impl Pair {
    /// The row and the column of the first pixel, or of the second.
    #[inline(always)]
    pub(super) fn pixel(&self, second: bool) -> [u32; 2] {
        [self.row + u32::from(second & self.below), self.column + u32::from(second & !self.below)]
    }

    /// The row and the column of the pixel that the face covers.
    #[inline(always)]
    pub(super) fn covered_pixel(&self) -> [u32; 2] {
        self.pixel(!self.covers_first)
    }

    /// The row and the column of the other pixel.
    #[inline(always)]
    pub(super) fn other_pixel(&self) -> [u32; 2] {
        self.pixel(self.covers_first)
    }
}

/// The line of a silhouette: where it meets rows or columns of pixel centres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    /// Whether it meets columns, not rows.
    below: bool,
    /// Where it meets row or column 0, and how much farther on the next.
    start: f64,
    slope: f64,
    /// How far from the middle of a pair it may pass.
    reach: f64,
}

impl Line {
    /// The line through two vertices, for pairs of pixels beside each other, and for those below each
    /// other. Surely it runs more along the one or the other direction where its coefficients differ by
    /// more than the rounding errors of both and of a crossing's own.
    #[inline(always)]
    pub(super) fn new<S: Scalar<Wide = S>>(
        p: Vertex<S>,
        q: Vertex<S>,
        size: Size,
    ) -> [Option<Self>; 2] {
        let ([px, py], [qx, qy]) = (extent(p, size), extent(q, size));
        let noise = 16.0 * f64::EPSILON * (p.w.abs() * (qx + qy) + q.w.abs() * (px + py)).to_f64();
        // More than the rounding errors of the edge function, here and in a crossing.
        let error_bound = 16.0 * f64::EPSILON * (px * qy + py * qx).to_f64();
        let [one, by_x, by_y] = edge(p, q).map(S::to_f64);
        let [width, height] = size.extents::<f64>();
        // At pixel centres `x = 2 c + 1 - width`, and `y = height - 1 - 2 r`.
        let one = one + by_x * (1.0 - width) + by_y * (height - 1.0);
        let (by_c, by_r) = (2.0 * by_x, -2.0 * by_y);
        let line = |below, across: f64, along: f64| Self {
            below,
            start: -one / across,
            slope: -along / across,
            reach: 0.5 + SLACK + error_bound / across.abs(),
        };
        // Not a number, where the vertices are not: then it may run either way.
        let runs_along_rows = by_x.abs() + noise < by_y.abs();
        let runs_along_columns = by_y.abs() + noise < by_x.abs();
        [
            (!runs_along_rows).then(|| line(false, by_c, by_r)),
            (!runs_along_columns).then(|| line(true, by_r, by_c)),
        ]
    }

    /// Calls `visit` with the pairs of one pixel within a run of the face and one outside of its row or its
    /// columns, unless the line surely passes them by.
    #[inline(always)]
    pub(super) fn for_each_pair(
        &self,
        row: u32,
        columns: Range<u32>,
        size: Size,
        mut visit: impl FnMut(Pair),
    ) {
        let (width, height) = (size.width as u32, size.height as u32);
        if !self.below {
            let crossing = self.crossing(row);
            if columns.start > 0 && !self.misses(crossing, columns.start) {
                visit(Pair { row, column: columns.start - 1, below: false, covers_first: false });
            }
            if columns.end < width && !self.misses(crossing, columns.end) {
                visit(Pair { row, column: columns.end - 1, below: false, covers_first: true });
            }
            return;
        }
        for column in self.columns_near(row, columns) {
            let crossing = self.crossing(column);
            if row > 0 && !self.misses(crossing, row) {
                visit(Pair { row: row - 1, column, below: true, covers_first: false });
            }
            if row + 1 < height && !self.misses(crossing, row + 1) {
                visit(Pair { row, column, below: true, covers_first: true });
            }
        }
    }

    /// Where it meets a row or a column.
    #[inline(always)]
    fn crossing(&self, index: u32) -> f64 {
        self.start + self.slope * f64::from(index)
    }

    /// Whether it surely passes by the pair of which the second pixel has an index, which it crosses at `crossing`.
    #[inline(always)]
    fn misses(&self, crossing: f64, second: u32) -> bool {
        (crossing - (f64::from(second) - 0.5)).abs() > self.reach
    }

    /// The columns in which it may pass above or below a pixel of a row: `|start + slope c - r| <= reach
    /// + 1/2`.
    #[inline(always)]
    fn columns_near(&self, row: u32, columns: Range<u32>) -> Range<u32> {
        // A line that is level within its row gets a slope that moves it by less than the second constant.
        let slope = if self.slope.abs() < 1e-9 { 1e-9 } else { self.slope };
        let reach = 0.5 + 1e-4 + self.reach;
        let (middle, half) = ((f64::from(row) - self.start) / slope, (reach / slope).abs());
        // What is not a number leaves all columns.
        let start = (middle - half).max(f64::from(columns.start)) as u32;
        let end = (middle + half).min(f64::from(columns.end - 1)) as i64 + 1;
        start..end.max(0) as u32
    }
}
