//! The gradients of coordinates, differentials, level and bias.
//!
//! # Backward
//! A probe at `u + t_k D v_1` gives its gradient `u_bar` to the coordinates u, and `t_k u_bar` to the
//! longer axis `D v_1` of the footprint. The differentials D get theirs from that axis, and by `footprint`
//! from the direction `v_1` and the level. Where the chart is curved, so do the coordinates.

use std::ops::Range;

use bokashi_core::parallel::{for_each_piece_mut, for_each_two_pieces_mut};
use bokashi_core::{Accumulator, Accumulators, Scalar, sum};

use super::chart::Chart;
use super::footprint::Footprint;
use super::lanes::LANES;
use super::lookup::Lookup;
use super::values::Values;

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

/// The gradients of the footprints of all samples, or of some.
#[derive(Debug, Clone, Copy)]
struct Footprints<'a, T> {
    /// Of each sample a row: the gradient of the longer axis, unless all samples have a single probe;
    /// then the gradient of the level.
    rows: &'a [T],
    width: usize,
}

impl<'a, T: Scalar> Footprints<'a, T> {
    /// Those of some samples.
    #[inline(always)]
    fn of_samples(self, samples: Range<usize>) -> Self {
        let rows = &self.rows[samples.start * self.width..samples.end * self.width];
        Self { rows, ..self }
    }

    /// The gradients of the longer axis and of the level of sample `n`.
    #[inline(always)]
    fn of<const K: usize>(self, n: usize) -> ([T; K], T) {
        let row = &self.rows[n * self.width..][..self.width];
        match row.split_first_chunk::<K>() {
            Some((&axis_bar, &[level_bar])) => (axis_bar, level_bar),
            _ => ([T::ZERO; K], row[0]),
        }
    }

    /// The gradient of the level of sample `n`.
    fn level(self, n: usize) -> T {
        self.rows[(n + 1) * self.width - 1]
    }
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
    let width = if lookup.filter.probes() > 1 { K + 1 } else { 1 };
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
            let (own, is_fresh) = coordinates_bar.entries_or_fresh();
            let pull_back = |piece: usize, own: &mut [T], rows: &mut [T]| {
                if is_fresh {
                    own.fill(T::ZERO);
                }
                pull_back(piece, own, rows);
            };
            if rows.is_empty() {
                for_each_piece_mut(own, lengths[0], |piece, own| pull_back(piece, own, &mut []));
            } else {
                for_each_two_pieces_mut(own, rows, lengths, pull_back);
            }
            if is_bent {
                add_bends(lookup, Footprints { rows, width }, own);
            }
        }
    }
    let footprints = Footprints { rows, width };
    if let Some(differentials_bar) = wanted.differentials.and_then(|input| gradients.get(input)) {
        add_to_differentials(lookup, footprints, differentials_bar);
    }
    if let Some(level_bar) = wanted.level.and_then(|input| gradients.get(input)) {
        let entries = level_bar.entries();
        if let [entry] = entries {
            // It may be the level of all samples.
            *entry += T::narrow(sum::<T>(count, |n| footprints.level(n).widen()));
        } else {
            entries.iter_mut().enumerate().for_each(|(n, entry)| *entry += footprints.level(n));
        }
    }
}

/// Adds the gradients of the probes of some samples, from sample `start` on, to those of their
/// coordinates and of their footprints; not to what is empty.
fn pull_back_probes<T: Scalar, C: Chart<K>, const K: usize, const N: usize, const L: usize>(
    values: Values<'_, T, C, K>,
    start: usize,
    bars: &[T],
    coordinates: &mut [T],
    rows: &mut [T],
) {
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || {
            // Moved, so that the closure can run only once and is inlined here.
            let (coordinates, rows) = (coordinates.as_chunks_mut::<K>().0, rows);
            let chart = values.lookup.chart;
            let width = if values.lookup.filter.probes() > 1 { K + 1 } else { 1 };
            let count = coordinates.len().max(rows.len() / width);
            values.pull_back::<N, L>(
                start..start + count,
                bars,
                !rows.is_empty(),
                #[inline(always)]
                |probes, moves| {
                    let mut own = [[T::ZERO; LANES]; K];
                    chart.pull_back_all(&probes.coordinates, probes.count, &moves.at, &mut own);
                    let first = probes.samples[0] - start;
                    if width == 1 {
                        // Each sample has a single probe.
                        for (i, row) in coordinates.iter_mut().skip(first).take(LANES).enumerate() {
                            for k in 0..K {
                                row[k] += own[k][i];
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
                                row[k] += own[k][i];
                            }
                        }
                        if let Some(row) = rows.get_mut(n * width..(n + 1) * width) {
                            for k in 0..K {
                                row[k] += probes.offsets[i] * own[k][i];
                            }
                            row[K] += moves.levels[i];
                        }
                    }
                },
            );
        },
    );
}

