//! The loops over rows: light by light over a block, so that each becomes vectors.

use std::ops::Range;

use bokashi_core::Scalar;
use smallvec::SmallVec;

use super::blocks::{
    BLOCK, Column, Lanes, MATERIAL, Numbers, Rows, Target, Written, add_row, row, set_row, store,
};
use super::direction::pull_back_unit;
use super::lamp::{Kind, Lamp};
use super::model::{Layers, Model};
use crate::vector::{dot, plus, scaled};

/// Sums of a light over rows: the gradients of its place and of its strength.
pub(super) const SUMS_OF_LIGHT: usize = 6;

/// Rows in the light of lamps.
pub(super) struct Lighting<'a, T, M> {
    pub(super) model: M,
    pub(super) rows: Rows<'a, T>,
    pub(super) lamps: SmallVec<[Lamp<T>; 8]>,
}

/// The product of two colours.
#[inline(always)]
fn times<T: Scalar>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// Those of the layers that count.
#[inline(always)]
fn counted<T: Scalar>(layers: Layers<T>, [below, above]: [T; 2]) -> [T; 3] {
    plus(scaled(below, layers.below), above, layers.above)
}

/// 1 for what counts, and 0.
fn weights<T: Scalar>(below: bool, above: bool) -> [T; 2] {
    [below, above].map(|counts| if counts { T::ONE } else { T::ZERO })
}

