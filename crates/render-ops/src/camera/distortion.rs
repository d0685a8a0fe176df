//! The distortion of a lens, and where its polynomial holds.
//!
//! # Forward
//! A point (X, Y, Z) in camera coordinates has the normalized coordinates `x = X / Z`, `y = Y / Z`, and
//! `s = r^2 = x^2 + y^2`. With `f(s) = 1 + k1 s + k2 s^2 + k3 s^3` the lens shows it at
//!
//! - `x'' = x f(s) + t_x`, `t_x = 2 p1 x y + p2 (s + 2 x^2)`,
//! - `y'' = y f(s) + t_y`, `t_y = p1 (s + 2 y^2) + 2 p2 x y`.
//!
//! The polynomial is fitted to what the sensor saw. Far outside, `r f(r^2)` may turn round, and would
//! bring points back into the image. So it holds up to the *rim*, the first radius at which that
//! happens, and at most up to [`FARTHEST`]. From there on the map goes on linearly along each ray from
//! the centre: with `m = rim / r`, the point m (x, y) is on the rim, and what it is shown at is divided
//! by m. Times Z that is `rho / rim` times the distorted point `rim n` of the rim, with `rho = |(X, Y)|` and
//! `n = (X, Y) / rho`. It does not depend on Z, so it goes on to Z = 0, and behind the camera.
//!
//! # Where it is not smooth
//! At the rim, where slopes jump; on the axis behind the camera, where p1 and p2 leave a kink; and
//! where the rim leaps as coefficients change, because the polynomial begins to turn round or does so no
//! longer.
//!
//! # Source
//! Brown, *Decentering distortion of lenses*, Photogrammetric Engineering 32(3), 1966; the order and
//! signs of the coefficients are those of OpenCV's module `calib3d`. What lies beyond the rim is ours.

use bokashi_core::Scalar;

/// The largest radius at which the polynomial holds: 86 degrees off the axis.
const FARTHEST: f64 = 16.0;

/// The radius, in normalized coordinates (the tangent of the angle off the axis), up to which
/// [`distort`](crate::distort()) follows the polynomial of `coefficients` = (k1, k2, p1, p2, k3). It is the
/// first radius r at which `r (1 + k1 r^2 + k2 r^4 + k3 r^6)` stops to grow, and at most 16.
pub fn distortion_radius(coefficients: [f64; 5]) -> f64 {
    Distortion::of(coefficients).rim
}

/// The coefficients of a lens.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distortion<S> {
    /// k1, k2, k3.
    radial: [S; 3],
    /// p1, p2.
    tangential: [S; 2],
    rim: S,
    /// How the rim moves with k1, k2 and k3.
    rim_slopes: [S; 3],
}

/// How a distorted point moves with its point, and with the coefficients.
pub(super) struct Slopes<S> {
    /// Of the two distorted coordinates by X, Y and Z.
    pub(super) by_point: [[S; 3]; 2],
    /// Of the two distorted coordinates by each coefficient.
    pub(super) by_coefficient: [[S; 5]; 2],
}

/// Where a point is.
enum Place<S> {
    /// The normalized coordinates, up to the rim.
    Inside([S; 2]),
    /// The direction and the distance of (X, Y), beyond the rim.
    Outside([S; 2], S),
    /// On the axis behind the camera.
    Behind,
}

