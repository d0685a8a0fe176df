//! Where samples are taken: from coordinates to blocks of probes.

use std::ops::{Range, RangeInclusive};

use bokashi_core::Scalar;

use super::cells::{Extents, Rounding, integer};
use super::chart::{Chart, Places};
use super::footprint::Footprint;
use super::lanes::{LANES, Lanes};
use super::options::TextureFilter;

/// A probe of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Probe {
    pub(super) sample: usize,
    /// Its number among the sample's probes.
    pub(super) number: usize,
}

impl Probe {
    /// The first probe of a sample.
    pub(super) fn first_of(sample: usize) -> Self {
        Self { sample, number: 0 }
    }
}

/// A block of probes, in the order of their samples.
#[derive(Debug)]
pub(super) struct Probes<T, const K: usize> {
    pub(super) count: usize,
    pub(super) samples: Lanes<usize>,
    /// Their numbers among the probes of their samples.
    pub(super) numbers: Lanes<u8>,
    pub(super) coordinates: [Lanes<T>; K],
    /// `t_k`: where they are along the longer axis of the footprint.
    pub(super) offsets: Lanes<T>,
    /// Their shares in their samples.
    pub(super) shares: Lanes<T>,
    /// lambda, among the levels that there are.
    pub(super) levels: Lanes<T>,
    /// The fraction of lambda.
    pub(super) fractions: Lanes<T>,
    pub(super) places: Places<T>,
    /// Twice the finer level, and 1 more where the level is free.
    keys: Lanes<u32>,
}

/// Neighbouring probes of a block that are taken from the same levels.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    pub(super) lanes: Range<usize>,
    /// The finer level.
    pub(super) level: usize,
    /// Whether the level moves with what it follows from. Only then the next level counts, too.
    pub(super) is_free: bool,
}

impl Segment {
    /// The levels that count.
    #[inline(always)]
    pub(super) fn levels(&self) -> RangeInclusive<usize> {
        self.level..=self.level + usize::from(self.is_free)
    }
}

impl<T: Scalar, const K: usize> Probes<T, K> {
    pub(super) fn new() -> Self {
        Self {
            count: 0,
            samples: [0; LANES],
            numbers: [0; LANES],
            coordinates: [[T::ZERO; LANES]; K],
            offsets: [T::ZERO; LANES],
            shares: [T::ONE; LANES],
            levels: [T::ZERO; LANES],
            fractions: [T::ZERO; LANES],
            places: Places::new(),
            keys: [0; LANES],
        }
    }

