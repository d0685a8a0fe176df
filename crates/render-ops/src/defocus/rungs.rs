//! Rungs: blurs of fixed radii, between which every circle of confusion lies.
//!
//! # Forward
//! Rung m has the signed radius `rho_m = 3 sinh(0.08 m)`: the same in every step of a fit, a quarter of a pixel apart
//! near the focus, and a twelfth of the radius far from it. Half as many leave gradients ragged on slopes. What has a
//! circle of radius s between `rho_k` and `rho_(k+1)` is shared among both: `1 - t` to rung k and t to rung k + 1, with
//! `t = (s^2 - rho_k^2) / (rho_(k+1)^2 - rho_k^2)`. So its second moment is that of a disc of radius s. Rung 0
//! is the picture itself, and around it t grows with the square of s, as it should.
//!
//! # Backward
//! `dt/ds = 2 s / (rho_(k+1)^2 - rho_k^2)`.
//!
//! # Where it is not smooth
//! The slope steps at rungs; t does not.

use bokashi_core::Scalar;

/// The radii of all rungs up to the largest circle.
#[derive(Debug, Default)]
pub(crate) struct Rungs {
    /// From the most negative on: those of the rungs `-most..=most`.
    radii: Vec<f64>,
    most: i32,
    /// Per rung the square of its radius, and the inverse of how much larger the next one's is.
    squares: Vec<[f64; 2]>,
    /// The rung before each bin of an eighth of a pixel: rungs lie farther apart.
    bins: Vec<u16>,
}

/// Between which rungs a circle lies.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Position<S> {
    /// The rung before it, from the nearest on, counted from 0.
    pub(crate) rung: usize,
    /// The share of the next rung, and its derivative by the radius.
    pub(crate) next: S,
    pub(crate) slope: S,
}

impl<S: Scalar> Position<S> {
    /// The rungs that a circle lies on, with its shares. In focus that is one: the share of the next has no slope,
    /// either.
    #[inline]
    pub(crate) fn rungs(&self) -> [Option<(usize, S)>; 2] {
        let Self { rung, next, slope } = *self;
        [Some((rung, S::ONE - next)), (slope != S::ZERO).then_some((rung + 1, next))]
    }
}

const FIRST_STEP: f64 = 0.08;
const SCALE: f64 = 3.0;
/// Bins per pixel.
const BINS: f64 = 8.0;

/// The standard deviation from which on a blur is done at half the size: that of a disc of radius 12. Halved from
/// 8 on, a picture's slope by the aperture lost up to a fifth of its size.
const HALVED_FROM: f64 = 6.0;
/// How often an image is halved at most: a band of rows can be.
pub(crate) const MOST_HALVINGS: usize = 4;

impl Rungs {
    /// The rungs for circles of at most `largest` pixels.
    pub(crate) fn reach(&mut self, largest: f64) {
        let most = (1.0 + ((largest / SCALE).asinh() / FIRST_STEP).ceil()) as i32;
        if most == self.most {
            return;
        }
        self.most = most;
        let radius = |m: i32| SCALE * (FIRST_STEP * f64::from(m)).sinh();
        self.radii.clear();
        self.radii.extend((-most..=most).map(radius));
        let square = |radii: &[f64]| [radii[0], radii[1]].map(|radius| radius * radius);
        let squares = self.radii.windows(2).map(square);
        self.squares = squares.map(|[own, after]| [own, (after - own).recip()]).collect();
        let (first, last) = (self.radii[0], self.radii[self.radii.len() - 1]);
        let count = ((last - first) * BINS).ceil() as usize + 1;
        let rung_before = |bin: usize| {
            let start = first + bin as f64 / BINS;
            let after = self.radii.partition_point(|&radius| radius <= start);
            after.saturating_sub(1).min(self.radii.len() - 2) as u16
        };
        self.bins = (0..count).map(rung_before).collect();
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.radii.len()
    }

