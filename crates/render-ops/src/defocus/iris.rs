//! The iris of a lens, and what of it the pixels of a blur cover.
//!
//! # Forward
//! A rung of radius r sees through the point p of the iris what lies `r p` beside a pixel. So its blur weights
//! each pixel with the share of the iris that it covers, of the size at which these weights have the variance
//! `r^2 / 4` per axis, that of a round iris of radius r. In front of the focus r is below 0, and an iris with
//! blades stands upside down.
//!
//! A disc has the weights of [`Kernel::Disc`](crate::Kernel). Those of a polygon are areas of what is left of it
//! when it is cut off at the four sides of a pixel.
//!
//! # Sums
//! Down a column of pixels the weights are constant but at the rim. With running sums P of the column,
//! `sum_y w_y c_y = sum_y (w_(y-1) - w_y) P_y`: one look-up for each change, two or more per column. A small iris
//! has as many changes as pixels, and takes these themselves: sums would only be rounded.
//!
//! # Border
//! What lies beyond the image is not known, so weights are taken of the rest, and made to sum to 1 again.
//!
//! # Backward
//! The adjoint of a blur divides by these sums first, and then blurs through the iris upside down.

use std::f64::consts::TAU;

use crate::size::Size;
use crate::taps::disc::DiscTaps;

/// The opening of a lens. Whatever its form, a blur of radius r has the variance of a disc of radius r.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub enum Iris {
    /// A disc.
    #[default]
    Disc,
    /// A regular polygon, as blades make it.
    Polygon {
        /// Its sides: 3 to 16.
        blades: usize,
        /// The direction of a corner from the middle, in radians from the right towards the bottom of the image.
        rotation: f64,
    },
}

impl Iris {
    /// How far its corners reach, in radii of the disc of the same variance: that of a polygon of circumradius c
    /// is `c^2 (2 + cos(2 pi / n)) / 12`, that of a disc `r^2 / 4`.
    pub fn reach(self) -> f64 {
        match self {
            Self::Disc => 1.0,
            Self::Polygon { blades, .. } => (3.0 / (2.0 + (TAU / blades as f64).cos())).sqrt(),
        }
    }
}

/// The rule that an iris breaks, if any, and its value.
pub(crate) fn broken_rule(iris: Iris) -> Option<(&'static str, f64)> {
    match iris {
        Iris::Polygon { blades, .. } if !(3..=16).contains(&blades) => {
            Some(("an iris of 3 to 16 blades", blades as f64))
        }
        Iris::Polygon { rotation, .. } if !rotation.is_finite() => {
            Some(("a finite rotation of the iris", rotation))
        }
        _ => None,
    }
}

/// A change of weight down a column of pixels, as a look-up of running sums; or a weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LookUp {
    /// Rows and columns from the pixel's own.
    pub(crate) row: isize,
    pub(crate) column: isize,
    pub(crate) weight: f64,
}

/// The reach up to which pixels are looked up.
const DIRECT: usize = 2;

/// The weights of a blur.
#[derive(Debug, Default, Clone)]
pub(crate) struct Weights {
    /// How many pixels it reaches beyond its own.
    pub(crate) reach: usize,
    pub(crate) look_ups: Vec<LookUp>,
    /// Whether pixels are looked up, and not sums of those above.
    pub(crate) is_direct: bool,
    /// `[2 reach + 2, 2 reach + 2]`: the sum of all weights above and to the left.
    sums: Vec<f64>,
}

impl Weights {
    /// Those of an iris, of a variance per axis in pixels; and those of the iris upside down.
    pub(crate) fn pair(iris: Iris, variance: f64) -> [Self; 2] {
        let (reach, values) = match iris {
            _ if variance <= 0.0 => (0, vec![1.0]),
            Iris::Disc => disc(variance),
            Iris::Polygon { blades, rotation } => polygon(blades, rotation, variance),
        };
        [false, true].map(|is_turned| Self::new(reach, &values, is_turned))
    }

    /// Those of some values row by row; from the last to the first, where `is_turned`.
    fn new(reach: usize, values: &[f64], is_turned: bool) -> Self {
        let side = 2 * reach + 1;
        let last = side * side - 1;
        let weight = |row: usize, column: usize| {
            let pixel = row * side + column;
            values[if is_turned { last - pixel } else { pixel }]
        };
        let offset = |index: usize| index as isize - reach as isize;
        let is_direct = reach <= DIRECT;
        let mut look_ups = Vec::new();
        for column in 0..side {
            let mut before = 0.0;
            for row in 0..=side {
                let own = if row < side { weight(row, column) } else { 0.0 };
                let weight = if is_direct { own } else { before - own };
                if weight != 0.0 {
                    let (row, column) = (offset(row), offset(column));
                    look_ups.push(LookUp { row, column, weight });
                }
                before = own;
            }
        }
        let mut sums = vec![0.0; (side + 1) * (side + 1)];
        for row in 0..side {
            let mut line = 0.0;
            for column in 0..side {
                line += weight(row, column);
                sums[(row + 1) * (side + 1) + column + 1] =
                    sums[row * (side + 1) + column + 1] + line;
            }
        }
        Self { reach, look_ups, is_direct, sums }
    }

