//! The threads that operations run on, beside the interpreter.

use std::sync::atomic::{AtomicUsize, Ordering};

use bokashi_core::parallel::with_threads;
use pyo3::prelude::*;

/// The threads that were asked for; 0 for as many as there are.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// Lets every operation run on `count` threads from now on, or on as many as there are. The bits of results do not
/// depend on it.
#[pyfunction]
#[pyo3(signature = (count=None))]
pub fn set_num_threads(count: Option<usize>) {
    THREADS.store(count.unwrap_or(0), Ordering::Relaxed);
}

/// The number of threads that operations run on.
#[pyfunction]
pub fn num_threads() -> usize {
    match THREADS.load(Ordering::Relaxed) {
        0 => bokashi_core::parallel::threads(),
        count => count,
    }
}

/// Runs `work` with the interpreter's lock released, on the threads that were asked for.
pub fn released<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> R {
    py.detach(|| match THREADS.load(Ordering::Relaxed) {
        0 => work(),
        count => with_threads(count, work),
    })
}
