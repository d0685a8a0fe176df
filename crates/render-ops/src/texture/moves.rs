//! The gradients of coordinates, differentials, level and bias.
//!
//! # Backward
//! A probe at `u + t_k D v_1` gives its gradient `u_bar` to the coordinates u, and `t_k u_bar` to the
//! longer axis `D v_1` of the footprint. The differentials D get theirs from that axis, and by `footprint`
//! from the direction `v_1` and the level. Where the chart is curved, so do the coordinates.

use bokashi_core::parallel::{for_each_piece_mut, for_each_two_pieces_mut};
use bokashi_core::{Accumulator, Accumulators, Scalar, sum};

use super::chart::Chart;
use super::footprint::Footprint;
use super::lanes::LANES;
use super::lookup::Lookup;
use super::values::Values;
use crate::dispatch::{dispatch_256, dispatch_special};

/// Samples in one piece of work.
const SAMPLES_PER_PIECE: usize = 1 << 11;

/// The inputs whose gradients are wanted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub(super) coordinates: Option<usize>,
    pub(super) differentials: Option<usize>,
    /// The level, or the bias.
    pub(super) level: Option<usize>,
}

/// The numbers of a row of [`Footprints`], of samples with at most `most` probes of `K` coordinates.
#[inline(always)]
fn width<const K: usize>(most: usize) -> usize {
    if most > 1 { K + 1 } else { 1 }
}

/// Adds the gradients that are wanted, from the upstream gradients `bars` of `count` samples, in groups
/// of `N` channels, of `L` numbers each. `rows` is memory.
pub(super) fn add_moves<T: Scalar, C: Chart<K>, const K: usize, const N: usize, const L: usize>(
    values: Values<'_, T, C, K>,
    wanted: Wanted,
    (count, bars): (usize, &[T]),
    rows: &mut Vec<T>,
    gradients: &mut Accumulators<'_, T>,
) {
    let lookup = &values.lookup;
    let is_bent = C::IS_CURVED && lookup.differentials.is_some() && lookup.filter.mixes_levels();
    let is_asked_for = wanted.differentials.is_some() || wanted.level.is_some();
    let width = width::<K>(lookup.filter.probes());
    rows.resize(if is_asked_for || is_bent { count * width } else { 0 }, T::ZERO);
    let pull_back = |piece: usize, coordinates: &mut [T], rows: &mut [T]| {
        let start = piece * SAMPLES_PER_PIECE;
        rows.fill(T::ZERO);
        pull_back_probes::<T, C, K, N, L>(values, start, bars, coordinates, rows);
    };
    let lengths = [K, width].map(|width| width * SAMPLES_PER_PIECE);
    match wanted.coordinates.and_then(|input| gradients.get(input)) {
        None => for_each_piece_mut(rows, lengths[1], |piece, rows| pull_back(piece, &mut [], rows)),
        Some(coordinates_bar) => {
            let (entries, is_fresh) = coordinates_bar.entries_or_fresh();
            let pull_back = |piece: usize, entries: &mut [T], rows: &mut [T]| {
                if is_fresh {
                    entries.fill(T::ZERO);
                }
                pull_back(piece, entries, rows);
            };
            for_each_two_pieces_mut(entries, rows, lengths, pull_back);
            if is_bent {
                Footprints { lookup: values.lookup, rows }.add_to_coordinates(entries);
            }
        }
    }
    if let Some(differentials_bar) = wanted.differentials.and_then(|input| gradients.get(input)) {
        Footprints { lookup: values.lookup, rows }.add_to_differentials(differentials_bar);
    }
    if let Some(level_bar) = wanted.level.and_then(|input| gradients.get(input)) {
        let of_level = |n: usize| rows[(n + 1) * width - 1];
        match level_bar.entries() {
            // It may be the level of all samples.
            [entry] => *entry += T::narrow(sum::<T>(count, |n| of_level(n).widen())),
            entries => {
                entries.iter_mut().enumerate().for_each(|(n, entry)| *entry += of_level(n));
            }
        }
    }
}

