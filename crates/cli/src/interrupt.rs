//! Signals that ask the program to end: an interrupt, a termination, a terminal that hangs up.
//!
//! A signal that was ignored when the program began stays ignored, as `nohup` wants it.

use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use crate::failure::{Failure, status_of};

/// Held while files are written: a program that is interrupted finishes them first.
pub type Writing = Arc<Mutex<()>>;

/// The first signal to a fit that is saved, which then ends at its next step.
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicI32>);

/// No number of a signal.
const OVER: i32 = i32::MAX;

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
/// # Errors
/// [`Failure::Work`] where the system gives out no signals.
pub fn end_when_interrupted(writing: &Writing, saved: Option<&Interrupt>) -> Result<(), Failure> {
    let (writing, saved) = (Arc::clone(writing), saved.cloned());
    let mut waits = false;
    on_signal(move |signal| {
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
