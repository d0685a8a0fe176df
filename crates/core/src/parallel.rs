//! Work cut into pieces of a fixed size, whatever the number of threads.
//!
//! Pieces are cut by size alone and results are merged in the order of the pieces. So every result
//! is bitwise the same for any number of threads. Work of a single piece never enters the thread
//! pool: at 32 x 32 pixels to enter it costs more than the work.
//!
//! Threads take pieces one after another, in their order. So the first results are there while there is
//! still work, and one thread merges them while the others go on.

use std::cell::Cell;
use std::ops::Range;
#[cfg(feature = "parallel")]
use std::sync::atomic::{AtomicU32, Ordering};
#[cfg(feature = "parallel")]
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[cfg(feature = "parallel")]
use rayon::prelude::*;
#[cfg(feature = "parallel")]
use rayon::{ThreadPool, ThreadPoolBuilder};
#[cfg(feature = "parallel")]
use smallvec::SmallVec;

/// Entries in one piece of cheap elementwise work: a few microseconds, many times the cost of
/// handing a piece to another thread.
pub const ENTRIES_PER_PIECE: usize = 1 << 14;

/// Calls `work(k, piece)` for each piece of `piece` entries of `data`, the last one perhaps
/// shorter; pieces may run at the same time.
pub fn for_each_piece_mut<T: Send>(
    data: &mut [T],
    piece: usize,
    work: impl Fn(usize, &mut [T]) + Send + Sync,
) {
    if data.len() <= piece {
        if !data.is_empty() {
            work(0, data);
        }
        return;
    }
    #[cfg(feature = "parallel")]
    if is_shared(data.len(), piece) {
        let pieces = data.chunks_mut(piece).enumerate();
        return share(pieces.len(), &mut { pieces }, &|some| {
            some.for_each(|(k, chunk)| work(k, chunk));
        });
    }
    data.chunks_mut(piece).enumerate().for_each(|(k, chunk)| work(k, chunk));
}

/// The most items that a thread takes at once.
#[cfg(feature = "parallel")]
const AT_ONCE: usize = 8;

/// Takes that each thread would need for all that is left: the more, the less it waits for the last one, and the more
/// often threads meet at the lock.
#[cfg(feature = "parallel")]
const TAKES_PER_THREAD: usize = 4;

/// Lets the threads take some of `items` after others, `count` in all, and work on them. By references, so that it is
/// compiled once per type of item and not for every operation.
#[cfg(feature = "parallel")]
fn share<I: Send>(
    count: usize,
    items: &mut (dyn Iterator<Item = I> + Send),
    work: &(dyn Fn(&mut dyn Iterator<Item = I>) + Sync),
) {
    let threads = threads().min(count);
    let items = Mutex::new((items, count));
    let take = || {
        let (items, left) = &mut *lock(&items);
        let some = (*left / (TAKES_PER_THREAD * threads)).clamp(1, AT_ONCE);
        *left = left.saturating_sub(some);
        items.take(some).collect::<SmallVec<[I; AT_ONCE]>>()
    };
    on_each(threads, &|| {
        loop {
            let some = take();
            if some.is_empty() {
                break;
            }
            work(&mut some.into_iter());
        }
    });
}

/// Calls `work` on each of some threads; where there are none to be had, on this one. Nothing in it is generic: what
/// rayon makes of it is compiled once.
#[cfg(feature = "parallel")]
fn on_each(threads: usize, work: &(dyn Fn() + Sync)) {
    let all = || (0..threads).into_par_iter().with_max_len(1).for_each(|_| work());
    match pool() {
        Pool::Rayons => all(),
        Pool::Own(pool) => pool.install(all),
        Pool::None => work(),
    }
}

/// What is behind a lock, which nobody leaves half done.
#[cfg(feature = "parallel")]
fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes `value(k)` to the k-th item, for every k; pieces of `piece` items may be worked on at the same time.
#[inline]
pub fn write_each<T: Send>(
    items: &mut [T],
    piece: usize,
    value: impl Fn(usize) -> T + Send + Sync,
) {
    for_each_piece_mut(items, piece, |k, items| {
        (k * piece..).zip(items).for_each(|(k, item)| *item = value(k));
    });
}

