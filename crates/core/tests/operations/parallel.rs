use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::Duration;

use bokashi_core::parallel::{
    ENTRIES_PER_PIECE, alone, for_each_piece_mut, for_each_two_pieces_mut, for_each_zipped_mut,
    is_shared, join, merge_each, merge_ranges, merge_ranges_into, threads, with_threads,
    write_each,
};
use rayon::ThreadPoolBuilder;

#[test]
fn pieces_cover_everything_once_and_in_order() {
    for length in [0, 1, 9, 10, 11, 100] {
        let mut covered = Vec::new();
        merge_ranges(length, 10, |range| range, |range| covered.extend(range));
        assert_eq!(covered, (0..length).collect::<Vec<_>>());

        let mut data = vec![0; length];
        for_each_piece_mut(&mut data, 10, |k, piece| {
            piece.iter_mut().enumerate().for_each(|(i, entry)| *entry += 10 * k + i);
        });
        assert_eq!(data, (0..length).collect::<Vec<_>>());
        write_each(&mut data, 10, |k| 3 * k);
        assert!(data.iter().enumerate().all(|(k, &item)| item == 3 * k));
    }
}

#[test]
fn results_in_memory_of_earlier_ones_are_those_of_this_call() {
    let mut results: Vec<Vec<usize>> = Vec::new();
    for length in [100, 9, 11, 0, 100] {
        let mut covered: Vec<usize> = Vec::new();
        let work = |range: Range<usize>, result: &mut Vec<usize>| {
            result.clear();
            result.extend(range);
        };
        // What is left behind in some of them does not come back.
        merge_ranges_into(&mut results, length, 10, work, |result| covered.extend(result.iter()));
        assert_eq!(covered, (0..length).collect::<Vec<_>>());
    }
    assert_eq!(results.len(), 10);
}

#[test]
fn what_runs_alone_is_shared_with_no_other_thread_and_a_panic_ends_that() {
    let before = threads();
    alone(|| {
        assert_eq!(threads(), 1);
        alone(|| assert!(!is_shared(10, 1)));
        assert_eq!(join(true, threads, || 2), (1, 2));
    });
    assert!(std::panic::catch_unwind(|| alone(|| panic!("on purpose"))).is_err());
    assert_eq!(threads(), before);
}

#[test]
fn two_arrays_are_cut_alike() {
    for length in [0, 1, 9, 10, 11, 100] {
        let (mut a, mut b) = (vec![0; length], vec![0; length.div_ceil(10)]);
        for_each_two_pieces_mut(&mut a, &mut b, [10, 1], |k, a, b| {
            a.fill(k);
            b[0] = k;
        });
        assert!((0..length).all(|i| a[i] == i / 10));
        assert!(b.iter().enumerate().all(|(k, &b)| b == k));
        // Without a second array, too.
        let mut none: [usize; 0] = [];
        for_each_two_pieces_mut(&mut a, &mut none, [10, 0], |k, a, none| {
            a.fill(k + 1);
            assert!(none.is_empty());
        });
        assert!((0..length).all(|i| a[i] == i / 10 + 1));
    }
}

#[test]
fn zipped_entries_stay_beside_each_other_across_pieces() {
    let length = 2 * ENTRIES_PER_PIECE + 3;
    let numbers: Vec<usize> = (0..length).collect();
    let mut sums = vec![1; length];
    for_each_zipped_mut(&mut sums, [&numbers, &numbers], |sum, [a, b]| *sum += a + b);
    assert!(sums.iter().enumerate().all(|(k, &sum)| sum == 1 + 2 * k));
}

#[test]
fn work_runs_on_as_many_threads_as_asked_for_and_pools_are_kept() {
    for count in [1, 3, 2, 3, 0] {
        let of_call = with_threads(count, || (threads(), std::thread::current().id()));
        let expected = if cfg!(feature = "parallel") { count.max(1) } else { 1 };
        assert_eq!(of_call.0, expected);
        assert_eq!(of_call.1 == std::thread::current().id(), expected == 1);
        let sums = with_threads(count, || {
            let mut data = vec![0; 100];
            for_each_piece_mut(&mut data, 7, |k, piece| piece.fill(k));
            data
        });
        assert!((0..).zip(sums).all(|(k, sum)| sum == k / 7));
    }
    if cfg!(feature = "parallel") {
        let thread = || {
            with_threads(1000, || (threads(), rayon::broadcast(|_| std::thread::current().id())))
        };
        let (first, again) = (thread(), thread());
        assert_eq!(first.0, 256);
        assert_eq!(first, again, "threads were started anew");
    }
    let alone = alone(|| with_threads(3, || (threads(), std::thread::current().id())));
    assert_eq!(alone, (1, std::thread::current().id()));
}

#[test]
fn work_and_merging_may_share_work_of_their_own() {
    let sum = |upto: usize| {
        let mut sum = 0;
        merge_each(true, 0..upto, |k| k, |k| sum += k);
        sum
    };
    for threads in [1, 2, 5] {
        on(threads, || {
            let mut sums = Vec::new();
            merge_each(true, 0..40, sum, |inner| sums.push(inner + sum(20)));
            assert!(
                (0..40_usize)
                    .zip(sums)
                    .all(|(k, found)| found == k * k.saturating_sub(1) / 2 + 190)
            );
            let mut within = Vec::new();
            alone(|| merge_each(true, 0..9, sum, |inner| within.push(inner)));
            with_threads(3, || assert_eq!(sum(10), 45));
            assert_eq!(within.len(), 9);
        });
    }
}

fn on(threads: usize, work: impl FnOnce() + Send) {
    ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work);
}

#[test]
fn results_are_merged_in_their_order_however_long_the_work_takes() {
    for threads in [1, 2, 3, 8] {
        for count in [0, 1, 2, 7, 100] {
            on(threads, || {
                let work = |k: usize| {
                    sleep(Duration::from_micros((k * 7919 % 5) as u64 * 50));
                    k
                };
                let mut merged = Vec::new();
                merge_each(true, 0..count, work, |k| merged.push(k));
                assert!(merged.into_iter().eq(0..count), "{count} on {threads} threads");
            });
        }
    }
}

#[test]
fn results_are_merged_while_other_items_are_worked_on() {
    let merged = AtomicUsize::new(0);
    on(2, || {
        let work = |k: usize| {
            // The last one ends after the first one was merged.
            let is_over = || k < 9 || merged.load(Ordering::SeqCst) > 0;
            (0..20_000).any(|_| {
                is_over() || {
                    sleep(Duration::from_micros(100));
                    false
                }
            })
        };
        merge_each(true, 0..10, work, |is_over| {
            assert!(is_over, "nothing was merged in two seconds");
            merged.fetch_add(1, Ordering::SeqCst);
        });
    });
    assert_eq!(merged.into_inner(), 10);
}

#[test]
fn a_panic_in_work_or_in_merging_reaches_the_caller() {
    let panics = |in_work: bool| {
        let run = || {
            on(2, || {
                let mut count = 0;
                let work = |k: usize| assert!(k != 7 || !in_work, "on purpose");
                merge_each(true, 0..20, work, |()| {
                    count += 1;
                    assert!(count < 12 || in_work, "on purpose");
                });
            });
        };
        std::panic::catch_unwind(run).is_err()
    };
    assert!(panics(true) && panics(false));
}
