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
    let mut first: Option<Run<T>> = None;
    for (threads, pool) in THREADS.iter().zip(pools()) {
        // In f32 there may be other outputs than in f64, or a refusal: another law's matter.
        let Ok(run) = pool.install(|| run(&*trial.case.subject, &point, &upstream)) else {
            return Ok(());
        };
        match &first {
            None => first = Some(run),
            Some(first) => compare(tally, &run, first, &format!("{threads} threads"))?,
        }
    }
    Ok(())
}
