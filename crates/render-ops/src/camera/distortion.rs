//! The distortion of a lens, and where its formula holds.
//!
//! # Forward
//! A point (X, Y, Z) in camera coordinates has the normalized coordinates `x = X / Z`, `y = Y / Z`, and
//! `s = r^2 = x^2 + y^2`. With `f = n / d`, `n(s) = 1 + k1 s + k2 s^2 + k3 s^3` and
//! `d(s) = 1 + k4 s + k5 s^2 + k6 s^3` the lens shows it at
//!
//! - `x'' = x f(s) + t_x`, `t_x = 2 p1 x y + p2 (s + 2 x^2)`,
//! - `y'' = y f(s) + t_y`, `t_y = p1 (s + 2 y^2) + 2 p2 x y`.
//!
//! The formula is fitted to what the sensor saw. Far outside, `r f(r^2)` may turn round, and would
//! bring points back into the image. So it holds up to the *limit*, the first radius at which that
//! happens or d falls below [`LEAST`], and at most up to [`FARTHEST`]. With `n = sum_i n_i s^i` and d alike,
//! the slope of `r f(r^2)` has the sign of `sum_ij (1 + 2 i - 2 j) n_i d_j s^(i + j)`. From the limit on the map
//! goes on linearly along each ray from the centre: with `m = limit / r`, the point m (x, y) is at the limit, and
//! what it is shown at is divided by m. Times Z that is `rho / limit` times the distorted point `limit n`,
//! with `rho = |(X, Y)|` and `n = (X, Y) / rho`. It does not depend on Z, so it goes on to Z = 0, and behind the
//! camera.
//!
//! # Where it is not smooth
//! At the limit, where slopes jump; on the axis behind the camera, where p1 and p2 leave a kink; and
//! where the limit leaps as coefficients change, because the formula begins to turn round or does so no
//! longer.
//!
//! # Source
//! Brown, *Decentering distortion of lenses*, Photogrammetric Engineering 32(3), 1966; the order and
//! signs of the coefficients, and the denominator, are those of OpenCV's module `calib3d`. What lies beyond the
//! limit is ours.

use bokashi_core::Scalar;

use super::bend::{LensMap, Slopes};
use super::turning::{Turn, bisected, polynomial, polynomial_slope};

/// The largest radius at which the formula holds: 86 degrees off the axis.
const FARTHEST: f64 = 16.0;

/// The least denominator: where a difference of numbers around 1 comes nearer to 0, slopes lose their digits.
const LEAST: f64 = 0.05;

/// The radius up to which [`distort`](crate::distort()) follows the formula of `coefficients` =
/// (k1, k2, p1, p2, k3), and perhaps k4, k5, k6: `N` is 5 or 8. It is in normalized coordinates, the tangent of
/// the angle off the axis. It is the first radius r at which the radial part `r f(r^2)` stops to grow, or at which
/// its denominator falls below 0.05, and at most 16.
pub fn distortion_radius<const N: usize>(coefficients: [f64; N]) -> f64 {
    Distortion::new(all(coefficients)).limit
}

/// All eight coefficients of a lens: those that it lacks are 0.
pub(super) fn all<S: Scalar, const N: usize>(coefficients: [S; N]) -> [S; 8] {
    const { assert!(N == 5 || N == 8, "a lens has 5 or 8 coefficients") };
    std::array::from_fn(|k| if k < N { coefficients[k] } else { S::ZERO })
}

/// The coefficients of a lens.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distortion<S> {
    /// 1, k1, k2, k3, and 1, k4, k5, k6.
    parts: [[S; 4]; 2],
    /// p1, p2.
    tangential: [S; 2],
    limit: S,
    /// How the limit moves with k1, k2, k3, and with k4, k5, k6.
    limit_slopes: [[S; 3]; 2],
}

/// f(s), its slope, and 1 / d(s).
struct Factor<S> {
    f: S,
    slope: S,
    share: S,
}

/// Where a point is.
enum Region<S> {
    /// The normalized coordinates, up to the limit.
    Inside([S; 2]),
    /// The direction and the distance of (X, Y), beyond the limit.
    Outside([S; 2], S),
    /// On the axis behind the camera.
    Behind,
}

