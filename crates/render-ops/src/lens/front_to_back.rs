//! What a lens sees of blurred rungs, at one pixel.
//!
//! # Forward
//! Rung k, from the nearest on, has at the pixel the blurred colours `C_k` and the blurred alpha `A_k`. With g of
//! `hiding`, `F_k = sum_(m < k - 1) g(rho_m, rho_k) v_m` is what hides it, and
//! `v_k = max(0, min(A_k (1 - F_k), 1 - sum_(m < k) v_m))` what is seen of it. With `q_k = v_k / A_k` the
//! picture is `o = sum_k q_k C_k / V`, `V = sum_k v_k`.
//!
//! Rungs near each other add up: they are one surface, cut into rungs. Rungs apart lie over one another: what
//! they cover of the lens is independent.
//!
//! # Backward
//! With `b = o_bar / V` and `V_bar = -o . b`, from the last rung to the first, with `q_bar = b . C_k` and
//! `v_bar = V_bar` and what later rungs have added: `C_bar_k = q_k b`. Where the first argument of min was
//! taken, q is `1 - F_k`: `A_bar_k = (1 - F_k) v_bar`, `F_bar = -q_bar - A_k v_bar`, and `v_bar_m += g F_bar`.
//! Where the second was: `v_bar += q_bar / A_k`, `A_bar_k = -q_bar q_k / A_k`, and `v_bar_m -= v_bar` for all
//! `m < k`. Where max took 0: nothing.
//!
//! # Where it is not smooth
//! Where min changes sides. Both sides are equal on whole surfaces, where alphas add up to 1, and so are their
//! derivatives there.

use bokashi_core::Scalar;

use super::hiding::gap;
use super::rungs::Rungs;

/// g between all rungs.
#[derive(Debug, Default)]
pub(super) struct Gaps {
    values: Vec<f64>,
    count: usize,
}

impl Gaps {
    pub(super) fn between(&mut self, rungs: &Rungs) {
        let count = rungs.count();
        if self.count != count {
            self.count = count;
            self.values.clear();
            for k in 0..count {
                let to = rungs.radius(k);
                // Neighbours are of one surface.
                let hides = |m: usize| if m + 1 < k { gap(rungs.radius(m), to).share } else { 0.0 };
                self.values.extend((0..count).map(hides));
            }
        }
    }

    /// How much of rung `k` rung `m` hides.
    fn of(&self, m: usize, k: usize) -> f64 {
        self.values[k * self.count + m]
    }
}

/// Which argument decides what is seen of a rung.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Limit {
    /// What hides it.
    Hidden,
    /// What is left.
    Left,
    /// It is not seen.
    Unseen,
}

/// A rung at a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layer<S> {
    pub(super) rung: usize,
    /// Which of the band's strips it is.
    pub(super) strip: usize,
    /// `A_k`.
    pub(super) alpha: S,
    /// `v_k` and `q_k`.
    pub(super) seen: S,
    pub(super) share: S,
    pub(super) limit: Limit,
}

impl<S: Scalar> Layer<S> {
    pub(super) fn new(rung: usize, strip: usize, alpha: S) -> Self {
        Self { rung, strip, alpha, seen: S::ZERO, share: S::ZERO, limit: Limit::Unseen }
    }
}

/// How far both arguments of min lie apart where they differ by more than rounding.
const ROUNDING: f64 = 1e-6;

/// Finds what is seen of `layers`, the nearest first; returns V, and a number that tells on which smooth piece
/// it lies.
pub(super) fn see<S: Scalar>(layers: &mut [Layer<S>], gaps: &Gaps) -> (S, u64) {
    let (mut total, mut piece) = (S::ZERO, 0_u64);
    for k in 0..layers.len() {
        let (before, rest) = layers.split_at_mut(k);
        let layer = &mut rest[0];
        let mut hidden = S::ZERO;
        for other in &*before {
            hidden += S::from_f64(gaps.of(other.rung, layer.rung)) * other.seen;
        }
        let (through, left) = (S::ONE - hidden, S::ONE - total);
        let wanted = layer.alpha * through;
        layer.limit = if wanted <= S::ZERO || left <= S::ZERO {
            Limit::Unseen
        } else if wanted <= left {
            Limit::Hidden
        } else {
            Limit::Left
        };
        (layer.seen, layer.share) = match layer.limit {
            Limit::Hidden => (wanted, through),
            Limit::Left => (left, left / layer.alpha),
            Limit::Unseen => (S::ZERO, S::ZERO),
        };
        total += layer.seen;
        let is_cut = (wanted - left).to_f64() > ROUNDING;
        piece = piece.wrapping_mul(3).wrapping_add(u64::from(is_cut) + (layer.rung as u64) * 5);
    }
    (total, piece)
}

