//! A fisheye: angles off the axis become radii.
//!
//! # Forward
//! A point P = (X, Y, Z) at the distance d from the eye lies at the angle `theta = atan2(rho, Z)` off the axis,
//! with `rho = |(X, Y)|`. The lens shows it at the radius `theta_d = theta p(theta^2)`,
//! `p(s) = 1 + k1 s + k2 s^2 + k3 s^3 + k4 s^4`, in the direction of (X, Y). A pinhole shows that at
//! (g X, g Y, d), with `g = theta_d / sin(theta)`.
//!
//! The polynomial is fitted to what the sensor saw. So it holds up to the *limit*, the first angle at which theta_d
//! stops to grow, and at most up to [`WIDEST`]. From there on directions turn evenly until the axis behind
//! the camera stays where it is: with `tau = pi - theta`, and the radius R at the limit, P goes to
//! `(g X, g Y, d h)`, where `g = sin(c tau) / (C sin(tau))`, `h = -cos(c tau) / C`, `C = (1 + R^2)^(-1/2)` and
//! `c = (pi - atan(R)) / (pi - limit)`. So the sphere of directions is mapped on itself without a tear, and what
//! lies beyond the limit leaves the image through infinity, as it does for a pinhole.
//!
//! # Slopes
//! With an angle a off the axis, before the camera or behind it, and `b = |Z| / Z` there,
//! `dg/dP = E (b X Z / d^3, b Y Z / d^3, -b rho^2 / d^3)` with `E = (dg/da) / sin(a)`, which is smooth on the
//! axis. `sin(a) / a` and its slope by a^2 are Stumpff's `c_1`, and a^2 is a series near the axis.
//!
//! # Where it is not smooth
//! At the limit, where slopes jump; where the limit leaps as coefficients change, because the polynomial begins to
//! turn round or does so no longer; at the eye itself.
//!
//! # Source
//! Kannala and Brandt, *A generic camera model and calibration method for conventional, wide-angle, and fish-eye
//! lenses*, IEEE Transactions on Pattern Analysis and Machine Intelligence 28(8), 2006, with the coefficients of
//! OpenCV's module `fisheye`, COLMAP's OPENCV_FISHEYE and nerfstudio. What lies beyond the limit is ours.

use std::f64::consts::PI;

use bokashi_core::Scalar;

use super::bend::{LensMap, Slopes};
use super::stumpff::{slopes, stumpff};
use super::turning::{Turn, bisected, polynomial, polynomial_slope};

/// The largest angle at which the polynomial holds: 150 degrees.
const WIDEST: f64 = PI * 5.0 / 6.0;

/// Below this `tan^2`, the square of an angle is a series, to rounding.
const SERIES_UP_TO: f64 = 1e-6;

/// Squares of coordinates beyond it, and below its reciprocal, would leave the range of the numbers.
const FAR: f64 = 1e100;

/// The angle off the axis, in radians, up to which [`fisheye`](crate::fisheye()) follows the polynomial of
/// `coefficients` = (k1, k2, k3, k4). It is the first angle at which the radius that is shown stops to grow, and
/// at most 150 degrees.
pub fn fisheye_limit(coefficients: [f64; 4]) -> f64 {
    Equidistant::new(coefficients).limit
}

/// The radius, in normalized coordinates, at which a fisheye of `coefficients` = (k1, k2, k3, k4) shows what lies
/// `angle` radians off the axis.
pub fn fisheye_radius(angle: f64, coefficients: [f64; 4]) -> f64 {
    let lens = Equidistant::new(coefficients);
    angle * polynomial(&lens.coefficients, angle * angle)
}