/// Calls `work(k, piece of a, piece of b)` for the k-th piece of `pieces[0]` entries of `a` and of
/// `pieces[1]` entries of `b`, for every k; pieces may run at the same time. Where `b` is empty, so are its
/// pieces.
///
/// # Panics
/// Unless both are cut into equally many pieces, or `b` is empty.
pub fn for_each_two_pieces_mut<A: Send, B: Send>(
    a: &mut [A],
    b: &mut [B],
    pieces: [usize; 2],
    work: impl Fn(usize, &mut [A], &mut [B]) + Send + Sync,
) {
    let [of_a, of_b] = pieces;
    if b.is_empty() {
        return for_each_piece_mut(a, of_a, |k, a| work(k, a, &mut []));
    }
    let count = a.len().div_ceil(of_a);
    assert_eq!(count, b.len().div_ceil(of_b), "both are cut into equally many pieces");
    #[cfg(feature = "parallel")]
    if is_shared(count, 1) {
        let mut pairs = a.chunks_mut(of_a).zip(b.chunks_mut(of_b)).enumerate();
        return share(count, &mut pairs, &|some| some.for_each(|(k, (a, b))| work(k, a, b)));
    }
    let pairs = a.chunks_mut(of_a).zip(b.chunks_mut(of_b)).enumerate();
    pairs.for_each(|(k, (a, b))| work(k, a, b));
}

/// Calls `work(k, item)` on each item; items may run at the same time.
pub fn for_each_item_mut<T: Send>(items: &mut [T], work: impl Fn(usize, &mut T) + Send + Sync) {
    for_each_piece_mut(items, 1, |k, item| work(k, &mut item[0]));
}

/// Calls `work(entry, [from[0][k], from[1][k], ...])` for the k-th entry of `data`, for every k;
/// entries may be worked on at the same time.
///
/// # Panics
/// Where one of `from` is shorter than `data`.
#[inline]
pub fn for_each_zipped_mut<D: Send, T: Copy + Sync, const N: usize>(
    data: &mut [D],
    from: [&[T]; N],
    work: impl Fn(&mut D, [T; N]) + Send + Sync,
) {
    for_each_piece_mut(data, ENTRIES_PER_PIECE, |k, piece| {
        let from = from.map(|entries| &entries[k * ENTRIES_PER_PIECE..][..piece.len()]);
        // A map of the array is a call, for each entry, where a crate is compiled in several units.
        let mut numbers = from.map(|entries| entries[0]);
        for (k, entry) in piece.iter_mut().enumerate() {
            for n in 0..N {
                numbers[n] = from[n][k];
            }
            work(entry, numbers);
        }
    });
}

/// Calls `merge(work(item))` for each item, in the order of the items. If `is_shared`, items may be worked on at the
/// same time, and results merged while other items are worked on.
pub fn merge_each<I: Send, R: Send>(
    is_shared: bool,
    items: impl ExactSizeIterator<Item = I> + Send,
    work: impl Fn(I) -> R + Sync,
    mut merge: impl FnMut(R) + Send,
) {
    #[cfg(feature = "parallel")]
    if is_shared && items.len() > 1 && threads() > 1 {
        return merge_shared(items.len(), &mut items.enumerate(), &work, &mut merge);
    }
    #[cfg(not(feature = "parallel"))]
    let _ = is_shared;
    items.for_each(|item| merge(work(item)));
}

