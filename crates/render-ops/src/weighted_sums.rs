//! Sums over the fragments of a face: of their weights, times numbers that they have.
//!
//! `N` fragments of a face are worked on side by side, and each sum has as many parts. Fragment k of those that are
//! summed belongs to part `k % N`, wherever planes begin. Parts take time to be added up, so faces with few fragments
//! have fewer.

use std::ops::Range;

use bokashi_core::Scalar;

use crate::planes::{CAPACITY, LANES, Plane, load, split, zeros};

/// Parts of the sums of few fragments.
const FEW_PARTS: usize = 4;

/// From so many fragments on there are [`LANES`] parts.
const MANY: usize = 32;

/// What is summed over the fragments of a face, times their weights: `K` numbers that follow from u, v and `C` others.
pub(crate) trait Terms<S, const C: usize, const K: usize> {
    /// Those of a fragment. They are zero where u, v and all numbers are.
    fn compute(&self, uv: [S; 2], numbers: [S; C]) -> [S; K];
}

/// Fragments, number by number.
pub(crate) struct FragmentPlanes<'a, T, const C: usize> {
    /// Per fragment: u and v.
    all_uv: &'a [[T; 2]],
    /// Per fragment: what else there is.
    all_numbers: &'a [[T; C]],
    /// The fragments that were copied.
    range: Range<usize>,
    uv: [Plane<T>; 2],
    numbers: [Plane<T>; C],
}

impl<'a, T: Scalar, const C: usize> FragmentPlanes<'a, T, C> {
    /// For fragments of `uv` and `numbers`.
    #[inline(always)]
    pub(crate) fn new(uv: &'a [[T; 2]], numbers: &'a [[T; C]]) -> Self {
        Self { all_uv: uv, all_numbers: numbers, range: 0..0, uv: zeros(), numbers: zeros() }
    }

    /// The sums over some fragments of a face of their weights times numbers: `sums[i][k]` of `b_i terms_k`.
    #[inline(always)]
    pub(crate) fn sum<F: Terms<T::Wide, C, K>, const K: usize>(
        &mut self,
        terms: &F,
        fragments: Range<usize>,
    ) -> [[T::Wide; K]; 3] {
        if fragments.len() < MANY {
            self.sum_in_parts::<F, K, FEW_PARTS>(terms, fragments)
        } else {
            self.sum_in_parts::<F, K, LANES>(terms, fragments)
        }
    }

    #[inline(always)]
    fn sum_in_parts<F: Terms<T::Wide, C, K>, const K: usize, const N: usize>(
        &mut self,
        terms: &F,
        fragments: Range<usize>,
    ) -> [[T::Wide; K]; 3] {
        let mut parts = [[[T::Wide::ZERO; N]; K]; 3];
        let Range { mut start, end } = fragments;
        assert!(end <= self.all_uv.len(), "fragments up to {end} of {}", self.all_uv.len());
        while start < end {
            if !(self.range.start <= start && end <= self.range.end) {
                self.copy_from(start);
            }
            let here = start..end.min(self.range.end);
            start = here.end;
            self.add_to(&mut parts, terms, here);
        }
        let mut sums = [[T::Wide::ZERO; K]; 3];
        // Not by `map`, which would be a call.
        for i in 0..3 {
            for k in 0..K {
                sums[i][k] = add_up(&parts[i][k]);
            }
        }
        sums
    }

    /// Copies fragments from `start` on, as many as there is room for.
    #[inline(always)]
    fn copy_from(&mut self, start: usize) {
        self.range = start..self.all_uv.len().min(start + CAPACITY);
        split(&mut self.uv, &self.all_uv[self.range.clone()]);
        split(&mut self.numbers, &self.all_numbers[self.range.clone()]);
    }