/// Adds the gradients of the probes of some samples, from sample `start` on, to those of their
/// coordinates and of their footprints; not to what is empty.
#[inline(never)]
fn pull_back_probes<T: Scalar, C: Chart<K>, const K: usize, const N: usize, const L: usize>(
    values: Values<'_, T, C, K>,
    start: usize,
    bars: &[T],
    coordinates: &mut [T],
    rows: &mut [T],
) {
    dispatch_special::<T, _, _>(
        (coordinates, rows),
        #[inline(always)]
        |(coordinates, rows)| add_probes::<T, C, K, N, L>(values, start, bars, coordinates, rows),
        |(coordinates, rows)| add_probes_by_channel(values, start, bars, coordinates, rows),
    );
}

/// [`pull_back_probes`], channel by channel.
#[inline(never)]
fn add_probes_by_channel<T: Scalar, C: Chart<K>, const K: usize>(
    values: Values<'_, T, C, K>,
    start: usize,
    bars: &[T],
    coordinates: &mut [T],
    rows: &mut [T],
) {
    add_probes::<T, C, K, 1, 1>(values, start, bars, coordinates, rows);
}

#[inline(always)]
fn add_probes<T: Scalar, C: Chart<K>, const K: usize, const N: usize, const L: usize>(
    values: Values<'_, T, C, K>,
    start: usize,
    bars: &[T],
    coordinates: &mut [T],
    rows: &mut [T],
) {
    let coordinates = coordinates.as_chunks_mut::<K>().0;
    let chart = values.lookup.chart;
    let width = width::<K>(values.lookup.filter.probes());
    let count = coordinates.len().max(rows.len() / width);
    values.pull_back::<N, L>(
        start..start + count,
        bars,
        !rows.is_empty(),
        #[inline(always)]
        |probes, moves| {
            let mut place_bars = [[T::ZERO; LANES]; K];
            chart.pull_back_all(
                &probes.coordinates,
                probes.count,
                &moves.positions,
                &mut place_bars,
            );
            let first = probes.samples[0] - start;
            if width == 1 {
                // Each sample has a single probe.
                for (i, row) in coordinates.iter_mut().skip(first).take(LANES).enumerate() {
                    for k in 0..K {
                        row[k] += place_bars[k][i];
                    }
                }
                for (i, level) in rows.iter_mut().skip(first).take(LANES).enumerate() {
                    *level += moves.levels[i];
                }
                return;
            }
            for i in 0..probes.count {
                let n = probes.samples[i] - start;
                if let Some(row) = coordinates.get_mut(n) {
                    for k in 0..K {
                        row[k] += place_bars[k][i];
                    }
                }
                // A probe lies at `u + t_k D v_1`: its gradient goes on to the axis, times t_k.
                if let Some(row) = rows.get_mut(n * width..(n + 1) * width) {
                    for k in 0..K {
                        row[k] += probes.offsets[i] * place_bars[k][i];
                    }
                    row[K] += moves.levels[i];
                }
            }
        },
    );
}

/// Footprints, and their gradients.
struct Footprints<'a, T, C, const K: usize> {
    lookup: Lookup<'a, T, C, K>,
    /// Of each sample a row: the gradient of the longer axis, unless all samples have a single probe;
    /// then the gradient of the level.
    rows: &'a [T],
}

