//! A blur by a disc, of part of an image.
//!
//! # Forward
//! The weight of a pixel is the share of the disc's area that it covers. With the unit disc and `x, y >= 0`, cut
//! to 1, the area within `[0, x] x [0, y]` is `Q = x y` where `x^2 + y^2 <= 1`, and else
//! `Q = a y + P(x) - P(a)` with `a = sqrt(1 - y^2)` and `P(u) = (asin u + u sqrt(1 - u^2)) / 2`; Q is odd in x and
//! in y. With a pixel's corners divided by R, its weight is the difference of Q over the four corners, over pi.
//!
//! Coverage adds a pixel's width to the disc: so R is the radius at which the weights have the variance
//! `r^2 / 4` per axis of a disc of radius r.
//!
//! Weights fall from the middle of a row to its ends: with `d_k = w_k - w_(k+1)` a row of the disc has the sum
//! `sum_k d_k (p_(x+k+1) - p_(x-k))`, where p are sums of the image's row from its start. Inside the disc all
//! `d_k` are 0, so that a row costs a few look-ups, whatever the radius.
//!
//! # Backward
//! A disc with a mirrored border is its own adjoint. The radii are fixed, so there is no gradient by them.

use std::f64::consts::PI;

use bokashi_core::Scalar;

use super::strips::{Bands, Strip};
use crate::border::Border;
use crate::size::Size;

/// A disc's weights, by row from the middle on.
#[derive(Debug, Default, Clone)]
pub(super) struct Disc {
    /// Each `d_k` that is not 0, with its k.
    rows: Vec<Vec<(usize, f64)>>,
}

impl Disc {
    /// A disc with the variance of a disc of radius `radius`, from 0 up.
    pub(super) fn new(radius: f64) -> Self {
        let own = own_radius(radius);
        let reach = (own - 0.5).ceil().max(0.0) as usize;
        let row = |row: usize| {
            let weight = |column: usize| weight(column, row, own);
            let steps = (0..=reach).map(|k| (k, weight(k) - weight(k + 1)));
            steps.filter(|&(_, step)| step != 0.0).collect()
        };
        Self { rows: (0..=reach).map(row).collect() }
    }

    /// How many pixels it reaches beyond its own.
    pub(super) fn reach(&self) -> usize {
        self.rows.len().saturating_sub(1)
    }

    /// Whether it was never made.
    pub(super) fn is_vacant(&self) -> bool {
        self.rows.is_empty()
    }
}

/// The signed area of the unit disc within `[0, x] x [0, y]`.
fn quadrant(x: f64, y: f64) -> f64 {
    let sign = x.signum() * y.signum();
    let (x, y) = (x.abs().min(1.0), y.abs().min(1.0));
    if x * x + y * y <= 1.0 {
        return sign * x * y;
    }
    let below = |u: f64| 0.5 * (u.asin() + u * (1.0 - u * u).max(0.0).sqrt());
    let a = (1.0 - y * y).sqrt();
    sign * (a * y + below(x) - below(a))
}

/// The share of a disc of radius `radius` that a pixel covers.
fn weight(column: usize, row: usize, radius: f64) -> f64 {
    let [x, y] = [column, row].map(|at| at as f64);
    let square = |x: f64| x * x;
    if square(x + 0.5) + square(y + 0.5) <= square(radius) {
        return (PI * radius * radius).recip();
    }
    if square((x - 0.5).max(0.0)) + square((y - 0.5).max(0.0)) >= square(radius) {
        return 0.0;
    }
    let area = |x: f64, y: f64| quadrant(x / radius, y / radius);
    let sides = area(x + 0.5, y + 0.5) - area(x - 0.5, y + 0.5);
    (sides - area(x + 0.5, y - 0.5) + area(x - 0.5, y - 0.5)) / PI
}

/// The variance per axis of the weights of a disc of radius `radius`.
fn variance(radius: f64) -> f64 {
    let reach = (radius - 0.5).ceil().max(0.0) as usize;
    let mut sum = 0.0;
    for row in 0..=reach {
        for column in 0..=reach {
            let times = [column, row].map(|at| if at > 0 { 2.0 } else { 1.0 });
            let square = (column * column) as f64;
            sum += times[0] * times[1] * square * weight(column, row, radius);
        }
    }
    sum
}

/// The radius at which coverage has the variance of a disc of radius `radius`.
fn own_radius(radius: f64) -> f64 {
    let goal = 0.25 * radius * radius;
    // False position, with the side that stays halved.
    let (mut low, mut high) = ([0.5, -goal], [radius + 0.5, variance(radius + 0.5) - goal]);
    for _ in 0..60 {
        if low[1] >= 0.0 || high[1] - low[1] <= 1e-15 * goal {
            break;
        }
        let at = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1]);
        let off = variance(at) - goal;
        if off.abs() <= 1e-14 * goal {
            return at;
        }
        if off < 0.0 {
            (low, high[1]) = ([at, off], 0.5 * high[1]);
        } else {
            (high, low[1]) = ([at, off], 0.5 * low[1]);
        }
    }
    low[0]
}

/// Memory for a band.
#[derive(Debug, Default)]
pub(super) struct Bench<W> {
    /// Sums of a row from its start.
    sums: Vec<W>,
    /// The rows of a band.
    blurred: Vec<W>,
}

