//! Samples of a level at a place, and how they change with the place.

use bokashi_core::Scalar;

use super::chart::{Chart, Place};

/// The texels of a level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Level<'a, T> {
    /// `[faces, rows, columns, channels]`.
    pub(super) texels: &'a [T],
    /// Rows and columns.
    pub(super) extents: [usize; 2],
    pub(super) channels: usize,
}

/// The four texels around a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell<T> {
    pub(super) face: usize,
    /// Row and column of the upper left texel, from -1 on.
    pub(super) at: [isize; 2],
    /// f and g: how far the place lies from it to the right and down.
    pub(super) fractions: [T; 2],
}

impl<T: Scalar> Cell<T> {
    /// The cell of a place on a level of such extents, where there is one. With `is_nearest` the
    /// fractions are 0 and the nearest texel is the upper left texel.
    #[inline(always)]
    pub(super) fn of<const K: usize>(
        chart: impl Chart<K>,
        place: Place<T>,
        [rows, columns]: [usize; 2],
        is_nearest: bool,
    ) -> Option<Self> {
        let [x, y] = place.at;
        if is_nearest {
            let [x, y] = [(x, columns), (y, rows)].map(|(at, extent)| at.to_f64() * extent as f64);
            if chart.ends() && !(x >= 0.0 && y >= 0.0 && x < columns as f64 && y < rows as f64) {
                return None;
            }
            let at = [(y, rows), (x, columns)]
                .map(|(at, extent)| (at as isize).min(extent as isize - 1));
            return Some(Self { face: place.face, at, fractions: [T::ZERO; 2] });
        }
        let half = T::from_f64(0.5);
        let x = x * T::from_f64(columns as f64) - half;
        let y = y * T::from_f64(rows as f64) - half;
        let (left, upper) = (x.to_f64().floor(), y.to_f64().floor());
        if chart.ends()
            && !(left >= -1.0 && upper >= -1.0 && left < columns as f64 && upper < rows as f64)
        {
            return None;
        }
        let fractions = [x - T::from_f64(left), y - T::from_f64(upper)];
        Some(Self { face: place.face, at: [upper as isize, left as isize], fractions })
    }
}

impl<T: Scalar> Level<'_, T> {
    /// `N` channels, from `first` on, of the four texels of a cell: the upper left and right, the lower
    /// left and right.
    #[inline(always)]
    pub(super) fn corners<const K: usize, const N: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        first: usize,
    ) -> [[T; N]; 4] {
        let [rows, columns] = self.extents;
        let [row, column] = cell.at;
        let is_inside =
            row >= 0 && column >= 0 && row + 1 < rows as isize && column + 1 < columns as isize;
        if !is_inside {
            return self.corners_beyond(chart, cell, first);
        }
        let line = columns * self.channels;
        let upper =
            (cell.face * rows + row as usize) * line + column as usize * self.channels + first;
        let pair = |at: usize| {
            let texels = &self.texels[at..at + self.channels + N];
            let right = &texels[self.channels..];
            [std::array::from_fn(|c| texels[c]), std::array::from_fn(|c| right[c])]
        };
        let ([a, b], [c, d]) = (pair(upper), pair(upper + line));
        [a, b, c, d]
    }

    #[cold]
    #[inline(never)]
    fn corners_beyond<const K: usize, const N: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        first: usize,
    ) -> [[T; N]; 4] {
        let [row, column] = cell.at;
        [[row, column], [row, column + 1], [row + 1, column], [row + 1, column + 1]].map(|at| {
            let texels = chart.beyond(self.extents, cell.face, at);
            let mut sum = [T::ZERO; N];
            for &[face, row, column] in texels.iter() {
                let at = (face * self.extents[0] + row) * self.extents[1] + column;
                let texel = &self.texels[at * self.channels + first..][..N];
                sum.iter_mut().zip(texel).for_each(|(sum, &texel)| *sum += texel);
            }
            match texels.count {
                0 | 1 => sum,
                count => sum.map(|sum| sum / T::from_f64(count as f64)),
            }
        })
    }

    /// `N` channels of the bilinear sample in a cell.
    #[inline(always)]
    pub(super) fn sample<const K: usize, const N: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        first: usize,
    ) -> [T; N] {
        mixed(&self.corners(chart, cell, first), cell.fractions)
    }

    /// `N` channels of the bilinear sample in a cell, and the derivatives of B . `bars` along the
    /// place's two axes.
    #[inline(always)]
    pub(super) fn sample_along<const K: usize, const N: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        first: usize,
        bars: &[T; N],
    ) -> ([T; N], [T; 2]) {
        let [a, b, c, d] = self.corners::<K, N>(chart, cell, first);
        let [f, g] = cell.fractions;
        let (mut value, mut slopes) = ([T::ZERO; N], [T::ZERO; 2]);
        for k in 0..N {
            let (upper, lower) = (b[k] - a[k], d[k] - c[k]);
            let down = (c[k] - a[k]) + f * (lower - upper);
            value[k] = a[k] + f * upper + g * down;
            slopes[0] += bars[k] * (upper + g * (lower - upper));
            slopes[1] += bars[k] * down;
        }
        let [rows, columns] = self.extents.map(|extent| T::from_f64(extent as f64));
        (value, [columns * slopes[0], rows * slopes[1]])
    }
}

/// In this form texels that are all the same come out exactly.
#[inline(always)]
fn mixed<T: Scalar, const N: usize>([a, b, c, d]: &[[T; N]; 4], [f, g]: [T; 2]) -> [T; N] {
    std::array::from_fn(|k| {
        let upper = a[k] + f * (b[k] - a[k]);
        let lower = c[k] + f * (d[k] - c[k]);
        upper + g * (lower - upper)
    })
}