impl<T: Scalar, C: Chart<K>, const K: usize> Footprints<'_, T, C, K> {
    /// Adds to the gradients of the coordinates.
    fn add_to_coordinates(&self, bars: &mut [T]) {
        for_each_piece_mut(bars, K * SAMPLES_PER_PIECE, |piece, bars| {
            let all = bars.as_chunks_mut::<K>().0;
            self.pull_back(
                piece * SAMPLES_PER_PIECE,
                all,
                #[inline(always)]
                |row, [bar, _, _]| {
                    for k in 0..K {
                        row[k] += bar[k];
                    }
                },
            );
        });
    }

    /// Adds to the gradients of the differentials.
    fn add_to_differentials(&self, differentials_bar: &mut Accumulator<T>) {
        let (bars, is_fresh) = differentials_bar.entries_or_fresh();
        for_each_piece_mut(bars, 2 * K * SAMPLES_PER_PIECE, |piece, bars| {
            if is_fresh {
                bars.fill(T::ZERO);
            }
            let all = bars.as_chunks_mut::<2>().0.as_chunks_mut::<K>().0;
            self.pull_back(
                piece * SAMPLES_PER_PIECE,
                all,
                #[inline(always)]
                |row, [_, along_x, along_y]| {
                    for i in 0..K {
                        row[i][0] += along_x[i];
                        row[i][1] += along_y[i];
                    }
                },
            );
        });
    }

    /// Calls `add(bar, [u_bar, D_x_bar, D_y_bar])` for each sample from sample `start` on, with its
    /// entry of `bars`.
    #[inline(always)]
    fn pull_back<B>(&self, start: usize, bars: &mut [B], add: impl Fn(&mut B, [[T; K]; 3])) {
        let Lookup { differentials: Some(slopes), known: Some(levels), .. } = self.lookup else {
            return;
        };
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let bars = bars;
                // Known beforehand, a single probe makes the loop one of vectors.
                match self.lookup.filter.probes() {
                    1 => self.pull_back_with(1, (slopes, levels), start, bars, add),
                    most => self.pull_back_with(most, (slopes, levels), start, bars, add),
                }
            },
        );
    }

    /// [`Footprints::pull_back`] with at most `most` probes.
    #[inline(always)]
    fn pull_back_with<B>(
        &self,
        most: usize,
        (slopes, levels): (&[[[T; 2]; K]], &[T]),
        start: usize,
        bars: &mut [B],
        add: impl Fn(&mut B, [[T; K]; 3]),
    ) {
        let (count, width) = (bars.len(), width::<K>(most));
        let (slopes, levels) = (&slopes[start..][..count], &levels[start..][..count]);
        let coordinates = &self.lookup.coordinates[start..][..count];
        let rows = &self.rows[start * width..][..count * width];
        for n in 0..count {
            let row = &rows[n * width..(n + 1) * width];
            let mut axis_bar = [T::ZERO; K];
            if width > 1 {
                axis_bar.copy_from_slice(&row[..K]);
            }
            let sample = (coordinates[n], slopes[n], self.lookup.is_free(levels[n]));
            let change = pull_back_footprint(&self.lookup, most, sample, axis_bar, row[width - 1]);
            add(&mut bars[n], change);
        }
    }
}

/// The gradients of the coordinates and of their changes along x and y, from those of the longer axis
/// of the footprint, which has at most `most` probes, and of the level.
#[inline(always)]
fn pull_back_footprint<T: Scalar, C: Chart<K>, const K: usize>(
    lookup: &Lookup<'_, T, C, K>,
    most: usize,
    (coordinates, slopes, is_free): ([T; K], [[T; 2]; K], bool),
    axis_bar: [T; K],
    level_bar: T,
) -> [[T; K]; 3] {
    let j = lookup.slopes(coordinates, slopes);
    let footprint = Footprint::new(j, most);
    let several = footprint.probes > 1;
    let direction = footprint.direction();
    // The axis is `D v_1`: v_1_bar = D' axis_bar, and D_bar has axis_bar v_1'.
    let mut v_bar = [T::ZERO; 2];
    for i in 0..K {
        for k in 0..2 {
            v_bar[k] += slopes[i][k] * axis_bar[i];
        }
    }
    let j_bar = lookup.along_face(footprint.pull_back(j, level_bar, v_bar));
    let (direct, slopes_bar) = lookup.chart.pull_back_slopes(coordinates, slopes, j_bar);
    let mut bars = [direct, [T::ZERO; K], [T::ZERO; K]];
    for i in 0..K {
        for k in 0..2 {
            let by_axis = if several { axis_bar[i] * direction[k] } else { T::ZERO };
            bars[1 + k][i] = slopes_bar[i][k] + by_axis;
        }
    }
    // Without a choice before, which no vector could make.
    for bar in bars.as_flattened_mut() {
        *bar = if several || is_free { *bar } else { T::ZERO };
    }
    bars
}
