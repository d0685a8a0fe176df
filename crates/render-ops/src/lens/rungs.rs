//! Rungs: blurs of fixed radii, between which every circle of confusion lies.
//!
//! # Forward
//! Rung m has the signed radius `rho_m = 3 sinh(0.12 m)`: the same in every step of a fit, about a third of a
//! pixel apart near the focus, and an eighth of the radius far from it. What has a circle of radius s between
//! `rho_k` and `rho_(k+1)` is shared among both: `1 - t` to rung k and t to rung k + 1, with
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
pub(super) struct Rungs {
    /// From the most negative on: those of the rungs `-most..=most`.
    radii: Vec<f64>,
    most: i32,
}

/// Between which rungs a circle lies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<S> {
    /// The rung before it, from the nearest on, counted from 0.
    pub(super) rung: usize,
    /// The share of the next rung, and its derivative by the radius.
    pub(super) next: S,
    pub(super) slope: S,
}

const FIRST_STEP: f64 = 0.12;
const SCALE: f64 = 3.0;

impl Rungs {
    /// The rungs for circles of at most `largest` pixels.
    pub(super) fn reach(&mut self, largest: f64) {
        let most = (1.0 + ((largest / SCALE).asinh() / FIRST_STEP).ceil()) as i32;
        if most != self.most {
            self.most = most;
            let radius = |m: i32| SCALE * (FIRST_STEP * f64::from(m)).sinh();
            self.radii.clear();
            self.radii.extend((-most..=most).map(radius));
        }
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.radii.len()
    }

    /// The signed radius of a rung, counted from 0.
    pub(super) fn radius(&self, rung: usize) -> f64 {
        self.radii[rung]
    }

    /// How many rungs lie between a rung and the picture itself.
    pub(super) fn steps(&self, rung: usize) -> usize {
        rung.abs_diff(self.most as usize)
    }

    /// Where a circle of signed radius `s` lies.
    pub(super) fn place<S: Scalar>(&self, s: S) -> Place<S> {
        let at = s.to_f64();
        let guess = ((at / SCALE).asinh() / FIRST_STEP).floor() as i32 + self.most;
        let mut rung = guess.clamp(0, 2 * self.most - 1) as usize;
        // The guess is off by one where it is rounded.
        while rung > 0 && at < self.radii[rung] {
            rung -= 1;
        }
        while rung + 2 < self.radii.len() && at >= self.radii[rung + 1] {
            rung += 1;
        }
        let [own, after] = [self.radii[rung], self.radii[rung + 1]].map(|rho| rho * rho);
        let scale = S::from_f64((after - own).recip());
        let next = (s * s - S::from_f64(own)) * scale;
        Place { rung, next, slope: S::from_f64(2.0) * s * scale }
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
            let place = rungs.place(s);
            let [a, b] = [rungs.radius(place.rung), rungs.radius(place.rung + 1)];
            assert!(a <= s && s < b, "{s} is not between {a} and {b}");
            assert!((-1e-12..=1.0 + 1e-12).contains(&place.next));
            let moment = (1.0 - place.next) * a * a + place.next * b * b;
            assert!((moment - s * s).abs() < 1e-9 * (1.0 + s * s));
            let step = 1e-6;
            if s - a > step && b - s > step {
                let slope = (rungs.place(s + step).next - rungs.place(s - step).next) / 2e-6;
                assert!((slope - place.slope).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn what_is_in_focus_is_the_picture_itself() {
        let mut rungs = Rungs::default();
        for largest in [0.0, 0.2, 5.0] {
            rungs.reach(largest);
            let place = rungs.place(0.0);
            assert_eq!((rungs.steps(place.rung), place.next, place.slope), (0, 0.0, 0.0));
            for s in [-largest, largest] {
                assert!(rungs.place(s).rung + 1 < rungs.count());
            }
        }
    }
}
