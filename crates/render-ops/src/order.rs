//! The smallest and the largest of numbers that are not NaN.

use bokashi_core::Scalar;

/// The smaller of two that are not NaN: a single instruction, where the rules for NaN take three.
#[inline(always)]
pub(crate) fn smaller<S: Scalar>(a: S, b: S) -> S {
    if a < b { a } else { b }
}

/// The larger of two that are not NaN.
#[inline(always)]
pub(crate) fn larger<S: Scalar>(a: S, b: S) -> S {
    if a > b { a } else { b }
}

/// The smallest of three.
#[inline(always)]
pub(crate) fn least<S: Scalar>([a, b, c]: [S; 3]) -> S {
    smaller(smaller(a, b), c)
}

/// The largest of three.
#[inline(always)]
pub(crate) fn largest<S: Scalar>([a, b, c]: [S; 3]) -> S {
    larger(larger(a, b), c)
}
