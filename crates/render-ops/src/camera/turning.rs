//! Where a polynomial falls below 0.

use bokashi_core::Scalar;
use smallvec::SmallVec;

/// The coefficients of a polynomial, or its places of interest: a step takes no memory for so many.
type Few = SmallVec<[f64; 8]>;

/// `sum_k c_k s^k`.
pub(super) fn polynomial<S: Scalar>(coefficients: &[S], s: S) -> S {
    coefficients.iter().rev().fold(S::ZERO, |sum, &coefficient| sum * s + coefficient)
}

/// Its slope by s.
pub(super) fn polynomial_slope<S: Scalar>(coefficients: &[S], s: S) -> S {
    let terms = coefficients.iter().enumerate().skip(1).rev();
    terms.fold(S::ZERO, |sum, (k, &coefficient)| sum * s + S::from_f64(k as f64) * coefficient)
}

/// The first place from 0 to `end` at which a polynomial, above 0 at 0, falls below 0. It carries the derivatives
/// of the coefficients, where numbers carry them.
pub(super) struct Turn<S> {
    pub(super) root: S,
    /// What the polynomial's slopes by the coefficients are multiplied by for those of the place. `None` where the
    /// polynomial hardly falls below 0: the place is about to leap.
    pub(super) scale: Option<S>,
}

impl<S: Scalar> Turn<S> {
    pub(super) fn new(coefficients: &[S], end: f64) -> Option<Self> {
        let numbers: Few = coefficients.iter().map(|coefficient| coefficient.to_f64()).collect();
        let start = *sign_changes(&numbers, end).first()?;
        let s = S::from_f64(start);
        let slope = polynomial_slope(coefficients, s);
        let terms = numbers.iter().enumerate().skip(1);
        let size: f64 = terms
            .map(|(k, coefficient)| (k as f64 * coefficient * start.powi(k as i32 - 1)).abs())
            .sum();
        if slope.to_f64().abs() <= f64::EPSILON * size {
            return Some(Self { root: s, scale: None });
        }
        // By Newton's method: the value is there already.
        let value = polynomial(coefficients, s);
        let root = s - (value - S::from_f64(value.to_f64())) / slope;
        Some(Self { root, scale: Some(-(S::ONE / polynomial_slope(coefficients, root))) })
    }
}

/// Where the polynomial changes its sign from 0 to `end`, in ascending order. Between two places where its slope
/// does so it goes one way.
fn sign_changes(coefficients: &[f64], end: f64) -> Few {
    if coefficients.len() < 2 {
        return Few::new();
    }
    let slopes =
        coefficients.iter().enumerate().skip(1).map(|(k, coefficient)| k as f64 * coefficient);
    let bends = sign_changes(&slopes.collect::<Few>(), end);
    let is_above = |s: f64| polynomial(coefficients, s) >= 0.0;
    let mut roots = Few::new();
    let mut low = 0.0;
    for high in bends.into_iter().chain([end]) {
        let before = is_above(low);
        if is_above(high) != before {
            roots.push(bisected(low, high, |s| is_above(s) == before));
        }
        low = high;
    }
    roots
}

/// The last number from `low` to `high` for which `holds`, where it holds up to a point.
pub(super) fn bisected(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    loop {
        let middle = 0.5 * low + 0.5 * high;
        if middle <= low || middle >= high {
            return low;
        }
        *(if holds(middle) { &mut low } else { &mut high }) = middle;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_of_any_degree_changes_its_sign_at_its_roots() {
        // Products of (s - root), by their coefficients.
        let with_roots = |roots: &[f64]| {
            roots.iter().fold(vec![1.0], |all: Vec<f64>, root| {
                let mut product = vec![0.0; all.len() + 1];
                for (k, coefficient) in all.iter().enumerate() {
                    product[k] -= root * coefficient;
                    product[k + 1] += coefficient;
                }
                product
            })
        };
        for roots in [vec![], vec![0.5], vec![0.5, 0.75, 2.0, 3.0, 4.0, 5.0]] {
            let found = sign_changes(&with_roots(&roots), 4.5);
            let expected: Vec<_> = roots.iter().copied().filter(|root| *root < 4.5).collect();
            assert_eq!(found.len(), expected.len(), "{found:?}");
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "{found} and not {expected}");
            }
        }
        // Negative ones, and those that are touched, are none.
        assert!(sign_changes(&with_roots(&[-1.0, -2.0, 1.0, 1.0]), 4.0).is_empty());
    }

    #[test]
    fn a_turn_moves_with_the_coefficients() {
        // 2 - s^2 c, at sqrt(2 / c).
        let at = |c: f64| Turn::new(&[2.0, 0.0, -c], 10.0).unwrap();
        let slope = -(2.0_f64).sqrt() / 2.0 * 0.5_f64.powf(1.5);
        let found = at(2.0);
        assert!((found.root - 1.0).abs() < 1e-15);
        // The polynomial's slope by c is -s^2.
        assert!((-found.scale.unwrap() - slope).abs() < 1e-15);
    }
}