impl<S: Scalar> Distortion<S> {
    pub(super) fn new([k1, k2, p1, p2, k3, k4, k5, k6]: [S; 8]) -> Self {
        let parts = [[S::ONE, k1, k2, k3], [S::ONE, k4, k5, k6]];
        let mut lens = Self {
            parts,
            tangential: [p1, p2],
            limit: S::from_f64(FARTHEST),
            limit_slopes: [[S::ZERO; 3]; 2],
        };
        let [upper, lower] = parts;
        let factor = |i: usize, j: usize| S::from_f64(1.0 + 2.0 * i as f64 - 2.0 * j as f64);
        let mut growth = [S::ZERO; 7];
        for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
            growth[i + j] += factor(i, j) * upper[i] * lower[j];
        }
        let mut above = lower;
        above[0] = S::from_f64(1.0 - LEAST);
        let end = FARTHEST * FARTHEST;
        let turns = [Turn::new(&growth, end), Turn::new(&above, end)];
        let is_first = match &turns {
            [Some(turn), Some(fall)] => turn.root <= fall.root,
            [turn, _] => turn.is_some(),
        };
        let [turn, fall] = turns;
        let Some(Turn { root: s, scale }) = (if is_first { turn } else { fall }) else {
            return lens;
        };
        lens.limit = s.sqrt();
        let Some(scale) = scale else { return lens };
        // The slopes of what is 0 at the limit, by each coefficient.
        let powers = [S::ONE, s, s * s, s * s * s];
        let sum = |term: &dyn Fn(usize) -> S| (0..4).map(term).sum::<S>();
        let slopes = match is_first {
            true => [1, 2, 3].map(|k| {
                let of_upper = sum(&|j| factor(k, j) * lower[j] * powers[j]);
                let of_lower = sum(&|i| factor(i, k) * upper[i] * powers[i]);
                [powers[k] * of_upper, powers[k] * of_lower]
            }),
            false => [1, 2, 3].map(|k| [S::ZERO, powers[k]]),
        };
        let scale = scale / (lens.limit + lens.limit);
        lens.limit_slopes = [0, 1].map(|part| slopes.map(|by| scale * by[part]));
        lens
    }

    fn factor(&self, s: S) -> Factor<S> {
        let [upper, lower] = &self.parts;
        let share = S::ONE / polynomial(lower, s);
        let f = polynomial(upper, s) * share;
        let slope = (polynomial_slope(upper, s) - f * polynomial_slope(lower, s)) * share;
        Factor { f, slope, share }
    }

    /// f by k1, k2, k3, and by k4, k5, k6, without what the limit does.
    fn factor_slopes(&self, s: S) -> [[S; 3]; 2] {
        let Factor { f, share, .. } = self.factor(s);
        let powers = [s, s * s, s * s * s].map(|power| power * share);
        [powers, powers.map(|power| -(f * power))]
    }

    /// t_x and t_y by p1, and by p2.
    fn tangents([x, y]: [S; 2]) -> [[S; 2]; 2] {
        let (xx, yy, xy) = (x * x, y * y, x * y);
        let (s, twice) = (xx + yy, xy + xy);
        [[twice, s + (yy + yy)], [s + (xx + xx), twice]]
    }

    /// t_x and t_y.
    fn tangential(&self, point: [S; 2]) -> [S; 2] {
        let ([p1, p2], [by_p1, by_p2]) = (self.tangential, Self::tangents(point));
        [p1 * by_p1[0] + p2 * by_p2[0], p1 * by_p1[1] + p2 * by_p2[1]]
    }

    fn locate(&self, [x, y, z]: [S; 3]) -> Region<S> {
        if z > S::ZERO {
            let projected = [x / z, y / z];
            if projected[0] * projected[0] + projected[1] * projected[1] <= self.limit * self.limit
            {
                return Region::Inside(projected);
            }
        }
        // Divided by the larger first, so that no square leaves the range of the numbers.
        let largest = x.abs().maximum_or_nan(y.abs());
        if largest == S::ZERO {
            return Region::Behind;
        }
        let [a, b] = [x / largest, y / largest];
        let length = (a * a + b * b).sqrt();
        Region::Outside([a / length, b / length], largest * length)
    }

    /// The distorted point's X and Y; its Z is the point's.
    pub(super) fn shown(&self, point: [S; 3]) -> [S; 2] {
        let [x, y, z] = point;
        match self.locate(point) {
            Region::Inside(projected) => {
                let Factor { f, .. } =
                    self.factor(projected[0] * projected[0] + projected[1] * projected[1]);
                let [tx, ty] = self.tangential(projected);
                [x * f + z * tx, y * f + z * ty]
            }
            Region::Outside(n, rho) => {
                let Factor { f, .. } = self.factor(self.limit * self.limit);
                let [tx, ty] = self.tangential(n).map(|t| self.limit * rho * t);
                [x * f + tx, y * f + ty]
            }
            Region::Behind => [S::ZERO; 2],
        }
    }

    /// Of X and Y by the point, and by all eight coefficients.
    pub(super) fn shown_slopes(&self, point: [S; 3]) -> ([[S; 3]; 2], [[S; 8]; 2]) {
        match self.locate(point) {
            Region::Inside(projected) => self.slopes_inside(point, projected),
            Region::Outside(n, rho) => self.slopes_outside(n, rho),
            Region::Behind => {
                let Factor { f, .. } = self.factor(self.limit * self.limit);
                ([[f, S::ZERO, S::ZERO], [S::ZERO, f, S::ZERO]], [[S::ZERO; 8]; 2])
            }
        }
    }

    fn slopes_inside(
        &self,
        [big_x, big_y, z]: [S; 3],
        [x, y]: [S; 2],
    ) -> ([[S; 3]; 2], [[S; 8]; 2]) {
        let [p1, p2] = self.tangential;
        let (two, six) = (S::from_f64(2.0), S::from_f64(6.0));
        let s = x * x + y * y;
        let Factor { f, slope, .. } = self.factor(s);
        let [tx, ty] = self.tangential([x, y]);
        let mixed = two * (x * y * slope + p1 * x + p2 * y);
        let across = f + two * x * x * slope + two * p1 * y + six * p2 * x;
        let down = f + two * y * y * slope + six * p1 * y + two * p2 * x;
        // x'' - x dx''/dx - y dx''/dy: what is linear has dropped out.
        let radial = -(two * s * slope);
        let by_z = [radial * x - tx, radial * y - ty];
        let [by_p1, by_p2] = Self::tangents([x, y]);
        let by_factor = self.factor_slopes(s);
        let row = |k: usize, along: S| {
            let [[k1, k2, k3], [k4, k5, k6]] = by_factor.map(|part| part.map(|by| along * by));
            [k1, k2, z * by_p1[k], z * by_p2[k], k3, k4, k5, k6]
        };
        let by_point = [[across, mixed, by_z[0]], [mixed, down, by_z[1]]];
        (by_point, [row(0, big_x), row(1, big_y)])
    }

    fn slopes_outside(&self, [x, y]: [S; 2], rho: S) -> ([[S; 3]; 2], [[S; 8]; 2]) {
        let ([p1, p2], limit) = (self.tangential, self.limit);
        let (two, five) = (S::from_f64(2.0), S::from_f64(5.0));
        let square = limit * limit;
        let Factor { f, slope, .. } = self.factor(square);
        let (xxx, yyy) = (x * x * x, y * y * y);
        let by_point = [
            [
                f + limit * (two * p1 * yyy + p2 * (five * x - two * xxx)),
                limit * (two * p1 * xxx + p2 * (y - two * x * x * y)),
                S::ZERO,
            ],
            [
                limit * (p1 * (x - two * y * y * x) + two * p2 * yyy),
                f + limit * (p1 * (five * y - two * yyy) + two * p2 * xxx),
                S::ZERO,
            ],
        ];
        let (t, [by_p1, by_p2]) = (self.tangential([x, y]), Self::tangents([x, y]));
        let by_factor = self.factor_slopes(square);
        let row = |k: usize, along: S| {
            let by_limit = along * (two * limit * slope) + t[k];
            let [[k1, k2, k3], [k4, k5, k6]] = [0, 1].map(|part| {
                [0, 1, 2].map(|j| {
                    rho * (along * by_factor[part][j] + by_limit * self.limit_slopes[part][j])
                })
            });
            [k1, k2, limit * rho * by_p1[k], limit * rho * by_p2[k], k3, k4, k5, k6]
        };
        (by_point, [row(0, x), row(1, y)])
    }
}