impl<T: Scalar, M> Lighting<'_, T, M> {
    /// Writes the radiance of `rows`: whether all of their numbers are finite, directions have a length,
    /// and no point light is too close.
    #[inline(always)]
    pub(super) fn light<const K: usize>(&self, rows: Range<usize>, out: &mut [T]) -> bool
    where
        M: Model<K>,
    {
        let (block, mut is_good) = self.rows.load::<K>(&rows);
        let mut radiance: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let model = self.model;
        for lamp in &self.lamps {
            let strength = lamp.strength;
            // A loop for each kind: a choice inside would not become vectors.
            match lamp.kind {
                Kind::Directional => {
                    for k in 0..BLOCK {
                        let value = model.reflect(block.point(k), lamp.place);
                        add_row(&mut radiance, k, times(strength, value));
                    }
                }
                Kind::Point => {
                    for k in 0..BLOCK {
                        let (l, _, inverse) = lamp.seen_from(block.position(k));
                        is_good &= inverse.is_finite();
                        let value = model.reflect(block.point(k), l);
                        add_row(&mut radiance, k, times(scaled(inverse, strength), value));
                    }
                }
                Kind::Everywhere { below, above } => {
                    let weights = weights(below, above);
                    for k in 0..BLOCK {
                        let value = counted(model.everywhere(block.point(k)), weights);
                        add_row(&mut radiance, k, times(strength, value));
                    }
                }
            }
        }
        store(&radiance, out, true);
        is_good
    }

    /// Writes what the gradients `upstream` of a piece's radiance lead to. Without `GEOMETRY` those are the
    /// gradients of materials and of lights' strengths alone.
    #[inline(always)]
    pub(super) fn pull_back<const K: usize, const GEOMETRY: bool>(
        &self,
        upstream: &Column<'_, T>,
        rows: Range<usize>,
        written: &mut Written<'_, T>,
    ) where
        M: Model<K>,
    {
        let start = rows.start;
        for first in rows.clone().step_by(BLOCK) {
            let range = first..(first + BLOCK).min(rows.end);
            let bars = self.pull_back_block::<K, GEOMETRY>(upstream, &range, written);
            for Target { first, width, entries, is_fresh } in &mut written.targets {
                let entries =
                    &mut entries[(range.start - start) * *width..(range.end - start) * *width];
                store(bars.part(*first, *width), entries, *is_fresh);
            }
        }
    }

    /// [`Lighting::pull_back`] of all gradients.
    #[inline(never)]
    pub(super) fn pull_back_all<const K: usize>(
        &self,
        upstream: &Column<'_, T>,
        rows: Range<usize>,
        written: &mut Written<'_, T>,
    ) where
        M: Model<K>,
    {
        self.pull_back::<K, true>(upstream, rows, written);
    }

    /// The gradients of a block's rows; what has no rows is added to the sums of the piece.
    ///
    /// In one piece: the loops of all kinds of light keep the block's gradients in registers.
    #[inline(always)]
    fn pull_back_block<const K: usize, const GEOMETRY: bool>(
        &self,
        upstream: &Column<'_, T>,
        rows: &Range<usize>,
        written: &mut Written<'_, T>,
    ) -> Numbers<T, K>
    where
        M: Model<K>,
    {
        let count = rows.len();
        let has_sums = written.width > 0;
        let (block, _) = self.rows.load::<K>(rows);
        let mut upstream_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        upstream.load(rows, &mut upstream_bars);
        let mut bars = Numbers::zeros();
        let mut place_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let mut strength_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let model = self.model;
        for (light, lamp) in self.lamps.iter().enumerate() {
            let strength = lamp.strength;
            match lamp.kind {
                Kind::Directional => {
                    for k in 0..BLOCK {
                        let bar = row(&upstream_bars, k);
                        let (value, lamp_bars) =
                            model.pull_back(block.point(k), lamp.place, times(bar, strength));
                        bars.add::<GEOMETRY>(k, &lamp_bars);
                        set_row(&mut strength_bars, k, times(bar, value));
                        if GEOMETRY {
                            set_row(&mut place_bars, k, lamp_bars.light);
                        }
                    }
                }
                Kind::Point => {
                    for k in 0..BLOCK {
                        let (l, distance, inverse) = lamp.seen_from(block.position(k));
                        let bar = scaled(inverse, row(&upstream_bars, k));
                        let strong = times(bar, strength);
                        let (value, lamp_bars) = model.pull_back(block.point(k), l, strong);
                        bars.add::<GEOMETRY>(k, &lamp_bars);
                        set_row(&mut strength_bars, k, times(bar, value));
                        if GEOMETRY {
                            // The light falls as 1 / r^2: its slope is -2 / r.
                            let fall = T::from_f64(-2.0) * dot(strong, value) / distance;
                            let place_bar =
                                plus(pull_back_unit(l, distance, lamp_bars.light), fall, l);
                            add_row(&mut bars.positions, k, scaled(-T::ONE, place_bar));
                            set_row(&mut place_bars, k, place_bar);
                        }
                    }
                }
                Kind::Everywhere { below, above } => {
                    let weights = weights(below, above);
                    for k in 0..BLOCK {
                        let bar = row(&upstream_bars, k);
                        let strong = times(bar, strength);
                        let layers = Layers {
                            below: scaled(weights[0], strong),
                            above: scaled(weights[1], strong),
                        };
                        let (value, lamp_bars) = model.pull_back_everywhere(block.point(k), layers);
                        bars.add::<GEOMETRY>(k, &lamp_bars);
                        set_row(&mut strength_bars, k, times(bar, counted(value, weights)));
                    }
                }
            }
            if has_sums {
                let first = MATERIAL + K + SUMS_OF_LIGHT * light;
                add_totals(&place_bars, count, &mut written.sums[first..]);
                add_totals(&strength_bars, count, &mut written.sums[first + 3..]);
            }
        }
        if GEOMETRY {
            block.pull_back_units(&mut bars);
        }
        for column in self.rows.columns.iter().filter(|column| column.is_uniform && has_sums) {
            let lanes = bars.part(column.first, column.width);
            add_totals(lanes, count, &mut written.sums[column.first..]);
        }
        bars
    }
}

/// Adds the sums over the first `count` rows.
#[inline(always)]
fn add_totals<T: Scalar>(lanes: &[[T; BLOCK]], count: usize, totals: &mut [T::Wide]) {
    for (lane, total) in lanes.iter().zip(totals) {
        // Eight sums side by side, for vectors.
        let (whole, rest) = lane[..count].as_chunks::<8>();
        let mut parts = [T::Wide::ZERO; 8];
        for chunk in whole {
            for i in 0..8 {
                parts[i] += chunk[i].widen();
            }
        }
        let sum: T::Wide = parts.into_iter().sum();
        let rest: T::Wide = rest.iter().map(|entry| entry.widen()).sum();
        *total += sum + rest;
    }
}
