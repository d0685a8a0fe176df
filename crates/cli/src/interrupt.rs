//! Signals that ask the program to end: an interrupt, a termination, a terminal that hangs up.
//!
//! A signal that was ignored when the program began stays ignored, as `nohup` wants it.

use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::failure::{Failure, status_of};

/// Held while files are written: a program that is interrupted finishes them first.
pub type Writing = Arc<Mutex<()>>;

/// The first signal to a fit that is saved, which then ends at its next step.
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicI32>);

/// No number of a signal.
const OVER: i32 = i32::MAX;

/// A signal that comes within this time of another is taken for the same one.
const SAME: Duration = Duration::from_secs(1);

impl Interrupt {
    /// The signal's number, once there is one.
    pub fn signal(&self) -> Option<i32> {
        Some(self.0.load(Ordering::Relaxed)).filter(|&signal| signal != 0 && signal != OVER)
    }

    /// From now on the first signal ends the program: no fit is left that it could ask.
    pub fn no_more_fits(&self) {
        let _ = self.is_first(OVER);
    }

    /// Whether `signal` is the first one.
    fn is_first(&self, signal: i32) -> bool {
        self.0.compare_exchange(0, signal, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

/// Ends the program at a signal, but never between the halves of a file. A fit that is `saved` is
/// asked to end at the first one; the program ends at the second. A further one does not wait for
/// files, which may go to a FIFO without a reader.
///
/// What follows within a second is no second signal. `mpirun` and Slurm signal a process and all that
/// it has started, and a process may hand on to these what it got.
///
/// # Errors
/// [`Failure::Work`] where the system gives out no signals.
pub fn end_when_interrupted(writing: &Writing, saved: Option<&Interrupt>) -> Result<(), Failure> {
    let (writing, saved) = (Arc::clone(writing), saved.cloned());
    let (mut waits, mut heeded) = (false, None);
    on_signal(move |signal| {
        if is_the_same(&mut heeded, Instant::now()) {
            return;
        }
        if saved.as_ref().is_some_and(|interrupt| interrupt.is_first(signal)) {
            return;
        }
        let status = i32::from(status_of(signal));
        if waits {
            std::process::exit(status);
        }
        waits = true;
        let writing = Arc::clone(&writing);
        thread::spawn(move || {
            let _held = writing.lock().unwrap_or_else(PoisonError::into_inner);
            std::process::exit(status);
        });
    })
    .map_err(|error| Failure::Work(format!("no signals: {error}")))
}

/// Whether a signal that comes `now` is the one that was `heeded` last; if not, it is heeded.
fn is_the_same(heeded: &mut Option<Instant>, now: Instant) -> bool {
    let is_same = heeded.is_some_and(|heeded| now - heeded < SAME);
    if !is_same {
        *heeded = Some(now);
    }
    is_same
}

#[cfg(unix)]
fn on_signal(mut end: impl FnMut(i32) + Send + 'static) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

    let ignored = ignored();
    let all = [SIGHUP, SIGINT, SIGTERM].into_iter();
    let heeded = all.filter(|signal| ignored >> (signal - 1) & 1 == 0);
    let mut signals = signal_hook::iterator::Signals::new(heeded)?;
    thread::spawn(move || signals.forever().for_each(&mut end));
    Ok(())
}

/// The signals that this program ignores, as Linux tells: bit `k` is signal `k + 1`.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let bits = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    bits.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0)
}

#[cfg(not(unix))]
fn on_signal(mut end: impl FnMut(i32) + Send + 'static) -> Result<(), ctrlc::Error> {
    // The number that an interrupt has elsewhere.
    ctrlc::set_handler(move || end(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_that_comes_again_at_once_is_the_same() {
        let start = Instant::now();
        let mut heeded = None;
        let of = [0, 5, 999, 1000, 1500, 2100]
            .map(|ms| is_the_same(&mut heeded, start + Duration::from_millis(ms)));
        assert_eq!(of, [false, true, true, false, true, false]);
    }
}
