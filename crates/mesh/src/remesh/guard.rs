//! Limits of every change of the mesh: no face turns over, no sliver is made, no more faces cross.

use bokashi_render_ops::glam::DVec3;
use smallvec::SmallVec;

use super::changing::Changing;
use crate::box_tree::Bounds;
use crate::crossing::cross;
use crate::triangle::{area_vector, quality};

/// The least cosine between a face's normals before and after a change: 45 degrees.
const LEAST_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The least quality of a new face, where the old ones were better.
const LEAST_QUALITY: f64 = 0.2;

/// A vertex with more faces does not move until flips have left it fewer: a move compares all pairs of its faces.
pub(super) const MOST_FACES: usize = 64;

/// A face of a lower quality has no normal to speak of.
const NEEDLE: f64 = 1e-6;

/// A face as a change would leave it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Proposal {
    pub(super) face: [u32; 3],
    pub(super) points: [DVec3; 3],
    /// The present face from which it comes.
    pub(super) old: u32,
}

pub(super) type Proposals = SmallVec<[Proposal; 12]>;

impl Changing<'_> {
    /// Whether the faces `gone` may be replaced by the proposed ones.
    pub(super) fn allows(&self, gone: &[u32], proposals: &[Proposal]) -> bool {
        let old = |face: u32| self.corners(self.faces[face as usize]);
        let mut worst = f64::INFINITY;
        for proposal in proposals {
            let quality = quality(proposal.points);
            worst = worst.min(quality);
            if quality < NEEDLE || !keeps_normal(old(proposal.old), proposal.points) {
                return false;
            }
        }
        if worst < LEAST_QUALITY && gone.iter().all(|face| quality(old(*face)) > worst) {
            return false;
        }
        !self.crosses_more(gone, proposals)
    }

    /// Whether the proposed faces cross more faces than those that they replace.
    fn crosses_more(&self, gone: &[u32], proposals: &[Proposal]) -> bool {
        if self.tree.is_none() {
            return false;
        }
        let crossings = self.crossings(gone, proposals);
        if crossings == 0 {
            return false;
        }
        let old = gone.iter().map(|&old| {
            let face = self.faces[old as usize];
            Proposal { face, points: self.corners(face), old }
        });
        crossings > self.crossings(gone, &old.collect::<Proposals>())
    }

    /// The number of crossing pairs: of two proposed faces, or of a proposed face and one that is not in `gone`.
    fn crossings(&self, gone: &[u32], proposals: &[Proposal]) -> usize {
        let Some(tree) = &self.tree else { return 0 };
        let bounds: SmallVec<[Bounds; 12]> =
            proposals.iter().map(|it| Bounds::around(&it.points)).collect();
        let all = bounds.iter().fold(Bounds::around(&[]), |all, it| all.with(it));
        let mut crossings = 0;
        tree.for_each_near(&all, |other, around| {
            if gone.contains(&other) {
                return;
            }
            let face = self.faces[other as usize];
            let points = self.corners(face);
            for (proposal, bounds) in proposals.iter().zip(&bounds) {
                let meets = bounds.meets(around);
                if meets && cross((&proposal.face, &proposal.points), (&face, &points)) {
                    crossings += 1;
                }
            }
        });
        for (k, one) in proposals.iter().enumerate() {
            for other in &proposals[..k] {
                if cross((&one.face, &one.points), (&other.face, &other.points)) {
                    crossings += 1;
                }
            }
        }
        crossings
    }
}

/// Whether the normal of a face turns by less than 45 degrees. A needle has no normal to keep.
pub(super) fn keeps_normal(old: [DVec3; 3], new: [DVec3; 3]) -> bool {
    let [before, after] = [old, new].map(area_vector);
    before.dot(after) >= LEAST_COSINE * (before.length() * after.length()) || quality(old) < NEEDLE
}