/// [`merge_each`] on the thread pool, by references as [`share`].
#[cfg(feature = "parallel")]
fn merge_shared<I: Send, R: Send>(
    count: usize,
    items: &mut (dyn Iterator<Item = (usize, I)> + Send),
    work: &(dyn Fn(I) -> R + Sync),
    merge: &mut (dyn FnMut(R) + Send),
) {
    // How many results were taken out, and those that are there beyond.
    let results = Mutex::new((0, SmallVec::<[Option<R>; 2 * AT_ONCE]>::new()));
    let add = |first: usize, some: SmallVec<[R; AT_ONCE]>| {
        let (taken, waiting) = &mut *lock(&results);
        let place = first - *taken;
        if waiting.len() < place + some.len() {
            waiting.resize_with(place + some.len(), || None);
        }
        waiting[place..].iter_mut().zip(some).for_each(|(place, result)| *place = Some(result));
    };
    let is_next_there = || lock(&results).1.first().is_some_and(Option::is_some);
    let next = || {
        let (taken, waiting) = &mut *lock(&results);
        let count = waiting.iter().take(AT_ONCE).take_while(|result| result.is_some()).count();
        *taken += count;
        waiting.drain(..count).flatten().collect::<SmallVec<[R; AT_ONCE]>>()
    };
    let merge = Mutex::new(merge);
    share(count, items, &|some| {
        let mut some = some.peekable();
        let first = some.peek().map_or(0, |&(k, _)| k);
        add(first, some.map(|(_, item)| work(item)).collect());
        // Who merges goes on with what others add meanwhile, and looks once more after it; these go on with their work.
        while is_next_there()
            && let Ok(mut merge) = merge.try_lock()
        {
            loop {
                let some = next();
                if some.is_empty() {
                    break;
                }
                some.into_iter().for_each(&mut **merge);
            }
        }
    });
}

/// Calls `merge(work(range))` for each range of `piece` indices of `0..length`, as [`merge_each`].
pub fn merge_ranges<R: Send>(
    length: usize,
    piece: usize,
    work: impl Fn(Range<usize>) -> R + Send + Sync,
    merge: impl FnMut(R) + Send,
) {
    let range = |k: usize| k * piece..((k + 1) * piece).min(length);
    let pieces = 0..length.div_ceil(piece);
    merge_each(is_shared(length, piece), pieces, |k| work(range(k)), merge);
}

/// [`merge_ranges`] with results that are written into `results`, whose memory the next call finds
/// again. They hold what an earlier call left there, which `work` clears or writes over.
pub fn merge_ranges_into<'a, R: Default + Send>(
    results: &'a mut Vec<R>,
    length: usize,
    piece: usize,
    work: impl Fn(Range<usize>, &mut R) + Send + Sync,
    merge: impl FnMut(&mut R) + Send,
) {
    let pieces = length.div_ceil(piece);
    if results.len() < pieces {
        results.resize_with(pieces, R::default);
    }
    let pieces = results[..pieces].iter_mut().enumerate();
    let work = |(k, result): (usize, &'a mut R)| {
        work(k * piece..((k + 1) * piece).min(length), result);
        result
    };
    merge_each(is_shared(length, piece), pieces, work, merge);
}

/// Runs both, at the same time if it `is_shared`, and returns both results.
pub fn join<A: Send, B: Send>(
    is_shared: bool,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    #[cfg(feature = "parallel")]
    if is_shared && threads() > 1 {
        let (mut one, mut other) = (Call::Later(first), Call::Later(second));
        both(&mut || one.run(), &mut || other.run());
        return (one.result(), other.result());
    }
    #[cfg(not(feature = "parallel"))]
    let _ = is_shared;
    (first(), second())
}

/// A function that is called once, and then what it returned.
#[cfg(feature = "parallel")]
enum Call<F, R> {
    Later(F),
    Running,
    Done(R),
}

#[cfg(feature = "parallel")]
impl<F: FnOnce() -> R, R> Call<F, R> {
    fn run(&mut self) {
        if let Self::Later(work) = std::mem::replace(self, Self::Running) {
            *self = Self::Done(work());
        }
    }

    fn result(self) -> R {
        let Self::Done(result) = self else { unreachable!("it was called") };
        result
    }
}

/// Runs both, at the same time where threads are to be had. As [`on_each`], without anything generic.
#[cfg(feature = "parallel")]
fn both(first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)) {
    match pool() {
        Pool::Rayons => _ = rayon::join(first, second),
        Pool::Own(pool) => _ = pool.install(|| rayon::join(first, second)),
        Pool::None => {
            first();
            second();
        }
    }
}

