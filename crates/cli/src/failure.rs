//! Why the program ends without success: one line, and an exit status.

use std::fmt;
use std::process::ExitCode;

/// A reason, in one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The program was asked for what it cannot do: status 2.
    Use(String),
    /// What was asked for went wrong: status 1.
    Work(String),
    /// It was interrupted, and what is to be told of it: status 130, as a shell would report it,
    /// 128 and the signal's number.
    Interrupted(String),
}

/// The status of a program that an interrupt ended.
pub const INTERRUPTED: u8 = 130;

impl Failure {
    /// The status that the program ends with.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Use(_) => ExitCode::from(2),
            Self::Work(_) => ExitCode::FAILURE,
            Self::Interrupted(_) => ExitCode::from(INTERRUPTED),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Use(text) | Self::Work(text) | Self::Interrupted(text)) = self;
        f.write_str(&one_line(text))
    }
}

/// Text of several lines as one.
pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_one_line() {
        let failure = Failure::Work("first\n\n  second\tthird\r\n".into());
        assert_eq!(failure.to_string(), "first second third");
    }
}
