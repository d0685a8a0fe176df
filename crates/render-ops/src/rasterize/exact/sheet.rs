//! Faces that lie side by side in a cell, so that none hides another.
//!
//! Inside an edge that is none of the outline the surface goes on: there one face ends and one begins. So
//! how many faces cover a place changes only across sides that lie on the outline. If no other face enters
//! or runs along such a side, nothing lies beyond it, and a single face inside it. Where there is such a
//! side, no place of the cell is covered twice.
//!
//! A face is taken to be beside a side only where that is clear. Else faces are held against each other.

use bokashi_core::Scalar;

use super::polygon::{Line, size, value_at};

/// Values within the first share of a line's size may be rounding; values beyond the second are not.
const ROUNDING: f64 = 1e-14;
const CLEAR: f64 = 1e-9;

/// Whether a side from p to q at most touches a face with the edge functions `edges`, in one of its ends.
#[inline(always)]
pub(super) fn is_beside<S: Scalar>([p, q]: [[S; 2]; 2], edges: &[Line<S>; 3]) -> bool {
    edges.iter().any(|&edge| {
        let (a, b, size) = (value_at(edge, p), value_at(edge, q), size(edge));
        let most = S::from_f64(ROUNDING) * size;
        let clear = S::from_f64(-CLEAR) * size;
        (a < clear && b <= most) || (b < clear && a <= most)
    })
}
