//! Gradients while a backward pass runs: sums that operations add to.
//!
//! A sum takes its buffer when the first operation asks for it, and that operation's terms are
//! written, not added: nothing is cleared first. An upstream gradient that a pass starts from is read
//! where the caller holds it, unless something is added to it. An operation can give a buffer to a sum,
//! and take over the sum of its own output where nobody else asks for that.

use std::sync::Arc;

use crate::entries::Entries;
use crate::parallel::for_each_zipped_mut;
use crate::pool::Pool;
use crate::scalar::Scalar;
use crate::value::Value;

/// What a backward pass wants of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// Nothing.
    Nothing,
    /// Its gradient, for those of the values below.
    Through,
    /// Its gradient, for whoever asked.
    Result,
}

/// How far a sum has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// It has no buffer.
    Vacant,
    /// Nothing has been added yet: the buffer holds no meaningful numbers.
    Fresh,
    /// Something has been added.
    Sum,
    /// It is the caller's, and has no buffer of its own.
    Lent,
}

/// The gradient of one input. Everything adds to what is already there; nothing overwrites it.
#[derive(Debug)]
pub struct Accumulator<T> {
    buffer: Vec<T>,
    state: State,
    lent: Option<Entries<T>>,
}

impl<T: Scalar> Accumulator<T> {
    /// A sum without a buffer.
    pub(crate) fn vacant() -> Self {
        Self { buffer: Vec::new(), state: State::Vacant, lent: None }
    }

    /// The sum, if anything has been added.
    #[inline]
    pub(crate) fn sum(&self) -> Option<&[T]> {
        match self.state {
            State::Vacant | State::Fresh => None,
            State::Sum => Some(&self.buffer),
            State::Lent => self.lent.as_deref(),
        }
    }

    /// Gets a buffer of `length` entries, unless there is one.
    #[inline]
    pub(crate) fn prepare(&mut self, length: usize, pool: &mut Pool<T>) {
        match self.state {
            State::Vacant => {
                self.buffer = pool.take(length);
                self.state = State::Fresh;
            }
            State::Lent => self.copy_lent(pool),
            State::Fresh | State::Sum => {}
        }
    }

    /// Adds an upstream gradient that the caller holds.
    pub(crate) fn lend(&mut self, entries: Entries<T>, pool: &mut Pool<T>) {
        if self.state == State::Vacant {
            self.lent = Some(entries);
            self.state = State::Lent;
        } else {
            self.prepare(entries.len(), pool);
            self.add(&entries);
        }
    }

    /// Copies what was lent.
    #[cold]
    fn copy_lent(&mut self, pool: &mut Pool<T>) {
        let Some(lent) = self.lent.take() else { return };
        self.buffer = pool.take(lent.len());
        self.buffer.copy_from_slice(&lent);
        self.state = State::Sum;
    }

    /// Gives the buffer back.
    #[inline]
    pub(crate) fn release(&mut self, pool: &mut Pool<T>) {
        match std::mem::replace(&mut self.state, State::Vacant) {
            State::Vacant => {}
            State::Lent => self.lent = None,
            State::Fresh | State::Sum => pool.give(std::mem::take(&mut self.buffer)),
        }
    }

    /// The sum's buffer, given up, if it has one of its own and anything has been added.
    #[inline]
    pub(crate) fn take_own(&mut self) -> Option<Vec<T>> {
        (self.state == State::Sum).then(|| {
            self.state = State::Vacant;
            std::mem::take(&mut self.buffer)
        })
    }

    /// Adds the entries of `buffer`: where there is no sum yet, it becomes the sum.
    fn give(&mut self, buffer: Vec<T>, pool: &mut Pool<T>) {
        if self.state == State::Vacant {
            (self.buffer, self.state) = (buffer, State::Sum);
        } else {
            self.prepare(buffer.len(), pool);
            self.add(&buffer);
            pool.give(buffer);
        }
    }

    /// The sum's buffer, given up, if anything has been added.
    pub(crate) fn take(&mut self, pool: &mut Pool<T>) -> Option<Vec<T>> {
        self.copy_lent(pool);
        self.take_own()
    }

    /// The entries, and whether nothing has been added yet: then they hold no meaningful numbers, and
    /// whoever takes them writes every one of them, instead of adding.
    #[inline]
    pub fn entries_or_fresh(&mut self) -> (&mut [T], bool) {
        debug_assert!(
            matches!(self.state, State::Fresh | State::Sum),
            "it has a buffer of its own"
        );
        let fresh = std::mem::replace(&mut self.state, State::Sum) == State::Fresh;
        (&mut self.buffer, fresh)
    }