    /// The signed radius of a rung, counted from 0.
    pub(crate) fn radius(&self, rung: usize) -> f64 {
        self.radii[rung]
    }

    /// How often the image is halved for a rung, and the variance per axis of the blur that is left for its
    /// iris, in pixels of that size: halving and doubling have the variance of a pixel of the larger image.
    pub(crate) fn halvings(&self, rung: usize) -> (usize, f64) {
        let radius = self.radii[rung];
        let smaller = |(count, variance): &(usize, f64)| Some((count + 1, 0.25 * (variance - 1.0)));
        let mut sizes = std::iter::successors(Some((0, 0.25 * radius * radius)), smaller);
        let is_last = |&(count, variance): &(usize, f64)| {
            count == MOST_HALVINGS || variance < HALVED_FROM * HALVED_FROM
        };
        sizes.find(is_last).expect("the number of halvings is bounded")
    }

    /// Where a circle of signed radius `s` lies.
    #[inline]
    pub(crate) fn locate<S: Scalar>(&self, s: S) -> Position<S> {
        let radius = s.to_f64();
        let bin = ((radius - self.radii[0]) * BINS) as usize;
        let mut rung = usize::from(self.bins[bin.min(self.bins.len() - 1)]);
        if rung + 2 < self.radii.len() && radius >= self.radii[rung + 1] {
            rung += 1;
        }
        // The bin is off by one where it is rounded.
        rung -= usize::from(rung > 0 && radius < self.radii[rung]);
        self.position(rung, s)
    }

    /// Where a circle of signed radius `s` lies behind a rung.
    #[inline(always)]
    pub(crate) fn position<S: Scalar>(&self, rung: usize, s: S) -> Position<S> {
        let [own, scale] = self.squares[rung].map(S::from_f64);
        let next = (s * s - own) * scale;
        Position { rung, next, slope: S::from_f64(2.0) * s * scale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_lies_between_its_rungs_with_its_own_second_moment() {
        let mut rungs = Rungs::default();
        rungs.reach(40.0);
        for k in -400..=400 {
            let s = 0.1 * f64::from(k);
            let position = rungs.locate(s);
            let [a, b] = [rungs.radius(position.rung), rungs.radius(position.rung + 1)];
            assert!(a <= s && s < b, "{s} is not between {a} and {b}");
            assert!((-1e-12..=1.0 + 1e-12).contains(&position.next));
            let moment = (1.0 - position.next) * a * a + position.next * b * b;
            assert!((moment - s * s).abs() < 1e-9 * (1.0 + s * s));
            let step = 1e-6;
            if s - a > step && b - s > step {
                let slope = (rungs.locate(s + step).next - rungs.locate(s - step).next) / 2e-6;
                assert!((slope - position.slope).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn what_is_in_focus_is_the_picture_itself() {
        let mut rungs = Rungs::default();
        for largest in [0.0, 0.2, 5.0] {
            rungs.reach(largest);
            let position = rungs.locate(0.0);
            assert_eq!(
                (rungs.radius(position.rung), position.next, position.slope),
                (0.0, 0.0, 0.0)
            );
            for s in [-largest, largest] {
                assert!(rungs.locate(s).rung + 1 < rungs.count());
            }
        }
    }

    #[test]
    fn a_blur_and_its_halvings_have_the_variance_of_a_rung() {
        let mut rungs = Rungs::default();
        rungs.reach(600.0);
        for rung in 0..rungs.count() {
            let (count, left) = rungs.halvings(rung);
            let variance = (0..count).fold(left, |variance, _| 4.0 * variance + 1.0);
            let radius = rungs.radius(rung);
            assert!((variance - 0.25 * radius * radius).abs() < 1e-9 * (1.0 + variance));
            assert_eq!(count == 0, radius.abs() < 12.0);
            assert!(left < 36.0 || count == MOST_HALVINGS);
        }
    }
}
