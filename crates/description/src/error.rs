//! What can go wrong with a description.

use crate::location::Location;

/// What can go wrong with a description. Each message says the rule, then the value that broke it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DescriptionError {
    /// A text would take more memory than a description may.
    #[error("{location}: at most {most} {what} are read, and there are {found}")]
    TooLarge {
        /// The file.
        location: Location,
        /// What there is too much of.
        what: &'static str,
        /// How many there may be.
        most: u64,
        /// How many there are.
        found: u64,
    },
    /// A text does not say what it should.
    #[error("{location}: {message}")]
    Content {
        /// Where.
        location: Location,
        /// The rule, and what broke it.
        message: String,
    },
}
