//! Where a piece lies and how far it spreads, as seen by the mean of its barycentrics (`mean`): with
//! the density 1 / t, where t is linear over the image and positive on the piece.
//!
//! # Sums
//! They are the integrals of 1 and r over t, and of 1, r and r r^T over t^2. Each is taken over the
//! triangles of the fan around a polygon's first corner, in units of t there; r is from that corner.
//! In sums about one corner nothing cancels that counts: a piece's centroid under 1 / t is nearly as
//! far from the corner where t is least as from the others, whatever t is.
//!
//! # Polygons where t changes little
//! Let t be 1 at the first corner, and `1 - a` and `1 - b` at the points p and q. At `r = u p + v q` it is
//! `1 - h`, `h = a u + b v`. Powers of h have the integrals
//! `int u^i v^j h^n = i! j! n! / (n + i + j + 2)! H_n`, per twice the area. `H_n` is the sum of all
//! products of n factors from a (i + 1 times) and b (j + 1 times). So the integrals of r over t and of
//! r r^T over t^2 are power series. The others follow, since with t's gradient g
//! `int 1 = int (1 + g . r) / t`, and likewise `int r / t` and `int 1 / t`.
//!
//! # All other polygons
//! That would cancel where t changes much. The level line of t through the middle corner cuts a triangle
//! in two. Each part has an apex and a base, along which t is the same. At the share u of the way from
//! the apex to the base t is linear in u, and the breadth is u times the base: integrals along a
//! segment (`reciprocal`).
//!
//! # Pieces that reach to the horizon
//! What the slopes of the weights and the sides say of a mean cancels, and by as much as t changes.
//! Beyond [`HORIZON`] the weights N_i are therefore raised alike, by a third of [`RAISE`] times the size
//! of t. With `e = RAISE` a barycentric becomes `(N_i + e/3) / (T + e)`, in units of that size. It moves by at
//! most `e / (T + e)`, whose mean over T is `e ln(1 + 1/e)`, 2e-8. The gradient is that of the raised mean.

use bokashi_core::Scalar;

use super::polygon::{Line, Triangle, size, value_at};
use super::reciprocal::Reciprocal;

/// Where a piece lies and how far it spreads, with T for t at its centroid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent<S> {
    /// `int p / t` over `int 1 / t`.
    pub(super) centroid: [S; 2],
    /// The means of x^2, xy and y^2 from the centroid, times T^2 / t^2.
    pub(super) spread: [S; 3],
    /// The means of x and y from the centroid, times T^2 / t^2.
    pub(super) drift: [S; 2],
    /// Whether the weights were raised.
    pub(super) is_raised: bool,
}

impl<S: Scalar> Extent<S> {
    /// Of what has no size.
    pub(super) fn from_point(point: [S; 2]) -> Self {
        Self { centroid: point, spread: [S::ZERO; 3], drift: [S::ZERO; 2], is_raised: false }
    }
}

/// Below this share of its size in the pixel, t is held: there it is rounding.
pub(super) const FLOOR: f64 = 1.0 / (1_u64 << 40) as f64;

/// A piece reaches to the horizon where t is below this share of its size in the pixel.
const HORIZON: f64 = 1.0 / (1_u64 << 32) as f64;

/// By which share of its size t is raised then.
const RAISE: f64 = 1.0 / (1_u64 << 30) as f64;

/// What each of three weights that add up to t is raised by, in a piece that reaches to the horizon.
#[inline(always)]
pub(super) fn raise<S: Scalar>(t: Line<S>) -> S {
    S::from_f64(RAISE / 3.0) * size(t)
}

/// Up to this change of t, relative to its value at the first corner, series are summed: of this many
/// terms.
const MOST_CHANGE: f64 = 1.0 / 16.0;
const MOST_TERMS: usize = 10;

/// A series ends where the powers of the change are below this. Its remainder is a third of that.
const SMALLEST_POWER: f64 = 1e-12;

/// The integrals of 1, x and y over t, and of 1, x, y, x^2, xy and y^2 over t^2.
#[derive(Debug, Clone, Copy)]
struct Sums<S> {
    over_t: [S; 3],
    over_t_squared: [S; 6],
}

impl<S: Scalar> Sums<S> {
    const ZERO: Self = Self { over_t: [S::ZERO; 3], over_t_squared: [S::ZERO; 6] };

