//! Where samples are taken: from coordinates to cells of levels.

use bokashi_core::Scalar;

use super::cell::{Cell, Extents};
use super::chart::{Chart, Place};
use super::footprint::Footprint;
use super::options::TextureFilter;
use super::texels::{Touch, Touches};

/// Which part of the texture a sample is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot<T, const K: usize> {
    pub(super) coordinates: [T; K],
    /// The finer level.
    pub(super) level: usize,
    /// The coarser level's share; nothing where the level is not free.
    pub(super) fraction: T,
    /// Whether the level moves with what it follows from.
    pub(super) is_free: bool,
    pub(super) footprint: Option<Footprint<T>>,
    /// The longer axis of the footprint, as a change of the coordinates.
    axis: [T; K],
    pub(super) probes: usize,
}

impl<T: Scalar, const K: usize> Spot<T, K> {
    /// The coordinates of a probe.
    #[inline(always)]
    pub(super) fn probe(&self, k: usize) -> [T; K] {
        match &self.footprint {
            Some(footprint) if self.probes > 1 => {
                let offset = footprint.offset(k);
                std::array::from_fn(|i| self.coordinates[i] + offset * self.axis[i])
            }
            _ => self.coordinates,
        }
    }

    /// The share of a probe in its sample.
    #[inline(always)]
    pub(super) fn share(&self) -> T {
        if self.probes == 1 { T::ONE } else { T::from_f64(1.0 / self.probes as f64) }
    }

    /// The levels that it is taken from.
    #[inline(always)]
    fn levels(&self) -> std::ops::RangeInclusive<usize> {
        self.level..=self.level + usize::from(self.is_free)
    }
}

/// Where the samples of a texture are taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lookup<'a, T, C, const K: usize> {
    pub(super) chart: C,
    pub(super) filter: TextureFilter,
    pub(super) coordinates: &'a [[T; K]],
    pub(super) level: Option<&'a [T]>,
    pub(super) differentials: Option<&'a [[[T; 2]; K]]>,
    pub(super) bias: Option<&'a [T]>,
    /// The level of each sample, where the forward pass has found it.
    pub(super) known: Option<&'a [T]>,
    /// Of all levels, the finest first.
    pub(super) extents: &'a [Extents<T>],
}

impl<T: Scalar, C: Chart<K>, const K: usize> Lookup<'_, T, C, K> {
    /// How a place changes from pixel to pixel, in texels of level 0.
    #[inline(always)]
    pub(super) fn slopes(&self, coordinates: [T; K], slopes: [[T; 2]; K]) -> [[T; 2]; 2] {
        let [columns, rows] = self.extents[0].scale;
        let [s, t] = self.chart.slopes(coordinates, slopes);
        [s.map(|slope| columns * slope), t.map(|slope| rows * slope)]
    }

    /// The gradients of the slopes of a place from those of [`Lookup::slopes`].
    #[inline(always)]
    pub(super) fn along_face(&self, [s_bar, t_bar]: [[T; 2]; 2]) -> [[T; 2]; 2] {
        let [columns, rows] = self.extents[0].scale;
        [s_bar.map(|bar| columns * bar), t_bar.map(|bar| rows * bar)]
    }

    /// The level of sample n before it is bounded.
    #[inline(always)]
    pub(super) fn level(&self, n: usize) -> T {
        let of = |numbers: &[T]| if numbers.len() == 1 { numbers[0] } else { numbers[n] };
        match (self.level, self.differentials) {
            (Some(level), _) => of(level),
            (None, Some(differentials)) => {
                let slopes = self.slopes(self.coordinates[n], differentials[n]);
                let footprint = Footprint::of(slopes, self.filter.probes());
                footprint.level() + self.bias.map_or(T::ZERO, of)
            }
            _ => T::ZERO,
        }
    }

    /// The spot of sample n, with its footprint where that is asked for or makes probes.
    #[inline(always)]
    pub(super) fn spot(&self, n: usize, with_footprint: bool) -> Spot<T, K> {
        let coordinates = self.coordinates[n];
        let mut spot = Spot {
            coordinates,
            level: 0,
            fraction: T::ZERO,
            is_free: false,
            footprint: None,
            axis: [T::ZERO; K],
            probes: 1,
        };
        if let Some(differentials) = self.differentials
            && (with_footprint || self.filter.probes() > 1)
        {
            let slopes = differentials[n];
            let footprint = Footprint::of(self.slopes(coordinates, slopes), self.filter.probes());
            if footprint.probes > 1 {
                let [x, y] = footprint.direction();
                spot.axis = slopes.map(|slope| slope[0] * x + slope[1] * y);
                spot.probes = footprint.probes;
            }
            spot.footprint = Some(footprint);
        }
        let level = match self.known {
            Some(known) => known[n],
            None => self.level(n),
        };
        let coarsest = self.extents.len() - 1;
        if !self.filter.mixes_levels() {
            let nearest = (level.to_f64() + 0.5).max(0.0);
            spot.level = (nearest as usize).min(coarsest);
        } else if level > T::ZERO && level < T::from_f64(coarsest as f64) {
            spot.level = level.to_f64() as usize;
            spot.fraction = level - T::from_f64(spot.level as f64);
            spot.is_free = true;
        } else if !(level <= T::ZERO) {
            spot.level = coarsest;
        }
        spot
    }

    /// The cell of a place on a level.
    #[inline(always)]
    pub(super) fn cell(&self, place: Place<T>, level: usize) -> Option<Cell<T>> {
        let extents = &self.extents[level];
        if self.filter == TextureFilter::Nearest {
            Cell::nearest(place, extents, self.chart.ends())
        } else {
            Cell::around(place, extents, self.chart.ends())
        }
    }
}

impl<T: Scalar, C: Chart<K>, const K: usize> Touches<T> for Lookup<'_, T, C, K> {
    #[inline(always)]
    fn for_each(&self, n: usize, mut touch: impl FnMut(usize, usize, Cell<T>)) {
        let spot = self.spot(n, false);
        for probe in 0..spot.probes {
            let place = self.chart.place(spot.probe(probe));
            for level in spot.levels() {
                if let Some(cell) = self.cell(place, level) {
                    touch(probe, level, cell);
                }
            }
        }
    }

    #[inline(always)]
    fn touch(&self, n: usize, probe: usize, level: usize) -> Touch<T> {
        let spot = self.spot(n, false);
        let place = self.chart.place(spot.probe(probe));
        let cell = self.cell(place, level).expect("it was found there before");
        let mut weight = spot.share();
        if spot.is_free {
            let fraction = if level == spot.level { T::ONE - spot.fraction } else { spot.fraction };
            weight = weight * fraction;
        }
        Touch { cell, weight }
    }
}
