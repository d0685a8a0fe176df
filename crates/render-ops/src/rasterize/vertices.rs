//! What is computed for all vertices before faces are judged, eight of them side by side.

use bokashi_core::Scalar;

use super::corner::{ClipVertices, Corner};
use super::culling::Extents;
use super::filter::{Depths, EIGHT, Eight, Filter, Record};
use crate::homogeneous::Vertex;
use crate::order::smaller;
use crate::size::Size;

/// About so many places among the vertices at which eight of them are measured beforehand.
const PLACES: usize = 16;

/// What is known of some vertices together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measures<S> {
    pub(super) depths: Depths,
    pub(super) extents: Extents<S>,
    /// The smallest and the largest of what they are multiplied by.
    pub(super) factors: [S; 2],
}

impl<S: Scalar<Wide = S>> Default for Measures<S> {
    fn default() -> Self {
        let factors = [S::from_f64(f64::INFINITY), S::ZERO];
        Self { depths: Depths::default(), extents: Extents::default(), factors }
    }
}

impl<S: Scalar<Wide = S>> Measures<S> {
    /// Of a sample of the vertices, which bounds nothing for the others; of up to eight, of all of them.
    #[inline(always)]
    pub(super) fn from_sample<T: Scalar<Wide = S>>(corners: &ClipVertices<'_, T>) -> Self {
        let mut lanes = [Self::default(); EIGHT];
        for first in (0..corners.len()).step_by((corners.len() / PLACES).max(EIGHT)) {
            Self::add_to(&mut lanes, &eight_from(corners, first, corners.len()), corners.size);
        }
        lanes.into_iter().fold(Self::default(), Self::with)
    }

    /// Adds eight vertices, one to each of the lanes.
    #[inline(always)]
    fn add_to(lanes: &mut Eight<Self>, eight: &EightCorners<S>, size: Size) {
        for k in 0..EIGHT {
            lanes[k] = lanes[k].with(Self::from_corner(&eight.corner(k), size));
        }
    }

    #[inline(always)]
    fn from_corner(corner: &Corner<S>, size: Size) -> Self {
        let Vertex { x, y, z, w } = corner.vertex;
        let (depth, is_tame) = (corner.depth(), corner.is_tame(size));
        let depths = Depths {
            least: if is_tame { depth } else { f64::INFINITY },
            largest: if is_tame { depth } else { f64::NEG_INFINITY },
            largest_z: z.abs().to_f64(),
        };
        let extents = Extents([x, y, w].map(S::abs));
        Self { depths, extents, factors: [corner.factor; 2] }
    }

    /// Those of other vertices, too.
    #[inline(always)]
    pub(super) fn with(self, others: Self) -> Self {
        let ([least, most], [other_least, other_most]) = (self.factors, others.factors);
        Self {
            depths: self.depths.with(others.depths),
            extents: self.extents.with(others.extents),
            factors: [
                smaller(least, other_least),
                if most > other_most { most } else { other_most },
            ],
        }
    }
}

/// Writes the records of the vertices from `first` on, and measures them.
#[inline(always)]
pub(super) fn record<T: Scalar>(
    corners: &ClipVertices<'_, T>,
    filter: &Filter,
    first: usize,
    records: &mut [Record],
) -> Measures<T::Wide> {
    let end = first + records.len();
    let mut lanes = [Measures::default(); EIGHT];
    let (blocks, rest) = records.as_chunks_mut::<EIGHT>();
    for (first, records) in (first..).step_by(EIGHT).zip(blocks) {
        *records = record_eight(&eight_from(corners, first, end), filter, corners.size, &mut lanes);
    }
    if !rest.is_empty() {
        let eight = eight_from(corners, end - rest.len(), end);
        let records = record_eight(&eight, filter, corners.size, &mut lanes);
        rest.copy_from_slice(&records[..rest.len()]);
    }
    lanes.into_iter().fold(Measures::default(), Measures::with)
}

/// The records of eight vertices, which are measured in lanes.
#[inline(always)]
fn record_eight<S: Scalar<Wide = S>>(
    eight: &EightCorners<S>,
    filter: &Filter,
    size: Size,
    lanes: &mut Eight<Measures<S>>,
) -> Eight<Record> {
    Measures::add_to(lanes, eight, size);
    std::array::from_fn(|k| filter.record(&eight.corner(k), size))
}

/// Eight vertices, number by number.
struct EightCorners<S> {
    x: Eight<S>,
    y: Eight<S>,
    z: Eight<S>,
    w: Eight<S>,
    factors: Eight<S>,
}

impl<S: Scalar> EightCorners<S> {
    #[inline(always)]
    fn corner(&self, k: usize) -> Corner<S> {
        let Self { x, y, z, w, factors } = self;
        let vertex = Vertex { x: x[k], y: y[k], z: z[k], w: w[k] };
        Corner { vertex, factor: factors[k] }
    }
}

/// The vertices from `first` on. Where there are fewer than eight before `end`, the last one takes part several times.
#[inline(always)]
fn eight_from<T: Scalar>(
    corners: &ClipVertices<'_, T>,
    first: usize,
    end: usize,
) -> EightCorners<T::Wide> {
    let zero = [T::Wide::ZERO; EIGHT];
    let mut eight = EightCorners { x: zero, y: zero, z: zero, w: zero, factors: zero };
    for k in 0..EIGHT {
        let Corner { vertex: Vertex { x, y, z, w }, factor } =
            corners.corner((first + k).min(end - 1) as u32);
        (eight.x[k], eight.y[k], eight.z[k], eight.w[k]) = (x, y, z, w);
        eight.factors[k] = factor;
    }
    eight
}
