//! From a pixel's footprint on a texture to a level of detail and to probes.
//!
//! # Forward
//! Let `J: [2, 2]` be the change of a place, in texels of level 0, from pixel to pixel. J maps the
//! circle of a pixel to an ellipse, whose half axes are the singular values `sigma_1 >= sigma_2` of J.
//! With the right singular vector `v_1` of `sigma_1`, the longer axis is `J v_1`. The largest
//! eigenvalue of `G = J^T J` is `sigma_1^2 = h + sqrt(d^2 + g_xy^2)`, `h = (g_xx + g_yy) / 2`,
//! `d = (g_xx - g_yy) / 2`.
//!
//! A sample is the mean of n probes along the longer axis, at the offsets `t_k J v_1`,
//! `t_k = (k + 1/2) / n - 1/2`, on the level `lambda = log2(sigma_1 / n) + bias`. The number of probes
//! is `sigma_1 / max(sigma_2, 1)`, rounded, and 1 for an isotropic filter. Levels outside those that
//! there are become the nearest of them.
//!
//! # Backward
//! `dsigma_1 = u_1 . dJ v_1`, with `u_1 = J v_1 / sigma_1`. So `J_bar += lambda_bar / (sigma_1^2 ln 2)
//! (J v_1) v_1^T`. With `v_2` at a right angle to `v_1`, `dv_1 = v_2 dtheta` and
//! `dtheta = v_2 . dG v_1 / (sigma_1^2 - sigma_2^2)`. So with `theta_bar = v_1_bar . v_2`:
//! `J_bar += theta_bar / (sigma_1^2 - sigma_2^2) ((J v_1) v_2^T + (J v_2) v_1^T)`.
//!
//! # Where it is not smooth
//! Where the number of probes steps; where the level is the first or the last, and where both half
//! axes are equal.
//!
//! # Source
//! Heckbert, *Fundamentals of texture mapping and image warping*, 1989, section 3; the extension
//! EXT_texture_filter_anisotropic of OpenGL for probes and their level, but for two differences. There
//! the longer axis is taken for the longer column of J, and the number of probes is rounded up.

use bokashi_core::Scalar;

use super::logarithm::log2;

/// A pixel's footprint on a texture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Footprint<T> {
    /// `sigma_1^2`.
    square: T,
    /// `sigma_1^2 - sigma_2^2`.
    gap: T,
    /// `v_1`.
    direction: [T; 2],
    /// n.
    pub(super) probes: usize,
}

impl<T: Scalar> Footprint<T> {
    /// Of J, with at most `most` probes.
    #[inline(always)]
    pub(super) fn new([[sx, sy], [tx, ty]]: [[T; 2]; 2], most: usize) -> Self {
        let half = T::from_f64(0.5);
        let (xx, yy, xy) = (sx * sx + tx * tx, sy * sy + ty * ty, sx * sy + tx * ty);
        let (mean, apart) = (half * (xx + yy), half * (xx - yy));
        let root = root_of(apart * apart + xy * xy);
        let mut footprint =
            Self { square: mean + root, gap: root + root, direction: [T::ONE, T::ZERO], probes: 1 };
        if most > 1 {
            footprint.direction = direction(apart, xy, root);
            // sigma_2 = |det J| / sigma_1, where h - root would cancel.
            let determinant = sx * ty - sy * tx;
            let shorter = (determinant * determinant / footprint.square).maximum_or_nan(T::ONE);
            let ratio = (footprint.square / shorter).to_f64().sqrt();
            // Also for what is no number.
            if ratio > 1.5 {
                footprint.probes = (ratio + 0.5).min(most as f64) as usize;
            }
        }
        footprint
    }

    /// lambda before it is bounded, without a bias.
    #[inline(always)]
    pub(super) fn level(&self) -> T {
        let level = T::from_f64(0.5) * log2(self.square);
        if self.probes == 1 { level } else { level - T::from_f64((self.probes as f64).log2()) }
    }

    /// `v_1`.
    #[inline(always)]
    pub(super) fn direction(&self) -> [T; 2] {
        self.direction
    }

    /// `t_k`.
    #[inline(always)]
    pub(super) fn offset(&self, k: usize) -> T {
        T::from_f64((k as f64 + 0.5) / self.probes as f64 - 0.5)
    }

