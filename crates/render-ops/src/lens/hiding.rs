//! Which surfaces hide each other as a whole, and which only in parts.
//!
//! # Forward
//! Surfaces with circles of confusion a and b (signed radii) touch, or lie apart, as far as the lens can tell:
//! `g(a, b) = S((|b - a| / (2 + 0.65 max(|a|, |b|)) - 1/4) / (1/2))`, with `S(x) = 3 x^2 - 2 x^3` on [0, 1],
//! is 0 for those that touch, and 1 for those apart.
//!
//! Of the surfaces at a pixel's centre, with alphas `a_i`, the nearest first, surface j shows through those in
//! front of it with the share `p_j = prod_(i < j) (1 - a_i (1 - g(s_i, s_j)))`. Close behind a surface nothing
//! shows but what its alpha leaves; far behind it all of the surface does, since it is blurred apart from
//! what hides it, and hidden where rungs are put together.
//!
//! In a boundary pixel of exact coverage the surface at the centre is covered by pieces in front of it. With
//! weights `w_n` and alphas `a_n` of these it has there the share `p_0 = sum_n w_n (1 - a_n (1 - g(s_n, s_0)))`,
//! beside what is visible of it.
//!
//! # Backward
//! `dg/da = 2 S' (d'_a / m - d m'_a / m^2)` with `d = |b - a|` and `m` the denominator.
//! `a_bar_i -= p_bar_j (1 - g) rest`, `g_bar_ij = p_bar_j a_i rest`, where `rest` is the product of the other
//! factors. `w_bar_n = p_bar_0 (1 - a_n (1 - g))`, `a_bar_n = -p_bar_0 w_n (1 - g)`, `g_bar_n = p_bar_0 w_n a_n`.
//!
//! # Where it is not smooth
//! Where `|a| = |b|`, between 0 and 1. At 0 and 1 the second derivative jumps.

use bokashi_core::Scalar;

/// A share of a pixel that is less is rounding.
pub(super) const LEAST_SHARE: f64 = 1e-6;

/// How much of b is seen beside a, and the derivatives by a and by b.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gap<S> {
    pub(super) share: S,
    pub(super) slopes: [S; 2],
    /// On which smooth piece of g it lies.
    pub(super) piece: u8,
}

/// g(a, b).
#[inline]
pub(super) fn gap<S: Scalar>(a: S, b: S) -> Gap<S> {
    let size = |x: S| if x < S::ZERO { -x } else { x };
    let sign = |x: S| if x < S::ZERO { -S::ONE } else { S::ONE };
    let number = S::from_f64;
    let distance = size(b - a);
    let is_first_larger = size(a) >= size(b);
    let larger = if is_first_larger { a } else { b };
    let measure = number(2.0) + number(0.65) * size(larger);
    // Most surfaces touch or lie apart, and need no quotient.
    let fourfold = number(4.0) * distance;
    let is_apart = fourfold >= number(3.0) * measure;
    if is_apart || fourfold <= measure {
        let share = if is_apart { S::ONE } else { S::ZERO };
        return Gap { share, slopes: [S::ZERO; 2], piece: u8::from(is_apart) };
    }
    let x = number(2.0) * (distance / measure) - number(0.5);
    let by_x = number(6.0) * x * (S::ONE - x);
    let by_distance = number(2.0) * by_x / measure * sign(b - a);
    let by_larger = number(-1.3) * by_x * (distance / measure) / measure * sign(larger);
    let slopes = match is_first_larger {
        true => [by_larger - by_distance, by_distance],
        false => [-by_distance, by_larger + by_distance],
    };
    let share = x * x * (number(3.0) - number(2.0) * x);
    Gap { share, slopes, piece: 2 + u8::from(is_first_larger) }
}

/// g(a, b) where b is at least `least`, else 0.
#[inline]
fn gap_from<S: Scalar>(least: f64, a: S, b: S) -> Gap<S> {
    if b.to_f64() < least {
        return Gap { share: S::ZERO, slopes: [S::ZERO; 2], piece: 0 };
    }
    gap(a, b)
}