    /// Adds `entry(k)` to the k-th entry, for every k.
    #[inline]
    pub fn add_each(&mut self, mut entry: impl FnMut(usize) -> T) {
        let (sum, fresh) = self.entries_or_fresh();
        if fresh {
            sum.iter_mut().enumerate().for_each(|(k, sum)| *sum = entry(k));
        } else {
            sum.iter_mut().enumerate().for_each(|(k, sum)| *sum += entry(k));
        }
    }

    /// Adds `entry([from[0][k], from[1][k], ...])` to the k-th entry, for every k; entries of a
    /// large array are worked on at the same time.
    ///
    /// # Panics
    /// Where one of `from` is shorter than the input.
    #[inline]
    pub fn add_zipped<const N: usize>(
        &mut self,
        from: [&[T]; N],
        entry: impl Fn([T; N]) -> T + Send + Sync,
    ) {
        let (sum, fresh) = self.entries_or_fresh();
        if fresh {
            for_each_zipped_mut(sum, from, |sum, from| *sum = entry(from));
        } else {
            for_each_zipped_mut(sum, from, |sum, from| *sum += entry(from));
        }
    }

    /// Adds `entries[k]` to the k-th entry, for every k.
    ///
    /// # Panics
    /// Unless there are as many entries as the input has.
    pub fn add(&mut self, entries: &[T]) {
        let size = self.buffer.len();
        assert_eq!(size, entries.len(), "a gradient has as many entries as its input");
        self.add_zipped([entries], |[entry]| entry);
    }

    /// The sum so far, zeros at first, for an operation that adds to some entries.
    pub fn entries(&mut self) -> &mut [T] {
        let (sum, fresh) = self.entries_or_fresh();
        if fresh {
            sum.fill(T::ZERO);
        }
        sum
    }
}

/// The gradients of an operation's inputs, to be added to.
#[derive(Debug)]
pub struct Accumulators<'a, T> {
    pub(crate) values: &'a [Value<T>],
    pub(crate) indices: &'a [u32],
    pub(crate) wanted: &'a [Wanted],
    /// The gradients of all values before the operation's outputs.
    pub(crate) gradients: &'a mut [Accumulator<T>],
    /// That of the operation's only output, where it can be taken over.
    pub(crate) upstream: Option<Vec<T>>,
    pub(crate) pool: &'a mut Pool<T>,
}

