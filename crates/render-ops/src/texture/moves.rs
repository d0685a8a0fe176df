//! The gradients of coordinates, differentials, level and bias.
//!
//! A probe at `u + t_k D v_1` gives its gradient `u_bar` to the coordinates u, and `t_k u_bar` to the
//! longer axis `D v_1` of the footprint. The differentials D get theirs from that axis, and by `footprint`
//! from the direction `v_1` and the level.

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Scalar, sum};

use super::chart::Chart;
use super::lanes::LANES;
use super::lookup::Lookup;
use super::values::Values;

/// Samples in one piece of work.
const SAMPLES_PER_PIECE: usize = 1 << 11;

/// The gradients of all samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Upstream<'a, T> {
    pub(super) count: usize,
    pub(super) bars: &'a [T],
    pub(super) channels: usize,
}

/// The inputs whose gradients are wanted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub(super) coordinates: Option<usize>,
    pub(super) differentials: Option<usize>,
    /// The level, or the bias.
    pub(super) level: Option<usize>,
}

/// Adds the gradients that are wanted: those of groups of `N` channels, in `L` numbers each.
pub(super) fn add_moves<T: Scalar, C: Chart<K>, const K: usize, const N: usize, const L: usize>(
    values: Values<'_, T, C, K>,
    wanted: Wanted,
    Upstream { count, bars, channels }: Upstream<'_, T>,
    rows: &mut Vec<T>,
    gradients: &mut Accumulators<'_, T>,
) {
    let _ = channels;
    let several = values.lookup.filter.probes() > 1;
    if let Wanted { coordinates: Some(input), differentials: None, level: None } = wanted {
        let Some(coordinates_bar) = gradients.get(input) else { return };
        let (entries, is_fresh) = coordinates_bar.entries_or_fresh();
        return for_each_piece_mut(entries, K * SAMPLES_PER_PIECE, |piece, entries| {
            pulp::Arch::new().dispatch(
                #[inline(always)]
                || {
                    // Moved, so that the closure can run only once and is inlined here.
                    let (start, entries) = (piece * SAMPLES_PER_PIECE, entries);
                    if is_fresh {
                        entries.fill(T::ZERO);
                    }
                    let rows = entries.as_chunks_mut::<K>().0;
                    let samples = start..start + rows.len();
                    values.pull_back::<N, L>(
                        samples,
                        bars,
                        false,
                        #[inline(always)]
                        |probes, moves| {
                            let mut own = [[T::ZERO; LANES]; K];
                            let chart = values.lookup.chart;
                            chart.pull_back_all(
                                &probes.coordinates,
                                probes.count,
                                &moves.at,
                                &mut own,
                            );
                            if several {
                                for i in 0..probes.count {
                                    let row = &mut rows[probes.samples[i] - start];
                                    for k in 0..K {
                                        row[k] += own[k][i];
                                    }
                                }
                                return;
                            }
                            let rows = &mut rows[probes.samples[0] - start..][..probes.count];
                            for (i, row) in rows.iter_mut().enumerate() {
                                for k in 0..K {
                                    row[k] += own[k][i];
                                }
                            }
                        },
                    );
                },
            );
        });
    }
    let with_slopes = wanted.differentials.is_some();
    // Of the coordinates, the differentials and the level.
    let widths = [K, 2 * K, 1];
    let starts = [0, K, 3 * K];
    let width = 3 * K + 1;
    rows.clear();
    rows.resize(count * width, T::ZERO);
    for_each_piece_mut(rows, width * SAMPLES_PER_PIECE, |piece, rows| {
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let (start, rows) = (piece * SAMPLES_PER_PIECE, rows);
                let samples = start..start + rows.len() / width;
                values.pull_back::<N, L>(
                    samples.clone(),
                    bars,
                    true,
                    #[inline(always)]
                    |probes, moves| {
                        let mut own = [[T::ZERO; LANES]; K];
                        let chart = values.lookup.chart;
                        chart.pull_back_all(&probes.coordinates, probes.count, &moves.at, &mut own);
                        for i in 0..probes.count {
                            let row = &mut rows[(probes.samples[i] - start) * width..][..width];
                            for k in 0..K {
                                row[k] += own[k][i];
                                // The gradient of the longer axis, for the time being.
                                row[K + k] += probes.offsets[i] * own[k][i];
                            }
                            row[3 * K] += moves.levels[i];
                        }
                    },
                );
                if with_slopes {
                    for (n, row) in samples.zip(rows.chunks_exact_mut(width)) {
                        pull_back_footprint(&values.lookup, n, row);
                    }
                }
            },
        );
    });
    let inputs = [wanted.coordinates, wanted.differentials, wanted.level];
    for (part, input) in inputs.into_iter().enumerate() {
        let Some(own_bar) = input.and_then(|input| gradients.get(input)) else { continue };
        let (entries, is_fresh) = own_bar.entries_or_fresh();
        let (start, own) = (starts[part], widths[part]);
        if entries.len() != count * own {
            // One number for all samples.
            let total = T::narrow(sum::<T>(count, |n| rows[n * width + start].widen()));
            entries[0] = if is_fresh { total } else { entries[0] + total };
            continue;
        }
        for_each_piece_mut(entries, own * SAMPLES_PER_PIECE, |piece, entries| {
            let rows = rows[piece * SAMPLES_PER_PIECE * width..].chunks_exact(width);
            for (entries, row) in entries.chunks_exact_mut(own).zip(rows) {
                for (entry, &bar) in entries.iter_mut().zip(&row[start..]) {
                    *entry = if is_fresh { bar } else { *entry + bar };
                }
            }
        });
    }
}

/// Turns the gradients of the longer axis and of the level of sample n, in its row, into those of its
/// differentials and its level.
#[inline(always)]
fn pull_back_footprint<T: Scalar, C: Chart<K>, const K: usize>(
    lookup: &Lookup<'_, T, C, K>,
    n: usize,
    row: &mut [T],
) {
    let Some(differentials) = lookup.differentials else { return };
    let Some(footprint) = lookup.footprint(n) else { return };
    let (coordinates, slopes) = (lookup.coordinates[n], differentials[n]);
    let (mut axis_bar, level_bar) = ([T::ZERO; K], row[3 * K]);
    axis_bar.copy_from_slice(&row[K..2 * K]);
    row[K..3 * K].fill(T::ZERO);
    if footprint.probes == 1 && !lookup.is_free(n) {
        return;
    }
    let direction = footprint.direction();
    let mut v_bar = [T::ZERO; 2];
    for i in 0..K {
        for k in 0..2 {
            v_bar[k] += slopes[i][k] * axis_bar[i];
            row[K + 2 * i + k] += axis_bar[i] * direction[k];
        }
    }
    let j = lookup.slopes(coordinates, slopes);
    let j_bar = lookup.along_face(footprint.pull_back(j, level_bar, v_bar));
    let (own, own_slopes) = lookup.chart.pull_back_slopes(coordinates, slopes, j_bar);
    for i in 0..K {
        row[i] += own[i];
        for k in 0..2 {
            row[K + 2 * i + k] += own_slopes[i][k];
        }
    }
}
