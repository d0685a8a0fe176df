//! Work cut into pieces of a fixed size, whatever the number of threads.
//!
//! Pieces are cut by size alone and results are merged in the order of the pieces. So every result
//! is bitwise the same for any number of threads. Work of a single piece never enters the thread
//! pool: at 32 x 32 pixels to enter it costs more than the work.

use std::cell::Cell;
use std::ops::Range;
#[cfg(feature = "parallel")]
use std::sync::atomic::{AtomicU32, Ordering};
#[cfg(feature = "parallel")]
use std::sync::{Arc, Mutex, PoisonError};

#[cfg(feature = "parallel")]
use rayon::prelude::*;
#[cfg(feature = "parallel")]
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Entries in one piece of cheap elementwise work: a few microseconds, many times the cost of
/// handing a piece to another thread.
pub const ENTRIES_PER_PIECE: usize = 1 << 14;

/// Pieces that a thread takes at once: rayon would cut work into a few tasks per thread, and of
/// unlike pieces the slow ones often are neighbours.
#[cfg(feature = "parallel")]
const PIECES_PER_TASK: usize = 1;

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
        return share(data, piece, &work);
    }
    data.chunks_mut(piece).enumerate().for_each(|(k, chunk)| work(k, chunk));
}

/// The pieces of [`for_each_piece_mut`] on the thread pool. By a reference to `work`, so that rayon is
/// compiled once per type of entry and not for every operation.
#[cfg(feature = "parallel")]
fn share<T: Send>(data: &mut [T], piece: usize, work: &(dyn Fn(usize, &mut [T]) + Sync)) {
    in_living_pool(|| {
        let pieces = data.par_chunks_mut(piece).with_max_len(PIECES_PER_TASK);
        pieces.enumerate().for_each(|(k, chunk)| work(k, chunk));
    });
}

/// The pieces of [`merge_ranges`] on the thread pool, by a reference to `work` as in [`share`].
#[cfg(feature = "parallel")]
fn share_ranges<R: Send>(pieces: usize, work: &(dyn Fn(usize) -> R + Sync)) -> Vec<R> {
    in_living_pool(|| (0..pieces).into_par_iter().with_max_len(PIECES_PER_TASK).map(work).collect())
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
        return in_living_pool(|| {
            let pairs = a.par_chunks_mut(of_a).zip(b.par_chunks_mut(of_b));
            let pairs = pairs.with_max_len(PIECES_PER_TASK).enumerate();
            pairs.for_each(|(k, (a, b))| work(k, a, b));
        });
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
        for (k, entry) in piece.iter_mut().enumerate() {
            work(entry, from.map(|entries| entries[k]));
        }
    });
}

/// Calls `merge(work(range))` for each range of `piece` indices of `0..length`, in the order of the
/// ranges; the work, not the merging, may run at the same time.
pub fn merge_ranges<R: Send>(
    length: usize,
    piece: usize,
    work: impl Fn(Range<usize>) -> R + Send + Sync,
    mut merge: impl FnMut(R),
) {
    let pieces = length.div_ceil(piece);
    let range = |k: usize| k * piece..((k + 1) * piece).min(length);
    #[cfg(feature = "parallel")]
    if is_shared(length, piece) {
        return share_ranges(pieces, &|k| work(range(k))).into_iter().for_each(merge);
    }
    (0..pieces).for_each(|k| merge(work(range(k))));
}

/// [`merge_ranges`] with results that are written into `results`, whose memory the next call finds
/// again. They hold what an earlier call left there, which `work` clears or writes over.
pub fn merge_ranges_into<R: Default + Send>(
    results: &mut Vec<R>,
    length: usize,
    piece: usize,
    work: impl Fn(Range<usize>, &mut R) + Send + Sync,
    merge: impl FnMut(&mut R),
) {
    let pieces = length.div_ceil(piece);
    if results.len() < pieces {
        results.resize_with(pieces, R::default);
    }
    let results = &mut results[..pieces];
    for_each_item_mut(results, |k, result| {
        work(k * piece..((k + 1) * piece).min(length), result);
    });
    results.iter_mut().for_each(merge);
}

/// Runs both, perhaps at the same time, and returns both results.
pub fn join<A: Send, B: Send>(
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    #[cfg(feature = "parallel")]
    if threads() > 1 {
        return in_living_pool(|| rayon::join(first, second));
    }
    (first(), second())
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

/// Runs `work` on `count` threads; on one, as [`alone`] does. Threads are started once and kept.
///
/// In a process that was forked they are started anew: those of its parent are not there. So are those that share work
/// outside such a call.
pub fn with_threads<R: Send>(count: usize, work: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "parallel")]
    if count > 1
        && let Some(pool) = pool_of(count)
    {
        return pool.install(work);
    }
    let _ = count;
    alone(work)
}

/// The pools of [`with_threads`]: process, threads, pool. Those of a process that was forked stay, unused: their
/// threads can't be waited for.
#[cfg(feature = "parallel")]
static POOLS: Mutex<Vec<(u32, usize, Arc<ThreadPool>)>> = Mutex::new(Vec::new());

/// The pool of `count` threads; `None` where the system has no threads to give.
#[cfg(feature = "parallel")]
fn pool_of(count: usize) -> Option<Arc<ThreadPool>> {
    let process = std::process::id();
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((.., pool)) =
        pools.iter().find(|(of, threads, _)| (*of, *threads) == (process, count))
    {
        return Some(Arc::clone(pool));
    }
    let pool = Arc::new(ThreadPoolBuilder::new().num_threads(count).build().ok()?);
    pools.push((process, count, Arc::clone(&pool)));
    Some(pool)
}

/// The process that rayon's own pool was first used in; 0 before.
#[cfg(feature = "parallel")]
static FIRST_PROCESS: AtomicU32 = AtomicU32::new(0);

/// Runs `work` in a pool whose threads are there: rayon's own one has lost them in a process that was forked after its
/// first use, and would be waited for without end.
#[cfg(feature = "parallel")]
fn in_living_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    if rayon::current_thread_index().is_some() {
        return work();
    }
    let process = std::process::id();
    let first = FIRST_PROCESS
        .compare_exchange(0, process, Ordering::Relaxed, Ordering::Relaxed)
        .unwrap_or_else(|first| first);
    match first == 0 || first == process {
        true => work(),
        false => with_threads(rayon::current_num_threads(), work),
    }
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
    let threads = if IS_ALONE.get() { 1 } else { rayon::current_num_threads() };
    #[cfg(not(feature = "parallel"))]
    let threads = 1;
    threads
}
