//! Why a program ends without success, and with which exit status.

use std::fmt;
use std::process::ExitCode;

use bokashi_fit::FitError;
use bokashi_scene::SceneError;

use crate::plain::plain;

/// What `--help` says of the exit status.
pub const EXIT_STATUSES: &str = "\
Exit status:
  0    all done
  1    what was asked for went wrong
  2    a wrong request: nothing was done
  129, 130, 143
       hung up, interrupted, terminated: 128 and the signal's number
  141  whoever read standard output went away: 128 and the number of SIGPIPE";

/// A reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The command line cannot be read: status 2. The parser's whole message, of several lines.
    CommandLine(String),
    /// The program was asked for what it cannot do, which is known before any work: status 2.
    Use(String),
    /// What was asked for went wrong: status 1.
    Work(String),
    /// A signal ended it: status 128 and the signal's number, as a shell would report it.
    Interrupted {
        /// The signal's number.
        signal: i32,
        /// What is to be told of it.
        message: String,
    },
    /// Whoever read standard output went away, as `head` does: status 141, without a word, as if
    /// the signal `SIGPIPE` had ended it.
    Closed,
}

/// What went wrong with a fit, or on another rank of the job that does it.
impl From<FitError> for Failure {
    fn from(error: FitError) -> Self {
        Self::Work(error.to_string())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Work(error.to_string())
    }
}

/// The number of the signal `SIGPIPE`.
const PIPE: i32 = 13;

/// The exit status of a program that a signal ended.
pub fn status_of(signal: i32) -> u8 {
    u8::try_from(128 + signal).unwrap_or(u8::MAX)
}

impl Failure {
    /// The status that the program ends with.
    pub fn status(&self) -> u8 {
        match self {
            Self::CommandLine(_) | Self::Use(_) => 2,
            Self::Work(_) => 1,
            Self::Interrupted { signal, .. } => status_of(*signal),
            Self::Closed => status_of(PIPE),
        }
    }
}

/// One line, but for what the command line's parser says.
impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CommandLine(text) => f.write_str(&plain(text.trim_end())),
            Self::Use(text) | Self::Work(text) | Self::Interrupted { message: text, .. } => {
                f.write_str(&one_line(text))
            }
            Self::Closed => f.write_str("standard output is closed"),
        }
    }
}

/// The status that `program` ends with, after the reason on standard error.
pub fn ended(program: &str, result: Result<(), Failure>) -> ExitCode {
    let Err(failure) = result else { return ExitCode::SUCCESS };
    match &failure {
        Failure::CommandLine(_) => eprintln!("{failure}"),
        Failure::Closed => {}
        _ => eprintln!("{program}: {failure}"),
    }
    ExitCode::from(failure.status())
}

/// Text of several lines as one, for a terminal.
pub(crate) fn one_line(text: &str) -> String {
    plain(&text.split_whitespace().collect::<Vec<_>>().join(" ")).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_one_line() {
        let failure = Failure::Work("first\n\n  second\tthird\r\n".into());
        assert_eq!(failure.to_string(), "first second third");
        let failure = Failure::Work("a\u{1b}[2J".into());
        assert_eq!(failure.to_string(), "a\\u{1b}[2J");
        let failure = Failure::CommandLine("'\u{1b}[2J'\n\nUsage\n".into());
        assert_eq!(failure.to_string(), "'\\u{1b}[2J'\n\nUsage");
    }

    #[test]
    fn a_signal_is_128_and_its_number() {
        let message = String::new();
        for (signal, status) in [(1, 129), (2, 130), (15, 143)] {
            assert_eq!(Failure::Interrupted { signal, message: message.clone() }.status(), status);
        }
        assert_eq!(Failure::Closed.status(), 141);
    }
}
