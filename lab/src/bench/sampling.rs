//! Times of several contestants, taken in turns.
//!
//! A round takes one sample of each contestant, so that whatever else the machine does falls on all
//! of them alike. A sample is a number of steps, as many as make it long against the clock's own
//! time, and enters its thread pool once. As many go before it untimed, for a fit repeats its steps:
//! what the other contestants have left in the caches is none of its business. The minimum says what
//! the code can do, the median what it did here, the quartiles how steady the machine was.

use std::cmp::Ordering;
use std::time::Instant;

use bokashi_fit::FitError;
use bokashi_report::Cell;
use rayon::ThreadPool;

use crate::bench::effort::{ENOUGH_SAMPLES, Effort};

/// Something whose time is taken.
pub(crate) struct Contestant<'a> {
    pool: &'a ThreadPool,
    step: Box<dyn FnMut() -> Result<(), FitError> + Send + 'a>,
}

impl<'a> Contestant<'a> {
    /// Whatever `step` does, on the threads of `pool`.
    pub(crate) fn new(
        pool: &'a ThreadPool,
        step: impl FnMut() -> Result<(), FitError> + Send + 'a,
    ) -> Self {
        Self { pool, step: Box::new(step) }
    }

    /// The seconds of a step, from a sample of so many after `untimed` ones. The pool, also one of a
    /// single thread, is entered once per sample: what that takes is no part of a step.
    fn sample(&mut self, untimed: usize, steps: usize) -> Result<f64, FitError> {
        let Self { pool, step } = self;
        pool.install(|| {
            (0..untimed).try_for_each(|_| step())?;
            let start = Instant::now();
            (0..steps).try_for_each(|_| step())?;
            Ok(start.elapsed().as_secs_f64() / steps as f64)
        })
    }
}

/// Stands beside figures that come from fewer samples than are enough.
pub(crate) const FEW_SAMPLES: &str = "*";

/// The time of a step, in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Timing {
    pub(crate) minimum: f64,
    pub(crate) lower_quartile: f64,
    pub(crate) median: f64,
    pub(crate) upper_quartile: f64,
    pub(crate) samples: usize,
}

impl Timing {
    /// Of the times of single samples, of which there is at least one.
    pub(crate) fn from_seconds(mut seconds: Vec<f64>) -> Self {
        seconds.sort_by(f64::total_cmp);
        let quantile = |part: f64| seconds[(part * (seconds.len() - 1) as f64).round() as usize];
        Self {
            minimum: quantile(0.0),
            lower_quartile: quantile(0.25),
            median: quantile(0.5),
            upper_quartile: quantile(0.75),
            samples: seconds.len(),
        }
    }

    /// A figure of this time as the cell of a table, marked where it has few samples.
    pub(crate) fn cell(&self, figure: f64) -> Cell {
        Cell::Number(figure, if self.has_enough_samples() { "" } else { FEW_SAMPLES })
    }

    /// The distance between the quartiles, as a share of the median.
    pub(crate) fn spread(&self) -> f64 {
        (self.upper_quartile - self.lower_quartile) / self.median
    }

    /// Whether it is less or greater than that of another contestant of the same turns: equal where
    /// the ranges between the quartiles meet.
    pub(crate) fn compare(&self, other: &Self) -> Ordering {
        match () {
            () if self.upper_quartile < other.lower_quartile => Ordering::Less,
            () if self.lower_quartile > other.upper_quartile => Ordering::Greater,
            () => Ordering::Equal,
        }
    }

    /// Whether there are as many samples as there should be.
    pub(crate) fn has_enough_samples(&self) -> bool {
        self.samples >= ENOUGH_SAMPLES
    }
}

/// Steps taken before the samples, to see how long one takes; two are enough, one with its memory
/// new and one without, where they take longer than so many seconds.
const TRIES: usize = 5;
const LONG_TRY: f64 = 0.1;

/// A step that takes longer than so many seconds goes through more memory than any cache holds: none
/// goes before it untimed.
const LONG_STEP: f64 = 0.05;