/// Blurs what the bands of `source` hold of a rung into `target`, a part of the image of some rows and columns;
/// all that `source` does not hold is 0.
pub(super) fn blur_disc<T: Scalar>(
    source: Bands<'_, T>,
    rung: usize,
    size: Size,
    disc: &Disc,
    target: &mut Strip<T>,
    bench: &mut Bench<T::Wide>,
) {
    let (width, entries) = (target.columns.len(), target.entries);
    let row = width * entries;
    bench.blurred.clear();
    bench.blurred.resize(target.rows.len() * row, T::Wide::ZERO);
    let reach = disc.reach();
    let [first, end] = [target.rows.start as isize, target.rows.end as isize];
    for at in first - reach as isize..end + reach as isize {
        let from = Border::Mirror.source(at, size.height).expect("a mirror is endless");
        let Some(strip) = source.strip(rung, from) else { continue };
        sum_row(strip, from, target.columns.start, width + 2 * reach, reach, size, &mut bench.sums);
        for to in first.max(at - reach as isize)..end.min(at + reach as isize + 1) {
            let out = &mut bench.blurred[(to - first) as usize * row..][..row];
            let steps = &disc.rows[to.abs_diff(at)];
            let sums = &bench.sums[..];
            crate::dispatch::dispatch::<T, _>(
                #[inline(always)]
                || {
                    for &(k, step) in steps {
                        let after = &sums[(reach + k + 1) * entries..][..row];
                        let before = &sums[(reach - k) * entries..][..row];
                        let step = T::Wide::from_f64(step);
                        for ((out, &after), &before) in out.iter_mut().zip(after).zip(before) {
                            *out += step * (after - before);
                        }
                    }
                },
            );
        }
    }
    target.held = target.columns.clone();
    target.values.clear();
    target.values.extend(bench.blurred.iter().map(|&value| T::narrow(value)));
}

/// Sums of row `row` of a strip, mirrored at the border, over `count` columns from `reach` before `first` on.
fn sum_row<T: Scalar>(
    strip: &Strip<T>,
    row: usize,
    first: usize,
    count: usize,
    reach: usize,
    size: Size,
    sums: &mut Vec<T::Wide>,
) {
    let entries = strip.entries;
    sums.clear();
    sums.resize((count + 1) * entries, T::Wide::ZERO);
    for k in 0..count {
        let column = (first + k) as isize - reach as isize;
        let column = Border::Mirror.source(column, size.width).expect("a mirror is endless");
        let (done, rest) = sums.split_at_mut((k + 1) * entries);
        let (before, now) = (&done[k * entries..], &mut rest[..entries]);
        match strip.pixel(row, column) {
            Some(values) => {
                for ((now, &before), &value) in now.iter_mut().zip(before).zip(values) {
                    *now = before + value.widen();
                }
            }
            None => now.copy_from_slice(before),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::strips::{ROWS, Strips};
    use super::*;

    #[test]
    fn weights_are_a_disc_of_the_right_variance() {
        for (radius, own) in [(0.0, 0.5), (1.0, 0.788), (3.0, 2.932), (8.0, 7.976)] {
            assert!((own_radius(radius) - own).abs() < 1e-3, "{radius}: {}", own_radius(radius));
        }
        for radius in [0.05, 0.36, 0.74, 1.0, 2.9, 11.0, 40.0] {
            let own = own_radius(radius);
            assert!((variance(own) / (0.25 * radius * radius) - 1.0).abs() < 1e-9, "{radius}");
            let reach = (own - 0.5).ceil() as usize;
            let mut sum = 0.0;
            for row in 0..=reach {
                for column in 0..=reach {
                    let times =
                        if row > 0 { 2.0 } else { 1.0 } * if column > 0 { 2.0 } else { 1.0 };
                    sum += times * weight(column, row, own);
                }
            }
            assert!((sum - 1.0).abs() < 1e-13, "{radius}: {sum}");
            assert_eq!([weight(reach + 1, 0, own), weight(0, reach + 1, own)], [0.0; 2]);
        }
    }

    #[test]
    fn a_blur_is_the_sum_over_the_disc_of_a_mirrored_image() {
        let size = Size { width: 9, height: 37 };
        for radius in [0.0, 0.4, 1.7, 6.3, 14.0] {
            let disc = Disc::new(radius);
            let own = own_radius(radius);
            let image = |row: usize, column: usize, c: usize| {
                ((row * 91 + column * 37 + c * 53) % 101) as f64 / 101.0
            };
            let mut source = vec![Strips::default(); size.height.div_ceil(ROWS)];
            for row in 3..34 {
                for column in 1..8 {
                    let strip = source[row / ROWS].strip_mut(5, row, 2, size);
                    let values = strip.pixel_mut(row, column);
                    values.iter_mut().zip(0..).for_each(|(v, c)| *v = image(row, column, c));
                }
            }
            let held = |row: usize, column: usize, c: usize| {
                let is_held = (3..34).contains(&row) && (1..8).contains(&column);
                if is_held { image(row, column, c) } else { 0.0 }
            };
            let mut target = Strip { entries: 2, rows: 2..30, columns: 1..9, ..Strip::default() };
            let source = Bands { strips: &source, first: 0 };
            blur_disc(source, 5, size, &disc, &mut target, &mut Bench::default());
            let reach = disc.reach() as isize;
            for (row, column, c) in [(2, 1, 0), (29, 8, 1), (17, 5, 0), (11, 2, 1)] {
                let mut sum = 0.0;
                for y in -reach..=reach {
                    for x in -reach..=reach {
                        let at = |at: usize, off: isize, extent| {
                            Border::Mirror.source(at as isize + off, extent).unwrap()
                        };
                        let value = held(at(row, y, size.height), at(column, x, size.width), c);
                        sum += weight(x.unsigned_abs(), y.unsigned_abs(), own) * value;
                    }
                }
                let found = target.pixel(row, column).unwrap()[c];
                assert!((found - sum).abs() < 1e-12, "{radius}: {found} is not {sum}");
            }
        }
    }
}
