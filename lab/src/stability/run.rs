//! Running cases: each in a thread of its own, so that a panic or a hang is a failed row.

use std::any::Any;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use bokashi_catalogue::{Outcome, Verdict};

/// How long a case may take: many times what the slowest one needs without optimization.
pub(super) const LIMIT: Duration = Duration::from_secs(120);

/// What `case` comes to, within `limit`. A case that does not end is left behind in its thread.
pub(super) fn run(case: impl FnOnce() -> Outcome + Send + 'static, limit: Duration) -> Verdict {
    let (sender, receiver) = channel();
    let thread = thread::spawn(move || {
        // The receiver is gone where the time was up.
        let _ = sender.send(case());
    });
    match receiver.recv_timeout(limit) {
        Ok(Ok(verdict)) => verdict,
        Ok(Err(error)) => Verdict::failed(format!("an error that was not expected: {error}")),
        Err(RecvTimeoutError::Timeout) => {
            Verdict::failed(format!("did not end within {} s", limit.as_secs_f64()))
        }
        Err(RecvTimeoutError::Disconnected) => match thread.join() {
            Err(panic) => Verdict::failed(format!("panicked: {}", message(&*panic))),
            Ok(()) => Verdict::failed("ended without a word"),
        },
    }
}

/// The message of a panic.
fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref().copied()).unwrap_or("no message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_a_failed_row_with_its_message() {
        let verdict = run(|| panic!("index {} of 3", 7), LIMIT);
        assert_eq!((verdict.pass, &*verdict.outcome), (false, "panicked: index 7 of 3"));
        let verdict = run(|| panic!("plain"), LIMIT);
        assert_eq!(verdict.outcome, "panicked: plain");
    }

    #[test]
    fn a_hang_is_a_failed_row() {
        let forever = || loop {
            thread::park();
        };
        let verdict = run(forever, Duration::from_millis(50));
        assert_eq!((verdict.pass, &*verdict.outcome), (false, "did not end within 0.05 s"));
    }

    #[test]
    fn an_unexpected_error_is_a_failed_row() {
        let verdict = run(|| Err("no such thing".into()), LIMIT);
        let outcome = "an error that was not expected: no such thing";
        assert_eq!((verdict.pass, &*verdict.outcome), (false, outcome));
    }
}
