//! Which pixels of a band have to be resolved: one bit each.

use std::ops::Range;

/// Bits of a word.
const BITS: usize = u64::BITS as usize;

/// Pixels of a row that are looked at together.
pub(super) const BLOCK: usize = 8;

/// The marked pixels of some rows.
#[derive(Debug, Default)]
pub(super) struct PixelMask {
    words: Vec<u64>,
    words_per_row: usize,
    /// How many pixels are marked in the words before each word, once they are counted.
    before: Vec<u32>,
    /// Per word of a row: what is marked in some row, once they are counted.
    some_row: Vec<u64>,
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
        for word in first / BITS..last / BITS + 1 {
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

    /// Whether a pixel of `rows` is marked among `columns`. The pixels have been counted.
    #[inline(always)]
    pub(super) fn has_some(&self, rows: Range<usize>, columns: Range<usize>) -> bool {
        if columns.is_empty() {
            return false;
        }
        let (first, last) = (columns.start, columns.end - 1);
        (first / BITS..last / BITS + 1).any(|word| {
            let within = within(word, first, last);
            let mut all = rows.clone().map(|row| self.words[row * self.words_per_row + word]);
            self.some_row[word] & within != 0 && all.any(|bits| bits & within != 0)
        })
    }

    /// Marks, in the place of pixels, the blocks of [`BLOCK`] pixels of a row that are wholly marked in
    /// `pixels`.
    pub(super) fn mark_whole_blocks(&mut self, pixels: &Self) {
        for (index, &bits) in pixels.words.iter().enumerate().filter(|(_, bits)| **bits != 0) {
            let (row, word) = (index / pixels.words_per_row, index % pixels.words_per_row);
            // The first bit of each block becomes whether all its bits are set.
            let mut whole = bits;
            for shift in [1, 2, 4] {
                whole &= whole >> shift;
            }
            for block in (0..BITS / BLOCK).filter(|block| whole >> (block * BLOCK) & 1 == 1) {
                let block = word * (BITS / BLOCK) + block;
                self.mark(row, block..block + 1);
            }
        }
    }

    /// The stripes of the image in which a pixel is marked, a bit each. There are up to 64, of `1 << shift` columns each. A
    /// mark stands for `block` pixels of a row. The pixels have been counted.
    pub(super) fn stripes(&self, block: usize, shift: u32) -> u64 {
        let mut stripes = 0;
        for (word, &bits) in self.some_row.iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                let first = (word * BITS + bits.trailing_zeros() as usize) * block;
                stripes |= stripes_of(first..first + block, shift);
                bits &= bits - 1;
            }
        }
        stripes
    }

    /// Counts the marked pixels.
    pub(super) fn count(&mut self) -> usize {
        self.some_row.clear();
        self.some_row.resize(self.words_per_row, 0);
        for row in self.words.chunks_exact(self.words_per_row.max(1)) {
            self.some_row.iter_mut().zip(row).for_each(|(some, bits)| *some |= bits);
        }
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

    /// Calls `visit` with each run of pixels of a row of `width` pixels that are not marked.
    pub(super) fn for_each_gap(
        &self,
        row: usize,
        width: usize,
        mut visit: impl FnMut(Range<usize>),
    ) {
        let words = &self.words[row * self.words_per_row..][..self.words_per_row];
        // The first column from `from` on that is marked, or that is not where all bits are turned.
        let next = |from: usize, turned: u64| {
            let mut within = u64::MAX << (from % BITS);
            for (word, bits) in words.iter().enumerate().skip(from / BITS) {
                let bits = (bits ^ turned) & within;
                if bits != 0 {
                    return word * BITS + bits.trailing_zeros() as usize;
                }
                within = u64::MAX;
            }
            width
        };
        let mut start = next(0, u64::MAX);
        while start < width {
            let end = next(start, 0);
            visit(start..end);
            start = next(end, u64::MAX);
        }
    }

    /// Calls `visit` with a row and its marked pixels, for each of `rows` with marked pixels among
    /// `columns`; where those belong to several words, more than once. The pixels have been counted.
    #[inline(always)]
    pub(super) fn for_each_row_in(
        &self,
        rows: Range<usize>,
        columns: Range<usize>,
        mut visit: impl FnMut(usize, Marked),
    ) {
        if columns.is_empty() {
            return;
        }
        let (first, last) = (columns.start, columns.end - 1);
        for word in first / BITS..last / BITS + 1 {
            let within = within(word, first, last);
            for row in rows.clone() {
                let index = row * self.words_per_row + word;
                let all = self.words[index];
                if all & within != 0 {
                    let (first_column, before) = (word * BITS, self.before[index]);
                    visit(row, Marked { first_column, bits: all & within, all, before });
                }
            }
        }
    }
}

