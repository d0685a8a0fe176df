//! Crowded pixels: cut into four cells, and these again, until a cell holds so few faces that what is
//! visible in it is soon found.
//!
//! In a cell there are fewer faces than in the pixel, and their depths lie in shorter intervals, so they
//! fall into more depth groups: what hides a cell hides all behind it. The time for a cell goes with the
//! square of its faces, so four cells take less time than their pixel. The results are the same to
//! rounding: parts of a face are joined, and the cuts themselves are no sides.
//!
//! # Limits
//! Where all faces meet in a point, no cell around that point has few of them. A cell that is still
//! crowded at the largest depth shows what lies at its centre, and so does what is left once the pixel's
//! work is used up. This *sampled* area is the error's bound: every other place is exact. Nothing moves
//! in it, so the gradient lacks the sides there.
//!
//! Work is shared among cells. The least crowded one of four comes first, and hands on what it
//! has not needed. So the place where most faces meet gets most.

use std::ops::Range;

use bokashi_core::Scalar;

use super::cell::Cell;
use super::depth_intervals::{DepthInterval, depth_groups, sort_by_depth};
use super::polygon::value_at;
use super::visible::{Candidate, Visible, behind};
use crate::raster_options::Limits;

/// Sampled cells are cut this often, so that a pixel has some hundred samples at least.
const DEPTH_OF_SAMPLES: u32 = 4;

/// How much more work than to hold a polygon against a face it is to keep a part.
const WORK_PER_PART: usize = 32;

/// What is known of a crowded pixel.
pub(super) struct Crowd<'a, S> {
    pub(super) limits: Limits,
    pub(super) candidates: &'a [Candidate<S>],
    pub(super) visible: &'a mut Visible<S>,
    /// The faces of the cells under way, by their numbers among the candidates.
    pub(super) faces: &'a mut Vec<DepthInterval<S>>,
    /// The area that was sampled.
    pub(super) sampled: S,
}

impl<S: Scalar> Crowd<'_, S> {
    /// Finds what is visible in a cell, `depth` cuts below its pixel, into which only `faces` may reach;
    /// returns what is left of `work`.
    fn find(&mut self, cell: Cell<S>, depth: u32, faces: Range<usize>, work: usize) -> usize {
        sort_by_depth(&mut self.faces[faces.clone()]);
        let is_found = self.find_at_once(cell, faces.clone(), work);
        let work = work.saturating_sub(self.visible.cuts());
        if is_found {
            return work.saturating_sub(WORK_PER_PART * self.visible.keep());
        }
        self.divide(cell, depth, faces, work)
    }

    /// The same of a cell that is known to be crowded.
    #[inline(never)]
    pub(super) fn divide(
        &mut self,
        cell: Cell<S>,
        depth: u32,
        faces: Range<usize>,
        work: usize,
    ) -> usize {
        let count = faces.len();
        if depth == self.limits.depth || work < count {
            self.sample(cell, depth, faces);
            return work;
        }
        let end = self.faces.len();
        let mut quarters =
            cell.quarters().map(|quarter| (quarter, self.gather(&quarter, faces.clone())));
        // The least crowded first. Each may spend an equal share of what is left, and what it does not spend is
        // for the others.
        quarters.sort_by_key(|(_, faces)| faces.len());
        let mut work = work - count;
        for (left, (quarter, faces)) in (1..=quarters.len()).rev().zip(quarters) {
            let share = work / left;
            work -= share - self.find(quarter, depth + 1, faces, share);
        }
        self.faces.truncate(end);
        work
    }

    /// Gathers those of `faces` that may reach into a cell.
    fn gather(&mut self, cell: &Cell<S>, faces: Range<usize>) -> Range<usize> {
        let first = self.faces.len();
        for index in faces {
            let interval = self.faces[index];
            let candidate = &self.candidates[interval.face as usize];
            // A face that lies outside of the cell beyond one of its edges does not reach into it.
            let [p, q, r] = candidate.edges.map(|edge| cell.range(edge)[1] < S::ZERO);
            if p | q | r {
                continue;
            }
            let [least, most] = cell.range(candidate.depth);
            let [least, most] = [least - candidate.tie_bound, most + candidate.tie_bound];
            // Of what is no number nothing new is known.
            let nearest = if least > interval.nearest { least } else { interval.nearest };
            let farthest = if most < interval.farthest { most } else { interval.farthest };
            // A face that was given another's plane may lie outside of its own interval.
            let interval = if nearest <= farthest {
                DepthInterval { nearest, farthest, ..interval }
            } else {
                interval
            };
            if !interval.is_out() {
                self.faces.push(interval);
            }
        }
        first..self.faces.len()
    }

    /// Finds what is visible in a cell without cutting it; returns whether it did so within the limits.
    fn find_at_once(&mut self, cell: Cell<S>, faces: Range<usize>, work: usize) -> bool {
        let Self { limits, candidates, visible, .. } = self;
        visible.begin(cell, limits.cuts.min(work));
        for group in depth_groups(&self.faces[faces]) {
            let (count, members) = (group.len(), group.iter().map(|interval| interval.face));
            // With less work than that there is no hope.
            let is_crowded = count > limits.faces_of_cell || count * count > 16 * work;
            // Planes that were shared may have parted a face from its neighbours.
            if is_crowded || !visible.add(candidates, members, false) {
                return false;
            }
            if visible.fills_cell() {
                break;
            }
        }
        true
    }

    /// Shows in a cell what lies at its centre, or at those of its parts.
    fn sample(&mut self, cell: Cell<S>, depth: u32, faces: Range<usize>) {
        if depth < DEPTH_OF_SAMPLES {
            for quarter in cell.quarters() {
                self.sample(quarter, depth + 1, faces.clone());
            }
            return;
        }
        let point = cell.center();
        let candidate = |index: u32| &self.candidates[index as usize];
        let faces = self.faces[faces].iter().map(|interval| interval.face);
        let covering = faces.filter(|&index| candidate(index).covers(point));
        let nearest = covering.reduce(|best, other| {
            let lies_behind = value_at(behind(candidate(best), candidate(other)), point) >= S::ZERO;
            if lies_behind { best } else { other }
        });
        if let Some(nearest) = nearest {
            self.visible.keep_sample(nearest, point, cell.area());
        }
        self.sampled += cell.area();
    }
}
