//! The mean of the barycentrics over a piece, so that its value is the mean of any attribute.
//!
//! # Forward
//! Barycentrics are `b_i = N_i / T`, `T = sum N_i`, with N_i linear over the image and T positive on the
//! piece. Let c be the piece's centroid under the density 1 / T: `c = int p / T dA / int 1 / T dA`. As
//! N_i is linear, `int N_i / T dA = N_i(c) int 1 / T dA`; the sum over i says that the area A is
//! `T(c) int 1 / T dA`. So the mean of b_i is exactly `N_i(c) / T(c)`, whatever the perspective, in any
//! number of parts, and over samples, too. It is in [0, 1], as b_i is at c.
//!
//! # Backward
//! Let all values without an argument be taken at c, `r = p - c`, n_i and tau the gradients of N_i and T,
//! and `nu_i = n_i - b_i tau`. Then `N_i(p) - b_i T(p) = nu_i . r`, so at p the barycentric is
//! `b_i + nu_i . r / T(p)`. With `kappa = sum b_bar_i nu_i` and `m = sum b_bar_i b_i` a change of
//! the N_j changes the loss by the mean of `sum (b_bar_j - m) dN_j / T - kappa . r sum dN_j / T^2`. The mean
//! of 1 / T is 1 / T(c), and that of r / T is 0. So with Sigma and mu, the means of `r r^T / T^2` and
//! of `r / T^2`,
//!
//! `N_bar_j = (b_bar_j - m) / T - mu . kappa` at c, and `n_bar_j = -Sigma kappa`, besides r times
//! `N_bar_j`. Area gained at p changes the loss by `kappa . r / (A T(p))` per unit of area.
//!
//! Sigma, mu and T(p) are kept in units of T(c), as kappa is here: nothing leaves the range of the
//! numbers then. In exact numbers `mu = -Sigma tau / T`, which cancels in slivers.

use bokashi_core::Scalar;

use super::extent::{Extent, FLOOR, raise};
use super::polygon::{Line, size, value_at};
use super::reciprocal::Reciprocal;
use crate::homogeneous::missing_factors;
use crate::rasterize::pull_back::weights_bar;

#[inline(always)]
fn dot<S: Scalar>(p: [S; 2], q: [S; 2]) -> S {
    p[0] * q[0] + p[1] * q[1]
}

/// What the gradients of a piece's barycentrics say.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bars<S> {
    /// Of the edge functions' values at the centroid, and of their slopes.
    pub(super) values: [S; 3],
    pub(super) slopes: [[S; 2]; 3],
    pub(super) growth: GrowthOfMean<S>,
}

/// What it is worth that a piece of area `area` grows somewhere.
#[derive(Debug)]
pub(super) struct Growth<S> {
    pub(super) area: S,
    /// The gradient of the area.
    pub(super) area_bar: S,
    /// Where its barycentrics move with its sides.
    pub(super) of_mean: Option<GrowthOfMean<S>>,
}

/// What the gradients of a piece's barycentrics say of its growth.
#[derive(Debug, Clone, Copy)]
pub(super) struct GrowthOfMean<S> {
    centroid: [S; 2],
    /// Over T, as kappa.
    tau: [S; 2],
    kappa: [S; 2],
}

impl<S: Scalar> Growth<S> {
    /// The integrals of `(1 - u) g` and of `u g` du along a side, with g the worth per unit of area. It
    /// is a constant and a linear function over a linear one, in which nothing large cancels however
    /// small the piece.
    #[inline(always)]
    pub(super) fn along(&self, ends: [[S; 2]; 2]) -> [S; 2] {
        let half = S::from_f64(0.5) * self.area_bar;
        let Some(GrowthOfMean { centroid, tau, kappa }) = self.of_mean else { return [half; 2] };
        let [p, q] = ends.map(|[x, y]| [x - centroid[0], y - centroid[1]]);
        let t = |r| (S::ONE + dot(tau, r)).maximum_or_nan(S::from_f64(FLOOR));
        let [both_p, mixed, both_q] = Reciprocal::new(t(p), t(q)).over_t();
        let [k_p, k_q] = [p, q].map(|r| dot(kappa, r) / self.area);
        [half + k_p * both_p + k_q * mixed, half + k_p * mixed + k_q * both_q]
    }
}

