//! Extreme cases of an operation: what is put in, what has to come out, what came out.
//!
//! Every case runs in `f32` and in `f64`. Wherever there is an exact answer, the case compares with
//! it. The answer is worked out another way: in whole numbers, by a linear system per pixel, by a
//! double sum over taps, or by hand. The case says how far off it is and how far it may be.

use std::error::Error;
use std::fmt::Display;

/// A case: what is put in, what has to come out, and a run in each precision.
#[derive(Debug, Clone, Copy)]
pub struct Extreme {
    /// Its number in the grid. From 1 to 50 they are those of the list that the project set out with.
    pub number: u32,
    /// What is put in, in a few words.
    pub name: &'static str,
    /// What has to come out.
    pub expected: &'static str,
    /// Runs it in `f32`.
    pub single: fn() -> Outcome,
    /// Runs it in `f64`.
    pub double: fn() -> Outcome,
}

/// A list of cases, each with the function that runs it in any precision. It is for a static, so that no
/// crate that asks for the cases compiles them once more.
macro_rules! extremes {
    ($($number:literal $name:literal, $expected:literal, $run:ident;)*) => {
        &[$(Extreme {
            number: $number,
            name: $name,
            expected: $expected,
            single: $run::<f32>,
            double: $run::<f64>,
        },)*]
    };
}
pub(crate) use extremes;

/// What a case came to.
#[derive(Debug, Clone)]
pub struct Verdict {
    /// What came out.
    pub outcome: String,
    /// Whether that is what had to.
    pub pass: bool,
    /// How far it is from the exact answer, where there is one.
    pub error: Option<f64>,
    /// The largest error that passes.
    pub bound: Option<f64>,
}

/// An error that a case did not expect.
pub type Failure = Box<dyn Error + Send + Sync>;

/// What a case gives: with an error that it did not expect it has failed.
pub type Outcome = Result<Verdict, Failure>;

impl Verdict {
    /// `outcome`, as long as `error` is no larger than `bound`; a NaN is.
    pub fn within(outcome: impl Into<String>, error: f64, bound: f64) -> Self {
        let (pass, outcome) = (error <= bound, outcome.into());
        let outcome = if pass { outcome } else { format!("off by {error:.1e} from: {outcome}") };
        Self { outcome, pass, error: Some(error), bound: Some(bound) }
    }

    /// `outcome`, where nothing but exactly the right answer passes and `wrong` counts the others.
    pub fn exactly(outcome: impl Into<String>, wrong: usize) -> Self {
        Self::within(outcome, wrong as f64, 0.0)
    }

    /// Every one of the results has to be the error with the message beside it.
    pub fn refused(results: Vec<(Result<(), String>, String)>) -> Self {
        let mut outcome = String::new();
        for (result, expected) in results {
            match result {
                Err(message) if message == expected => {
                    if outcome.is_empty() {
                        outcome = format!("error: {message}");
                    }
                }
                Err(message) => return Self::failed(format!("another error: {message}")),
                Ok(()) => return Self::failed(format!("no error, where one says: {expected}")),
            }
        }
        Self { outcome, pass: true, error: None, bound: None }
    }

    /// A failure.
    pub fn failed(outcome: impl Into<String>) -> Self {
        Self { outcome: outcome.into(), pass: false, error: None, bound: None }
    }

    /// The same, as long as another condition holds.
    #[must_use]
    pub fn and(self, holds: bool, otherwise: impl Display) -> Self {
        if holds {
            return self;
        }
        Self { outcome: format!("{}; but {otherwise}", self.outcome), pass: false, ..self }
    }
}

/// A result whose value does not matter, with its error as text.
pub(crate) fn keep_error<V, E: Display>(result: Result<V, E>) -> Result<(), String> {
    result.map(drop).map_err(|error| error.to_string())
}
