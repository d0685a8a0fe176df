//! Faces in one plane.
//!
//! Of faces in one plane the lower index is in front. Planes are known to within rounding, so two planes are
//! the same where they differ by no more than that in the pixel. Asked pair by pair, that goes wrong: a first
//! plane can be the same as a second, and that as a third, and the first not as the third. Then each may lie
//! behind another, and none is seen. So faces that tie are given *one* plane. What is in front then depends on
//! the planes alone, and in one plane on the index, which no circle can be made of.
//!
//! The plane of a few that tie is that of the best known among them. No face is moved by more than twice what
//! its plane may be off by itself in the pixel. Of a face much smaller than the pixel that is more than what
//! it is off by where it is. Which planes there are is found in order of how well they are known; each further face
//! joins the nearest of these that it ties with, or is a new plane.

use bokashi_core::Scalar;

use super::polygon::size;
use super::visible::Candidate;

/// By how much two planes differ in the pixel, if they are the same to within rounding. What is known of no
/// depth at all is no tie.
#[inline(always)]
fn tie<S: Scalar>(one: &Candidate<S>, other: &Candidate<S>) -> Option<S> {
    let apart = size([0, 1, 2].map(|c| other.depth[c] - one.depth[c]));
    let bound = one.tie_bound + other.tie_bound;
    (apart <= bound && bound < S::from_f64(f64::INFINITY)).then_some(apart)
}

/// Gives candidates that lie in one plane, to within rounding, the same plane. `order` is memory.
#[inline(always)]
pub(super) fn share_planes<S: Scalar>(candidates: &mut [Candidate<S>], order: &mut Vec<u32>) {
    let some_tie = (1..candidates.len()).any(|index| {
        candidates[..index].iter().any(|other| tie(&candidates[index], other).is_some())
    });
    if some_tie {
        share(candidates, order);
    }
}

#[cold]
#[inline(never)]
fn share<S: Scalar>(candidates: &mut [Candidate<S>], order: &mut Vec<u32>) {
    order.clear();
    order.extend(0..candidates.len() as u32);
    order.sort_unstable_by(|&a, &b| {
        let [a, b] = [a, b].map(|index| &candidates[index as usize]);
        let by_bound = a.tie_bound.to_f64().total_cmp(&b.tie_bound.to_f64());
        by_bound.then(a.band_face.cmp(&b.band_face))
    });
    // The first so many have planes of their own.
    let mut planes = 0;
    for k in 0..order.len() {
        let index = order[k] as usize;
        let ties = order[..planes].iter().filter_map(|&plane| {
            Some((tie(&candidates[index], &candidates[plane as usize])?, plane))
        });
        match ties.min_by(|(a, _), (b, _)| a.to_f64().total_cmp(&b.to_f64())) {
            Some((_, plane)) => {
                let plane = candidates[plane as usize].clone();
                candidates[index] = Candidate {
                    depth: plane.depth,
                    depth_error_bound: plane.depth_error_bound,
                    tie_bound: plane.tie_bound,
                    ..candidates[index].clone()
                };
            }
            None => {
                order[planes] = index as u32;
                planes += 1;
            }
        }
    }
}
