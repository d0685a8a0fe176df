//! Memory that pieces of work borrow.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

/// Memory for as many pieces of work as run at the same time, or wait to be merged. It is kept from step to step, so a
/// step like the last one allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct Workbench<M>(Mutex<Vec<(ThreadId, M)>>);

impl<M: Default> Workbench<M> {
    /// Does a piece of work with memory of its own, which holds what some earlier piece left.
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut M) -> R) -> R {
        let mut memory = self.take();
        let result = work(&mut memory);
        self.put_back(memory);
        result
    }

    /// Takes memory out, which holds what some earlier piece left, for longer than a piece of work. Of several it takes
    /// what this thread put back last, for that may still lie in the cache of its core; else what was put back first.
    pub(crate) fn take(&self) -> M {
        let thread = thread::current().id();
        let mut kept = self.lock();
        let own = kept.iter().rposition(|(last, _)| *last == thread);
        if kept.is_empty() { M::default() } else { kept.remove(own.unwrap_or(0)).1 }
    }

    /// Keeps memory for later.
    pub(crate) fn put_back(&self, memory: M) {
        self.lock().push((thread::current().id(), memory));
    }

    /// The sum of `size` over all memory that is kept.
    pub(crate) fn total(&self, size: impl Fn(&M) -> usize) -> usize {
        self.lock().iter().map(|(_, memory)| size(memory)).sum()
    }
}

impl<M> Workbench<M> {
    fn lock(&self) -> MutexGuard<'_, Vec<(ThreadId, M)>> {
        // A piece that panics has taken its memory out, so all that is left can be used.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<E> Workbench<Vec<E>> {
    /// The bytes of the entries of all lists that are kept.
    pub(crate) fn bytes(&self) -> usize {
        self.lock().iter().map(|(_, list)| size_of_val(&list[..])).sum()
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
    fn a_thread_takes_what_it_put_back_last() {
        let bench = Workbench::<u32>::default();
        let on_another = |work: &(dyn Fn() + Sync)| {
            thread::scope(|scope| {
                scope.spawn(work).join().unwrap();
            })
        };
        bench.put_back(1);
        bench.put_back(2);
        on_another(&|| {
            bench.put_back(3);
            bench.put_back(4);
            assert_eq!([bench.take(), bench.take()], [4, 3]);
            // Of others what was put back first.
            assert_eq!(bench.take(), 1);
            bench.put_back(5);
        });
        assert_eq!([bench.take(), bench.take(), bench.take()], [2, 5, 0]);
    }

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
