//! Which pixels of a band have to be resolved: one bit each.

use std::ops::Range;

/// Bits of a word.
const BITS: usize = u64::BITS as usize;

/// The marked pixels of some rows.
#[derive(Debug, Default)]
pub(super) struct PixelMask {
    words: Vec<u64>,
    words_per_row: usize,
    /// How many pixels are marked in the words before each word, once they are counted.
    before: Vec<u32>,
}

impl PixelMask {
    /// None, in `rows` rows of `width` pixels.
    pub(super) fn clear(&mut self, rows: usize, width: usize) {
        self.words_per_row = width.div_ceil(BITS);
        self.words.clear();
        self.words.resize(rows * self.words_per_row, 0);
    }

    /// Marks neighbouring pixels of a row.
    #[inline(always)]
    pub(super) fn mark(&mut self, row: usize, columns: Range<usize>) {
        if columns.is_empty() {
            return;
        }
        let (first, last) = (columns.start, columns.end - 1);
        let row = &mut self.words[row * self.words_per_row..][..self.words_per_row];
        for word in first / BITS..=last / BITS {
            row[word] |= within(word, first, last);
        }
    }

    /// Forgets neighbouring pixels of a row.
    pub(super) fn unmark(&mut self, row: usize, columns: Range<usize>) {
        let (first, last) = (columns.start, columns.end - 1);
        let row = &mut self.words[row * self.words_per_row..][..self.words_per_row];
        for word in first / BITS..=last / BITS {
            row[word] &= !within(word, first, last);
        }
    }

    /// Whether all of neighbouring pixels of a row are marked.
    pub(super) fn has_all(&self, row: usize, columns: Range<usize>) -> bool {
        let (first, last) = (columns.start, columns.end - 1);
        let row = &self.words[row * self.words_per_row..][..self.words_per_row];
        (first / BITS..=last / BITS).all(|word| !row[word] & within(word, first, last) == 0)
    }

    /// Counts the marked pixels.
    pub(super) fn count(&mut self) -> usize {
        self.before.clear();
        let mut count = 0;
        self.before.extend(self.words.iter().map(|word| {
            let before = count;
            count += word.count_ones();
            before
        }));
        count as usize
    }

    /// Calls `visit` with the column of each marked pixel of a row.
    pub(super) fn for_each(&self, row: usize, mut visit: impl FnMut(usize)) {
        let words = &self.words[row * self.words_per_row..][..self.words_per_row];
        for (word, &bits) in words.iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                visit(word * BITS + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
        }
    }

    /// Calls `visit` with the column of each marked pixel of a row among `columns`, and with how many
    /// marked pixels come before it; they have been counted.
    #[inline(always)]
    pub(super) fn for_each_in(
        &self,
        row: usize,
        columns: Range<usize>,
        mut visit: impl FnMut(usize, usize),
    ) {
        if columns.is_empty() {
            return;
        }
        let (first, last) = (columns.start, columns.end - 1);
        for word in first / BITS..=last / BITS {
            let at = row * self.words_per_row + word;
            let all = self.words[at];
            let mut bits = all & within(word, first, last);
            while bits != 0 {
                let bit = bits.trailing_zeros();
                let rank = self.before[at] + (all & ((1 << bit) - 1)).count_ones();
                visit(word * BITS + bit as usize, rank as usize);
                bits &= bits - 1;
            }
        }
    }
}

/// The bits of word `word` of a row that are columns from `first` to `last`.
#[inline(always)]
fn within(word: usize, first: usize, last: usize) -> u64 {
    let low = first.saturating_sub(word * BITS);
    let high = (last - word * BITS).min(BITS - 1);
    (u64::MAX << low) & (u64::MAX >> (BITS - 1 - high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marked_pixels_are_found_in_order_and_numbered() {
        let mut marks = PixelMask::default();
        let (rows, width) = (3, 200);
        marks.clear(rows, width);
        let ranges = [(0, 3..5), (0, 60..70), (1, 0..200), (2, 63..64), (2, 64..65), (2, 199..200)];
        for (row, columns) in ranges.clone() {
            marks.mark(row, columns);
        }
        marks.mark(2, 7..7);
        let expected: Vec<_> =
            ranges.into_iter().flat_map(|(row, columns)| columns.map(move |c| (row, c))).collect();
        assert_eq!(marks.count(), expected.len());
        for columns in [0..width, 4..64, 63..65, 199..200, 8..8] {
            let mut found = Vec::new();
            for row in 0..rows {
                marks.for_each_in(row, columns.clone(), |column, rank| {
                    assert_eq!(expected[rank], (row, column));
                    found.push((row, column));
                });
            }
            let within = expected.iter().copied().filter(|(_, column)| columns.contains(column));
            assert!(found.into_iter().eq(within));
        }
        assert!(marks.has_all(1, 0..width) && marks.has_all(0, 60..70));
        assert!(!marks.has_all(0, 59..70) && !marks.has_all(0, 60..71));
        marks.unmark(1, 3..130);
        assert!(marks.has_all(1, 0..3) && marks.has_all(1, 130..width));
        marks.count();
        marks.for_each_in(1, 0..width, |column, _| assert!(!(3..130).contains(&column)));
        marks.clear(1, 10);
        assert_eq!(marks.count(), 0);
    }
}
