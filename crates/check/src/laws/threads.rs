//! Any number of threads gives the same bits, in both precisions.

use std::sync::OnceLock;

use bokashi_core::Tensor;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::recycling::compare;
use crate::failure::Broken;
use crate::run::{Run, point, run};
use crate::subject::Number;
use crate::trial::{Tally, Trial};

const THREADS: [usize; 4] = [1, 2, 4, 8];

/// Pools that are started once for all checks of a program.
fn pools() -> &'static [ThreadPool; 4] {
    static POOLS: OnceLock<[ThreadPool; 4]> = OnceLock::new();
    POOLS.get_or_init(|| {
        THREADS.map(|threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("a thread pool for the checks could not be started")
        })
    })
}

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    on_all_pools::<f64>(trial, &mut tally)?;
    on_all_pools::<f32>(trial, &mut tally)?;
    Ok(tally)
}

fn on_all_pools<T: Number>(trial: &Trial, tally: &mut Tally) -> Result<(), Broken> {
    let point = point::<T>(&trial.case.inputs);
    let upstream: Vec<Tensor<T>> = trial.upstream.iter().map(Tensor::cast).collect();
    let on = |pool: &ThreadPool| pool.install(|| run(&*trial.case.subject, &point, &upstream));
    let runs: Vec<Result<Run<T>, _>> = pools().iter().map(on).collect();
    // In f32 there may be other outputs than in f64, or a refusal: another law's matter. But it
    // is the same on any number of threads.
    let refusals = runs.iter().filter(|run| run.is_err()).count();
    if refusals != 0 && refusals != runs.len() {
        let what = format!("refused on {refusals} of {} numbers of threads", runs.len());
        return Err(Broken::from_message(what));
    }
    let mut runs = THREADS.iter().zip(runs.into_iter().flatten());
    let Some((_, first)) = runs.next() else { return Ok(()) };
    for (threads, run) in runs {
        compare(tally, &run, &first, &format!("{threads} threads"))?;
    }
    Ok(())
}