    /// The sum of the weights of those pixels beside `[row, column]` that lie in an image of this size.
    pub(crate) fn sum_inside(&self, [row, column]: [usize; 2], size: Size) -> f64 {
        let (reach, stride) = (self.reach, 2 * self.reach + 2);
        let range = |index: usize, extent: usize| {
            [reach.saturating_sub(index), (reach + extent - index).min(stride - 1)]
        };
        let ([top, bottom], [left, right]) = (range(row, size.height), range(column, size.width));
        let sum = |row: usize, column: usize| self.sums[row * stride + column];
        sum(bottom, right) - sum(top, right) - sum(bottom, left) + sum(top, left)
    }
}

/// The reach of a disc of this variance, and its weights row by row.
fn disc(variance: f64) -> (usize, Vec<f64>) {
    let mut taps = DiscTaps::<f64>::default();
    taps.fill(variance, 0.0);
    let reach = taps.reach();
    let offset = |index: usize| index.abs_diff(reach);
    let side = 2 * reach + 1;
    let weight = |pixel: usize| {
        let [row, column] = [pixel / side, pixel % side].map(offset);
        let steps = taps.column(column).iter().filter(|step| step.reach >= row);
        steps.map(|step| step.weight).sum()
    };
    (reach, (0..side * side).map(weight).collect())
}

/// The same of a polygon.
fn polygon(blades: usize, rotation: f64, variance: f64) -> (usize, Vec<f64>) {
    let excess = |radius: f64| variance_of(&covered(blades, rotation, radius)) - variance;
    // The variance grows with the polygon: parts of an interval that holds the wanted one, by secants (the Illinois
    // algorithm). The corners lie at most twice as far away as the rim of a disc, those of a triangle.
    let most = 2.0 * (2.0 * variance.sqrt() + 1.0);
    let [mut before, mut last] = [[0.0, -variance], [most, excess(most)]];
    while (last[0] - before[0]).abs() > 4.0 * f64::EPSILON * last[0] && last[1] != 0.0 {
        let next = last[0] - last[1] * (last[0] - before[0]) / (last[1] - before[1]);
        let found = [next, excess(next)];
        if (found[1] < 0.0) != (last[1] < 0.0) {
            before = last;
        } else {
            before[1] *= 0.5;
        }
        if next == last[0] {
            break;
        }
        last = found;
    }
    covered(blades, rotation, last[0].max(f64::MIN_POSITIVE))
}

/// The variance per axis of some weights: the mean of both.
fn variance_of((reach, values): &(usize, Vec<f64>)) -> f64 {
    let side = 2 * reach + 1;
    let square = |index: usize| (index.abs_diff(*reach) as f64).powi(2);
    let moments = values.iter().enumerate();
    0.5 * moments.map(|(k, w)| w * (square(k / side) + square(k % side))).sum::<f64>()
}

/// The share of a regular polygon that each pixel covers, of corners that lie `radius` from the middle.
fn covered(blades: usize, rotation: f64, radius: f64) -> (usize, Vec<f64>) {
    let corner = |k: usize| {
        let angle = rotation + TAU * k as f64 / blades as f64;
        [radius * angle.cos(), radius * angle.sin()]
    };
    let corners: Vec<_> = (0..blades).map(corner).collect();
    let farthest = corners.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    let reach = (farthest - 0.5).ceil().max(0.0) as usize;
    let whole = area(&corners);
    let side = 2 * reach + 1;
    let first = -(reach as f64) - 0.5;
    let mut values = vec![0.0; side * side];
    let [mut strip, mut pixel, mut memory] = [const { Vec::new() }; 3];
    for row in 0..side {
        let top = first + row as f64;
        cut(&corners, [top, top + 1.0], 1, [&mut strip, &mut memory]);
        for column in 0..side {
            let left = first + column as f64;
            cut(&strip, [left, left + 1.0], 0, [&mut pixel, &mut memory]);
            // A pixel inside has the same weight as its neighbours, to the last bit.
            let share = area(&pixel);
            let is_inside = share > 1.0 - 1e-12;
            values[row * side + column] = if is_inside { whole.recip() } else { share / whole };
        }
    }
    (reach, values)
}