    /// Adds the terms of fragments that were copied.
    #[inline(always)]
    fn add_to<F: Terms<T::Wide, C, K>, const K: usize, const N: usize>(
        &self,
        parts: &mut [[[T::Wide; N]; K]; 3],
        terms: &F,
        fragments: Range<usize>,
    ) {
        let [mut first, end] = [fragments.start, fragments.end].map(|k| k - self.range.start);
        while first < end {
            let count = end - first;
            let (us, vs): ([T; N], [T; N]) = (load(&self.uv[0], first), load(&self.uv[1], first));
            let mut numbers = [[T::ZERO; N]; C];
            for c in 0..C {
                numbers[c] = load(&self.numbers[c], first);
            }
            for part in 0..N {
                // Numbers behind the last fragment belong to other faces, or are left of other fragments.
                let own = |number: T| if part < count { number.widen() } else { T::Wide::ZERO };
                let (u, v) = (own(us[part]), own(vs[part]));
                let mut own_numbers = [T::Wide::ZERO; C];
                for c in 0..C {
                    own_numbers[c] = own(numbers[c][part]);
                }
                let terms = terms.compute([u, v], own_numbers);
                let third = T::Wide::ONE - u - v;
                for k in 0..K {
                    parts[0][k][part] += u * terms[k];
                    parts[1][k][part] += v * terms[k];
                    parts[2][k][part] += third * terms[k];
                }
            }
            first += N;
        }
    }
}

/// The sum of all parts, as a tree.
#[inline(always)]
fn add_up<S: Scalar, const N: usize>(parts: &[S; N]) -> S {
    match *parts.as_slice() {
        [a, b, c, d] => (a + c) + (b + d),
        [a, b, c, d, e, f, g, h] => ((a + e) + (c + g)) + ((b + f) + (d + h)),
        _ => unreachable!("{N} parts"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two numbers, and their product with u.
    struct Product;

    impl Terms<f64, 2, 3> for Product {
        fn compute(&self, [u, _]: [f64; 2], [a, b]: [f64; 2]) -> [f64; 3] {
            [a, b, u * a * b]
        }
    }

    fn bits(sums: [[f64; 3]; 3]) -> Vec<u64> {
        sums.as_flattened().iter().map(|sum| sum.to_bits()).collect()
    }

    /// The sums over some fragments with the others being no numbers, which stay with the faces that have them.
    fn sum_alone(uv: &[[f64; 2]], numbers: &[[f64; 2]], fragments: Range<usize>) -> Vec<u64> {
        let (mut own_uv, mut own_numbers) =
            (vec![[f64::NAN; 2]; uv.len()], vec![[f64::NAN; 2]; uv.len()]);
        own_uv[fragments.clone()].copy_from_slice(&uv[fragments.clone()]);
        own_numbers[fragments.clone()].copy_from_slice(&numbers[fragments.clone()]);
        bits(FragmentPlanes::new(&own_uv, &own_numbers).sum(&Product, fragments))
    }

    #[test]
    fn sums_are_those_of_a_face_alone_wherever_planes_begin() {
        let lengths =
            [1, 7, 8, 9, 2, 16, 31, 32, 40, CAPACITY - 60, 30, 2 * CAPACITY + 5, 3, CAPACITY, 1];
        let count = lengths.iter().sum();
        let number = |k: usize| (1.7 * k as f64).sin() + 0.3;
        let uv: Vec<_> = (0..count).map(|k| [0.5 * number(k), 0.5 * number(k + 7)]).collect();
        let numbers: Vec<_> = (0..count).map(|k| [number(k + 11), number(k + 19)]).collect();
        let mut planes = FragmentPlanes::new(&uv, &numbers);
        let mut start = 0;
        for length in lengths {
            let fragments = start..start + length;
            let sums = planes.sum(&Product, fragments.clone());
            assert_eq!(bits(sums), sum_alone(&uv, &numbers, fragments.clone()), "{fragments:?}");
            let mut expected = [[0.0; 3]; 3];
            for k in fragments.clone() {
                let ([u, v], terms) = (uv[k], Product.compute(uv[k], numbers[k]));
                for (sums, weight) in expected.iter_mut().zip([u, v, 1.0 - u - v]) {
                    for (sum, term) in sums.iter_mut().zip(terms) {
                        *sum += weight * term;
                    }
                }
            }
            for (sum, expected) in sums.as_flattened().iter().zip(expected.as_flattened()) {
                approx::assert_abs_diff_eq!(*sum, *expected, epsilon = 1e-14 * length as f64);
            }
            // One by one, and back to the first.
            for k in fragments.rev().step_by(29) {
                let sums = planes.sum(&Product, k..k + 1);
                assert_eq!(bits(sums), sum_alone(&uv, &numbers, k..k + 1), "{k}");
            }
            start += length;
        }
    }
}