    /// Adds another one's, times `weight`, which lie `[x, y]` from these, and whose t is in units `scale`
    /// times smaller.
    #[inline(always)]
    fn add<const SPREADS: bool>(&mut self, other: &Self, [x, y]: [S; 2], scale: S) {
        let [j, j_x, j_y] = other.over_t.map(|sum| scale * sum);
        let moved = [j, j_x + x * j, j_y + y * j];
        self.over_t.iter_mut().zip(moved).for_each(|(sum, part)| *sum += part);
        if !SPREADS {
            return;
        }
        let [m, m_x, m_y, m_xx, m_xy, m_yy] = other.over_t_squared.map(|sum| scale * scale * sum);
        let moved = [
            m,
            m_x + x * m,
            m_y + y * m,
            m_xx + x * (m_x + m_x + x * m),
            m_xy + x * m_y + y * m_x + x * y * m,
            m_yy + y * (m_y + m_y + y * m),
        ];
        self.over_t_squared.iter_mut().zip(moved).for_each(|(sum, part)| *sum += part);
    }

    /// Of a fan of the area `area`; t is 1 at its middle and has the gradient `[g_x, g_y]`. None where
    /// it changes too much.
    #[inline(always)]
    fn mild<const SPREADS: bool>(
        fan: impl Iterator<Item = Triangle<S>>,
        area: S,
        [g_x, g_y]: [S; 2],
    ) -> Option<Self> {
        let [mut j_x, mut j_y, mut m_xx, mut m_xy, mut m_yy] = [S::ZERO; 5];
        for Triangle { p, q, twice } in fan {
            let [a, b] = [p, q].map(|[x, y]| -(g_x * x + g_y * y));
            let [size_a, size_b] = [a, b].map(|change| change.to_f64().abs());
            let largest = if size_a > size_b { size_a } else { size_b };
            if largest > MOST_CHANGE {
                return None;
            }
            // By pairs of what belongs to u and to v.
            let ab = [a, b];
            let [mut b_n, mut h, mut h_uv] = [S::ONE; 3];
            let [mut h_first, mut h_square] = [[S::ONE; 2]; 2];
            let mut first = [S::from_f64(OF_FIRST[0]); 2];
            let (mut square, mut uv) = ([S::from_f64(OF_SECOND[0]); 2], S::from_f64(OF_SECOND[0]));
            let mut power = largest;
            for (&of_first, &of_second) in OF_FIRST[1..].iter().zip(&OF_SECOND[1..]) {
                // With one factor c more, the sums of all products obey `H_n = H_n without c + c H_(n-1)`.
                b_n *= b;
                h = b_n + a * h;
                h_first = [0, 1].map(|k| h + ab[k] * h_first[k]);
                let of_first = S::from_f64(of_first);
                first = [0, 1].map(|k| first[k] + of_first * h_first[k]);
                if SPREADS {
                    h_square = [0, 1].map(|k| h_first[k] + ab[k] * h_square[k]);
                    h_uv = h_first[0] + b * h_uv;
                    let of_second = S::from_f64(of_second);
                    square = [0, 1].map(|k| square[k] + of_second * h_square[k]);
                    uv += of_second * h_uv;
                }
                // The first power counts also where it is 0, for it may carry a derivative.
                power *= largest;
                if power <= SMALLEST_POWER {
                    break;
                }
            }
            let [u, v] = first.map(|integral| twice * integral);
            j_x += u * p[0] + v * q[0];
            j_y += u * p[1] + v * q[1];
            if SPREADS {
                let ([uu, vv], uv) =
                    (square.map(|integral| twice * (integral + integral)), twice * uv);
                let [x, y] = [0, 1].map(|axis| uu * p[axis] + uv * q[axis]);
                let [x_of_q, y_of_q] = [0, 1].map(|axis| uv * p[axis] + vv * q[axis]);
                m_xx += x * p[0] + x_of_q * q[0];
                m_xy += x * p[1] + x_of_q * q[1];
                m_yy += y * p[1] + y_of_q * q[1];
            }
        }
        let j = area - g_x * j_x - g_y * j_y;
        let (m_x, m_y) = (j_x - g_x * m_xx - g_y * m_xy, j_y - g_x * m_xy - g_y * m_yy);
        let m = j - g_x * m_x - g_y * m_y;
        Some(Self { over_t: [j, j_x, j_y], over_t_squared: [m, m_x, m_y, m_xx, m_xy, m_yy] })
    }

