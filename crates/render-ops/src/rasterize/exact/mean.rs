//! The mean of the barycentrics over a piece, so that its value is the mean of any attribute.
//!
//! # Forward
//! Barycentrics are `b_i = N_i / T`, `T = sum N_i`, with N_i linear over the image. Let c be a
//! piece's centroid and C its covariance, n_i and tau the gradients of N_i and T, and all values
//! taken at c. Around c a barycentric is `b_i + r . nu_i / T (1 - r . tau / T + ...)`, with
//! `nu_i = n_i - b_i tau`. So the mean is `b_i - nu_i . s`, with `s = C tau / T^2`. It is exact where
//! w is the same everywhere. Elsewhere its error is of the third order in how much 1 / w changes over
//! the piece, as a share of itself.
//!
//! Where all N_i are positive over a convex piece, so are these means: `tau . s` and `n_i . s / b_i`
//! are at most 1/2 then. Where a piece is in parts and `tau . s` is larger, s is 0. The piece then takes
//! the barycentrics at its centroid, and the mean jumps there.
//!
//! # Backward
//! `nu_bar_i = -b_bar_i s`, `s_bar = -sum b_bar_i nu_i`, `n_bar_i = nu_bar_i + tau_bar`,
//! `tau_bar = C s_bar / T^2 - sum b_i nu_bar_i`, `C_bar = s_bar tau^T / T^2`,
//! `T_bar = -2 s . s_bar / T`; to the b_i comes `-nu_bar_i . tau`, and `c_bar = sum N_bar_i n_i`.

use bokashi_core::Scalar;

use super::polygon::{Line, Moments, value_at};
use crate::homogeneous::missing_factors;
use crate::rasterize::pull_back::weights_bar;

/// Where a piece lies and how far it spreads: centroid, and covariance of x^2, xy and y^2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent<S> {
    pub(super) centroid: [S; 2],
    pub(super) covariance: [S; 3],
}

impl<S: Scalar> Extent<S> {
    #[inline(always)]
    pub(super) fn of(moments: &Moments<S>) -> Self {
        let [area, x, y, xx, xy, yy] = moments.integrals;
        let [x, y, xx, xy, yy] = [x, y, xx, xy, yy].map(|moment| moment / area);
        let centroid = [moments.origin[0] + x, moments.origin[1] + y];
        Self { centroid, covariance: [xx - x * x, xy - x * y, yy - y * y] }
    }
}

/// A symmetric matrix times a vector.
#[inline(always)]
fn times<S: Scalar>([xx, xy, yy]: [S; 3], [x, y]: [S; 2]) -> [S; 2] {
    [xx * x + xy * y, xy * x + yy * y]
}

#[inline(always)]
fn dot<S: Scalar>(p: [S; 2], q: [S; 2]) -> S {
    p[0] * q[0] + p[1] * q[1]
}

/// A face's barycentrics around a piece's centroid.
struct Around<S> {
    /// What the edge functions lack to be the N_i.
    missing: [S; 3],
    values: [S; 3],
    slopes: [[S; 2]; 3],
    total: S,
    tau: [S; 2],
    /// The piece's, or 0.
    covariance: [S; 3],
    /// s, and the nu of vertices 0 and 1.
    s: [S; 2],
    nu: [[S; 2]; 2],
}