/// Adds to the gradients of coordinates what comes from their footprints.
fn add_bends<T: Scalar, C: Chart<K>, const K: usize>(
    lookup: &Lookup<'_, T, C, K>,
    footprints: Footprints<'_, T>,
    coordinates_bar: &mut [T],
) {
    for_each_piece_mut(coordinates_bar, K * SAMPLES_PER_PIECE, |piece, entries| {
        let (start, all) = (piece * SAMPLES_PER_PIECE, entries.as_chunks_mut::<K>().0);
        let samples = start..start + all.len();
        let (lookup, footprints) =
            (lookup.of_samples(samples.clone()), footprints.of_samples(samples));
        let most = lookup.filter.probes();
        for (n, own) in all.iter_mut().enumerate() {
            let (bend, _) = pull_back_footprint(&lookup, n, most, footprints.of(n));
            for k in 0..K {
                own[k] += bend[k];
            }
        }
    });
}

/// Adds to the gradients of differentials.
fn add_to_differentials<T: Scalar, C: Chart<K>, const K: usize>(
    lookup: &Lookup<'_, T, C, K>,
    footprints: Footprints<'_, T>,
    differentials_bar: &mut Accumulator<T>,
) {
    let (entries, is_fresh) = differentials_bar.entries_or_fresh();
    for_each_piece_mut(entries, 2 * K * SAMPLES_PER_PIECE, |piece, entries| {
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let (start, entries) = (piece * SAMPLES_PER_PIECE, entries);
                if is_fresh {
                    entries.fill(T::ZERO);
                }
                let all = entries.as_chunks_mut::<2>().0.as_chunks_mut::<K>().0;
                let samples = start..start + all.len();
                let (lookup, footprints) =
                    (lookup.of_samples(samples.clone()), footprints.of_samples(samples));
                match lookup.filter.probes() {
                    // Known beforehand, it makes the loop one of vectors.
                    1 => add_slopes(&lookup, footprints, 1, all),
                    most => add_slopes(&lookup, footprints, most, all),
                }
            },
        );
    });
}

/// Adds to the gradients of the differentials of all samples, with at most `most` probes each.
#[inline(always)]
fn add_slopes<T: Scalar, C: Chart<K>, const K: usize>(
    lookup: &Lookup<'_, T, C, K>,
    footprints: Footprints<'_, T>,
    most: usize,
    all: &mut [[[T; 2]; K]],
) {
    for (n, own) in all.iter_mut().enumerate() {
        let (_, slopes_bar) = pull_back_footprint(lookup, n, most, footprints.of(n));
        for i in 0..K {
            for k in 0..2 {
                own[i][k] += slopes_bar[i][k];
            }
        }
    }
}

/// The gradients of the coordinates and of the differentials of sample `n`, which has at most `most`
/// probes, from those of the longer axis of its footprint and of its level.
#[inline(always)]
fn pull_back_footprint<T: Scalar, C: Chart<K>, const K: usize>(
    lookup: &Lookup<'_, T, C, K>,
    n: usize,
    most: usize,
    (axis_bar, level_bar): ([T; K], T),
) -> ([T; K], [[T; 2]; K]) {
    let mut slopes_bar = [[T::ZERO; 2]; K];
    let Some(differentials) = lookup.differentials else { return ([T::ZERO; K], slopes_bar) };
    let (coordinates, slopes) = (lookup.coordinates[n], differentials[n]);
    let j = lookup.slopes(coordinates, slopes);
    let footprint = Footprint::of(j, most);
    if footprint.probes == 1 && !lookup.is_free(n) {
        return ([T::ZERO; K], slopes_bar);
    }
    let mut v_bar = [T::ZERO; 2];
    if footprint.probes > 1 {
        let direction = footprint.direction();
        for i in 0..K {
            for k in 0..2 {
                v_bar[k] += slopes[i][k] * axis_bar[i];
                slopes_bar[i][k] = axis_bar[i] * direction[k];
            }
        }
    }
    let j_bar = lookup.along_face(footprint.pull_back(j, level_bar, v_bar));
    let (own, by_size) = lookup.chart.pull_back_slopes(coordinates, slopes, j_bar);
    for i in 0..K {
        for k in 0..2 {
            slopes_bar[i][k] += by_size[i][k];
        }
    }
    (own, slopes_bar)
}