    /// Of a fan whatever t is, at least `floor`: 1 at its middle, with this gradient. What is smaller
    /// than `least` takes its place.
    fn steep<const SPREADS: bool>(
        fan: impl Iterator<Item = Triangle<S>>,
        [g_x, g_y]: [S; 2],
        floor: S,
        least: &mut S,
    ) -> Self {
        let mut sums = Self::ZERO;
        for triangle in fan {
            let t = |[x, y]: [S; 2]| (S::ONE + (g_x * x + g_y * y)).maximum_or_nan(floor);
            let [t_p, t_q] = [triangle.p, triangle.q].map(t);
            *least = least.minimum_or_nan(t_p).minimum_or_nan(t_q);
            sums.add_steep::<SPREADS>(&triangle, t_p, t_q);
        }
        sums
    }

    /// Adds a triangle of a fan; t is 1 at its middle and `t_p` and `t_q` at the other corners.
    #[inline(always)]
    fn add_steep<const SPREADS: bool>(&mut self, triangle: &Triangle<S>, t_p: S, t_q: S) {
        let Triangle { p, q, twice } = *triangle;
        let mut corners = [(S::ONE, [S::ZERO; 2]), (t_p, p), (t_q, q)];
        for [k, next] in [[0, 1], [1, 2], [0, 1]] {
            if corners[next].0 < corners[k].0 {
                corners.swap(k, next);
            }
        }
        let [(least, low), (middle, corner), (most, high)] = corners;
        //          high       From `corner` to `end` t is the same. This base cuts the triangle into two parts,
        //         /    \      with the apexes `low` and `high`. At the share u of the way from an apex to the base
        //  corner +----+ end  t is linear in u, and the part is u times as broad as at the base.
        //         \    /
        //          low
        let share = if least < most { (middle - least) / (most - least) } else { S::ZERO };
        // The base: from the middle corner to where t is as there on the longest side.
        let end = [0, 1].map(|axis| low[axis] + share * (high[axis] - low[axis]));
        let center = [0, 1].map(|axis| S::from_f64(0.5) * (end[axis] + corner[axis]));
        let [x, y] = [0, 1].map(|axis| end[axis] - corner[axis]);
        let twelfth = S::from_f64(1.0 / 12.0);
        let base = [x * x, x * y, y * y].map(|product| twelfth * product);
        for (t, apex, share) in [(least, low, share), (most, high, S::ONE - share)] {
            let twice = share * twice;
            let reciprocal = Reciprocal::new(t, middle);
            let [_, e_1, e_2] = reciprocal.over_t().map(|integral| twice * integral);
            let [j, j_x, j_y] = &mut self.over_t;
            *j += e_1 + e_2;
            *j_x += e_1 * apex[0] + e_2 * center[0];
            *j_y += e_1 * apex[1] + e_2 * center[1];
            if SPREADS {
                let [d_0, d_1, d_2] = reciprocal.over_t_squared().map(|d| twice * d);
                let product = |i: usize, k: usize, base: S| {
                    d_0 * apex[i] * apex[k]
                        + d_1 * (apex[i] * center[k] + center[i] * apex[k])
                        + d_2 * (center[i] * center[k] + base)
                };
                let (of_apex, of_center) = (d_0 + d_1, d_1 + d_2);
                let [m, m_x, m_y, m_xx, m_xy, m_yy] = &mut self.over_t_squared;
                *m += of_apex + of_center;
                *m_x += of_apex * apex[0] + of_center * center[0];
                *m_y += of_apex * apex[1] + of_center * center[1];
                *m_xx += product(0, 0, base[0]);
                *m_xy += product(0, 1, base[1]);
                *m_yy += product(1, 1, base[2]);
            }
        }
    }
}

/// The coefficients of `H_n` in the integrals of u over t, and of u v over t^2; that of u^2 over t^2 is
/// twice as large: `n! / (n + 3)!` and `(n + 1)! / (n + 4)!`.
const OF_FIRST: [f64; MOST_TERMS] = coefficients(1);
const OF_SECOND: [f64; MOST_TERMS] = coefficients(2);

const fn coefficients(first: usize) -> [f64; MOST_TERMS] {
    let mut coefficients = [0.0; MOST_TERMS];
    let mut n = 0;
    while n < MOST_TERMS {
        let k = n + first;
        coefficients[n] = 1.0 / (k * (k + 1) * (k + 2)) as f64;
        n += 1;
    }
    coefficients
}