/// The time of each contestant, or the error that it ended with; each takes about `budget` seconds,
/// or as long as enough samples do.
pub(crate) fn interleaved(
    contestants: &mut [Contestant<'_>],
    effort: Effort,
    budget: f64,
) -> Vec<Result<Timing, FitError>> {
    struct Turns {
        untimed: usize,
        steps: usize,
        samples: usize,
        seconds: Vec<f64>,
    }
    let mut all: Vec<Result<Turns, FitError>> = Vec::new();
    for contestant in contestants.iter_mut() {
        // The first step finds no buffers and cold caches, and any can be disturbed.
        let mut tried = contestant.sample(0, 1);
        for tries in 1..TRIES {
            let Ok(least) = tried else { break };
            if tries > 1 && least > LONG_TRY {
                break;
            }
            tried = contestant.sample(0, 1).map(|seconds| least.min(seconds));
        }
        all.push(tried.map(|seconds| {
            let steps = (effort.sample_seconds() / seconds).ceil().clamp(1.0, 1e5) as usize;
            let samples = effort.samples(seconds * steps as f64, budget);
            let untimed = if seconds < LONG_STEP { steps } else { 0 };
            Turns { untimed, steps, samples, seconds: Vec::with_capacity(samples) }
        }));
    }
    let rounds = all.iter().flatten().map(|turns| turns.samples).max().unwrap_or(0);
    for round in 0..rounds {
        for (contestant, one) in contestants.iter_mut().zip(&mut all) {
            let Ok(turns) = one else { continue };
            // Whoever takes fewer samples takes them evenly over the rounds.
            if turns.seconds.len() * rounds > round * turns.samples {
                continue;
            }
            match contestant.sample(turns.untimed, turns.steps) {
                Ok(seconds) => turns.seconds.push(seconds),
                Err(error) => *one = Err(error),
            }
        }
    }
    all.into_iter().map(|turns| turns.map(|turns| Timing::from_seconds(turns.seconds))).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::bench::effort::USUAL;

    #[test]
    fn minimum_median_and_quartiles_are_those_of_the_sorted_samples() {
        let timing = Timing::from_seconds(vec![5.0, 1.0, 3.0, 2.0, 4.0]);
        assert_eq!((timing.minimum, timing.median, timing.samples), (1.0, 3.0, 5));
        assert_eq!((timing.lower_quartile, timing.upper_quartile), (2.0, 4.0));
        assert_eq!(timing.spread(), 2.0 / 3.0);
        assert!(!timing.has_enough_samples());
    }

    #[test]
    fn times_are_equal_where_their_quartiles_meet() {
        let timing = |middle: f64| {
            Timing::from_seconds([-2.0, -1.0, 0.0, 1.0, 2.0].map(|x| x + middle).into())
        };
        assert_eq!(timing(10.0).compare(&timing(12.0)), Ordering::Equal);
        assert_eq!(timing(10.0).compare(&timing(12.5)), Ordering::Less);
        assert_eq!(timing(12.5).compare(&timing(10.0)), Ordering::Greater);
    }

    #[test]
    fn contestants_take_turns_and_an_error_ends_only_its_own() {
        let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let order = Mutex::new(Vec::new());
        let taking = |name: char| {
            let order = &order;
            Contestant::new(&pool, move || {
                order.lock().unwrap().push(name);
                // Long enough for a step to be a sample.
                std::thread::sleep(std::time::Duration::from_micros(50));
                Ok(())
            })
        };
        let failing = Contestant::new(&pool, || {
            Err(FitError::Setting { setting: "a", rule: "b", value: "c".to_owned() })
        });
        let found = interleaved(&mut [taking('a'), failing, taking('b')], Effort::Quick, USUAL);
        assert!(found[0].is_ok() && found[1].is_err() && found[2].is_ok());
        let samples = Effort::Quick.samples(1e-4, USUAL);
        let order = order.lock().unwrap().iter().collect::<String>();
        assert_eq!(order, format!("aaaaabbbbb{}", "aabb".repeat(samples)));
    }

    #[test]
    fn all_steps_of_a_sample_are_taken_in_one_stay_in_the_pool() {
        let pool = ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let threads = Mutex::new(Vec::new());
        let mut contestant = Contestant::new(&pool, || {
            threads.lock().unwrap().push(rayon::current_thread_index());
            Ok(())
        });
        for _ in 0..20 {
            contestant.sample(10, 40).unwrap();
        }
        drop(contestant);
        let threads = threads.into_inner().unwrap();
        assert_eq!(threads.len(), 20 * 50);
        // Entered anew, either thread may take the work.
        for sample in threads.chunks(50) {
            assert!(sample[0].is_some() && sample.iter().all(|thread| *thread == sample[0]));
        }
    }
}