    /// `J_bar` from the gradients of lambda and of `v_1`.
    #[inline(always)]
    pub(super) fn pull_back(&self, j: [[T; 2]; 2], level_bar: T, v_bar: [T; 2]) -> [[T; 2]; 2] {
        let [c, s] = if self.probes > 1 {
            self.direction
        } else {
            // Not worked out by the forward pass.
            let [[sx, sy], [tx, ty]] = j;
            let half = T::from_f64(0.5);
            let (xx, yy) = (sx * sx + tx * tx, sy * sy + ty * ty);
            direction(half * (xx - yy), sx * sy + tx * ty, half * self.gap)
        };
        let (v1, v2) = ([c, s], [-s, c]);
        let along = |v: [T; 2]| j.map(|row| row[0] * v[0] + row[1] * v[1]);
        let (first, second) = (along(v1), along(v2));
        // lambda = log2(sigma_1^2) / 2, and sigma_1^2 changes by 2 (J v_1) . dJ v_1.
        let by_level = level_bar * T::from_f64(std::f64::consts::LOG2_E) / self.square;
        let turn = v_bar[0] * v2[0] + v_bar[1] * v2[1];
        // The gap of a footprint whose squares overflow is 0.
        let has_turn = self.probes > 1 && self.gap > T::ZERO;
        let by_turn = if has_turn { turn / self.gap } else { T::ZERO };
        [0, 1].map(|i| {
            [0, 1].map(|k| {
                by_level * first[i] * v1[k] + by_turn * (first[i] * v2[k] + second[i] * v1[k])
            })
        })
    }
}

/// The square root, with a slope of 0 at 0: where both half axes are equal, any direction will do.
#[inline(always)]
fn root_of<T: Scalar>(x: T) -> T {
    if x > T::ZERO { x.sqrt() } else { T::ZERO }
}

/// The eigenvector of `[[d, g], [g, -d]]` to its eigenvalue `root = sqrt(d^2 + g^2)`, of length 1.
#[inline(always)]
fn direction<T: Scalar>(d: T, g: T, root: T) -> [T; 2] {
    let [x, y] = if d >= T::ZERO { [d + root, g] } else { [g, root - d] };
    let square = x * x + y * y;
    if square > T::ZERO && square.is_finite() {
        let length = square.sqrt();
        [x / length, y / length]
    } else {
        [T::ONE, T::ZERO]
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat2, DVec2};

    use super::*;

    /// Footprints round, long, turned, sheared and mirrored.
    fn all() -> Vec<[[f64; 2]; 2]> {
        let mut all =
            vec![[[3.0, 0.0], [0.0, 3.0]], [[8.0, 0.0], [0.0, 1.5]], [[0.0, 9.0], [2.1, 0.0]]];
        for k in 0..40 {
            let (a, b) = (0.37 * k as f64, 1.3 * k as f64);
            let (long, short) = (2.0 + (k % 7) as f64 * 3.1, 1.1 + 0.13 * (k % 5) as f64);
            let flip = if k % 3 == 0 { -1.0 } else { 1.0 };
            let stretched = DMat2::from_diagonal(DVec2::new(long, flip * short));
            let j = DMat2::from_angle(a) * stretched * DMat2::from_angle(b);
            all.push([[j.x_axis.x, j.y_axis.x], [j.x_axis.y, j.y_axis.y]]);
        }
        all
    }

    /// The largest and the smallest length of `J v` over directions v.
    fn extremes(j: [[f64; 2]; 2]) -> [f64; 2] {
        let lengths = (0..200_000).map(|k| {
            let (s, c) = (k as f64 * std::f64::consts::PI / 200_000.0).sin_cos();
            j.map(|row| row[0] * c + row[1] * s).into_iter().map(|x| x * x).sum::<f64>().sqrt()
        });
        lengths.fold([0.0, f64::MAX], |[most, least], x| [most.max(x), least.min(x)])
    }

    #[test]
    fn the_longer_axis_is_the_longest_that_a_pixel_reaches() {
        for j in all() {
            let [longest, shortest] = extremes(j);
            let footprint = Footprint::new(j, 8);
            approx::assert_relative_eq!(footprint.square.sqrt(), longest, max_relative = 1e-9);
            let v = footprint.direction();
            let along = j.map(|row| row[0] * v[0] + row[1] * v[1]);
            approx::assert_relative_eq!(along[0].hypot(along[1]), longest, max_relative = 1e-9);
            let probes = ((longest / shortest.max(1.0)).round() as usize).clamp(1, 8);
            assert_eq!(footprint.probes, probes, "{j:?}");
            let level = (longest / probes as f64).log2();
            approx::assert_relative_eq!(footprint.level(), level, epsilon = 1e-9);
            let isotropic = Footprint::new(j, 1);
            assert_eq!(isotropic.probes, 1);
            approx::assert_relative_eq!(isotropic.level(), longest.log2(), epsilon = 1e-9);
        }
    }

    #[test]
    fn what_is_flat_huge_or_nothing_has_a_footprint_too() {
        for most in [1, 8] {
            for j in
                [[[0.0; 2]; 2], [[1e-300; 2]; 2], [[1e300, 0.0], [0.0, 1e300]], [[1e200; 2]; 2]]
            {
                let footprint = Footprint::<f64>::new(j, most);
                assert!((1..=most).contains(&footprint.probes));
                assert!(
                    !footprint.level().is_nan()
                        && footprint.direction().iter().all(|v| v.is_finite())
                );
            }
        }
    }
}