/// Some marked pixels of a row.
pub(super) struct Marked {
    /// The column of the first bit.
    first_column: usize,
    bits: u64,
    /// All marked pixels of the word, and how many there are before it.
    all: u64,
    before: u32,
}

impl Marked {
    /// Calls `visit` with the column of each pixel.
    #[inline(always)]
    pub(super) fn for_each(&self, mut visit: impl FnMut(usize)) {
        let mut bits = self.bits;
        // `bits & (bits - 1)` clears the lowest bit that is set.
        while bits != 0 {
            visit(self.first_column + bits.trailing_zeros() as usize);
            bits &= bits - 1;
        }
    }

    /// How many marked pixels come before that of a column.
    #[inline(always)]
    pub(super) fn rank(&self, column: usize) -> usize {
        let before = self.all & ((1 << (column - self.first_column)) - 1);
        (self.before + before.count_ones()) as usize
    }
}

/// How many columns a stripe of an image has, as a power of two, so that there are at most 64.
pub(super) fn stripe_shift(width: usize) -> u32 {
    width.div_ceil(BITS).next_power_of_two().trailing_zeros()
}

/// The stripes of `1 << shift` columns in which some of `columns` lie, of which there is one at least: a bit for each.
#[inline(always)]
pub(super) fn stripes_of(columns: Range<usize>, shift: u32) -> u64 {
    within(0, columns.start >> shift, (columns.end - 1) >> shift)
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
            marks.for_each_row_in(0..rows, columns.clone(), |row, marked| {
                marked.for_each(|column| {
                    assert_eq!(expected[marked.rank(column)], (row, column));
                    found.push((row, column));
                });
            });
            found.sort_unstable();
            assert_eq!(marks.has_some(0..rows, columns.clone()), !found.is_empty());
            let within = expected.iter().copied().filter(|(_, column)| columns.contains(column));
            assert!(found.into_iter().eq(within));
        }
        for (block, shift) in [1, 2, 8]
            .into_iter()
            .flat_map(|block| [0, 3, 6].map(|s| (block, s + stripe_shift(block * width))))
        {
            let is_marked = |stripe: usize| {
                let columns = expected.iter().flat_map(|&(_, c)| c * block..(c + 1) * block);
                columns.clone().any(|column| column >> shift == stripe)
            };
            let all = (0..64).filter(|&stripe| is_marked(stripe)).map(|stripe| 1 << stripe).sum();
            assert_eq!(marks.stripes(block, shift), all);
        }
        let gaps = |marks: &PixelMask, row| {
            let mut gaps = Vec::new();
            marks.for_each_gap(row, width, |gap| gaps.push([gap.start, gap.end]));
            gaps
        };
        assert_eq!(gaps(&marks, 0), [[0, 3], [5, 60], [70, 200]]);
        assert!(gaps(&marks, 1).is_empty());
        assert_eq!(gaps(&marks, 2), [[0, 63], [65, 199]]);
        let mut blocks = PixelMask::default();
        blocks.clear(rows, width / BLOCK);
        blocks.mark_whole_blocks(&marks);
        assert_eq!(blocks.count(), width / BLOCK);
        // A block of 8 columns lies in two stripes of 4.
        assert_eq!(blocks.stripes(BLOCK, stripe_shift(width)), u64::MAX >> (64 - width / 4));
        assert!(blocks.has_some(1..2, 0..1) && !blocks.has_some(0..1, 0..width / BLOCK));
        marks.unmark(1, 3..130);
        assert_eq!(gaps(&marks, 1), [[3, 130]]);
        blocks.clear(rows, width / BLOCK);
        blocks.mark_whole_blocks(&marks);
        assert_eq!(gaps(&blocks, 1)[0], [0, 17]);
        for width in [1, 2, 63, 64, 65, 128, 129, 1000, 1024, 1025, 5000_usize] {
            let last = (width - 1) >> stripe_shift(width);
            assert!(last < 64 && (width <= 64 || last >= 32));
        }
        assert_eq!(stripes_of(5..6, 0) | stripes_of(60..130, 1), 1 << 5 | u64::MAX << 30);
        marks.clear(1, 10);
        assert_eq!(marks.count(), 0);
    }
}
