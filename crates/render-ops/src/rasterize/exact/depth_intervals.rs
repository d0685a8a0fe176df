//! The intervals of the depths of faces in a pixel, or in a block of pixels.
//!
//! Sorted by their nearest depths, faces fall into *groups* with gaps between their depths. A group lies
//! before all that follows: what it hides is never looked at. If the first group has no edges, its faces
//! make up whole surface layers. A single layer hides everything else.

use bokashi_core::Scalar;

/// With more intervals, sorting is left to the library.
const FEW: usize = 20;

/// The interval of a face's depths in a block of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthInterval<S> {
    /// The number of its face: among those of the band, or among the candidates of a pixel.
    pub(super) face: u32,
    /// The range of its depths, and a little more.
    pub(super) nearest: S,
    pub(super) farthest: S,
}

/// What a face is in a block of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct FaceInBlock {
    /// Whether it covers the block's centre, or may.
    pub(super) covers: bool,
    /// Whether an edge of the surface's outline, or a seam, may cross the block in it.
    pub(super) ends: bool,
}

impl<S: Scalar> DepthInterval<S> {
    /// Whether nothing of it lies in the depth range.
    pub(super) fn is_out(&self) -> bool {
        self.farthest < -S::ONE || self.nearest > S::ONE
    }

    /// Whether all of it does.
    #[inline(always)]
    pub(super) fn is_within(&self) -> bool {
        self.nearest >= -S::ONE && self.farthest <= S::ONE
    }
}

/// Sorts intervals, the nearest first.
#[inline(always)]
pub(super) fn sort_by_depth<S: Scalar>(intervals: &mut [DepthInterval<S>]) {
    if intervals.len() > FEW {
        return sort_many(intervals);
    }
    // By insertion; no depth is NaN.
    for end in 1..intervals.len() {
        let interval = intervals[end];
        let mut index = end;
        while index > 0 && interval.nearest < intervals[index - 1].nearest {
            intervals[index] = intervals[index - 1];
            index -= 1;
        }
        intervals[index] = interval;
    }
}

#[cold]
#[inline(never)]
fn sort_many<S: Scalar>(intervals: &mut [DepthInterval<S>]) {
    intervals.sort_unstable_by(|a, b| a.nearest.to_f64().total_cmp(&b.nearest.to_f64()));
}

/// How many surface layers the first group of these faces makes up in a block of pixels. Sorts the
/// intervals, the nearest first.
///
/// Faces of one layer touch, so no gap parts them. Where none of a group's faces ends in the block,
/// its layers are whole, and each covers the block's centre once: the faces that cover it are
/// counted. `None` where a face ends, or may reach out of the depth range. What is out of that
/// range hides nothing. `in_block` tells what a face is in the block.
#[inline(always)]
pub(super) fn front_layers<S: Scalar>(
    intervals: &mut [DepthInterval<S>],
    mut in_block: impl FnMut(u32) -> FaceInBlock,
) -> Option<usize> {
    sort_by_depth(intervals);
    let (mut farthest, mut layers) = (-S::from_f64(f64::INFINITY), 0);
    for interval in intervals.iter().filter(|interval| !interval.is_out()) {
        // A gap behind whole layers: they hide the rest.
        if interval.nearest > farthest && layers > 0 {
            break;
        }
        let FaceInBlock { covers, ends } = in_block(interval.face);
        if ends || !interval.is_within() {
            return None;
        }
        farthest = farthest.maximum_or_nan(interval.farthest);
        layers += usize::from(covers);
    }
    Some(layers)
}

/// Parts sorted intervals into groups: between a group's depths and the next group's there is a gap.
pub(super) fn depth_groups<S: Scalar>(
    intervals: &[DepthInterval<S>],
) -> impl Iterator<Item = &[DepthInterval<S>]> {
    let mut farthest = -S::from_f64(f64::INFINITY);
    intervals.chunk_by(move |interval, next| {
        farthest = farthest.maximum_or_nan(interval.farthest);
        next.nearest <= farthest
    })
}

/// Whether surface layers may pass through each other in the first group.
#[inline(always)]
pub(super) fn may_cross<S: Scalar>(
    intervals: &mut [DepthInterval<S>],
    in_block: impl FnMut(u32) -> FaceInBlock,
) -> bool {
    front_layers(intervals, in_block).is_none_or(|layers| layers > 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn interval([nearest, depth]: [f64; 2]) -> DepthInterval<f64> {
        DepthInterval { face: 0, nearest, farthest: nearest + depth }
    }

    proptest! {
        /// Ranges of integers, so that some only touch.
        #[test]
        fn between_groups_there_is_a_gap_and_in_none(
            ranges in proptest::collection::vec([0..30_u8, 0..4_u8], 0..12),
        ) {
            let mut intervals: Vec<_> = ranges.iter().map(|range| interval(range.map(f64::from))).collect();
            intervals.sort_by(|a, b| a.nearest.total_cmp(&b.nearest));
            let ranges = |intervals: &[DepthInterval<f64>]| -> Vec<_> {
                intervals.iter().map(|interval| [interval.nearest, interval.farthest]).collect()
            };
            prop_assert_eq!(depth_groups(&intervals).flat_map(ranges).collect::<Vec<_>>(), ranges(&intervals));
            let is_filled = |depth: f64| intervals.iter().any(|s| s.nearest <= depth && depth <= s.farthest);
            let mut before = f64::NEG_INFINITY;
            for group in depth_groups(&intervals) {
                let farthest = group.iter().fold(f64::NEG_INFINITY, |most, s| most.max(s.farthest));
                prop_assert!(before < group[0].nearest);
                // Halves of integers tell all gaps.
                let mut depth = group[0].nearest;
                while depth <= farthest {
                    prop_assert!(is_filled(depth));
                    depth += 0.5;
                }
                before = farthest;
            }
        }
    }
}