/// Sums over the polygons of a piece. A sample is a polygon without an extent, of any area.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread<S> {
    t: Line<S>,
    /// Where the sums are from, and t there.
    origin: Option<([S; 2], S)>,
    sums: Sums<S>,
    is_raised: bool,
    /// Whether it reaches to the horizon.
    pub(super) reaches_far: bool,
}

impl<S: Scalar> Spread<S> {
    pub(super) fn new(t: Line<S>) -> Self {
        Self { t, origin: None, sums: Sums::ZERO, is_raised: false, reaches_far: false }
    }

    /// With raised weights.
    #[cold]
    pub(super) fn raised(t: Line<S>) -> Self {
        let third = raise(t);
        let [one, x, y] = t;
        Self { is_raised: true, ..Self::new([one + third + third + third, x, y]) }
    }

    /// The least that t may be.
    #[inline(always)]
    fn floor(&self) -> S {
        S::from_f64(FLOOR) * size(self.t)
    }

    /// Adds a polygon of the area `area`, with the first corner `corner` and the triangles `fan` around it.
    #[inline(always)]
    pub(super) fn add_fan<const SPREADS: bool>(
        &mut self,
        corner: [S; 2],
        fan: impl Iterator<Item = Triangle<S>> + Clone,
        area: S,
    ) {
        let t = value_at(self.t, corner).maximum_or_nan(self.floor());
        let inverse = S::ONE / t;
        let slopes = [inverse * self.t[1], inverse * self.t[2]];
        match Sums::mild::<SPREADS>(fan.clone(), area, slopes) {
            Some(sums) => self.add::<SPREADS>(corner, [t, inverse], sums),
            None => self.add_steep_fan::<SPREADS>(corner, fan, [t, inverse], slopes),
        }
    }

    /// [`Spread::add_fan`] where t changes much: by itself, so that what is usual stays in registers.
    #[inline(never)]
    fn add_steep_fan<const SPREADS: bool>(
        &mut self,
        corner: [S; 2],
        fan: impl Iterator<Item = Triangle<S>>,
        [t, inverse]: [S; 2],
        slopes: [S; 2],
    ) {
        let mut least = S::ONE;
        let sums = Sums::steep::<SPREADS>(fan, slopes, inverse * self.floor(), &mut least);
        self.reaches_far |= t * least < S::from_f64(HORIZON) * size(self.t);
        self.add::<SPREADS>(corner, [t, inverse], sums);
    }

    /// Adds sums from a corner, where t and its inverse are these.
    #[inline(always)]
    fn add<const SPREADS: bool>(&mut self, corner: [S; 2], [t, inverse]: [S; 2], sums: Sums<S>) {
        match self.origin {
            None => (self.origin, self.sums) = (Some((corner, t)), sums),
            Some((origin, unit)) => {
                let from_origin = [0, 1].map(|axis| corner[axis] - origin[axis]);
                self.sums.add::<SPREADS>(&sums, from_origin, unit * inverse);
            }
        }
    }