/// T of a face with these edge functions, but for a factor.
#[inline(always)]
pub(super) fn total<S: Scalar>(edges: &[Line<S>; 3], factors: [S; 3]) -> Line<S> {
    let missing = missing_factors(edges.map(size), factors);
    [0, 1, 2]
        .map(|c| missing[0] * edges[0][c] + missing[1] * edges[1][c] + missing[2] * edges[2][c])
}

/// The N_i at a piece's centroid, and what the edge functions lack to be them.
#[inline(always)]
fn weights<S: Scalar>(edges: &[Line<S>; 3], factors: [S; 3], extent: &Extent<S>) -> [[S; 3]; 2] {
    let a = edges.map(|edge| value_at(edge, extent.centroid));
    let missing = missing_factors(a, factors);
    let values: [S; 3] = std::array::from_fn(|i| missing[i] * a[i]);
    if !extent.is_raised {
        return [values, missing];
    }
    let t = [0, 1, 2].map(|c| (0..3).map(|i| missing[i] * edges[i][c]).sum());
    [values.map(|value| value + raise(t)), missing]
}

/// The mean of u and v over a piece of this extent of a face with these edge functions.
#[inline(always)]
pub(super) fn barycentrics<S: Scalar>(
    edges: &[Line<S>; 3],
    factors: [S; 3],
    extent: &Extent<S>,
) -> [S; 2] {
    let [values, _] = weights(edges, factors, extent);
    let total = values[0] + values[1] + values[2];
    [values[0] / total, values[1] / total]
}

