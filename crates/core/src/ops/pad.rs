//! Entries before and after an axis: `y_p = x_s(p)`, where position `p` of the padded axis shows source
//! `s(p)`, or a constant; `x_bar_i += sum over s(p) = i of y_bar_p`, in the order of `p`, but under
//! [`Padding::Mirror`] first those that show the axis forwards.

use std::iter::StepBy;
use std::ops::Range;

use crate::axis::blocks;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;

/// What stands before and after an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Padding<T> {
    /// A number, without a gradient.
    Constant(T),
    /// The first entry before the axis, the last one after it.
    Clamp,
    /// The axis, mirrored about its outer edges, again and again: `b a | a b c | c b a`.
    Mirror,
    /// The axis, from its other end, again and again: `b c | a b c | a b`.
    Wrap,
}

/// Positions in the padded axis: two arithmetic progressions.
type Positions = std::iter::Chain<StepBy<Range<usize>>, StepBy<Range<usize>>>;

impl<T> Padding<T> {
    /// The source that position `p` shows, of `extent` ones after `before` others; `None` where it shows
    /// a constant.
    fn source(&self, p: usize, before: usize, extent: usize) -> Option<usize> {
        match self {
            Self::Constant(_) => p.checked_sub(before).filter(|&i| i < extent),
            Self::Clamp => Some(p.saturating_sub(before).min(extent - 1)),
            Self::Wrap => Some(phase(p, before, extent)),
            Self::Mirror => {
                let (forward, turn) = (phase(p, before, extent), turns(p, before, extent));
                Some(if turn % 2 == 0 { forward } else { extent - 1 - forward })
            }
        }
    }

    /// The sources that are shown once, and side by side in the padded axis.
    fn shown_once(&self, beyond: [usize; 2], extent: usize) -> Range<usize> {
        let [before, after] = beyond.map(|count| count.min(extent));
        let [from_start, from_end] = match self {
            Self::Constant(_) => [0, 0],
            Self::Clamp => [before.min(1), after.min(1)],
            Self::Mirror => [before, after],
            Self::Wrap => [after, before],
        };
        from_start..extent - from_end
    }

    /// The positions, of `padded`, that show source `i`.
    fn positions(&self, i: usize, before: usize, extent: usize, padded: usize) -> Positions {
        let none = || (0..0).step_by(1);
        let every = |first: usize, step: usize| (first..padded.max(first)).step_by(step);
        match self {
            Self::Constant(_) => (before + i..before + i + 1).step_by(1).chain(none()),
            Self::Clamp => {
                let first = if i == 0 { 0 } else { before + i };
                let end = if i + 1 == extent { padded } else { before + i + 1 };
                (first..end).step_by(1).chain(none())
            }
            Self::Wrap => every((before + i) % extent, extent).chain(none()),
            Self::Mirror => {
                let period = 2 * extent;
                let backwards = (before + period - 1 - i) % period;
                every((before + i) % period, period).chain(every(backwards, period))
            }
        }
    }
}

/// How far position `p` is from the start of the copy of the axis that it lies in.
fn phase(p: usize, before: usize, extent: usize) -> usize {
    match p.checked_sub(before) {
        Some(after) => after % extent,
        None => extent - 1 - (before - p - 1) % extent,
    }
}

/// How many copies lie between position `p` and the axis itself, and one more.
fn turns(p: usize, before: usize, extent: usize) -> usize {
    match p.checked_sub(before) {
        Some(after) => after / extent,
        None => (before - p - 1) / extent + 1,
    }
}

struct Pad<T> {
    axis: usize,
    /// How many positions stand before the axis, and after it.
    beyond: [usize; 2],
    padding: Padding<T>,
}

impl<T> Pad<T> {
    const NAME: &'static str = "pad";

    /// The padded extent.
    fn padded(&self, shape: &Shape, extent: usize) -> Result<usize, TensorError> {
        let [before, after] = self.beyond;
        let padded = extent.checked_add(before).and_then(|padded| padded.checked_add(after));
        let fits = |&padded: &usize| shape.with(self.axis, padded).checked_size().is_some();
        padded.filter(fits).ok_or_else(|| TensorError::Value {
            operation: Self::NAME,
            rule: "fewer entries than fit an index".into(),
            value: extent as f64 + before as f64 + after as f64,
        })
    }
}