/// Whether g(a, b) is above 0.
#[inline(always)]
pub(super) fn is_gap(a: f64, b: f64) -> bool {
    4.0 * (b - a).abs() > 2.0 + 0.65 * a.abs().max(b.abs())
}

/// A fragment of a layer; the visible layer is the first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Surface {
    pub(super) layer: u32,
    pub(super) fragment: u32,
}

impl Surface {
    pub(super) const BACKGROUND: Self = Self { layer: u32::MAX, fragment: u32::MAX };
}

/// A surface at a pixel's centre.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link<S> {
    pub(super) surface: Surface,
    pub(super) alpha: S,
    /// Of its circle.
    pub(super) radius: S,
}

/// The share of the last of `chain`, and a number that tells on which smooth piece it lies. What has a smaller
/// radius than `least` shows nothing but what alphas leave.
pub(super) fn share_behind<S: Scalar>(chain: &[Link<S>], least: f64) -> (S, u64) {
    let Some((last, front)) = chain.split_last() else { return (S::ONE, 0) };
    let (mut share, mut piece) = (S::ONE, 0);
    for link in front {
        let gap = gap_from(least, link.radius, last.radius);
        share *= S::ONE - link.alpha * (S::ONE - gap.share);
        piece = 4 * piece + u64::from(gap.piece);
    }
    (share, piece)
}

/// What is seen of a surface behind a piece, as a share of the piece, and its derivatives: by the piece's alpha
/// and its circle's radius, and by the radius behind.
#[derive(Debug, Clone, Copy)]
pub(super) struct Behind<S> {
    pub(super) share: S,
    pub(super) by_alpha: S,
    pub(super) by_radii: [S; 2],
    pub(super) piece: u8,
}

/// What is seen of a surface of radius `behind` through a piece: nothing where the piece is not in front.
pub(super) fn behind_piece<S: Scalar>(alpha: S, radius: S, behind: S) -> Option<Behind<S>> {
    (radius < behind).then(|| {
        let gap = gap(radius, behind);
        Behind {
            share: S::ONE - alpha * (S::ONE - gap.share),
            by_alpha: gap.share - S::ONE,
            by_radii: gap.slopes.map(|slope| alpha * slope),
            piece: gap.piece,
        }
    })
}

/// The gradients of a surface at a pixel's centre: of its alpha, and of its circle's radius.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinkBar<S> {
    pub(super) alpha: S,
    pub(super) radius: S,
}