/// The area of a convex polygon.
fn area(corners: &[[f64; 2]]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    0.5 * corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
}

/// What of a convex polygon lies between two lines across an axis; `all` is memory.
fn cut(corners: &[[f64; 2]], lines: [f64; 2], axis: usize, [kept, all]: [&mut Vec<[f64; 2]>; 2]) {
    kept.clear();
    kept.extend_from_slice(corners);
    for (line, side) in lines.into_iter().zip([1.0, -1.0]) {
        std::mem::swap(kept, all);
        kept.clear();
        for (k, &a) in all.iter().enumerate() {
            let b = all[(k + 1) % all.len()];
            let [from, to] = [a, b].map(|point| side * (point[axis] - line));
            if from >= 0.0 {
                kept.push(a);
            }
            if (from > 0.0 && to < 0.0) || (from < 0.0 && to > 0.0) {
                let t = from / (from - to);
                let mut point = [0, 1].map(|k| a[k] + t * (b[k] - a[k]));
                point[axis] = line;
                kept.push(point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IRISES: [Iris; 4] = [
        Iris::Disc,
        Iris::Polygon { blades: 3, rotation: 0.3 },
        Iris::Polygon { blades: 5, rotation: -1.2 },
        Iris::Polygon { blades: 6, rotation: 0.0 },
    ];

    /// The weights of pixels, from the look-ups.
    fn values(weights: &Weights) -> Vec<Vec<f64>> {
        let reach = weights.reach as isize;
        let value = |row: isize, column: isize| -> f64 {
            let own = weights.look_ups.iter().filter(|look_up| look_up.column == column);
            match weights.is_direct {
                true => own.filter(|look_up| look_up.row == row).map(|own| own.weight).sum(),
                false => {
                    -own.filter(|above| above.row <= row).map(|above| above.weight).sum::<f64>()
                }
            }
        };
        (-reach..=reach).map(|row| (-reach..=reach).map(|x| value(row, x)).collect()).collect()
    }

    #[test]
    fn weights_sum_to_one_and_have_the_variance_of_a_disc() {
        for iris in IRISES {
            for radius in [0.05, 0.36, 1.0, 2.9, 7.8] {
                let [weights, _] = Weights::pair(iris, 0.25 * radius * radius);
                let (mut sum, mut variances) = (0.0, [0.0; 2]);
                for (y, row) in values(&weights).iter().enumerate() {
                    for (x, w) in row.iter().enumerate() {
                        assert!(*w > -1e-15, "{iris:?} has the weight {w}");
                        sum += w;
                        let square = |at: usize| (at.abs_diff(weights.reach) as f64).powi(2);
                        variances[0] += w * square(y);
                        variances[1] += w * square(x);
                    }
                }
                assert!((sum - 1.0).abs() < 1e-13, "{iris:?}, {radius}: {sum}");
                let variance = 0.5 * (variances[0] + variances[1]);
                assert!((variance / (0.25 * radius * radius) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn an_iris_upside_down_has_the_same_weights_from_the_other_end() {
        for iris in IRISES {
            let [upright, turned] = Weights::pair(iris, 2.3).map(|weights| values(&weights));
            for (row, other) in upright.iter().zip(turned.iter().rev()) {
                for (a, b) in row.iter().zip(other.iter().rev()) {
                    assert!((a - b).abs() < 1e-15);
                }
            }
        }
        // A triangle with a corner to the right is wider there, and tells both apart.
        let triangle = Iris::Polygon { blades: 3, rotation: 0.0 };
        let [upright, turned] = Weights::pair(triangle, 2.3).map(|weights| values(&weights));
        assert!(upright[upright.len() / 2].last().unwrap() > turned[0].last().unwrap());
    }

    #[test]
    fn sums_inside_are_those_of_the_weights_that_an_image_has() {
        let size = Size { width: 4, height: 9 };
        for iris in IRISES {
            let [weights, _] = Weights::pair(iris, 2.3);
            let (all, reach) = (values(&weights), weights.reach as isize);
            for (row, column) in [(0, 0), (4, 2), (8, 3), (1, 1)] {
                let mut expected = 0.0;
                for y in -reach..=reach {
                    for x in -reach..=reach {
                        let is_inside = |at: usize, by: isize, extent: usize| {
                            (0..extent as isize).contains(&(at as isize + by))
                        };
                        if is_inside(row, y, 9) && is_inside(column, x, 4) {
                            expected += all[(y + reach) as usize][(x + reach) as usize];
                        }
                    }
                }
                assert!((weights.sum_inside([row, column], size) - expected).abs() < 1e-13);
            }
        }
    }
}