impl<S: Scalar> Distortion<S> {
    pub(super) fn of([k1, k2, p1, p2, k3]: [S; 5]) -> Self {
        let radial = [k1, k2, k3];
        let [three, five, seven] = [3.0, 5.0, 7.0].map(S::from_f64);
        let mut rim = S::from_f64(FARTHEST);
        let mut rim_slopes = [S::ZERO; 3];
        if let Some(found) = turning_point(radial.map(S::to_f64)) {
            let [a, b, c] = [three * k1, five * k2, seven * k3];
            let growth = |s: S| S::ONE + s * (a + s * (b + s * c));
            let slope = |s: S| a + s * (b + b + three * c * s);
            let s = S::from_f64(found);
            let terms = [a, (b + b) * s, three * c * s * s];
            let size: f64 = terms.iter().map(|term| term.to_f64().abs()).sum();
            rim = s.sqrt();
            // Where it is 0 within rounding, the polynomial hardly turns round: the rim is about to leap.
            if slope(s).to_f64().abs() > f64::EPSILON * size {
                // The coefficients' derivatives, where numbers carry them: by Newton's method.
                let moved = growth(s) - S::from_f64(growth(s).to_f64());
                let s = s - moved / slope(s);
                rim = s.sqrt();
                let scale = -(S::ONE / (slope(s) * (rim + rim)));
                rim_slopes = [three * s, five * s * s, seven * s * s * s].map(|by| scale * by);
            }
        }
        Self { radial, tangential: [p1, p2], rim, rim_slopes }
    }

