//! What samples are: the texels of cells, mixed, and how that changes.

use bokashi_core::Scalar;

use super::cell::{Cell, Extents};
use super::chart::{Chart, Place};
use super::lookup::{Lookup, Spot};

/// The texels of a level, in groups of `N` channels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Level<'a, T, const N: usize> {
    /// `[faces, rows, columns, step]`.
    pub(super) texels: &'a [[T; N]],
    /// Groups of a texel.
    pub(super) step: usize,
    pub(super) extents: Extents<T>,
}

impl<T: Scalar, const N: usize> Level<'_, T, N> {
    /// Group `group` of the four texels of a cell: the upper left and right, the lower left and right.
    #[inline(always)]
    fn corners<const K: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        group: usize,
    ) -> [[T; N]; 4] {
        let [rows, columns] = self.extents.counts;
        let [row, column] = cell.at.map(|at| at as usize);
        // -1 is a large number without a sign.
        if row >= rows - 1 || column >= columns - 1 {
            return self.corners_beyond(chart, cell, group);
        }
        let upper = ((cell.face * rows + row) * columns + column) * self.step + group;
        let lower = upper + columns * self.step;
        let texels = self.texels;
        [texels[upper], texels[upper + self.step], texels[lower], texels[lower + self.step]]
    }

    #[cold]
    #[inline(never)]
    fn corners_beyond<const K: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        group: usize,
    ) -> [[T; N]; 4] {
        let ([row, column], [rows, columns]) = (cell.at, self.extents.counts);
        [[row, column], [row, column + 1], [row + 1, column], [row + 1, column + 1]].map(|at| {
            let beyond = chart.beyond([rows, columns], cell.face, at);
            let mut sum = [T::ZERO; N];
            for &[face, row, column] in beyond.iter() {
                let texel = ((face * rows + row) * columns + column) * self.step + group;
                sum.iter_mut().zip(self.texels[texel]).for_each(|(sum, texel)| *sum += texel);
            }
            match beyond.count {
                0 | 1 => sum,
                count => sum.map(|sum| sum / T::from_f64(count as f64)),
            }
        })
    }

    /// The bilinear sample in a cell. In this form texels that are all the same come out exactly.
    #[inline(always)]
    fn sample<const K: usize>(&self, chart: impl Chart<K>, cell: &Cell<T>, group: usize) -> [T; N] {
        let [a, b, c, d] = self.corners(chart, cell, group);
        let [f, g] = cell.fractions;
        std::array::from_fn(|k| {
            let upper = a[k] + f * (b[k] - a[k]);
            let lower = c[k] + f * (d[k] - c[k]);
            upper + g * (lower - upper)
        })
    }

    /// The bilinear sample B in a cell, and the derivatives of B . `bars` along the face's two axes.
    #[inline(always)]
    fn sample_along<const K: usize>(
        &self,
        chart: impl Chart<K>,
        cell: &Cell<T>,
        group: usize,
        bars: &[T; N],
    ) -> ([T; N], [T; 2]) {
        let [a, b, c, d] = self.corners(chart, cell, group);
        let [f, g] = cell.fractions;
        let (mut value, mut slopes) = ([T::ZERO; N], [T::ZERO; 2]);
        for k in 0..N {
            let (upper, lower) = (b[k] - a[k], d[k] - c[k]);
            let down = (c[k] - a[k]) + f * (lower - upper);
            value[k] = a[k] + f * upper + g * down;
            slopes[0] += bars[k] * (upper + g * (lower - upper));
            slopes[1] += bars[k] * down;
        }
        (value, self.extents.along_face(slopes))
    }
}

/// Samples of levels, by groups of `N` channels.
pub(super) struct Values<'a, T, C, const K: usize, const N: usize> {
    pub(super) lookup: Lookup<'a, T, C, K>,
    pub(super) levels: &'a [Level<'a, T, N>],
}

/// The gradients that a sample gives to its coordinates, to the changes of these from pixel to pixel,
/// and to its level.
pub(super) type Moves<T, const K: usize> = ([T; K], [[T; 2]; K], T);

