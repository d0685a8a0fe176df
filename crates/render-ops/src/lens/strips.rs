//! The picture's rungs, a band of rows at a time.
//!
//! A band holds a strip for each rung that something in it lies on: colours times alpha, and alpha, of all
//! columns. So memory follows the pairs of a band and a rung that are used. What a strip holds lies between a
//! first and a last column, and costs outside of it nothing but memory.

use std::ops::Range;

use bokashi_core::Scalar;

use crate::size::Size;

/// Rows in a band: few, so that a slope's rungs each take the rows that they need.
pub(super) const ROWS: usize = 16;

/// A part of a rung.
#[derive(Debug, Clone, Default)]
pub(super) struct Strip<T> {
    pub(super) rung: usize,
    /// Numbers of a pixel.
    pub(super) entries: usize,
    pub(super) rows: Range<usize>,
    /// The columns that there is memory for.
    pub(super) columns: Range<usize>,
    /// The columns between which it is not 0 everywhere.
    pub(super) held: Range<usize>,
    /// Row by row.
    pub(super) values: Vec<T>,
}

impl<T: Scalar> Strip<T> {
    fn offset(&self, row: usize, column: usize) -> usize {
        let row = (row - self.rows.start) * self.columns.len();
        (row + column - self.columns.start) * self.entries
    }

    /// The numbers of a pixel, where it holds them.
    pub(super) fn pixel(&self, row: usize, column: usize) -> Option<&[T]> {
        let is_held = self.rows.contains(&row) && self.held.contains(&column);
        is_held.then(|| &self.values[self.offset(row, column)..][..self.entries])
    }

    /// The numbers of a pixel of its rows and columns, which it holds from now on.
    pub(super) fn pixel_mut(&mut self, row: usize, column: usize) -> &mut [T] {
        self.held = match self.held.is_empty() {
            true => column..column + 1,
            false => self.held.start.min(column)..self.held.end.max(column + 1),
        };
        let offset = self.offset(row, column);
        &mut self.values[offset..][..self.entries]
    }
}

/// Strips of neighbouring bands, the first of which starts at row `first`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bands<'a, T> {
    pub(super) strips: &'a [Strips<T>],
    pub(super) first: usize,
}

impl<'a, T: Scalar> Bands<'a, T> {
    /// The strip of a rung in the band that has `row`.
    pub(super) fn strip(&self, rung: usize, row: usize) -> Option<&'a Strip<T>> {
        let band = row.checked_sub(self.first)? / ROWS;
        self.strips.get(band)?.get(rung)
    }
}

/// The strips of a band, in the order of their rungs.
#[derive(Debug, Clone, Default)]
pub(super) struct Strips<T> {
    /// Those in use, and memory of others.
    strips: Vec<Strip<T>>,
    used: usize,
}

impl<T: Scalar> Strips<T> {
    pub(super) fn clear(&mut self) {
        self.used = 0;
    }

    pub(super) fn iter(&self) -> std::slice::Iter<'_, Strip<T>> {
        self.strips[..self.used].iter()
    }

    /// The strip of a rung, if there is one.
    pub(super) fn get(&self, rung: usize) -> Option<&Strip<T>> {
        let strips = &self.strips[..self.used];
        strips.binary_search_by_key(&rung, |strip| strip.rung).ok().map(|at| &strips[at])
    }

    /// Strip `at`, in the order of rungs.
    pub(super) fn nth(&self, at: usize) -> &Strip<T> {
        &self.strips[at]
    }

    pub(super) fn nth_mut(&mut self, at: usize) -> &mut Strip<T> {
        &mut self.strips[at]
    }

    /// A strip after all that there are: its numbers are whatever they were.
    pub(super) fn push(&mut self) -> &mut Strip<T> {
        if self.used == self.strips.len() {
            self.strips.push(Strip::default());
        }
        self.used += 1;
        &mut self.strips[self.used - 1]
    }

    /// The strip of a rung, of all columns, in the band that has `row`; a new one holds nothing.
    pub(super) fn strip_mut(
        &mut self,
        rung: usize,
        row: usize,
        entries: usize,
        size: Size,
    ) -> &mut Strip<T> {
        let found = self.strips[..self.used].binary_search_by_key(&rung, |strip| strip.rung);
        let at = found.unwrap_or_else(|at| {
            let first = row / ROWS * ROWS;
            let strip = self.push();
            strip.rung = rung;
            strip.entries = entries;
            strip.rows = first..(first + ROWS).min(size.height);
            strip.columns = 0..size.width;
            strip.held = 0..0;
            strip.values.clear();
            strip.values.resize(strip.rows.len() * size.width * entries, T::ZERO);
            self.strips[at..self.used].rotate_right(1);
            at
        });
        &mut self.strips[at]
    }

    /// The bytes that it holds, for reports.
    pub(super) fn bytes(&self) -> usize {
        self.iter().map(|strip| size_of_val(&strip.values[..])).sum()
    }
}