/// The gradients of the alphas of `layers`: `alpha_bar(k, bar)` takes each. `color_dots` has `b . C_k` of each,
/// and `total_bar` is `V_bar`.
pub(super) fn pull_back<S: Scalar>(
    layers: &[Layer<S>],
    gaps: &Gaps,
    color_dots: &[S],
    total_bar: S,
    seen_bars: &mut Vec<S>,
    mut alpha_bar: impl FnMut(usize, S),
) {
    seen_bars.clear();
    seen_bars.resize(layers.len(), total_bar);
    for (k, layer) in layers.iter().enumerate().rev() {
        let (before, rest) = seen_bars.split_at_mut(k);
        let (seen_bar, dot) = (rest[0], color_dots[k]);
        match layer.limit {
            Limit::Hidden => {
                alpha_bar(k, layer.share * seen_bar);
                let hidden_bar = -dot - layer.alpha * seen_bar;
                for (bar, other) in before.iter_mut().zip(layers) {
                    *bar += S::from_f64(gaps.of(other.rung, layer.rung)) * hidden_bar;
                }
            }
            Limit::Left => {
                alpha_bar(k, -dot * layer.share / layer.alpha);
                let seen_bar = seen_bar + dot / layer.alpha;
                before.iter_mut().for_each(|bar| *bar -= seen_bar);
            }
            Limit::Unseen => alpha_bar(k, S::ZERO),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rungs() -> (Rungs, Gaps) {
        let (mut rungs, mut gaps) = (Rungs::default(), Gaps::default());
        rungs.reach(12.0);
        gaps.between(&rungs);
        (rungs, gaps)
    }

    /// The picture of rungs of one channel.
    fn picture(given: &[(usize, f64, f64)], gaps: &Gaps) -> (f64, Vec<Layer<f64>>) {
        let layer = |&(rung, _, alpha): &(usize, f64, f64)| Layer::new(rung, 0, alpha);
        let mut layers: Vec<_> = given.iter().map(layer).collect();
        let (total, _) = see(&mut layers, gaps);
        let sum: f64 = layers.iter().zip(given).map(|(layer, given)| layer.share * given.1).sum();
        (sum / total, layers)
    }

    #[test]
    fn rungs_apart_lie_over_one_another_and_neighbours_add_up() {
        let (rungs, gaps) = rungs();
        let last = rungs.count() - 1;
        let (over, _) = picture(&[(0, 0.3 * 0.9, 0.3), (last, 0.2, 1.0)], &gaps);
        assert!((over - (0.27 + 0.7 * 0.2)).abs() < 1e-15);
        let (added, _) = picture(&[(4, 0.3 * 0.9, 0.3), (5, 0.7 * 0.2, 0.7)], &gaps);
        assert!((added - (0.27 + 0.14)).abs() < 1e-15);
        // What is more than the whole lens is cut.
        let (cut, layers) = picture(&[(4, 0.8, 0.8), (5, 0.3, 0.6)], &gaps);
        assert!((cut - (0.8 + 0.2 / 0.6 * 0.3)).abs() < 1e-15);
        assert_eq!(layers[1].limit, Limit::Left);
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let (_, gaps) = rungs();
        let given =
            [(1, 0.1, 0.35), (2, 0.2, 0.25), (9, 0.15, 0.5), (14, 0.3, 0.6), (15, 0.4, 0.7)];
        let (value, layers) = picture(&given, &gaps);
        let limits: Vec<_> = layers.iter().map(|layer| layer.limit).collect();
        assert!(limits.contains(&Limit::Left) && limits.contains(&Limit::Hidden));
        let total: f64 = layers.iter().map(|layer| layer.seen).sum();
        let dots: Vec<_> = given.iter().map(|given| given.1 / total).collect();
        let mut found = vec![f64::NAN; given.len()];
        let bars = &mut Vec::new();
        pull_back(&layers, &gaps, &dots, -value / total, bars, |k, bar| found[k] = bar);
        for k in 0..given.len() {
            let step = 1e-6;
            let at = |step: f64, of_color: f64| {
                let mut moved = given;
                moved[k].1 += step * of_color;
                moved[k].2 += step * (1.0 - of_color);
                picture(&moved, &gaps).0
            };
            let alpha = (at(step, 0.0) - at(-step, 0.0)) / (2.0 * step);
            let color = (at(step, 1.0) - at(-step, 1.0)) / (2.0 * step);
            assert!((found[k] - alpha).abs() < 1e-8, "{k}: {} is not {alpha}", found[k]);
            assert!((layers[k].share / total - color).abs() < 1e-8);
        }
    }
}