impl<T: Scalar> Accumulators<'_, T> {
    /// Whether the gradient of input `i` is wanted now.
    #[inline]
    pub fn needs(&self, i: usize) -> bool {
        self.wanted[self.indices[i] as usize] != Wanted::Nothing
    }

    /// Whether the gradient of input `i` was asked for. Otherwise it is at most a step on the way to one that was,
    /// and an operation may add what follows from it to the gradients further down instead.
    #[inline]
    pub fn is_result(&self, i: usize) -> bool {
        self.wanted[self.indices[i] as usize] == Wanted::Result
    }

    /// The gradient of input `i`, where it is wanted.
    #[inline]
    pub fn get(&mut self, i: usize) -> Option<&mut Accumulator<T>> {
        if !self.needs(i) {
            return None;
        }
        let index = self.indices[i] as usize;
        let gradient = &mut self.gradients[index];
        gradient.prepare(self.values[index].data().len(), self.pool);
        Some(gradient)
    }

    /// Adds `factor` times `entries`, which the operation keeps, to the gradient of input `i`, where it is
    /// wanted. Where the factor is 1, they are read in place unless something else is added: the gradient
    /// of a loss with respect to what it was computed from costs nothing then.
    ///
    /// # Panics
    /// Unless there are as many entries as the input has.
    pub fn lend_scaled(&mut self, i: usize, factor: T, entries: &Arc<Vec<T>>) {
        if !self.needs(i) {
            return;
        }
        let index = self.indices[i] as usize;
        let size = self.values[index].data().len();
        assert_eq!(size, entries.len(), "a gradient has as many entries as its input");
        let gradient = &mut self.gradients[index];
        if factor.is_same(T::ONE) {
            return gradient.lend(Entries::Own(Arc::clone(entries)), self.pool);
        }
        gradient.prepare(size, self.pool);
        gradient.add_zipped([&entries[..]], |[entry]| factor * entry);
    }

    /// The gradient of the only output, for an operation that asked for it ([`Keep::upstream`]): to be
    /// changed, and given to an input, wanted or not. `None` where somebody else reads it, too: then it is
    /// where it always is, to be copied. What was taken is no longer there.
    ///
    /// [`Keep::upstream`]: crate::Keep::upstream
    pub fn take_upstream(&mut self) -> Option<Vec<T>> {
        self.upstream.take()
    }

    /// Adds the entries of `buffer` to the gradient of input `i`, where it is wanted. They are not copied
    /// where nothing else has been added yet. Its memory serves the operations further down; so it should
    /// be a buffer of the tape's.
    ///
    /// # Panics
    /// Unless there are as many entries as the input has, where its gradient is wanted.
    pub fn give(&mut self, i: usize, buffer: Vec<T>) {
        if !self.needs(i) {
            return self.pool.give(buffer);
        }
        let index = self.indices[i] as usize;
        let size = self.values[index].data().len();
        assert_eq!(size, buffer.len(), "a gradient has as many entries as its input");
        self.gradients[index].give(buffer, self.pool);
    }

    /// A buffer of `length` entries, of those that wait to be used again, for [`Accumulators::give`]. They
    /// are whatever an earlier use left.
    pub fn buffer(&mut self, length: usize) -> Vec<T> {
        self.pool.take(length)
    }

    /// The gradient of input `i`, where it is wanted, taken out: for an operation that adds to several
    /// gradients at the same time. [`Accumulators::put_back`] ends that; a gradient that is not put
    /// back is lost. Of a variable that is several inputs each has a sum of its own until then.
    pub fn take(&mut self, i: usize) -> Option<Accumulator<T>> {
        self.get(i).map(|gradient| std::mem::replace(gradient, Accumulator::vacant()))
    }

    /// Puts back what [`Accumulators::take`] took out for input `i`.
    pub fn put_back(&mut self, i: usize, mut taken: Accumulator<T>) {
        let gradient = &mut self.gradients[self.indices[i] as usize];
        if gradient.state == State::Vacant {
            *gradient = taken;
            return;
        }
        if let Some(entries) = taken.sum() {
            gradient.add(entries);
        }
        taken.release(self.pool);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accumulator(fresh: bool) -> Accumulator<f64> {
        // NaN: what a fresh buffer holds means nothing.
        let (entry, state) = if fresh { (f64::NAN, State::Fresh) } else { (10.0, State::Sum) };
        Accumulator { buffer: vec![entry; 2], state, lent: None }
    }

    #[test]
    fn every_way_to_add_adds_once_to_what_is_there() {
        for (fresh, before) in [(true, 0.0), (false, 10.0)] {
            let ways: [fn(&mut Accumulator<f64>); 5] = [
                |sum| sum.add_each(|k| 1.0 + k as f64),
                |sum| sum.add(&[1.0, 2.0]),
                |sum| sum.add_zipped([&[3.0, 5.0], &[2.0, 3.0]], |[a, b]| a - b),
                |sum| sum.entries().iter_mut().zip([1.0, 2.0]).for_each(|(s, x)| *s += x),
                |sum| match sum.entries_or_fresh() {
                    (entries, true) => entries.copy_from_slice(&[1.0, 2.0]),
                    (_, false) => sum.add(&[1.0, 2.0]),
                },
            ];
            for way in ways {
                let mut sum = accumulator(fresh);
                way(&mut sum);
                assert_eq!(sum.buffer, [before + 1.0, before + 2.0]);
                way(&mut sum);
                assert_eq!(sum.buffer, [before + 2.0, before + 4.0]);
            }
        }
    }

    #[test]
    fn what_is_lent_is_read_in_place_until_something_is_added() {
        let mut pool = Pool::default();
        let lent = Arc::new(vec![3.0, 4.0]);
        let entries = || Entries::Own(Arc::clone(&lent));
        let mut sum = Accumulator::vacant();
        sum.lend(entries(), &mut pool);
        assert!(std::ptr::eq(sum.sum().unwrap(), lent.as_slice()));
        sum.lend(entries(), &mut pool);
        assert_eq!(sum.sum(), Some(&[6.0, 8.0][..]));
        sum.prepare(2, &mut pool);
        sum.add(&[1.0, 1.0]);
        assert_eq!(sum.take(&mut pool), Some(vec![7.0, 9.0]));

        sum.lend(entries(), &mut pool);
        assert_eq!(sum.take(&mut pool), Some(vec![3.0, 4.0]));
        sum.lend(entries(), &mut pool);
        sum.release(&mut pool);
        assert_eq!(sum.sum(), None);
        assert_eq!((Arc::strong_count(&lent), &*lent), (1, &vec![3.0, 4.0]));
    }

    #[test]
    #[should_panic(expected = "a gradient has as many entries as its input")]
    fn a_gradient_of_another_length_is_refused() {
        accumulator(true).add(&[1.0]);
    }
}
