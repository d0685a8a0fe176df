//! Points as a lens shows them, for any lens: the loops of an operation.
//!
//! # Forward
//! Point by point, by a [`LensMap`].
//!
//! # Backward
//! By the map's slopes. The gradients of the coefficients are sums over the points, in [`Scalar::Wide`], in
//! pieces of a fixed size.

use std::ops::Range;

use bokashi_core::parallel::{for_each_piece_mut, merge_ranges};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar};

use crate::error::RenderError;
use crate::point_map::POINTS_PER_PIECE;

/// Coefficients beyond it would leave the range of the numbers.
const LARGEST: f64 = 1e100;

/// A lens of `N` coefficients, as a map of points.
pub(super) trait LensMap<S, const N: usize>: Copy + Send + Sync {
    /// The lens of these coefficients.
    fn from_coefficients(coefficients: [S; N]) -> Self;

    /// Where a point goes.
    fn apply(&self, point: [S; 3]) -> [S; 3];

    /// How that moves.
    fn slopes(&self, point: [S; 3]) -> Slopes<S, N>;
}

/// How a point that a lens shows moves with the point, and with the coefficients.
pub(super) struct Slopes<S, const N: usize> {
    /// Of its X, Y and Z by those of the point.
    pub(super) by_point: [[S; 3]; 3],
    /// Of its X, Y and Z by each coefficient.
    pub(super) by_coefficient: [[S; N]; 3],
}

/// One kind of lens in any precision.
pub(super) trait LensKind<const N: usize>: Copy + Send + Sync + 'static {
    /// The operation's name.
    const NAME: &'static str;
    /// The shape of its coefficients, for errors.
    const RULE: &'static str;
    /// Whether coefficients of 0 are the identity.
    const HAS_IDENTITY: bool;
    /// The lens.
    type Lens<S: Scalar>: LensMap<S, N>;
}

/// Inputs: points `[V, 3]`, coefficients `[N]`. Output: points `[V, 3]`.
pub(super) struct Bend<K, const N: usize>(pub(super) K);

impl<K: LensKind<N>, const N: usize> Bend<K, N> {
    fn lens<T: Scalar>(coefficients: &[T]) -> K::Lens<T::Wide> {
        K::Lens::from_coefficients(std::array::from_fn(|k| coefficients[k].widen()))
    }
}

impl<T: Scalar, K: LensKind<N>, const N: usize> Op<T> for Bend<K, N> {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        K::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        if !matches!(**inputs.shape(0), [_, 3]) {
            return Err(RenderError::shape(K::NAME, "points of shape [V, 3]", inputs.shape(0)));
        }
        if **inputs.shape(1) != [N] {
            return Err(RenderError::shape(K::NAME, K::RULE, inputs.shape(1)));
        }
        let (points, coefficients) = (inputs.data(0), inputs.data(1));
        let is_lost = |entry: &&T| !(-LARGEST..=LARGEST).contains(&entry.to_f64());
        if let Some(lost) = coefficients.iter().find(is_lost) {
            let rule = "coefficients within -1e100 and 1e100";
            return Err(RenderError::value(K::NAME, rule, lost.to_f64()));
        }
        let is_zero = || coefficients.iter().all(|entry| entry.is_same(T::ZERO));
        if K::HAS_IDENTITY && !inputs.needs(1) && is_zero() {
            outputs.pass(0, "coefficients are 0");
            return Ok(());
        }
        let lens = Self::lens(coefficients);
        let out = outputs.push(inputs.shape(0));
        for_each_piece_mut(out, 3 * POINTS_PER_PIECE, |piece, out| {
            let points = &points.as_chunks::<3>().0[piece * POINTS_PER_PIECE..];
            for (out, point) in out.as_chunks_mut::<3>().0.iter_mut().zip(points) {
                *out = lens.apply(point.map(T::widen)).map(T::narrow);
            }
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let lens = Self::lens(kept.input(1));
        let points = kept.input(0).as_chunks::<3>().0;
        let bars = kept.only_upstream().as_chunks::<3>().0;
        if let Some(points_bar) = gradients.get(0) {
            for_each_piece_mut(points_bar.entries(), 3 * POINTS_PER_PIECE, |piece, entries| {
                let first = piece * POINTS_PER_PIECE;
                let pairs = points[first..].iter().zip(&bars[first..]);
                for (entries, (point, bar)) in entries.as_chunks_mut::<3>().0.iter_mut().zip(pairs)
                {
                    let [by_x, by_y, by_z] = lens.slopes(point.map(T::widen)).by_point;
                    let [x, y, z] = bar.map(T::widen);
                    for k in 0..3 {
                        entries[k] += T::narrow(by_x[k] * x + by_y[k] * y + by_z[k] * z);
                    }
                }
            });
        }
        let Some(coefficients_bar) = gradients.get(1) else { return };
        let mut total = [T::Wide::ZERO; N];
        let work = |range: Range<usize>| {
            let mut sums = [T::Wide::ZERO; N];
            for (point, bar) in points[range.clone()].iter().zip(&bars[range]) {
                let [by_x, by_y, by_z] = lens.slopes(point.map(T::widen)).by_coefficient;
                let [x, y, z] = bar.map(T::widen);
                for (k, sum) in sums.iter_mut().enumerate() {
                    *sum += by_x[k] * x + by_y[k] * y + by_z[k] * z;
                }
            }
            sums
        };
        merge_ranges(points.len(), POINTS_PER_PIECE, work, |sums: [T::Wide; N]| {
            total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        });
        coefficients_bar.add_each(|k| T::narrow(total[k]));
    }
}
