//! Sorting by whole numbers, in a time that grows with how many there are, and with how large they are.

/// Indices, sorted by one whole number after another, and memory.
#[derive(Debug, Default)]
pub(super) struct Sorting {
    pub(super) indices: Vec<u32>,
    before: Vec<u32>,
    starts: Vec<u32>,
}

impl Sorting {
    /// Begins anew with the indices of `count` things, in their order.
    pub(super) fn start(&mut self, count: usize) {
        self.indices.clear();
        self.indices.extend(0..count as u32);
    }

    /// Sorts by a number below `end` of each index. Indices of the same number stay in their order.
    pub(super) fn sort_by(&mut self, end: usize, number: impl Fn(usize) -> usize) {
        let Self { indices, before, starts } = self;
        starts.clear();
        starts.resize(end + 1, 0);
        indices.iter().for_each(|&index| starts[number(index as usize) + 1] += 1);
        let mut sum = 0;
        for start in &mut *starts {
            sum += *start;
            *start = sum;
        }
        std::mem::swap(indices, before);
        indices.resize(before.len(), 0);
        for &index in &*before {
            let start = &mut starts[number(index as usize)];
            indices[*start as usize] = index;
            *start += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn two_passes_sort_by_the_last_number_and_then_by_the_first(
            pairs in proptest::collection::vec((0_usize..7, 0_usize..5), 0..40),
            others in 0_usize..40,
        ) {
            let mut sorting = Sorting::default();
            // What an earlier call left is forgotten.
            sorting.start(others);
            sorting.sort_by(3, |index| index % 3);
            sorting.start(pairs.len());
            sorting.sort_by(7, |index| pairs[index].0);
            sorting.sort_by(5, |index| pairs[index].1);
            let mut expected: Vec<_> = (0..pairs.len() as u32).collect();
            expected.sort_by_key(|&index| (pairs[index as usize].1, pairs[index as usize].0));
            prop_assert_eq!(sorting.indices, expected);
        }
    }
}