thread_local! {
    /// Whether what this thread does is not to be shared.
    static IS_ALONE: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work` on this thread alone: what it calls shares nothing with other threads. For work that
/// is itself one of many pieces.
pub fn alone<R>(work: impl FnOnce() -> R) -> R {
    /// Sets back what was there, after a panic too.
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            IS_ALONE.set(self.0);
        }
    }
    let _before = Before(IS_ALONE.replace(true));
    work()
}

/// Runs `work` on `count` threads, at most 256; on one, and for 0, as [`alone`] does, and within [`alone`] on this thread.
/// Threads are started once, and kept for the last few numbers of threads.
///
/// In a process that was forked they are started anew: those of its parent are not there. So are those that share work
/// outside such a call, unless the program has built rayon's own pool before anything here asked for it.
pub fn with_threads<R: Send>(count: usize, work: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "parallel")]
    if count > 1
        && !IS_ALONE.get()
        && let Some(pool) = pool_of(count.min(MOST_THREADS))
    {
        let mut call = Call::Later(work);
        let run: &mut (dyn FnMut() + Send) = &mut || call.run();
        pool.install(run);
        return call.result();
    }
    let _ = count;
    alone(work)
}

/// The most threads of [`with_threads`].
#[cfg(feature = "parallel")]
const MOST_THREADS: usize = 256;

/// Pools that are kept.
#[cfg(feature = "parallel")]
const MOST_POOLS: usize = 4;

/// A process, a number of threads, and their pool.
#[cfg(feature = "parallel")]
type Known = (u32, usize, Arc<ThreadPool>);

/// The last pools of [`with_threads`].
#[cfg(feature = "parallel")]
static POOLS: Mutex<Vec<Known>> = Mutex::new(Vec::new());

/// The pool of `count` threads; `None` where the system has no threads to give.
#[cfg(feature = "parallel")]
fn pool_of(count: usize) -> Option<Arc<ThreadPool>> {
    let process = std::process::id();
    let known = |pools: &[Known]| {
        let pool = pools.iter().find(|(of, threads, _)| (*of, *threads) == (process, count));
        pool.map(|(.., pool)| Arc::clone(pool))
    };
    if let Some(pool) = known(&lock(&POOLS)) {
        return Some(pool);
    }
    // Not under the lock, which a fork meanwhile would leave locked.
    let pool = Arc::new(ThreadPoolBuilder::new().num_threads(count).build().ok()?);
    let mut pools = lock(&POOLS);
    let (own, of_parents): (Vec<_>, Vec<_>) = pools.drain(..).partition(|(of, ..)| *of == process);
    // These can't be waited for.
    of_parents.into_iter().for_each(std::mem::forget);
    pools.extend(own.into_iter().rev().take(MOST_POOLS - 1).rev());
    pools.push((process, count, Arc::clone(&pool)));
    Some(pool)
}

/// The process that rayon's own pool was first asked for in; 0 before.
#[cfg(feature = "parallel")]
static FIRST_PROCESS: AtomicU32 = AtomicU32::new(0);

/// Whether rayon's own pool has lost its threads: in a process that was forked after it was first asked for.
#[cfg(feature = "parallel")]
fn is_forked() -> bool {
    let process = std::process::id();
    let first = FIRST_PROCESS
        .compare_exchange(0, process, Ordering::Relaxed, Ordering::Relaxed)
        .unwrap_or_else(|first| first);
    first != 0 && first != process
}

/// Where work is shared.
#[cfg(feature = "parallel")]
enum Pool {
    /// Where this thread is, or in rayon's own pool.
    Rayons,
    /// In a pool of this process, since rayon's own one would be waited for without end.
    Own(Arc<ThreadPool>),
    /// Nowhere: the system has no threads to give.
    None,
}

#[cfg(feature = "parallel")]
fn pool() -> Pool {
    if rayon::current_thread_index().is_some() || !is_forked() {
        return Pool::Rayons;
    }
    pool_of(rayon::current_num_threads()).map_or(Pool::None, Pool::Own)
}

/// Whether work on `length` entries in pieces of `piece` is shared by several threads. For work
/// whose results need memory per piece only then; its results must not depend on the answer.
pub fn is_shared(length: usize, piece: usize) -> bool {
    length > piece && threads() > 1
}

/// The number of threads that share work. For how much memory to set aside; results must not depend
/// on it.
pub fn threads() -> usize {
    #[cfg(feature = "parallel")]
    let threads = if IS_ALONE.get() {
        1
    } else {
        // To ask rayon may start its pool.
        is_forked();
        rayon::current_num_threads()
    };
    #[cfg(not(feature = "parallel"))]
    let threads = 1;
    threads
}
