//! What lies on the picture's rungs, a band of rows at a time.
//!
//! A band holds a strip for each rung that something in it lies on: colours times alpha, and alpha, of all
//! columns, at the size that the rung is blurred at. So memory follows the pairs of a band and a rung that are
//! used. What a strip holds lies between a first and a last column, and costs outside of it nothing but memory.

use std::ops::Range;

use bokashi_core::Scalar;

use super::rungs::MOST_HALVINGS;
use crate::size::Size;

/// Rows in a band: few, so that a slope's rungs each take the rows that they need; and as many as can be halved.
pub(super) const ROWS: usize = 1 << MOST_HALVINGS;

/// A part of a rung.
#[derive(Debug, Clone)]
pub(super) struct Strip<T: Scalar> {
    pub(super) rung: usize,
    /// Rows and columns at the rung's size.
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
    /// The columns between which it is not 0 everywhere.
    pub(super) held: Range<usize>,
    /// For each channel of colours its numbers, row by row.
    pub(super) values: Vec<T>,
    /// The alphas, which are wide: what is seen of what lies behind is what they leave.
    pub(super) alphas: Vec<T::Wide>,
}

impl<T: Scalar> Default for Strip<T> {
    fn default() -> Self {
        let [rows, columns, held] = [0..0, 0..0, 0..0];
        Self { rung: 0, rows, columns, held, values: Vec::new(), alphas: Vec::new() }
    }
}

impl<T: Scalar> Strip<T> {
    /// Makes it a strip of so many channels of colours; its numbers are whatever they were.
    pub(super) fn reset(
        &mut self,
        rung: usize,
        channels: usize,
        [rows, columns]: [Range<usize>; 2],
    ) {
        self.rung = rung;
        self.held = columns.clone();
        (self.rows, self.columns) = (rows, columns);
        self.values.resize(channels * self.plane(), T::ZERO);
        self.alphas.resize(self.plane(), T::Wide::ZERO);
    }

    /// How many numbers a channel has.
    #[inline(always)]
    pub(super) fn plane(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// Where in a channel a pixel stands.
    #[inline(always)]
    pub(super) fn offset(&self, row: usize, column: usize) -> usize {
        (row - self.rows.start) * self.columns.len() + (column - self.columns.start)
    }

    /// Where in a channel the pixel of a row and a column stands, where the strip holds it.
    #[inline(always)]
    pub(super) fn held_offset(&self, row: usize, column: usize) -> Option<usize> {
        self.held.contains(&column).then(|| self.offset(row, column))
    }

    /// Holds a column from now on.
    #[inline(always)]
    pub(super) fn hold(&mut self, column: usize) {
        if self.held.is_empty() {
            self.held = column..column + 1;
        } else {
            self.held.start = self.held.start.min(column);
            self.held.end = self.held.end.max(column + 1);
        }
    }

    /// Some columns of a row of a channel.
    #[inline(always)]
    pub(super) fn row(&self, channel: usize, row: usize, columns: Range<usize>) -> &[T] {
        let start = channel * self.plane() + self.offset(row, columns.start);
        &self.values[start..start + columns.len()]
    }

    /// The alphas of some columns of a row.
    #[inline(always)]
    pub(super) fn alpha_row(&self, row: usize, columns: Range<usize>) -> &[T::Wide] {
        let start = self.offset(row, columns.start);
        &self.alphas[start..start + columns.len()]
    }
}

/// The strips of a band, in the order of their rungs.
#[derive(Debug, Clone)]
pub(super) struct Strips<T: Scalar> {
    /// Those in use, and memory of others.
    strips: Vec<Strip<T>>,
    used: usize,
}

impl<T: Scalar> Default for Strips<T> {
    fn default() -> Self {
        Self { strips: Vec::new(), used: 0 }
    }
}

impl<T: Scalar> Strips<T> {
    pub(super) fn clear(&mut self) {
        self.used = 0;
    }

    pub(super) fn as_slice(&self) -> &[Strip<T>] {
        &self.strips[..self.used]
    }

    pub(super) fn as_mut_slice(&mut self) -> &mut [Strip<T>] {
        &mut self.strips[..self.used]
    }

    /// The strip of a rung, if there is one.
    pub(super) fn get(&self, rung: usize) -> Option<&Strip<T>> {
        let strips = self.as_slice();
        strips.binary_search_by_key(&rung, |strip| strip.rung).ok().map(|index| &strips[index])
    }

    /// A strip after all that there are, with whatever it held.
    pub(super) fn push(&mut self) -> &mut Strip<T> {
        if self.used == self.strips.len() {
            self.strips.push(Strip::default());
        }
        self.used += 1;
        &mut self.strips[self.used - 1]
    }

    /// The bytes that it holds, for reports.
    pub(super) fn bytes(&self) -> usize {
        let bytes =
            |strip: &Strip<T>| size_of_val(&strip.values[..]) + size_of_val(&strip.alphas[..]);
        self.as_slice().iter().map(bytes).sum()
    }
}

/// The strips of neighbouring bands, the first of which starts at row `first` of the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bands<'a, T: Scalar> {
    pub(super) bands: &'a [Strips<T>],
    pub(super) first: usize,
}

impl<'a, T: Scalar> Bands<'a, T> {
    /// The strips of a rung, halved so often, that hold something in some of its rows.
    pub(super) fn strips(
        &self,
        rung: usize,
        halvings: usize,
        rows: Range<usize>,
    ) -> impl Iterator<Item = &'a Strip<T>> + Clone + use<'a, T> {
        let band = |row: usize| (row << halvings).saturating_sub(self.first) / ROWS;
        // Doubling looks at less than two rows beyond a band's own.
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
pub(super) fn halved(size: Size, halvings: usize) -> Size {
    let half = |extent: usize| extent.div_ceil(1 << halvings);
    Size { width: half(size.width), height: half(size.height) }
}
