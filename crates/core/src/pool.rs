//! Recycled buffers, so that a steady step allocates nothing.
//!
//! # What is kept
//! A buffer comes from the pool and goes back to it; sizes are rounded up to powers of two. A small
//! value keeps its buffer in its place until the next step puts a value of another length there. So a
//! tape holds at most as many small buffers of each size as two steps have in use at their peaks. They
//! are freed with the tape. Buffers that a caller handed in or still holds are not the pool's.
//!
//! # Large buffers
//! A large value gives its buffer back when its step ends, so that whatever comes first can have it. A
//! buffer of twice the size is as good as one of the right size. Of several, the one that last held about
//! as many entries is taken, so that little of it needs to be cleared. Where there is none, a new buffer
//! takes the place of smaller ones that wait, as far as they make up its size. So steps whose sizes
//! change from step to step hold little more than the largest of them. Only a larger buffer makes the
//! pool drop one: steps that are all alike soon find all they need.

use std::sync::Arc;

use crate::entries::Entries;
use crate::scalar::Scalar;
use crate::shape::Shape;

/// The class from which on buffers are large: of 2^18 entries.
const LARGE: usize = 18;

/// Whether a buffer for `length` entries is large.
#[inline]
pub(crate) fn is_large(length: usize) -> bool {
    length >> LARGE != 0
}

/// Buffers that nobody uses, by the power of two that their capacity reaches.
#[derive(Debug)]
pub(crate) struct Pool<T> {
    classes: Vec<Vec<Vec<T>>>,
    /// Empty buffers that can be shared, for those of the tape that somebody asks for.
    shells: Vec<Arc<Vec<T>>>,
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self { classes: Vec::new(), shells: Vec::new() }
    }
}

impl<T: Scalar> Pool<T> {
    /// A buffer of `length` entries. They are whatever an earlier use left (NaN in a build with
    /// debug assertions): the taker writes every one of them.
    #[inline]
    pub(crate) fn take(&mut self, length: usize) -> Vec<T> {
        let class = class_of(length);
        let mut buffer = if class >= LARGE {
            self.take_large(class, length)
        } else {
            let waiting = self.classes.get_mut(class).and_then(Vec::pop);
            waiting.unwrap_or_else(|| Vec::with_capacity(1 << class))
        };
        if buffer.len() != length {
            buffer.resize(length, T::ZERO);
        }
        if cfg!(debug_assertions) {
            buffer.fill(T::from_f64(f64::NAN));
        }
        buffer
    }

    /// Whether there is room for a value of `shape`. Where that is large, a buffer waits for it then.
    pub(crate) fn has_room(&mut self, shape: &[usize]) -> bool {
        let Some(length) = Shape::from(shape).bounded_size() else { return false };
        if !is_large(length) {
            return true;
        }
        let class = class_of(length);
        let waits =
            |class: usize| self.classes.get(class).is_some_and(|buffers| !buffers.is_empty());
        if waits(class) || waits(class + 1) {
            return true;
        }
        self.drop_smaller(class);
        let mut buffer = Vec::new();
        let has_room = buffer.try_reserve_exact(1 << class).is_ok();
        self.give(buffer);
        has_room
    }

    /// A buffer of class `class` for `length` entries, or of the next class.
    #[inline(never)]
    fn take_large(&mut self, class: usize, length: usize) -> Vec<T> {
        if let Some(buffer) =
            self.classes.get_mut(class).and_then(|buffers| take_nearest(buffers, length))
        {
            return buffer;
        }
        if let Some(buffer) = self.classes.get_mut(class + 1).and_then(Vec::pop) {
            return buffer;
        }
        self.drop_smaller(class);
        Vec::with_capacity(1 << class)
    }

    /// Drops smaller buffers that wait, as far as they make up one of class `class`.
    fn drop_smaller(&mut self, class: usize) {
        let mut missing = 1 << class;
        for smaller in (LARGE..class.min(self.classes.len())).rev() {
            // Otherwise buffers of earlier, smaller steps would wait beside the large one.
            while missing >= 1 << smaller && self.classes[smaller].pop().is_some() {
                missing -= 1 << smaller;
            }
        }
    }

    /// Takes a buffer back.
    #[inline]
    pub(crate) fn give(&mut self, buffer: Vec<T>) {
        // The largest class that the capacity fills, so that whoever takes it has room.
        let Some(class) = buffer.capacity().checked_ilog2() else { return };
        let class = class as usize;
        if self.classes.len() <= class {
            self.classes.resize_with(class + 1, Vec::new);
        }
        self.classes[class].push(buffer);
    }

    /// `buffer` in a form that can be shared.
    pub(crate) fn share(&mut self, buffer: Vec<T>) -> Arc<Vec<T>> {
        let Some(mut shell) = self.shells.pop() else { return Arc::new(buffer) };
        *Arc::get_mut(&mut shell).expect("nobody else holds a shell") = buffer;
        shell
    }

    /// Takes a buffer back that was shared, unless somebody else still holds it.
    pub(crate) fn give_shared(&mut self, shared: Entries<T>) {
        let Entries::Own(mut shared) = shared else { return };
        if let Some(buffer) = Arc::get_mut(&mut shared) {
            let buffer = std::mem::take(buffer);
            self.give(buffer);
            self.shells.push(shared);
        }
    }

    /// How many buffers wait to be taken.
    #[cfg(test)]
    pub(crate) fn count(&self) -> usize {
        self.classes.iter().map(Vec::len).sum()
    }
}