impl<T: Scalar, C: Chart<K>, const K: usize, const N: usize> Values<'_, T, C, K, N> {
    /// Writes sample n, all its groups.
    #[inline(always)]
    pub(super) fn write(&self, n: usize, out: &mut [[T; N]]) {
        let spot = self.lookup.spot(n, false);
        if spot.probes == 1 {
            let place = self.lookup.chart.place(spot.coordinates);
            for (group, out) in out.iter_mut().enumerate() {
                *out = self.probe(&spot, place, group);
            }
            return;
        }
        out.fill([T::ZERO; N]);
        for k in 0..spot.probes {
            let place = self.lookup.chart.place(spot.probe(k));
            for (group, out) in out.iter_mut().enumerate() {
                let probe = self.probe(&spot, place, group);
                out.iter_mut().zip(probe).for_each(|(out, probe)| *out += probe);
            }
        }
        let share = spot.share();
        out.iter_mut().flatten().for_each(|out| *out = share * *out);
    }

    /// A probe of a spot.
    #[inline(always)]
    fn probe(&self, spot: &Spot<T, K>, place: Place<T>, group: usize) -> [T; N] {
        let finer = self.of_level(spot.level, place, group);
        if !spot.is_free {
            return finer;
        }
        let coarser = self.of_level(spot.level + 1, place, group);
        std::array::from_fn(|c| finer[c] + spot.fraction * (coarser[c] - finer[c]))
    }

    /// The sample of a level.
    #[inline(always)]
    fn of_level(&self, level: usize, place: Place<T>, group: usize) -> [T; N] {
        match self.lookup.cell(place, level) {
            Some(cell) => self.levels[level].sample(self.lookup.chart, &cell, group),
            None => [T::ZERO; N],
        }
    }

    /// The sample of a level, and its derivatives along the face's axes.
    #[inline(always)]
    fn along_level(
        &self,
        level: usize,
        place: Place<T>,
        group: usize,
        bars: &[T; N],
    ) -> ([T; N], [T; 2]) {
        match self.lookup.cell(place, level) {
            Some(cell) => self.levels[level].sample_along(self.lookup.chart, &cell, group, bars),
            None => ([T::ZERO; N], [T::ZERO; 2]),
        }
    }

    /// The gradients of a probe's place and of its level, from those of a group.
    #[inline(always)]
    fn pull_back_probe(
        &self,
        spot: &Spot<T, K>,
        place: Place<T>,
        group: usize,
        bars: &[T; N],
    ) -> ([T; 2], T) {
        let (finer, mut at_bar) = self.along_level(spot.level, place, group, bars);
        let mut level_bar = T::ZERO;
        if spot.is_free {
            let (coarser, other) = self.along_level(spot.level + 1, place, group, bars);
            for i in 0..2 {
                at_bar[i] += spot.fraction * (other[i] - at_bar[i]);
            }
            for c in 0..N {
                level_bar += bars[c] * (coarser[c] - finer[c]);
            }
        }
        (at_bar, level_bar)
    }

    /// The gradients that sample n gives, from the gradients of all its groups.
    #[inline(always)]
    pub(super) fn pull_back(&self, n: usize, bars: &[[T; N]], with_slopes: bool) -> Moves<T, K> {
        let (lookup, chart) = (&self.lookup, self.lookup.chart);
        let spot = lookup.spot(n, with_slopes);
        let share = spot.share();
        let (mut bar, mut axis_bar, mut level_bar) = ([T::ZERO; K], [T::ZERO; K], T::ZERO);
        for k in 0..spot.probes {
            let coordinates = spot.probe(k);
            let place = chart.place(coordinates);
            let mut at_bar = [T::ZERO; 2];
            for (group, bars) in bars.iter().enumerate() {
                let (own, own_level) = self.pull_back_probe(&spot, place, group, bars);
                at_bar[0] += share * own[0];
                at_bar[1] += share * own[1];
                level_bar += share * own_level;
            }
            let own = chart.pull_back(coordinates, at_bar);
            for i in 0..K {
                bar[i] += own[i];
            }
            if let Some(footprint) = spot.footprint.filter(|_| spot.probes > 1) {
                let offset = footprint.offset(k);
                for i in 0..K {
                    axis_bar[i] += offset * own[i];
                }
            }
        }
        let mut slopes_bar = [[T::ZERO; 2]; K];
        if let (Some(footprint), Some(differentials)) = (&spot.footprint, lookup.differentials)
            && with_slopes
            && (spot.is_free || spot.probes > 1)
        {
            let slopes = differentials[n];
            let direction = footprint.direction();
            // The axis is D v.
            let mut v_bar = [T::ZERO; 2];
            for i in 0..K {
                for k in 0..2 {
                    v_bar[k] += slopes[i][k] * axis_bar[i];
                    slopes_bar[i][k] += axis_bar[i] * direction[k];
                }
            }
            let j = lookup.slopes(spot.coordinates, slopes);
            let j_bar = lookup.along_face(footprint.pull_back(j, level_bar, v_bar));
            let (own, own_slopes) = chart.pull_back_slopes(spot.coordinates, slopes, j_bar);
            for i in 0..K {
                bar[i] += own[i];
                for k in 0..2 {
                    slopes_bar[i][k] += own_slopes[i][k];
                }
            }
        }
        (bar, slopes_bar, level_bar)
    }
}
