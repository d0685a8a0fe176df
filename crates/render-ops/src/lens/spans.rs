//! Pixels side by side that show one surface, and nothing beside it: most of all. They are worked on together.
//!
//! `bands` has the formulas, and those of pixels that show more.

use std::ops::Range;

use bokashi_core::Scalar;

use super::surfaces::{Span, View};
use crate::defocus::{Strip, mean_weight};
use crate::size::Size;

/// How the circles of a part of a span lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Between {
    /// The rung before them.
    pub(super) rung: usize,
    /// Whether the next rung has a share, or the derivative of one: in focus it has none.
    pub(super) has_next: bool,
    pub(super) is_capped: bool,
}

impl Span {
    /// Some columns of it.
    fn part(&self, columns: Range<usize>) -> Self {
        Self { row: self.row, surface: self.surface_at(columns.start), columns }
    }

    /// Calls `visit` with those parts of it whose circles lie alike among the rungs.
    #[inline(always)]
    pub(super) fn for_each_part<T: Scalar>(
        &self,
        view: &View<'_, T>,
        mut visit: impl FnMut(&Self, Between),
    ) {
        let count = self.columns.len();
        let (_, radii) = view.alphas_and_radii(self.surface, count);
        let radius = |k: usize| radii.get(k).map_or(view.sky.radius, |radius| radius.widen());
        let kinds = |radius: T::Wide| (radius != T::Wide::ZERO, view.optics.is_capped(radius));
        let mut first = 0;
        while first < count {
            let own = radius(first);
            let rung = view.rungs.locate(own).rung;
            let ends = [rung, rung + 1].map(|rung| T::Wide::from_f64(view.rungs.radius(rung)));
            let is_between = |radius: T::Wide| ends[0] <= radius && radius < ends[1];
            let is_same = |radius| is_between(radius) && kinds(radius) == kinds(own);
            let others = radii.get(first + 1..).unwrap_or_default().iter();
            let more = others.take_while(|radius| is_same(radius.widen())).count();
            let end = if radii.is_empty() { count } else { first + 1 + more };
            let columns = self.columns.start + first..self.columns.start + end;
            let (has_next, is_capped) = kinds(own);
            visit(&self.part(columns), Between { rung, has_next, is_capped });
            first = end;
        }
    }
}

/// Numbers of a part of a span, side by side.
#[derive(Debug, Default)]
pub(super) struct Lines<S> {
    /// What rungs hold of each pixel, a line for each channel; the last one are the alphas.
    pub(super) values: Vec<S>,
    /// t, and its derivative by the radius.
    pub(super) next: Vec<S>,
    pub(super) slopes: Vec<S>,
    /// Shares of a rung.
    weights: Vec<S>,
    /// E at both rungs, as `values` lie; and, of all channels, the gradient of t, and that of the reference.
    pub(super) bars: [Vec<S>; 2],
    pub(super) next_bars: Vec<S>,
    pub(super) reference_bars: Vec<S>,
}

