//! Circles of confusion, signed.
//!
//! # Forward
//! A lens focused at `f` sees what the pinhole picture shows at depth z as a disc of radius `|s|` pixels,
//! `s = K (1 - f / z)`: below 0 in front of the focus, above 0 behind it, K at infinity, and no farther from 0
//! than a cap. Through the point p of the unit disc, the lens sees at a pixel x what the pinhole picture shows
//! at `x + p s`: so s says how much is blurred, and what is in front of what.
//!
//! # Backward
//! `ds/dz = K f / z^2`, `ds/dK = 1 - f / z`, `ds/df = -K / z`; all three are 0 where s is capped. Of ds/dz, the
//! derivatives by z, K and f are `-2 K f / z^3`, `f / z^2` and `K / z^2`.
//!
//! # Where it is not smooth
//! Where s reaches its cap.

use bokashi_core::Scalar;

/// The signed radius of a circle of confusion, in pixels, and its derivatives.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Circle<S> {
    pub(super) radius: S,
    pub(super) by_distance: S,
    pub(super) by_aperture: S,
    pub(super) by_focus: S,
}

/// A lens, in numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Optics<S> {
    /// K, in pixels.
    pub(super) aperture: S,
    pub(super) focus: S,
    /// The cap, in pixels.
    pub(super) largest: f64,
}

impl<S: Scalar> Optics<S> {
    /// Whether a radius is that of a capped circle.
    #[inline(always)]
    pub(super) fn is_capped(&self, radius: S) -> bool {
        radius.abs().to_f64() >= self.largest
    }

    /// The derivatives of `ds/dz` by distance, aperture and focus, where the circle is not capped.
    #[inline]
    pub(super) fn bends(&self, z: S) -> [S; 3] {
        let Self { aperture, focus, .. } = *self;
        let inverse = S::ONE / z;
        let square = inverse * inverse;
        [S::from_f64(-2.0) * aperture * focus * square * inverse, focus * square, aperture * square]
    }

    /// The radius of the circle of confusion of what is `z` away, and whether it is capped.
    #[inline]
    pub(super) fn radius(&self, z: S) -> (S, bool) {
        let Self { aperture, focus, largest } = *self;
        if aperture == S::ZERO {
            return (S::ZERO, false);
        }
        let radius = aperture * (S::ONE - focus / z);
        // At distance 0 it is infinite, and of -0 on the wrong side.
        if z == S::ZERO || radius.abs() > S::from_f64(largest) {
            let side = if z == S::ZERO || radius < S::ZERO { -1.0 } else { 1.0 };
            return (S::from_f64(side * largest), true);
        }
        (radius, false)
    }

    /// The circle of confusion of what is `z` away.
    pub(super) fn circle(&self, z: S) -> Circle<S> {
        let Self { aperture, focus, .. } = *self;
        let (radius, is_capped) = self.radius(z);
        if is_capped || aperture == S::ZERO {
            return Circle { radius, ..Circle::default() };
        }
        let (share, inverse) = (focus / z, S::ONE / z);
        Circle {
            radius,
            by_distance: aperture * share * inverse,
            by_aperture: S::ONE - share,
            by_focus: -aperture * inverse,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTICS: Optics<f64> = Optics { aperture: 4.0, focus: 2.0, largest: 20.0 };

    #[test]
    fn a_circle_is_zero_in_focus_below_in_front_and_the_aperture_at_infinity() {
        let radii =
            [0.0, -0.0, 1e-300, 1.0, 2.0, 4.0, f64::INFINITY].map(|z| OPTICS.circle(z).radius);
        assert_eq!(radii, [-20.0, -20.0, -20.0, -4.0, 0.0, 2.0, 4.0]);
        let slopes = OPTICS.circle(f64::INFINITY);
        assert_eq!((slopes.by_distance, slopes.by_aperture), (0.0, 1.0));
        assert!(slopes.by_focus == 0.0 && OPTICS.radius(1e-300).1);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let step = 1e-6;
        for z in [0.7, 1.9, 5.0] {
            let circle = OPTICS.circle(z);
            let quotient =
                |change: &dyn Fn(f64) -> f64| (change(step) - change(-step)) / (2.0 * step);
            let by_distance = quotient(&|d| OPTICS.circle(z + d).radius);
            let by_aperture =
                quotient(&|d| Optics { aperture: OPTICS.aperture + d, ..OPTICS }.circle(z).radius);
            let bends = [
                quotient(&|d| OPTICS.circle(z + d).by_distance),
                quotient(&|d| {
                    Optics { aperture: OPTICS.aperture + d, ..OPTICS }.circle(z).by_distance
                }),
                quotient(&|d| Optics { focus: OPTICS.focus + d, ..OPTICS }.circle(z).by_distance),
            ];
            for (bend, quotient) in OPTICS.bends(z).into_iter().zip(bends) {
                assert!((bend - quotient).abs() < 1e-7, "{bend} is not {quotient}");
            }
            let by_focus =
                quotient(&|d| Optics { focus: OPTICS.focus + d, ..OPTICS }.circle(z).radius);
            for (slope, quotient) in [
                (circle.by_distance, by_distance),
                (circle.by_aperture, by_aperture),
                (circle.by_focus, by_focus),
            ] {
                assert!((slope - quotient).abs() < 1e-8, "{slope} is not {quotient}");
            }
        }
    }
}