impl<S: Scalar> Around<S> {
    #[inline(always)]
    fn new(edges: &[Line<S>; 3], factors: [S; 3], extent: &Extent<S>) -> Self {
        let a = edges.map(|edge| value_at(edge, extent.centroid));
        let missing = missing_factors(a, factors);
        let values: [S; 3] = std::array::from_fn(|i| missing[i] * a[i]);
        let slopes: [[S; 2]; 3] =
            std::array::from_fn(|i| [missing[i] * edges[i][1], missing[i] * edges[i][2]]);
        let total = values[0] + values[1] + values[2];
        let tau = [0, 1].map(|axis| slopes[0][axis] + slopes[1][axis] + slopes[2][axis]);
        // In this order nothing leaves the range of the numbers.
        let relative = tau.map(|slope| slope / total);
        let change = dot(relative, times(extent.covariance, relative));
        let is_moderate = change <= S::from_f64(0.5);
        let covariance = if is_moderate { extent.covariance } else { [S::ZERO; 3] };
        let s = times(covariance, relative).map(|entry| entry / total);
        let nu = [0, 1].map(|i| {
            let b = values[i] / total;
            [slopes[i][0] - b * tau[0], slopes[i][1] - b * tau[1]]
        });
        Self { missing, values, slopes, total, tau, covariance, s, nu }
    }

    #[inline(always)]
    fn barycentrics(&self) -> [S; 2] {
        [0, 1].map(|i| self.values[i] / self.total - dot(self.nu[i], self.s))
    }
}

/// The mean of u and v over a piece of a face with these edge functions.
#[inline(always)]
pub(super) fn barycentrics<S: Scalar>(
    edges: &[Line<S>; 3],
    factors: [S; 3],
    extent: &Extent<S>,
) -> [S; 2] {
    Around::new(edges, factors, extent).barycentrics()
}

/// What the gradients of u and v say of the edge functions' values at the centroid and of their slopes,
/// and of the extent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bars<S> {
    pub(super) values: [S; 3],
    pub(super) slopes: [[S; 2]; 3],
    pub(super) extent: Extent<S>,
}

/// The adjoint of [`barycentrics`].
#[inline(always)]
pub(super) fn adjoint<S: Scalar>(
    edges: &[Line<S>; 3],
    factors: [S; 3],
    extent: &Extent<S>,
    uv_bar: [S; 2],
) -> Bars<S> {
    let Around { missing, values, slopes, total, tau, covariance, s, nu } =
        Around::new(edges, factors, extent);
    let mut s_bar = [0, 1].map(|axis| -(uv_bar[0] * nu[0][axis] + uv_bar[1] * nu[1][axis]));
    if covariance == [S::ZERO; 3] {
        s_bar = [S::ZERO; 2];
    }
    // nu_bar_i = -b_bar_i s
    let share = S::ONE + dot(s, tau);
    let total_bar = -(S::ONE + S::ONE) * dot(s, s_bar) / total;
    let values_bar = weights_bar(values, uv_bar.map(|bar| bar * share)).map(|bar| bar + total_bar);
    let of_s = times(covariance, s_bar.map(|bar| bar / total)).map(|bar| bar / total);
    let mean = (uv_bar[0] * values[0] + uv_bar[1] * values[1]) / total;
    let tau_bar = [0, 1].map(|axis| of_s[axis] + mean * s[axis]);
    let slopes_bar: [[S; 2]; 3] = std::array::from_fn(|i| {
        let bar = if i < 2 { uv_bar[i] } else { S::ZERO };
        [0, 1].map(|axis| missing[i] * (tau_bar[axis] - bar * s[axis]))
    });
    let relative = tau.map(|slope| slope / total);
    let [x, y] = s_bar.map(|bar| bar / total);
    let centroid = [0, 1].map(|axis| (0..3).map(|i| values_bar[i] * slopes[i][axis]).sum());
    Bars {
        values: std::array::from_fn(|i| missing[i] * values_bar[i]),
        slopes: slopes_bar,
        extent: Extent {
            centroid,
            covariance: [x * relative[0], x * relative[1] + y * relative[0], y * relative[1]],
        },
    }
}

#[cfg(test)]
mod tests {
    use proptest::array::{uniform2, uniform3};
    use proptest::prelude::*;

    use super::super::polygon::Polygons;
    use super::*;

    /// Edge functions that are positive in the pixel.
    fn edges() -> impl Strategy<Value = [Line<f64>; 3]> {
        uniform3((1.0..3.0, uniform2(-0.45..0.45)).prop_map(|(one, [x, y])| [one, x, y]))
    }