/// Takes out the buffer whose length is nearest to `length`: what a buffer lacks is cleared before it
/// is used, and a step like the last one finds a buffer of each length.
fn take_nearest<T>(waiting: &mut Vec<Vec<T>>, length: usize) -> Option<Vec<T>> {
    let places = (0..waiting.len()).rev();
    let nearest = places.min_by_key(|&index| waiting[index].len().abs_diff(length))?;
    Some(waiting.remove(nearest))
}

/// The smallest class whose buffers hold `length` entries.
fn class_of(length: usize) -> usize {
    length.max(1).next_power_of_two().ilog2() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_is_made_once_and_there_is_none_beyond_all_memory() {
        let mut pool = Pool::<f64>::default();
        for shape in [&[1 << 20, 1 << 20][..], &[1 << 40], &[1 << 63], &[1 << 40, 1 << 40]] {
            assert!(!pool.has_room(shape), "{shape:?}");
        }
        assert!(pool.has_room(&[0, 1 << 40, 1 << 40]) && pool.has_room(&[1 << 17]));
        assert_eq!(pool.count(), 0);
        assert!(pool.has_room(&[600, 1000]) && pool.has_room(&[1000, 600]));
        assert_eq!(pool.count(), 1);
        let buffer = pool.take(600_000);
        assert_eq!((buffer.len(), buffer.capacity(), pool.count()), (600_000, 1 << 20, 0));
    }

    #[test]
    fn a_returned_buffer_is_taken_again() {
        let mut pool = Pool::<f64>::default();
        let buffer = pool.take(5);
        let address = buffer.as_ptr();
        pool.give(buffer);
        let buffer = pool.take(7);
        assert_eq!(buffer.as_ptr(), address);
    }

    #[test]
    fn a_buffer_that_was_shared_is_taken_again_and_its_shell_too() {
        let mut pool = Pool::<f64>::default();
        let buffer = pool.take(5);
        let address = buffer.as_ptr();
        let shared = pool.share(buffer);
        let shell = Arc::as_ptr(&shared);
        pool.give_shared(Entries::Own(shared));
        let buffer = pool.take(7);
        assert_eq!(buffer.as_ptr(), address);
        assert_eq!(Arc::as_ptr(&pool.share(buffer)), shell);
    }

    #[test]
    fn a_shared_buffer_is_never_recycled() {
        let mut pool = Pool::<f64>::default();
        let shared = Arc::new(vec![3.0; 2]);
        pool.give_shared(Entries::Own(Arc::clone(&shared)));
        assert_eq!(pool.count(), 0);
        pool.take(2).fill(4.0);
        assert_eq!(*shared, [3.0, 3.0]);
    }

    #[test]
    fn a_large_buffer_serves_half_its_size_and_takes_the_place_of_smaller_ones() {
        let mut pool = Pool::<f32>::default();
        let count = |pool: &Pool<f32>| pool.count();
        let [large, larger] = [1 << LARGE, 2 << LARGE];
        let buffer = pool.take(larger);
        let address = buffer.as_ptr();
        pool.give(buffer);
        let buffer = pool.take(large);
        assert_eq!((buffer.as_ptr(), count(&pool)), (address, 0));
        pool.give(buffer);
        // None is as large, and the smaller one makes up half of it.
        let buffer = pool.take(2 * larger);
        assert_eq!(count(&pool), 0);
        pool.give(buffer);
        // What is four times as large is left for whoever needs it; small ones are never dropped.
        pool.give(vec![0.0; 4]);
        let buffer = pool.take(large);
        assert_eq!(count(&pool), 2);
        drop((buffer, pool.take(4 * larger)));
        assert_eq!(count(&pool), 1);
    }

    #[test]
    fn of_large_buffers_the_one_that_held_about_as_many_entries_is_taken() {
        let mut pool = Pool::<f32>::default();
        let lengths = [9, 6, 8, 7].map(|eighths| eighths << (LARGE - 3));
        let lengths = lengths.map(|length| length + 1);
        let buffers = lengths.map(|length| pool.take(length));
        let addresses = buffers.each_ref().map(|buffer| buffer.as_ptr());
        buffers.into_iter().for_each(|buffer| pool.give(buffer));
        for order in [[2, 0], [0, 2]] {
            let taken = order.map(|k| (k, pool.take(lengths[k])));
            for (k, buffer) in taken {
                assert_eq!(buffer.as_ptr(), addresses[k]);
                pool.give(buffer);
            }
        }
    }

    #[test]
    fn steps_whose_large_buffers_do_not_overlap_soon_find_them_all() {
        for lengths in [[18, 21, 19], [21, 18, 19], [19, 18, 21], [18, 19, 21], [21, 19, 18]] {
            let mut pool = Pool::<f32>::default();
            let mut step = || {
                lengths.map(|class| {
                    let buffer = pool.take(1 << class);
                    let address = buffer.as_ptr();
                    pool.give(buffer);
                    address
                })
            };
            step();
            step();
            assert_eq!(step(), step(), "{lengths:?}");
        }
    }

    #[test]
    fn buffers_of_odd_capacity_are_never_handed_out_too_small() {
        let mut pool = Pool::<f32>::default();
        pool.give(vec![0.0; 6]);
        pool.give(Vec::new());
        for length in 0..20 {
            assert_eq!(pool.take(length).len(), length);
        }
    }
}