/// Adds to `bars`, one for each of `chain`, what the gradient of [`share_behind`] says of them.
pub(super) fn pull_back_share<S: Scalar>(
    chain: &[Link<S>],
    least: f64,
    share_bar: S,
    bars: &mut [LinkBar<S>],
) {
    let Some((last, front)) = chain.split_last() else { return };
    let end = front.len();
    for (i, link) in front.iter().enumerate() {
        let mut rest = share_bar;
        for (j, other) in front.iter().enumerate() {
            if j != i {
                let gap = gap_from(least, other.radius, last.radius).share;
                rest *= S::ONE - other.alpha * (S::ONE - gap);
            }
        }
        let gap = gap_from(least, link.radius, last.radius);
        bars[i].alpha -= rest * (S::ONE - gap.share);
        let gap_bar = rest * link.alpha;
        bars[i].radius += gap_bar * gap.slopes[0];
        bars[end].radius += gap_bar * gap.slopes[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST: f64 = f64::NEG_INFINITY;

    fn link(alpha: f64, radius: f64) -> Link<f64> {
        Link { surface: Surface::BACKGROUND, alpha, radius }
    }

    #[test]
    fn surfaces_that_touch_have_no_gap_and_far_ones_a_whole_one() {
        for a in [-7.0, -0.3, 0.0, 2.0] {
            assert_eq!(gap(a, a).share, 0.0);
            assert_eq!(gap(a, a + 40.0).share, 1.0);
            assert_eq!(gap::<f64>(a, a + 1.5).share, gap(a + 1.5, a).share);
        }
        // By hand: 1.5 / (2 + 0.65 * 2) - 1/4 is 9/44, so x is 9/22.
        let x = 9.0_f64 / 22.0;
        assert!((gap(0.5, 2.0).share - x * x * (3.0 - 2.0 * x)).abs() < 1e-15);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let step = 1e-6;
        for (a, b) in [(0.5, 2.0), (-3.0, -1.2), (-0.7, 0.9), (4.0, 2.2)] {
            let found = gap::<f64>(a, b);
            assert!(found.piece >= 2);
            let slopes = [
                gap(a + step, b).share - gap(a - step, b).share,
                gap(a, b + step).share - gap(a, b - step).share,
            ];
            for k in 0..2 {
                assert!((found.slopes[k] - slopes[k] / (2.0 * step)).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn an_opaque_surface_hides_what_touches_it_and_a_clear_one_nothing() {
        assert_eq!(share_behind(&[link(1.0, 2.0), link(1.0, 2.1)], LEAST).0, 0.0);
        assert_eq!(share_behind(&[link(0.0, 2.0), link(1.0, 2.1)], LEAST).0, 1.0);
        assert_eq!(share_behind(&[link(1.0, -9.0), link(1.0, 9.0)], LEAST).0, 1.0);
        assert_eq!(
            share_behind(&[link(0.25, 2.0), link(0.5, 2.0), link(1.0, 2.1)], LEAST).0,
            0.375
        );
    }

    #[test]
    fn what_is_behind_a_piece_is_seen_far_behind_it_and_through_it() {
        assert!(behind_piece(1.0, 2.0, 2.0).is_none() && behind_piece(1.0, 2.0, 1.0).is_none());
        assert_eq!(behind_piece(1.0, 2.0, 30.0).unwrap().share, 1.0);
        assert_eq!(behind_piece(0.75, 2.0, 2.1).unwrap().share, 0.25);
        let at = |alpha, radius, behind| behind_piece::<f64>(alpha, radius, behind).unwrap();
        let (found, step) = (at(0.7, -1.0, 0.4), 1e-6);
        let quotients = [
            at(0.7 + step, -1.0, 0.4).share - at(0.7 - step, -1.0, 0.4).share,
            at(0.7, -1.0 + step, 0.4).share - at(0.7, -1.0 - step, 0.4).share,
            at(0.7, -1.0, 0.4 + step).share - at(0.7, -1.0, 0.4 - step).share,
        ];
        let slopes = [found.by_alpha, found.by_radii[0], found.by_radii[1]];
        for (slope, quotient) in slopes.into_iter().zip(quotients) {
            assert!((slope - quotient / (2.0 * step)).abs() < 1e-8);
        }
    }

    #[test]
    fn the_gradients_of_a_share_are_those_of_differences() {
        let chain = [link(0.7, -1.0), link(0.4, 0.3), link(1.0, 1.1)];
        let mut bars = [LinkBar { alpha: 0.0, radius: 0.0 }; 3];
        pull_back_share(&chain, LEAST, 1.5, &mut bars);
        let step = 1e-6;
        for k in 0..3 {
            let quotient = |change: fn(&mut Link<f64>, f64)| {
                let at = |step: f64| {
                    let mut moved = chain;
                    change(&mut moved[k], step);
                    1.5 * share_behind(&moved, LEAST).0
                };
                (at(step) - at(-step)) / (2.0 * step)
            };
            let alpha = quotient(|link, step| link.alpha += step);
            let radius = quotient(|link, step| link.radius += step);
            assert!((bars[k].radius - radius).abs() < 1e-8, "{k}");
            assert!(k == 2 || (bars[k].alpha - alpha).abs() < 1e-8, "{k}");
        }
    }
}