    fn extent([x, y, spread, tilt]: [f64; 4]) -> Extent<f64> {
        Extent { centroid: [x, y], covariance: [spread, tilt * spread, 0.5 * spread] }
    }

    proptest! {
        /// Over half a pixel, which has a third moment, against the mean of the middles of 32 x 32
        /// triangles.
        #[test]
        fn the_mean_is_one_up_to_the_third_order(edges in edges(), flat in 0.01..1.0) {
            let edges = edges.map(|[one, x, y]| [one, flat * x, flat * y]);
            let mut polygons = Polygons::<f64>::default();
            let pixel = polygons.pixel(1.0);
            let half = polygons.inside(pixel, [0.0, -1.0, -1.0], 0).unwrap();
            let found = barycentrics(&edges, [1.0; 3], &Extent::of(&polygons.moments(half)));
            let mut mean = [0.0; 2];
            for k in 0..1024 {
                let [x, y] = [k % 32, k / 32];
                // Squares of two triangles each, of which those on the diagonal have lost one.
                let third = if x + y < 32 { 1.0 } else { -1.0 };
                let [x, y] = if x + y < 32 { [x, y] } else { [32 - x, 32 - y] };
                let point = [x, y].map(|k| (f64::from(k) + third / 3.0) / 16.0 - 1.0);
                let a = edges.map(|edge| value_at(edge, point));
                let total: f64 = a.iter().sum();
                mean.iter_mut().zip(a).for_each(|(mean, a)| *mean += a / total / 1024.0);
            }
            let total: f64 = edges.iter().map(|edge| edge[0]).sum();
            let [x, y] = [1, 2].map(|axis| edges.iter().map(|edge| edge[axis].abs()).sum::<f64>());
            let change = (x + y) / total;
            for (found, mean) in found.into_iter().zip(mean) {
                prop_assert!((found - mean).abs() < 0.5 * change.powi(3) + 1e-4 * change);
            }
        }

        #[test]
        fn the_adjoint_is_the_difference_quotient(
            edges in edges(),
            place in [-0.5..0.5, -0.5..0.5, 0.05..0.3, -0.5..0.5],
            uv_bar in uniform2(-1.0..1.0),
            factors in uniform3(prop_oneof![Just(1.0), Just(0.25), Just(8.0)]),
        ) {
            let numbers = |edges: [Line<f64>; 3], extent: Extent<f64>| {
                let Extent { centroid, covariance } = extent;
                [edges.as_flattened(), &centroid, &covariance].concat()
            };
            let loss = |numbers: &[f64]| {
                let edges = [0, 1, 2].map(|i| [0, 1, 2].map(|c| numbers[3 * i + c]));
                let centroid = [numbers[9], numbers[10]];
                let covariance = [numbers[11], numbers[12], numbers[13]];
                let [u, v] = barycentrics(&edges, factors, &Extent { centroid, covariance });
                uv_bar[0] * u + uv_bar[1] * v
            };
            let start = numbers(edges, extent(place));
            let Bars { values, slopes, extent: extent_bar } =
                adjoint(&edges, factors, &extent(place), uv_bar);
            let [x, y] = extent(place).centroid;
            let edges_bar = [0, 1, 2].map(|i| {
                let [by_x, by_y] = slopes[i];
                [values[i], x * values[i] + by_x, y * values[i] + by_y]
            });
            for (k, bar) in numbers(edges_bar, extent_bar).into_iter().enumerate() {
                let by = |step: f64| {
                    let mut moved = start.clone();
                    moved[k] += step;
                    loss(&moved)
                };
                let quotient = (by(1e-6) - by(-1e-6)) / 2e-6;
                prop_assert!((quotient - bar).abs() < 1e-8, "{k}: {quotient} {bar}");
            }
        }
    }
}