    /// The extent of what was added, of the area `area`.
    #[inline(always)]
    pub(super) fn extent(&self, area: S) -> Option<Extent<S>> {
        let (origin, _) = self.origin?;
        let [j, j_x, j_y] = self.sums.over_t;
        let inverse = S::ONE / j;
        let [x, y] = [inverse * j_x, inverse * j_y];
        let [m, m_x, m_y, m_xx, m_xy, m_yy] = self.sums.over_t_squared;
        let drift = [m_x - m * x, m_y - m * y];
        let spread = [
            m_xx - x * (m_x + drift[0]),
            m_xy - x * m_y - y * drift[0],
            m_yy - y * (m_y + drift[1]),
        ];
        // T is the area over the integral of 1 / t.
        let scale = area * inverse * inverse;
        Some(Extent {
            centroid: [origin[0] + x, origin[1] + y],
            spread: spread.map(|sum| scale * sum),
            drift: drift.map(|sum| scale * sum),
            is_raised: self.is_raised,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::array::{uniform2, uniform3};
    use proptest::prelude::*;

    use super::super::polygon::Polygons;
    use super::*;

    fn numbers(extent: Extent<f64>) -> [f64; 7] {
        let Extent { centroid: [x, y], spread: [xx, xy, yy], drift: [d_x, d_y], .. } = extent;
        [x, y, xx, xy, yy, d_x, d_y]
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

        #[test]
        fn series_and_formulas_agree_where_both_hold(
            [p, q] in uniform2(uniform2(-1.0..1.0)),
            changes in uniform2(-0.999 * MOST_CHANGE..0.999 * MOST_CHANGE),
            power in 0..12_i32,
        ) {
            let cross: f64 = p[0] * q[1] - p[1] * q[0];
            prop_assume!(cross.abs() > 0.1);
            let (p, q, twice) = if cross > 0.0 { (p, q, cross) } else { (q, p, -cross) };
            // Changes of t at p and q: its gradient by Cramer's rule.
            let [a, b] = changes.map(|h| h * f64::powi(10.0, -power));
            let slopes = [(a * q[1] - b * p[1]) / twice, (b * p[0] - a * q[0]) / twice];
            let fan = || std::iter::once(Triangle { p, q, twice });
            let mild = Sums::mild::<true>(fan(), 0.5 * twice, slopes).unwrap();
            let steep = Sums::steep::<true>(fan(), slopes, 0.0, &mut 1.0);
            let both = mild.over_t.into_iter().zip(steep.over_t);
            for (mild, steep) in both.chain(mild.over_t_squared.into_iter().zip(steep.over_t_squared)) {
                prop_assert!((mild - steep).abs() < 1e-12 * twice, "{mild} {steep}");
            }
        }

        /// Of two parts, in either order, and of a whole that fell into them.
        #[test]
        fn parts_have_the_extent_of_the_whole(
            slopes in uniform2(-1.0..1.0),
            power in -12..0_i32,
            [line, other] in uniform2(uniform3(-1.0..1.0)),
        ) {
            // At a corner so small a share of what it is elsewhere.
            let share = f64::powi(10.0, power);
            let size = f64::abs(slopes[0]) + f64::abs(slopes[1]);
            prop_assume!(size > 0.0);
            let t = [size * (1.0 + share), slopes[0], slopes[1]];
            let mut polygons = Polygons::default();
            let pixel = polygons.rectangle([-1.0; 2], [1.0; 2]);
            let Some(whole) = polygons.inside(pixel, line, 0) else { return Ok(()) };
            let [Some(one), Some(two)] = polygons.split(whole, other, 1) else { return Ok(()) };
            let extent = |parts: &[_]| {
                let mut spread = Spread::new(t);
                for &part in parts {
                    let (corner, fan) = polygons.fan(part);
                    spread.add_fan::<true>(corner, fan, polygons.area(part));
                }
                numbers(spread.extent(parts.iter().map(|&part| polygons.area(part)).sum()).unwrap())
            };
            let (expected, area) = (extent(&[whole]), polygons.area(whole));
            for parts in [[one, two], [two, one]] {
                for (found, expected) in extent(&parts).into_iter().zip(expected) {
                    let bound = (1e-13 + 1e-14 / share) * (1.0 + expected.abs()) / area;
                    prop_assert!((found - expected).abs() < bound, "{found} {expected}");
                }
            }
        }
    }

    /// `T(c)` is the area over the integral of 1 / t; Sigma and mu are those of the sum.
    #[test]
    fn samples_have_the_extent_of_their_sum() {
        let t = [1.0, 0.4, -0.5];
        let points = [[0.2, 0.1], [-0.9, 0.8], [0.5, 0.9], [0.7, -0.3]];
        let mut spread = Spread::new(t);
        let mut polygons = Polygons::default();
        for point in points.map(|point| polygons.point(point)) {
            let (corner, fan) = polygons.fan(point);
            spread.add_fan::<true>(corner, fan, 0.25);
        }
        let extent = spread.extent(1.0).unwrap();
        let mean = |f: &dyn Fn([f64; 2]) -> f64| points.map(f).iter().sum::<f64>() / 4.0;
        let total = mean(&|p| 1.0 / value_at(t, p)).recip();
        let [x, y] = [0, 1].map(|axis| mean(&|p| total * p[axis] / value_at(t, p)));
        let of = |f: &dyn Fn(f64, f64) -> f64| {
            mean(&|p| f(p[0] - x, p[1] - y) * (total / value_at(t, p)).powi(2))
        };
        let expected = [
            x,
            y,
            of(&|x, _| x * x),
            of(&|x, y| x * y),
            of(&|_, y| y * y),
            of(&|x, _| x),
            of(&|_, y| y),
        ];
        for (found, expected) in numbers(extent).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
        assert!((value_at(t, extent.centroid) - total).abs() < 1e-15);
    }
}