    /// f(s), and its slope.
    fn factor(&self, s: S) -> [S; 2] {
        let [k1, k2, k3] = self.radial;
        let (two, three) = (S::from_f64(2.0), S::from_f64(3.0));
        [S::ONE + s * (k1 + s * (k2 + s * k3)), k1 + s * (two * k2 + s * (three * k3))]
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

    fn place(&self, [x, y, z]: [S; 3]) -> Place<S> {
        if z > S::ZERO {
            let seen = [x / z, y / z];
            if seen[0] * seen[0] + seen[1] * seen[1] <= self.rim * self.rim {
                return Place::Inside(seen);
            }
        }
        // Divided by the larger first, so that no square leaves the range of the numbers.
        let largest = x.abs().maximum_or_nan(y.abs());
        if largest == S::ZERO {
            return Place::Behind;
        }
        let [a, b] = [x / largest, y / largest];
        let length = (a * a + b * b).sqrt();
        Place::Outside([a / length, b / length], largest * length)
    }

    /// The distorted point's X and Y; its Z is the point's.
    pub(super) fn apply(&self, point: [S; 3]) -> [S; 2] {
        let [x, y, z] = point;
        match self.place(point) {
            Place::Inside(seen) => {
                let [f, _] = self.factor(seen[0] * seen[0] + seen[1] * seen[1]);
                let [tx, ty] = self.tangential(seen);
                [x * f + z * tx, y * f + z * ty]
            }
            Place::Outside(n, rho) => {
                let [f, _] = self.factor(self.rim * self.rim);
                let [tx, ty] = self.tangential(n).map(|t| self.rim * rho * t);
                [x * f + tx, y * f + ty]
            }
            Place::Behind => [S::ZERO; 2],
        }
    }

    pub(super) fn slopes(&self, point: [S; 3]) -> Slopes<S> {
        match self.place(point) {
            Place::Inside(seen) => self.slopes_inside(point, seen),
            Place::Outside(n, rho) => self.slopes_outside(n, rho),
            Place::Behind => {
                let [f, _] = self.factor(self.rim * self.rim);
                let by_point = [[f, S::ZERO, S::ZERO], [S::ZERO, f, S::ZERO]];
                Slopes { by_point, by_coefficient: [[S::ZERO; 5]; 2] }
            }
        }
    }

    fn slopes_inside(&self, [big_x, big_y, z]: [S; 3], [x, y]: [S; 2]) -> Slopes<S> {
        let [p1, p2] = self.tangential;
        let (two, six) = (S::from_f64(2.0), S::from_f64(6.0));
        let s = x * x + y * y;
        let [f, slope] = self.factor(s);
        let [tx, ty] = self.tangential([x, y]);
        let mixed = two * (x * y * slope + p1 * x + p2 * y);
        let across = f + two * x * x * slope + two * p1 * y + six * p2 * x;
        let down = f + two * y * y * slope + six * p1 * y + two * p2 * x;
        // x'' - x dx''/dx - y dx''/dy: what is linear has dropped out.
        let radial = -(two * s * slope);
        let by_z = [radial * x - tx, radial * y - ty];
        let [by_p1, by_p2] = Self::tangents([x, y]);
        let powers = [s, s * s, s * s * s];
        let row = |k: usize, along: S| {
            let [k1, k2, k3] = powers.map(|power| along * power);
            [k1, k2, z * by_p1[k], z * by_p2[k], k3]
        };
        Slopes {
            by_point: [[across, mixed, by_z[0]], [mixed, down, by_z[1]]],
            by_coefficient: [row(0, big_x), row(1, big_y)],
        }
    }

    fn slopes_outside(&self, [x, y]: [S; 2], rho: S) -> Slopes<S> {
        let ([p1, p2], rim) = (self.tangential, self.rim);
        let (two, five) = (S::from_f64(2.0), S::from_f64(5.0));
        let square = rim * rim;
        let [f, slope] = self.factor(square);
        let (xxx, yyy) = (x * x * x, y * y * y);
        let by_point = [
            [
                f + rim * (two * p1 * yyy + p2 * (five * x - two * xxx)),
                rim * (two * p1 * xxx + p2 * (y - two * x * x * y)),
                S::ZERO,
            ],
            [
                rim * (p1 * (x - two * y * y * x) + two * p2 * yyy),
                f + rim * (p1 * (five * y - two * yyy) + two * p2 * xxx),
                S::ZERO,
            ],
        ];
        let (t, [by_p1, by_p2]) = (self.tangential([x, y]), Self::tangents([x, y]));
        let powers = [square, square * square, square * square * square];
        let row = |k: usize, along: S| {
            let by_rim = along * (two * rim * slope) + t[k];
            let [k1, k2, k3] =
                std::array::from_fn(|j| rho * (along * powers[j] + by_rim * self.rim_slopes[j]));
            [k1, k2, rim * rho * by_p1[k], rim * rho * by_p2[k], k3]
        };
        Slopes { by_point, by_coefficient: [row(0, x), row(1, y)] }
    }
}

impl Distortion<f64> {
    /// A point that the lens, without p1 and p2, shows at the radius `shown`: its radius.
    pub(super) fn radius_of(&self, shown: f64) -> f64 {
        let [f, _] = self.factor(self.rim * self.rim);
        if shown >= self.rim * f {
            return shown / f;
        }
        bisected(0.0, self.rim, |r| r * self.factor(r * r)[0] <= shown)
    }
}

/// The square of the first radius, below [`FARTHEST`], at which `r f(r^2)` turns round: where its slope
/// `1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3` becomes negative.
fn turning_point([k1, k2, k3]: [f64; 3]) -> Option<f64> {
    let (a, b, c) = (3.0 * k1, 5.0 * k2, 7.0 * k3);
    let slope = |s: f64| 1.0 + s * (a + s * (b + s * c));
    // Between the two points where the cubic turns, and beyond them, it goes one way.
    let root = (b * b - 3.0 * a * c).sqrt();
    let q = -(b + root.copysign(b));
    let mut ends = [q / (3.0 * c), a / q, FARTHEST * FARTHEST];
    for end in &mut ends {
        if !(0.0..=FARTHEST * FARTHEST).contains(end) {
            *end = 0.0;
        }
    }
    ends.sort_unstable_by(f64::total_cmp);
    let mut low = 0.0;
    for end in ends {
        if slope(end) < 0.0 {
            return Some(bisected(low, end, |s| slope(s) > 0.0));
        }
        low = end;
    }
    None
}

/// The last number from `low` to `high` for which `holds`, where it holds up to a point.
fn bisected(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    loop {
        let middle = 0.5 * low + 0.5 * high;
        if middle <= low || middle >= high {
            return low;
        }
        *(if holds(middle) { &mut low } else { &mut high }) = middle;
    }
}
