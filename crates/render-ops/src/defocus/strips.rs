//! What lies on rungs, a band of rows at a time.
//!
//! A band holds a strip for each rung that something in it lies on: its channels, such as colours and alpha, of all
//! columns, at the size that the rung is blurred at. So memory follows the pairs of a band and a rung that are used.
//! Blurred rungs, and gradients, are strips of some columns. What a strip holds lies between a first and a last
//! column, and costs outside of it nothing but memory.

use std::ops::Range;

use bokashi_core::Scalar;

use super::rungs::MOST_HALVINGS;
use crate::size::Size;

/// Rows in a band: few, so that a slope's rungs each take the rows that they need; and as many as can be halved.
pub(crate) const ROWS: usize = 1 << MOST_HALVINGS;

/// Columns that are held together.
const HELD_COLUMNS: usize = 32;

/// A part of a rung.
#[derive(Debug, Clone, Default)]
pub(crate) struct Strip<S> {
    pub(crate) rung: usize,
    /// Rows and columns at the rung's size.
    pub(crate) rows: Range<usize>,
    pub(crate) columns: Range<usize>,
    /// The columns between which it has numbers: it is 0 elsewhere.
    pub(crate) held: Range<usize>,
    /// For each channel its numbers, row by row; the last channel are the alphas.
    pub(crate) values: Vec<S>,
}

impl<S: Scalar> Strip<S> {
    /// How many numbers a channel has.
    #[inline(always)]
    pub(crate) fn plane(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// Where in a channel a pixel stands.
    #[inline(always)]
    pub(crate) fn offset(&self, row: usize, column: usize) -> usize {
        (row - self.rows.start) * self.columns.len() + (column - self.columns.start)
    }

    /// Where in a channel the pixel of a row and a column stands, where the strip holds it.
    #[inline(always)]
    pub(crate) fn held_offset(&self, row: usize, column: usize) -> Option<usize> {
        self.held.contains(&column).then(|| self.offset(row, column))
    }

    /// Holds a column from now on: some columns at a time, which are 0.
    #[inline(always)]
    pub(crate) fn hold(&mut self, column: usize) {
        if !self.held.contains(&column) {
            self.hold_more(column);
        }
    }

    #[inline(never)]
    fn hold_more(&mut self, column: usize) {
        let Range { start, end } = self.columns;
        let first = column / HELD_COLUMNS * HELD_COLUMNS;
        let mut held = first.max(start)..(first + HELD_COLUMNS).min(end);
        if self.held.is_empty() {
            self.held = held.start..held.start;
        }
        held = held.start.min(self.held.start)..held.end.max(self.held.end);
        let (width, offset) = (end - start, |column: usize| column - start);
        let new = [held.start..self.held.start, self.held.end..held.end];
        for row in self.values.chunks_exact_mut(width) {
            for new in &new {
                row[offset(new.start)..offset(new.end)].fill(S::ZERO);
            }
        }
        self.held = held;
    }

    /// Some columns of a row of a channel.
    #[inline(always)]
    pub(crate) fn row(&self, channel: usize, row: usize, columns: Range<usize>) -> &[S] {
        let start = channel * self.plane() + self.offset(row, columns.start);
        &self.values[start..start + columns.len()]
    }
}

/// The strips of a band, in the order in which they were added.
#[derive(Debug, Clone, Default)]
pub(crate) struct Strips<S> {
    /// Those in use, and memory of others.
    strips: Vec<Strip<S>>,
    used: usize,
    /// Per rung: its strip, counted from 1; 0 where it has none.
    by_rung: Vec<u32>,
}

impl<S: Scalar> Strips<S> {
    pub(crate) fn clear(&mut self) {
        self.used = 0;
        self.by_rung.fill(0);
    }

    pub(crate) fn as_slice(&self) -> &[Strip<S>] {
        &self.strips[..self.used]
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [Strip<S>] {
        &mut self.strips[..self.used]
    }

    /// Which strip a rung has, if any.
    #[inline(always)]
    pub(crate) fn index(&self, rung: usize) -> Option<usize> {
        self.by_rung.get(rung).and_then(|&index| (index as usize).checked_sub(1))
    }

    /// The strip of a rung, if there is one.
    #[inline(always)]
    pub(crate) fn get(&self, rung: usize) -> Option<&Strip<S>> {
        self.index(rung).map(|index| &self.strips[index])
    }

    /// A new strip of a rung that has none, with so many channels: its numbers are whatever they were.
    pub(crate) fn push(
        &mut self,
        rung: usize,
        channels: usize,
        [rows, columns]: [Range<usize>; 2],
    ) -> &mut Strip<S> {
        if self.used == self.strips.len() {
            self.strips.push(Strip::default());
        }
        self.used += 1;
        if self.by_rung.len() <= rung {
            self.by_rung.resize(rung + 1, 0);
        }
        self.by_rung[rung] = self.used as u32;
        let strip = &mut self.strips[self.used - 1];
        strip.rung = rung;
        strip.held = columns.clone();
        (strip.rows, strip.columns) = (rows, columns);
        strip.values.resize(channels * strip.plane(), S::ZERO);
        strip
    }

    /// The bytes that it holds, for reports.
    pub(crate) fn bytes(&self) -> usize {
        self.as_slice().iter().map(|strip| size_of_val(&strip.values[..])).sum()
    }
}

/// The strips of neighbouring bands, the first of which starts at row `first` of the image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bands<'a, S> {
    pub(crate) bands: &'a [Strips<S>],
    pub(crate) first: usize,
}

impl<'a, S: Scalar> Bands<'a, S> {
    /// The strips of a rung, halved so often, that hold something in some of its rows.
    pub(crate) fn strips(
        &self,
        rung: usize,
        halvings: usize,
        rows: Range<usize>,
    ) -> impl Iterator<Item = &'a Strip<S>> + Clone + use<'a, S> {
        let band = |row: usize| (row << halvings).saturating_sub(self.first) / ROWS;
        // Doubling looks at less than two rows beyond a band's own, and what is tilted may lie two beyond it: at most
        // halvings that is two bands.
        let start = band(rows.start).saturating_sub(2).min(self.bands.len());
        let end = (band(rows.end) + 3).clamp(start, self.bands.len());
        let strips = self.bands[start..end].iter().filter_map(move |band| band.get(rung));
        strips.filter(move |strip| {
            let is_near = strip.rows.start < rows.end && rows.start < strip.rows.end;
            is_near && !strip.held.is_empty()
        })
    }
}

/// The size of an image that has been halved so often.
pub(crate) fn halved(size: Size, halvings: usize) -> Size {
    let half = |extent: usize| extent.div_ceil(1 << halvings);
    Size { width: half(size.width), height: half(size.height) }
}

/// The share that a pixel has of a pixel of the image that is halved so often: a mean of those that there are.
#[inline(always)]
pub(crate) fn mean_weight(size: Size, halvings: usize, [row, column]: [usize; 2]) -> f64 {
    let (first_row, first_column) = (row >> halvings << halvings, column >> halvings << halvings);
    let side = 1 << halvings;
    let Size { width, height } = size;
    if first_row + side <= height && first_column + side <= width {
        return MEAN_WEIGHTS[halvings];
    }
    let [rows, columns] = [height - first_row, width - first_column].map(|rest| rest.min(side));
    ((rows * columns) as f64).recip()
}

/// The share of a pixel of an image that is halved so often.
const MEAN_WEIGHTS: [f64; MOST_HALVINGS + 1] =
    [1.0, 1.0 / 4.0, 1.0 / 16.0, 1.0 / 64.0, 1.0 / 256.0];