/// The angle off the axis, in radians, of what a fisheye of `coefficients` = (k1, k2, k3, k4) shows at `radius`,
/// in normalized coordinates. `None` where it shows nothing: see [`fisheye_limit`].
pub fn fisheye_angle(radius: f64, coefficients: [f64; 4]) -> Option<f64> {
    let lens = Equidistant::new(coefficients);
    let radius_at = |angle: f64| angle * polynomial(&lens.coefficients, angle * angle);
    let is_shown = (0.0..=radius_at(lens.limit)).contains(&radius);
    is_shown.then(|| bisected(0.0, lens.limit, |angle| radius_at(angle) <= radius))
}

/// The coefficients of a fisheye.
#[derive(Debug, Clone, Copy)]
pub(super) struct Equidistant<S> {
    /// 1, k1, k2, k3, k4.
    coefficients: [S; 5],
    limit: S,
    /// R.
    limit_radius: S,
    /// c and 1 / C.
    turn: S,
    stretch: S,
    /// How atan(R) and c move with each coefficient.
    limit_slopes: [[S; 4]; 2],
}

/// How a point is shown at the angle a off the axis before the camera, or behind it.
struct Shown<S> {
    /// Points are divided by it first.
    unit: S,
    /// 1 before the camera, up to the limit; -1 behind it.
    side: S,
    /// X, Y, Z, and the distance.
    point: [S; 3],
    distance: S,
    /// a^2, and `sin(a) / a`.
    square: S,
    ratio: S,
    /// g and h.
    scale: [S; 2],
    /// Their slopes by a, divided by `sin(a)`.
    scale_slopes: [S; 2],
}

/// `atan(t)^2` of `t^2`, near 0.
fn squared_angle<S: Scalar>(t: S) -> S {
    let [a, b] = [2.0 / 3.0, 23.0 / 45.0].map(S::from_f64);
    t * (S::ONE - t * (a - t * b))
}

/// `sin(a) / a` of a^2, its slope by a^2, and `cos(a)`.
fn ratio<S: Scalar>(square: S) -> [S; 3] {
    let all = stumpff(square);
    [all[0], slopes(&all)[0], S::ONE - square * all[1]]
}

impl<S: Scalar> Equidistant<S> {
    fn new([k1, k2, k3, k4]: [S; 4]) -> Self {
        let coefficients = [S::ONE, k1, k2, k3, k4];
        let odd = |k: usize| S::from_f64(2.0 * k as f64 + 1.0);
        let growth: [S; 5] = std::array::from_fn(|k| odd(k) * coefficients[k]);
        let (mut limit, mut scale) = (S::from_f64(WIDEST), S::ZERO);
        if let Some(turn) = Turn::new(&growth, WIDEST * WIDEST) {
            limit = turn.root.sqrt();
            scale = turn.scale.map_or(S::ZERO, |scale| scale / (limit + limit));
        }
        let square = limit * limit;
        let limit_radius = limit * polynomial(&coefficients, square);
        let behind = S::from_f64(PI) - limit;
        let turn = (S::from_f64(PI) - limit_radius.atan2(S::ONE)) / behind;
        let one_and_square = S::ONE + limit_radius * limit_radius;
        let mut power = S::ONE;
        let slopes: [[S; 2]; 4] = std::array::from_fn(|k| {
            power *= square;
            // Where theta_d turns round, it does not move with the limit.
            let of_angle = limit * power / one_and_square;
            let of_limit = scale * odd(k + 1) * power;
            [of_angle, (turn * of_limit - of_angle) / behind]
        });
        Self {
            coefficients,
            limit,
            limit_radius,
            turn,
            stretch: one_and_square.sqrt(),
            limit_slopes: [0, 1].map(|part| slopes.map(|slope| slope[part])),
        }
    }