/// The adjoint of [`barycentrics`] over a piece of this extent.
#[inline(always)]
pub(super) fn adjoint<S: Scalar>(
    edges: &[Line<S>; 3],
    factors: [S; 3],
    extent: &Extent<S>,
    uv_bar: [S; 2],
) -> Bars<S> {
    let [values, missing] = weights(edges, factors, extent);
    let total = values[0] + values[1] + values[2];
    let slopes: [[S; 2]; 3] =
        std::array::from_fn(|i| [1, 2].map(|axis| missing[i] * edges[i][axis] / total));
    let tau = [0, 1].map(|axis| slopes[0][axis] + slopes[1][axis] + slopes[2][axis]);
    let nu = [0, 1].map(|i| {
        let b = values[i] / total;
        [slopes[i][0] - b * tau[0], slopes[i][1] - b * tau[1]]
    });
    let kappa = [0, 1].map(|axis| uv_bar[0] * nu[0][axis] + uv_bar[1] * nu[1][axis]);
    let [xx, xy, yy] = extent.spread;
    let slope = [[xx, xy], [xy, yy]].map(|row| -dot(row, kappa) / total);
    let shift = dot(extent.drift, kappa) / total;
    let values_bar = weights_bar(values, uv_bar);
    Bars {
        values: std::array::from_fn(|i| missing[i] * (values_bar[i] - shift)),
        slopes: missing.map(|missing| slope.map(|bar| missing * bar)),
        growth: GrowthOfMean { centroid: extent.centroid, tau, kappa },
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use bokashi_core::Dual;
    use proptest::array::{uniform2, uniform3};
    use proptest::prelude::*;

    use super::super::extent::Spread;
    use super::super::polygon::{BORDER, Polygon, Polygons, line_bar};
    use super::super::quadrature::nodes;
    use super::*;

    /// A line that carries how it moves.
    type Moving = Line<Dual<f64>>;

    /// What a face's piece in a pixel is made of.
    #[derive(Debug, Clone)]
    struct Case {
        /// Positive in the pixel.
        edges: [Line<f64>; 3],
        factors: [f64; 3],
        /// The piece lies inside of them.
        lines: Vec<Line<f64>>,
        /// How narrow it is.
        width: f64,
        uv_bar: [f64; 2],
        area_bar: f64,
        /// How all these lines move.
        tangents: Vec<f64>,
    }

    /// A unit normal and an offset.
    fn line() -> impl Strategy<Value = Line<f64>> {
        (-0.3..0.9, 0.0..TAU).prop_map(|(offset, angle): (f64, f64)| {
            let (sine, cosine) = angle.sin_cos();
            [offset, cosine, sine]
        })
    }

    fn case() -> impl Strategy<Value = Case> {
        let rho = prop_oneof![
            Just(1.0),
            (-9.0..0.0).prop_map(|power| 1.0 + f64::powf(10.0, power)),
            (0.0..6.0).prop_map(|power| f64::powf(10.0, power)),
        ];
        let weights = uniform3((0.1..1.0, 0.0..1.0));
        let angles = (uniform3(0.0..TAU), any::<bool>());
        let edges = (rho, weights, angles).prop_map(|(rho, weights, (angles, is_steep))| {
            [0, 1, 2].map(|i| {
                let (sine, cosine): (f64, f64) = angles[if is_steep { 0 } else { i }].sin_cos();
                let ((one, slope), reach) = (weights[i], cosine.abs() + sine.abs());
                // From 0 to 1 over the pixel.
                let slope = (rho - 1.0) * slope / (2.0 * reach);
                [one + slope * reach, slope * cosine, slope * sine]
            })
        });
        let factors = uniform3(prop_oneof![Just(1.0), Just(0.25), Just(8.0)]);
        let width = prop_oneof![2 => Just(None), 1 => (-6.0..0.0).prop_map(Some)];
        let lines = (proptest::collection::vec(line(), 1..5), width);
        let bars = (uniform2(-1.0..1.0), -1.0..1.0);
        let tangents = proptest::collection::vec(-1.0..1.0, 9 + 3 * 5);
        (edges, factors, lines, bars, tangents).prop_map(
            |(edges, factors, (mut lines, width), (uv_bar, area_bar), tangents)| {
                let width = width.map_or(1.0, |power| f64::powf(10.0, power));
                if width < 1.0 {
                    let [offset, x, y] = lines[0];
                    lines.push([width - offset, -x, -y]);
                }
                Case { edges, factors, lines, width, uv_bar, area_bar, tangents }
            },
        )
    }

    impl Case {
        /// How far line k moves at most.
        fn step(&self, k: usize) -> f64 {
            if k < 3 { size(self.edges[k]) } else { self.width }
        }

        /// The edges and the lines, which carry how they move.
        fn moving(&self) -> ([Moving; 3], Vec<Moving>) {
            let moving = |k: usize, line: Line<f64>| {
                [0, 1, 2].map(|c| Dual::new(line[c], self.step(k) * self.tangents[3 * k + c]))
            };
            let edges = [0, 1, 2].map(|i| moving(i, self.edges[i]));
            (edges, (3..).zip(&self.lines).map(|(k, &line)| moving(k, line)).collect())
        }
    }

    fn cut<S: Scalar>(polygons: &mut Polygons<S>, lines: &[Line<S>]) -> Option<Polygon> {
        let mut polygon = polygons.rectangle([-S::ONE; 2], [S::ONE; 2]);
        for (k, &line) in (0..).zip(lines) {
            polygon = polygons.inside(polygon, line, k)?;
        }
        Some(polygon)
    }

    /// The mean of u and v over a polygon by quadrature, from nothing but their definition.
    fn mean<S: Scalar>(
        polygons: &Polygons<S>,
        polygon: Polygon,
        edges: &[Line<S>; 3],
        factors: [f64; 3],
        nodes: &[[f64; 3]],
    ) -> [S; 2] {
        let points: Vec<_> = polygons.points(polygon).collect();
        let values = |point: [S; 2]| {
            let value = |i: usize| S::from_f64(factors[i]) * value_at(edges[i], point);
            [value(0), value(1), value(2)]
        };
        let mut sums = [S::ZERO; 3];
        let first = values(points[0]);
        for pair in points[1..].windows(2) {
            let [p, q] = [0, 1].map(|k| [0, 1].map(|axis| pair[k][axis] - points[0][axis]));
            let twice = p[0] * q[1] - p[1] * q[0];
            let (of_p, of_q) = (values(pair[0]), values(pair[1]));
            for &[u, rest, weight] in nodes {
                let [u, rest] = [u, rest].map(S::from_f64);
                let far = [0, 1, 2].map(|i| rest * of_p[i] + u * of_q[i]);
                for &[s, before, after] in nodes {
                    let weight = twice * S::from_f64(weight * after * s);
                    let [s, before] = [s, before].map(S::from_f64);
                    let n = [0, 1, 2].map(|i| before * first[i] + s * far[i]);
                    let share = weight / (n[0] + n[1] + n[2]);
                    let terms = [weight, share * n[0], share * n[1]];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                }
            }
        }
        [sums[1] / sums[0], sums[2] / sums[0]]
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(1000) })]

        #[test]
        fn means_and_their_gradients_are_those_of_a_quadrature(case in case()) {
            let (edges, lines) = case.moving();
            let mut moving = Polygons::default();
            let Some(polygon) = cut(&mut moving, &lines) else { return Ok(()) };
            let width = case.width.min(moving.area(polygon).value);
            prop_assume!(width > 1e-7);
            let of_quadrature = mean(&moving, polygon, &edges, case.factors, &nodes(20));
            let mut polygons = Polygons::default();
            let polygon = cut(&mut polygons, &case.lines).unwrap();
            let area = polygons.area(polygon);
            let mut spread = Spread::new(total(&case.edges, case.factors));
            let (corner, fan) = polygons.fan(polygon);
            spread.add_fan::<true>(corner, fan, area);
            let extent = spread.extent(area).unwrap();
            let found = barycentrics(&case.edges, case.factors, &extent);
            for (found, expected) in found.into_iter().zip(of_quadrature) {
                let error = (found - expected.value).abs();
                prop_assert!(error < 1e-13 / width, "{found} {expected:?} {error:e}");
            }
            let uv_bar = case.uv_bar.map(|bar| area * bar);
            let Bars { values, slopes, growth } =
                adjoint(&case.edges, case.factors, &extent, uv_bar);
            let [x, y] = extent.centroid;
            let edges_bar = [0, 1, 2].map(|i| {
                [values[i], x * values[i] + slopes[i][0], y * values[i] + slopes[i][1]]
            });
            let area_bar = case.area_bar;
            let growth = Growth { area, area_bar, of_mean: Some(growth) };
            let (mut slope, mut size) = (0.0, 0.0);
            let mut add = |k: usize, bar: Line<f64>, line: Moving| {
                for (bar, number) in bar.into_iter().zip(line) {
                    slope += bar * number.tangent;
                    size += bar.abs() * case.step(k);
                }
            };
            for i in 0..3 {
                add(i, edges_bar[i], edges[i]);
            }
            for (bound, ends) in polygons.segments(polygon) {
                if bound.line() != BORDER {
                    let k = bound.line() as usize;
                    let [_, x, y] = case.lines[k];
                    add(3 + k, line_bar(ends, 1.0, [x, y], growth.along(ends)), lines[k]);
                }
            }
            let of_mean: f64 = (0..2).map(|i| uv_bar[i] * of_quadrature[i].tangent).sum();
            let mut moving = Polygons::default();
            let polygon = cut(&mut moving, &lines).unwrap();
            let expected = of_mean + area_bar * moving.area(polygon).tangent;
            let error = (slope - expected).abs();
            // Where T is so small, it is rounded so coarsely.
            let t = total(&case.edges, case.factors);
            let least = polygons.points(polygon).map(|point| value_at(t, point));
            let steepness = super::size(t) / least.fold(f64::INFINITY, f64::min);
            let bound = (1e-12 + 1e-15 * steepness) * size / width;
            prop_assert!(error <= bound, "{slope} {expected} {error:e} of {size}");
        }
    }
}