macro_rules! lens_maps {
    ($($count:literal),*) => { $(
        impl<S: Scalar> LensMap<S, $count> for Distortion<S> {
            fn from_coefficients(coefficients: [S; $count]) -> Self {
                Self::new(all(coefficients))
            }

            fn apply(&self, point: [S; 3]) -> [S; 3] {
                let [x, y] = self.shown(point);
                [x, y, point[2]]
            }

            fn slopes(&self, point: [S; 3]) -> Slopes<S, $count> {
                let ([by_x, by_y], rows) = self.shown_slopes(point);
                let [of_x, of_y] = rows.map(|row| std::array::from_fn(|k| row[k]));
                Slopes {
                    by_point: [by_x, by_y, [S::ZERO, S::ZERO, S::ONE]],
                    by_coefficient: [of_x, of_y, [S::ZERO; $count]],
                }
            }
        }
    )* };
}

lens_maps!(5, 8);

impl Distortion<f64> {
    /// A point that the lens, without p1 and p2, shows at the radius `shown`: its radius.
    pub(super) fn radius_of(&self, shown: f64) -> f64 {
        let Factor { f, .. } = self.factor(self.limit * self.limit);
        if shown >= self.limit * f {
            return shown / f;
        }
        bisected(0.0, self.limit, |r| r * self.factor(r * r).f <= shown)
    }
}
