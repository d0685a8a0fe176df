//! Points as a lens shows them.
//!
//! # Forward
//! `(X, Y, Z)` becomes `(x'' Z, y'' Z, Z)`: see `distortion`.
//!
//! # Backward
//! By the slopes of both coordinates, from `distortion`. The gradients of the coefficients are sums over
//! the points, in [`Scalar::Wide`], in pieces of a fixed size.
//!
//! # Where it is not smooth, and source
//! See `distortion`.

use std::ops::Range;

use bokashi_core::parallel::{for_each_piece_mut, merge_ranges};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use super::distortion::Distortion;
use crate::error::RenderError;
use crate::moments::POINTS_PER_PIECE;

const NAME: &str = "distort";

/// Coefficients beyond it would leave the range of the numbers.
const LARGEST: f64 = 1e100;

/// `points: [V, 3]` in OpenCV's camera coordinates as a lens shows them: `[V, 3]`, (x'' Z, y'' Z, Z) with
/// the distorted normalized coordinates. A [`pinhole`](crate::pinhole()) then takes them to clip space.
///
/// `coefficients: [5]` are OpenCV's, in its order: (k1, k2, p1, p2, k3). Both inputs have a gradient. Edges
/// stay straight: a mesh needs faces small enough to bend.
///
/// The polynomial holds up to the radius where it would bring points back into the image
/// ([`distortion_radius`](crate::camera::distortion_radius)). From there on the map goes on linearly along
/// each ray from the centre, also behind the camera, so that points outside the image stay outside.
///
/// Coefficients of 0 that have no gradient are the identity: the points themselves are returned.
///
/// # Errors
/// [`RenderError::Shape`] unless the points are `[V, 3]` and the coefficients `[5]`;
/// `TensorError::Value` for a coefficient that is not finite, or beyond 1e100;
/// `TensorError::ForeignVariable` for variables of two tapes.
#[inline(never)]
pub fn distort<'t, T: Scalar>(
    points: Var<'t, T>,
    coefficients: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    points.tape().apply(Distort, &[points, coefficients])
}

/// Inputs: points `[V, 3]`, coefficients `[5]`. Output: points `[V, 3]`.
struct Distort;

fn lens_of<T: Scalar>(coefficients: &[T]) -> Distortion<T::Wide> {
    Distortion::of(std::array::from_fn(|k| coefficients[k].widen()))
}

impl<T: Scalar> Op<T> for Distort {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        if !matches!(**inputs.shape(0), [_, 3]) {
            return Err(RenderError::of_shape(NAME, "points of shape [V, 3]", inputs.shape(0)));
        }
        if **inputs.shape(1) != [5] {
            return Err(RenderError::of_shape(NAME, "coefficients of shape [5]", inputs.shape(1)));
        }
        let (points, coefficients) = (inputs.data(0), inputs.data(1));
        let is_lost = |entry: &&T| !(-LARGEST..=LARGEST).contains(&entry.to_f64());
        if let Some(lost) = coefficients.iter().find(is_lost) {
            let rule = "coefficients within -1e100 and 1e100";
            return Err(RenderError::of_value(NAME, rule, lost.to_f64()));
        }
        if !inputs.needs(1) && coefficients.iter().all(|entry| entry.is_same(T::ZERO)) {
            outputs.pass(0, "coefficients are 0");
            return Ok(());
        }
        let lens = lens_of(coefficients);
        let out = outputs.push(inputs.shape(0));
        for_each_piece_mut(out, 3 * POINTS_PER_PIECE, |piece, out| {
            let points = &points.as_chunks::<3>().0[piece * POINTS_PER_PIECE..];
            for (out, point) in out.as_chunks_mut::<3>().0.iter_mut().zip(points) {
                let [x, y] = lens.apply(point.map(T::widen));
                *out = [T::narrow(x), T::narrow(y), point[2]];
            }
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let lens = lens_of(kept.input(1));
        let points = kept.input(0).as_chunks::<3>().0;
        let bars = kept.only_upstream().as_chunks::<3>().0;
        if let Some(points_bar) = gradients.get(0) {
            for_each_piece_mut(points_bar.entries(), 3 * POINTS_PER_PIECE, |piece, entries| {
                let first = piece * POINTS_PER_PIECE;
                let own = points[first..].iter().zip(&bars[first..]);
                for (entries, (point, bar)) in entries.as_chunks_mut::<3>().0.iter_mut().zip(own) {
                    let [by_x, by_y] = lens.slopes(point.map(T::widen)).by_point;
                    for k in 0..3 {
                        let sum = by_x[k] * bar[0].widen() + by_y[k] * bar[1].widen();
                        let own = if k == 2 { bar[2].widen() } else { T::Wide::ZERO };
                        entries[k] += T::narrow(sum + own);
                    }
                }
            });
        }
        let Some(coefficients_bar) = gradients.get(1) else { return };
        let mut total = [T::Wide::ZERO; 5];
        let work = |range: Range<usize>| {
            let mut sums = [T::Wide::ZERO; 5];
            for (point, bar) in points[range.clone()].iter().zip(&bars[range]) {
                let [by_x, by_y] = lens.slopes(point.map(T::widen)).by_coefficient;
                for (k, sum) in sums.iter_mut().enumerate() {
                    *sum += by_x[k] * bar[0].widen() + by_y[k] * bar[1].widen();
                }
            }
            sums
        };
        merge_ranges(points.len(), POINTS_PER_PIECE, work, |sums: [T::Wide; 5]| {
            total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        });
        coefficients_bar.add_each(|k| T::narrow(total[k]));
    }
}
