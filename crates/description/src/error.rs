//! What can go wrong with a description.

use crate::place::Place;

/// What can go wrong with a description. Each message says the rule, then the value that broke it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DescriptionError {
    /// A text would take more memory than a description may.
    #[error("{place}: at most {most} {what} are read, and there are {found}")]
    TooLarge {
        /// The file.
        place: Place,
        /// What there is too much of.
        what: &'static str,
        /// How many there may be.
        most: u64,
        /// How many there are.
        found: u64,
    },
    /// A text does not say what it should.
    #[error("{place}: {message}")]
    Content {
        /// Where.
        place: Place,
        /// The rule, and what broke it.
        message: String,
    },
}