impl<S: Scalar> Lines<S> {
    /// Reads a part whose circles lie behind `rung`.
    #[inline(always)]
    pub(super) fn read<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        span: &Span,
        rung: usize,
    ) {
        let (count, channels) = (span.columns.len(), view.channels);
        let Self { values, next, slopes, .. } = self;
        for list in [&mut *next, &mut *slopes] {
            list.resize(count, S::ZERO);
        }
        values.resize(count * (channels + 1), S::ZERO);
        let first = span.row * view.visible.size().width + span.columns.start;
        let colors = view.colors(span.surface, first, count);
        let step = if colors.len() == channels { 0 } else { channels };
        let (alphas, radii) = view.alphas_and_radii(span.surface, count);
        let alpha = |k: usize| if alphas.is_empty() { S::ONE } else { alphas[k].widen() };
        for (channel, line) in values.chunks_exact_mut(count).enumerate() {
            for k in 0..count {
                line[k] = match view.reference.get(channel) {
                    Some(reference) => {
                        let color = colors[k * step + channel];
                        color.widen() - alpha(k) * reference.widen()
                    }
                    None => alpha(k),
                };
            }
        }
        for k in 0..count {
            let radius = if radii.is_empty() { view.sky.radius } else { radii[k].widen() };
            let position = view.rungs.position(rung, radius);
            (next[k], slopes[k]) = (position.next, position.slope);
        }
    }

    /// Adds the part's share of the first of its rungs, or of the next one.
    #[inline(always)]
    pub(super) fn add_to(
        &mut self,
        size: Size,
        halvings: usize,
        span: &Span,
        is_next: bool,
        strip: &mut Strip<S>,
    ) {
        let count = span.columns.len();
        let Self { values, next, weights, .. } = self;
        weights.clear();
        weights.extend(next.iter().map(|&next| if is_next { next } else { S::ONE - next }));
        let ends = [span.columns.start >> halvings, (span.columns.end - 1) >> halvings];
        ends.into_iter().for_each(|column| strip.hold(column));
        let (start, plane) = (strip.offset(span.row >> halvings, ends[0]), strip.plane());
        if halvings > 0 {
            for (weight, column) in weights.iter_mut().zip(span.columns.clone()) {
                *weight *= S::from_f64(mean_weight(size, halvings, [span.row, column]));
            }
        }
        for (line, plane) in values.chunks_exact(count).zip(strip.values.chunks_exact_mut(plane)) {
            let to = &mut plane[start..start + ends[1] - ends[0] + 1];
            if halvings == 0 {
                for k in 0..count {
                    to[k] += weights[k] * line[k];
                }
            } else {
                for (k, column) in span.columns.clone().enumerate() {
                    to[(column >> halvings) - ends[0]] += weights[k] * line[k];
                }
            }
        }
    }

    /// Reads E at the first of a part's rungs, or at the next one: 0 without a strip.
    #[inline(always)]
    pub(super) fn read_bars(
        &mut self,
        size: Size,
        halvings: usize,
        span: &Span,
        is_next: bool,
        strip: Option<&Strip<S>>,
    ) {
        let count = span.columns.len();
        let bars = &mut self.bars[usize::from(is_next)];
        bars.clear();
        bars.resize(self.values.len(), S::ZERO);
        let Some(strip) = strip else { return };
        let start = strip.offset(span.row >> halvings, span.columns.start >> halvings);
        let end = (span.columns.end - 1) >> halvings;
        let length = end + 1 - (span.columns.start >> halvings);
        for (line, plane) in
            bars.chunks_exact_mut(count).zip(strip.values.chunks_exact(strip.plane()))
        {
            let from = &plane[start..start + length];
            if halvings == 0 {
                line.copy_from_slice(from);
                continue;
            }
            for (to, column) in line.iter_mut().zip(span.columns.clone()) {
                let mean = mean_weight(size, halvings, [span.row, column]);
                let index = (column >> halvings) - (span.columns.start >> halvings);
                *to = S::from_f64(mean) * from[index];
            }
        }
    }

    /// Makes the mean B of E in the first of `bars`, its dot product with the reference, and the gradient of t.
    #[inline(always)]
    pub(super) fn mix<T: Scalar<Wide = S>>(&mut self, reference: &[T]) {
        let Self { values, next, bars: [own, other], next_bars, reference_bars, .. } = self;
        let count = next.len();
        for list in [&mut *next_bars, &mut *reference_bars] {
            list.clear();
            list.resize(count, S::ZERO);
        }
        let lines = own.chunks_exact_mut(count).zip(other.chunks_exact(count));
        for (channel, ((own, other), values)) in lines.zip(values.chunks_exact(count)).enumerate() {
            for k in 0..count {
                let step = other[k] - own[k];
                own[k] += next[k] * step;
                next_bars[k] += step * values[k];
            }
            if let Some(reference) = reference.get(channel) {
                let reference = reference.widen();
                for k in 0..count {
                    reference_bars[k] += own[k] * reference;
                }
            }
        }
    }
}