impl<T: Scalar> Op<T> for Pad<T> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let [_, extent, inner] = blocks(shape, self.axis, Self::NAME)?;
        let padded = self.padded(shape, extent)?;
        if padded == extent {
            outputs.pass(0, "nothing is added");
            return Ok(());
        }
        let constant = match self.padding {
            Padding::Constant(number) => number,
            _ if extent == 0 => {
                let rule = "an entry along the axis to repeat".into();
                let (operation, shape) = (Self::NAME, shape.clone());
                return Err(TensorError::Shape { operation, rule, shape });
            }
            _ => T::ZERO,
        };
        let y = outputs.try_push(Self::NAME, shape.with(self.axis, padded))?;
        let [before, _] = self.beyond;
        for_each_run_mut(y, [padded, inner], before..before + extent, |block, p, within, y| {
            match self.padding.source(p, before, extent) {
                None => y.fill(constant),
                Some(i) => {
                    let x = &x[(block * extent + i) * inner + within..][..y.len()];
                    y.copy_from_slice(x);
                }
            }
        });
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let blocks = blocks(kept.input_shape(0), self.axis, Self::NAME);
        let [_, extent, inner] = blocks.expect("the forward pass found the axis");
        let (y_bar, padded) = (kept.only_upstream(), kept.output_shape(0)[self.axis]);
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        let [before, after] = self.beyond;
        let alone = self.padding.shown_once([before, after], extent);
        for_each_run_mut(x_bar, [extent, inner], alone, |block, i, within, x_bar| {
            let mut positions = self.padding.positions(i, before, extent, padded);
            let entry = |p: usize| (block * padded + p) * inner + within;
            let first = positions.next().map_or(0, entry);
            let is_one = positions.clone().next().is_none();
            for (k, x_bar) in x_bar.iter_mut().enumerate() {
                let term = if is_one {
                    y_bar[first + k]
                } else {
                    let others = positions.clone().map(|p| y_bar[entry(p) + k].widen());
                    T::narrow(others.fold(y_bar[first + k].widen(), |sum, term| sum + term))
                };
                *x_bar = if fresh { term } else { *x_bar + term };
            }
        });
    }
}

/// Calls `work(block, row, first, entries)` for runs of entries of an array seen as
/// `[outer, rows, inner]`: from `first` on in a row, and to the end of that row at most, but across all
/// rows within `whole`. Runs may be worked on at the same time.
fn for_each_run_mut<T: Scalar>(
    data: &mut [T],
    [rows, inner]: [usize; 2],
    whole: Range<usize>,
    work: impl Fn(usize, usize, usize, &mut [T]) + Send + Sync,
) {
    for_each_piece_mut(data, ENTRIES_PER_PIECE, |k, mut data| {
        let first = k * ENTRIES_PER_PIECE;
        let (mut block, mut row, mut within) =
            (first / inner / rows, first / inner % rows, first % inner);
        while !data.is_empty() {
            let end = if whole.contains(&row) { whole.end } else { row + 1 };
            let length = ((end - row) * inner - within).min(data.len());
            let (head, rest) = data.split_at_mut(length);
            work(block, row, within, head);
            (row, within, data) = (end, 0, rest);
            if row == rows {
                (block, row) = (block + 1, 0);
            }
        }
    });
}

impl<T: Scalar> Var<'_, T> {
    /// The array with `beyond[0]` entries more before `axis` and `beyond[1]` more after it. There may be
    /// more of them than the axis has.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis; [`TensorError::Shape`] where it has no entry
    /// to repeat; [`TensorError::Value`] for more entries than fit an index.
    pub fn pad(
        self,
        axis: usize,
        beyond: [usize; 2],
        padding: Padding<T>,
    ) -> Result<Self, TensorError> {
        self.tape.apply(Pad { axis, beyond, padding }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_those_that_show_a_source() {
        for padding in [Padding::Constant(9.0), Padding::Clamp, Padding::Mirror, Padding::Wrap] {
            for (before, extent, after) in
                [(0, 1, 0), (7, 1, 5), (0, 2, 9), (5, 3, 4), (13, 4, 2), (2, 9, 1)]
            {
                let padded = before + extent + after;
                for i in 0..extent {
                    let mut found: Vec<_> = padding.positions(i, before, extent, padded).collect();
                    found.sort_unstable();
                    let shows = |p: &usize| padding.source(*p, before, extent) == Some(i);
                    let expected: Vec<_> = (0..padded).filter(shows).collect();
                    assert_eq!(found, expected, "{padding:?} {before} {extent} {after} {i}");
                }
            }
        }
    }
}
