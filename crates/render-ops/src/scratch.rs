//! Memory that pieces of work borrow.

use std::sync::{Mutex, PoisonError};

/// Memory for as many pieces of work as run at the same time, or wait to be merged. It is kept from step to step, so a
/// step like the last one allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct Workbench<M>(Mutex<Vec<M>>);

impl<M: Default> Workbench<M> {
    /// Does a piece of work with memory of its own, which holds what some earlier piece left.
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut M) -> R) -> R {
        let mut memory = self.take();
        let result = work(&mut memory);
        self.put_back(memory);
        result
    }

    /// Takes memory out, which holds what some earlier piece left, for longer than a piece of work.
    pub(crate) fn take(&self) -> M {
        self.lock().pop().unwrap_or_default()
    }

    /// Keeps memory for later.
    pub(crate) fn put_back(&self, memory: M) {
        self.lock().push(memory);
    }

    /// The sum of `size` over all memory that is kept.
    pub(crate) fn total(&self, size: impl Fn(&M) -> usize) -> usize {
        self.lock().iter().map(size).sum()
    }
}

impl<M> Workbench<M> {
    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<M>> {
        // A piece that panics has taken its memory out, so all that is left can be used.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<E> Workbench<Vec<E>> {
    /// The bytes of the entries of all lists that are kept.
    pub(crate) fn bytes(&self) -> usize {
        self.lock().iter().map(|list| size_of_val(&list[..])).sum()
    }
}

/// Gives a list `length` entries, whatever they are.
pub(crate) fn resize<I: Clone>(list: &mut Vec<I>, length: usize, filling: impl FnOnce() -> I) {
    if list.len() != length {
        list.resize(length, filling());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_those_of_all_lists_that_are_kept() {
        let bench = Workbench::<Vec<f32>>::default();
        assert_eq!(bench.bytes(), 0);
        bench.with(|first| {
            first.resize(3, 1.0);
            bench.with(|second| second.resize(5, 1.0));
            assert_eq!(bench.bytes(), 20);
        });
        assert_eq!(bench.bytes(), 32);
    }
}