    /// Where a point is, and how it is shown. `None` at the eye.
    fn shown(&self, point: [S; 3]) -> Option<Shown<S>> {
        let largest = point.iter().map(|x| x.to_f64().abs()).fold(0.0, f64::max);
        if largest == 0.0 {
            return None;
        }
        let is_usual = (1.0 / FAR..=FAR).contains(&largest);
        let unit = if is_usual { S::ONE } else { S::from_f64(largest) };
        let [x, y, z] = if is_usual { point } else { point.map(|x| x / unit) };
        let across = x * x + y * y;
        // The square of the angle between a point and the axis on its side.
        let square = |z: S| {
            let is_near = z > S::ZERO && across <= S::from_f64(SERIES_UP_TO) * z * z;
            if is_near {
                return squared_angle(across / (z * z));
            }
            let angle = across.sqrt().atan2(z);
            angle * angle
        };
        let before = square(z);
        let is_inside = before <= self.limit * self.limit;
        let side = if is_inside { S::ONE } else { -S::ONE };
        let square = if is_inside { before } else { square(-z) };
        let [sinc, sinc_slope, _] = ratio(square);
        let two = S::from_f64(2.0);
        let (scale, scale_slopes) = if is_inside {
            let p = polynomial(&self.coefficients, square);
            let p_slope = polynomial_slope(&self.coefficients, square);
            let g = p / sinc;
            ([g, S::ONE], [two * (p_slope - g * sinc_slope) / (sinc * sinc), S::ZERO])
        } else {
            let (c, stretch) = (self.turn, self.stretch);
            let [turned, turned_slope, cosine] = ratio(c * c * square);
            let g = c * stretch * turned / sinc;
            let g_slope = (c * c * c * stretch * turned_slope - g * sinc_slope) / sinc;
            ([g, -(cosine * stretch)], [two * g_slope / sinc, c * g])
        };
        let distance = (across + z * z).sqrt();
        Some(Shown {
            unit,
            side,
            point: [x, y, z],
            distance,
            square,
            ratio: sinc,
            scale,
            scale_slopes,
        })
    }
}

impl<S: Scalar> LensMap<S, 4> for Equidistant<S> {
    fn from_coefficients(coefficients: [S; 4]) -> Self {
        Self::new(coefficients)
    }

    fn apply(&self, point: [S; 3]) -> [S; 3] {
        let Some(Shown { unit, point: [x, y, _], distance, scale: [g, h], .. }) = self.shown(point)
        else {
            return [S::ZERO; 3];
        };
        [g * x, g * y, distance * h].map(|coordinate| unit * coordinate)
    }

    fn slopes(&self, point: [S; 3]) -> Slopes<S, 4> {
        let Some(shown) = self.shown(point) else {
            let row =
                |column: usize| std::array::from_fn(|k| if k == column { S::ONE } else { S::ZERO });
            return Slopes { by_point: [0, 1, 2].map(row), by_coefficient: [[S::ZERO; 4]; 3] };
        };
        let Shown { unit, side, point: [x, y, z], distance: d, square, ratio, .. } = shown;
        let ([g, h], [e, h_slope]) = (shown.scale, shown.scale_slopes);
        let across = x * x + y * y;
        let by_across = side * z * e / (d * d * d);
        let by_along = -(side * across * e / (d * d * d));
        let outwards = (h + h_slope * side * z / d) / d;
        let along = h * z / d - side * h_slope * across / (d * d);
        let by_point = [
            [g + x * x * by_across, x * y * by_across, x * by_along],
            [x * y * by_across, g + y * y * by_across, y * by_along],
            [x * outwards, y * outwards, along],
        ];
        let [angles, turns] = &self.limit_slopes;
        let mut power = S::ONE;
        let moves: [[S; 2]; 4] = std::array::from_fn(|k| {
            power *= square;
            if side > S::ZERO {
                return [power / ratio, S::ZERO];
            }
            let by_angle = self.limit_radius * angles[k];
            [g * by_angle - h / ratio * turns[k], h * by_angle + square * g * ratio * turns[k]]
        });
        let slopes_along =
            |along: S, which: usize| moves.map(|slopes| unit * along * slopes[which]);
        Slopes {
            by_point,
            by_coefficient: [slopes_along(x, 0), slopes_along(y, 0), slopes_along(d, 1)],
        }
    }
}
