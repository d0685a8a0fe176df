//! Which places of a list hold an index, for every index: a list of rows, inverted.

use std::sync::{Arc, Weak};

use crate::error::TensorError;
use crate::listed_rows::Lists;

/// The places of each index in a list, in order. They stay as long as the list is the same one.
#[derive(Debug, Default)]
pub(crate) struct Grouping {
    /// The list that was grouped. It is let go, but while its memory is known here no other list has the
    /// same address, and nobody can write to it in place.
    list: Option<Weak<[u32]>>,
    /// Where the places of each index start, and last where those of the last one end.
    starts: Vec<usize>,
    places: Vec<u32>,
}

impl Grouping {
    /// The places of each index below `count` in `list`, a list that was checked ([`check`]).
    pub(crate) fn lists(&mut self, list: &Arc<[u32]>, count: usize) -> Lists<'_> {
        let is_same = |other: &Weak<[u32]>| std::ptr::eq(other.as_ptr(), Arc::as_ptr(list));
        if !(self.list.as_ref().is_some_and(is_same) && self.starts.len() == count + 1) {
            // Whatever ends this before it is done leaves no list behind.
            self.list = None;
            self.group(list, count);
            self.list = Some(Arc::downgrade(list));
        }
        Lists { starts: &self.starts, rows: &self.places }
    }

    /// Counts each index, then puts each place where its index has the next one free.
    fn group(&mut self, list: &[u32], count: usize) {
        let Self { starts, places, .. } = self;
        starts.clear();
        starts.resize(count + 1, 0);
        list.iter().for_each(|&index| starts[index as usize] += 1);
        let mut end = 0;
        for start in starts.iter_mut() {
            end += *start;
            *start = end;
        }
        // From the last place on, so that each start ends where it belongs.
        places.clear();
        places.resize(list.len(), 0);
        for (position, &index) in list.iter().enumerate().rev() {
            let start = &mut starts[index as usize];
            *start -= 1;
            places[*start] = position as u32;
        }
    }

    /// The bytes that are kept.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.places[..])
    }
}

/// Whether the indices of `list` can be grouped.
///
/// # Errors
/// [`TensorError::Index`] unless each is below `count`; [`TensorError::Value`] for so long a list that its
/// places do not fit 32 bits.
pub(crate) fn check(
    list: &[u32],
    count: usize,
    operation: &'static str,
) -> Result<(), TensorError> {
    if let Some(&index) = list.iter().find(|&&index| index as usize >= count) {
        return Err(TensorError::Index { operation, index: index as usize, extent: count });
    }
    if u32::try_from(list.len()).is_err() {
        let (rule, value) = ("fewer than 2^32 rows".into(), list.len() as f64);
        return Err(TensorError::Value { operation, rule, value });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_each_index_are_in_order() {
        let list: Arc<[u32]> = Arc::from([2, 0, 2, 5, 0, 2]);
        let mut grouping = Grouping::default();
        let lists = grouping.lists(&list, 7);
        assert_eq!(lists.starts, [0, 2, 2, 5, 5, 5, 6, 6]);
        assert_eq!(lists.rows, [1, 4, 0, 2, 5, 3]);
        let lists = grouping.lists(&Arc::from([]), 0);
        assert_eq!((lists.starts, lists.rows), (&[0][..], &[][..]));
    }

    #[test]
    fn a_list_is_grouped_once_and_another_one_anew() {
        let list: Arc<[u32]> = Arc::from([1, 0]);
        let mut grouping = Grouping::default();
        let _ = grouping.lists(&list, 2);
        grouping.places[0] = 77;
        assert_eq!(grouping.lists(&list, 2).rows, [77, 0]);
        assert_eq!(grouping.lists(&list, 3).rows, [1, 0]);
        // One that may lie where the first one was.
        drop(list);
        let other: Arc<[u32]> = Arc::from([0, 1]);
        assert_eq!(grouping.lists(&other, 3).rows, [0, 1]);
        assert_eq!(Arc::strong_count(&other), 1);
    }
}