    /// The segment that begins with a lane.
    #[inline(always)]
    pub(super) fn segment(&self, first: usize) -> Segment {
        let keys = &self.keys[first..self.count];
        let key = keys[0];
        // Mostly they are all the same, which no loop with an early end finds out as fast.
        let end = if keys.iter().fold(true, |all, other| all & (*other == key)) {
            keys.len()
        } else {
            keys.iter().take_while(|other| **other == key).count()
        };
        Segment {
            lanes: first..(first + end).min(LANES),
            level: key as usize / 2,
            is_free: key % 2 == 1,
        }
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

/// Changes of places along the axes of a face, in texels.
#[inline(always)]
fn in_texels<T: Scalar>([columns, rows]: [T; 2], [s, t]: [[T; 2]; 2]) -> [[T; 2]; 2] {
    [[columns * s[0], columns * s[1]], [rows * t[0], rows * t[1]]]
}

/// Adds the numbers of some samples, or the number of all, to `levels`.
#[inline(always)]
fn add_numbers<T: Scalar>(numbers: &[T], samples: Range<usize>, levels: &mut [T]) {
    match numbers {
        [number] => levels.iter_mut().for_each(|level| *level += *number),
        numbers => {
            let numbers = &numbers[samples];
            levels.iter_mut().zip(numbers).for_each(|(level, number)| *level += *number);
        }
    }
}

impl<T: Scalar, C: Chart<K>, const K: usize> Lookup<'_, T, C, K> {
    /// How a place changes from pixel to pixel, in texels of level 0.
    #[inline(always)]
    pub(super) fn slopes(&self, coordinates: [T; K], slopes: [[T; 2]; K]) -> [[T; 2]; 2] {
        in_texels(self.extents[0].scale, self.chart.slopes(coordinates, slopes))
    }

    /// The gradients of the slopes of a place from those of [`Lookup::slopes`].
    #[inline(always)]
    pub(super) fn along_face(&self, [s_bar, t_bar]: [[T; 2]; 2]) -> [[T; 2]; 2] {
        let [columns, rows] = self.extents[0].scale;
        [s_bar.map(|bar| columns * bar), t_bar.map(|bar| rows * bar)]
    }

    /// How places become cells.
    #[inline(always)]
    pub(super) fn rounding(&self) -> Rounding {
        Rounding { to_nearest: self.filter == TextureFilter::Nearest, ends: self.chart.ends() }
    }

    /// Whether a level, before it is bounded, moves with what it follows from.
    #[inline(always)]
    pub(super) fn is_free(&self, level: T) -> bool {
        let top = T::from_f64((self.extents.len() - 1) as f64);
        self.filter.mixes_levels() && level > T::ZERO && level < top
    }

    /// Finds the levels of some samples before they are bounded.
    #[inline(always)]
    pub(super) fn find_levels(&self, samples: Range<usize>, levels: &mut [T]) {
        if let Some(known) = self.known {
            return levels.copy_from_slice(&known[samples]);
        }
        levels.fill(T::ZERO);
        if let Some(numbers) = self.level {
            return add_numbers(numbers, samples, levels);
        }
        let Some(differentials) = self.differentials else { return };
        let scale = self.extents[0].scale;
        let (coordinates, slopes) =
            (&self.coordinates[samples.clone()], &differentials[samples.clone()]);
        let count = levels.len();
        let (coordinates, slopes) = (&coordinates[..count], &slopes[..count]);
        if self.filter.probes() == 1 {
            for i in 0..count {
                let slopes = in_texels(scale, self.chart.slopes(coordinates[i], slopes[i]));
                levels[i] = Footprint::new(slopes, 1).level();
            }
        } else {
            for i in 0..count {
                let slopes = in_texels(scale, self.chart.slopes(coordinates[i], slopes[i]));
                levels[i] = Footprint::new(slopes, self.filter.probes()).level();
            }
        }
        if let Some(bias) = self.bias {
            add_numbers(bias, samples, levels);
        }
    }

    /// Fills a block with probes of the samples before `end`, and says which probe comes next.
    #[inline(always)]
    pub(super) fn fill(&self, probes: &mut Probes<T, K>, first: Probe, end: usize) -> Probe {
        probes.count = 0;
        let next = self.add(probes, first, end, LANES);
        self.settle(probes);
        next
    }

    /// Adds probes of the samples before `end` to a block, at most `most`, and says which probe comes
    /// next.
    #[inline(always)]
    pub(super) fn add(
        &self,
        probes: &mut Probes<T, K>,
        first: Probe,
        end: usize,
        most: usize,
    ) -> Probe {
        if self.filter.probes() > 1 {
            return self.add_several(probes, first, end, most);
        }
        let before = probes.count;
        let count = most.min(end - first.sample).min(LANES - before);
        let samples = first.sample..first.sample + count;
        probes.count += count;
        let lanes = before..before + count;
        for (k, sample) in probes.samples[lanes.clone()].iter_mut().enumerate() {
            *sample = first.sample + k;
        }
        let from = &self.coordinates[samples.clone()];
        for k in 0..K {
            let coordinates = &mut probes.coordinates[k][lanes.clone()];
            for (coordinate, from) in coordinates.iter_mut().zip(from) {
                *coordinate = from[k];
            }
        }
        self.find_levels(samples, &mut probes.levels[lanes]);
        Probe::first_of(first.sample + count)
    }

    /// [`Lookup::add`] where samples may have several probes.
    #[inline(always)]
    fn add_several(
        &self,
        probes: &mut Probes<T, K>,
        mut next: Probe,
        end: usize,
        most: usize,
    ) -> Probe {
        let full = LANES.min(probes.count + most);
        while next.sample < end && probes.count < full {
            let n = next.sample;
            let (coordinates, slopes) =
                (self.coordinates[n], self.differentials.map_or([[T::ZERO; 2]; K], |all| all[n]));
            let footprint = Footprint::new(self.slopes(coordinates, slopes), self.filter.probes());
            let level = match (self.known, self.bias) {
                (Some(known), _) => known[n],
                (None, None) => footprint.level(),
                (None, Some(&[bias])) => footprint.level() + bias,
                (None, Some(bias)) => footprint.level() + bias[n],
            };
            let [x, y] = footprint.direction();
            let several = footprint.probes > 1;
            let share = T::from_f64(1.0 / footprint.probes as f64);
            while next.number < footprint.probes && probes.count < full {
                let i = probes.count;
                let offset = if several { footprint.offset(next.number) } else { T::ZERO };
                probes.samples[i] = n;
                probes.numbers[i] = next.number as u8;
                probes.offsets[i] = offset;
                probes.shares[i] = share;
                probes.levels[i] = level;
                for k in 0..K {
                    let along = slopes[k][0] * x + slopes[k][1] * y;
                    probes.coordinates[k][i] =
                        if several { coordinates[k] + offset * along } else { coordinates[k] };
                }
                probes.count += 1;
                next.number += 1;
            }
            if next.number >= footprint.probes {
                next = Probe::first_of(n + 1);
            }
        }
        next
    }

    /// Works out the levels and the places of a block's probes.
    #[inline(always)]
    pub(super) fn settle(&self, probes: &mut Probes<T, K>) {
        let count = probes.count;
        let coarsest = (self.extents.len() - 1) as f64;
        let top = T::from_f64(coarsest);
        let levels = &mut probes.levels[..count];
        let (keys, fractions) = (&mut probes.keys[..count], &mut probes.fractions[..count]);
        if self.filter.mixes_levels() {
            for i in 0..levels.len() {
                let level = levels[i];
                let is_free = level > T::ZERO && level < top;
                let outside = if level <= T::ZERO { T::ZERO } else { top };
                let level = if is_free { level } else { outside };
                let finer = level.to_f64().floor();
                levels[i] = level;
                fractions[i] = level - T::from_f64(finer);
                // Neighbours with one key are worked on together: the same finer level, with or without the
                // coarser one.
                keys[i] = 2 * integer(finer) as u32 + u32::from(is_free);
            }
        } else {
            for i in 0..levels.len() {
                let nearest = (levels[i].to_f64() + 0.5).floor();
                let nearest = if nearest > 0.0 { nearest } else { 0.0 };
                let nearest = if nearest < coarsest { nearest } else { coarsest };
                levels[i] = T::from_f64(nearest);
                keys[i] = 2 * integer(nearest) as u32;
            }
        }
        self.chart.locate_all(&probes.coordinates, count, &mut probes.places);
    }
}
