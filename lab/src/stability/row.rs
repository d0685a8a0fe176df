//! What a case came to.

use std::error::Error;
use std::fmt::Display;

use serde::Serialize;

/// One case in one precision: a row of the grid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The case's number.
    pub case: u32,
    /// What is put in, in a few words.
    pub name: &'static str,
    /// The precision: `f32` or `f64`.
    pub precision: &'static str,
    /// What has to come out.
    pub expected: &'static str,
    /// What came out.
    pub outcome: String,
    /// Whether that is what had to.
    pub pass: bool,
    /// How far it is from the exact answer, where there is one.
    pub error: Option<f64>,
    /// The largest error that passes.
    pub bound: Option<f64>,
}

/// What a case found.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub(super) outcome: String,
    pub(super) pass: bool,
    pub(super) error: Option<f64>,
    pub(super) bound: Option<f64>,
}

/// An error that a case did not expect.
pub(super) type Failure = Box<dyn Error + Send + Sync>;

/// What a case gives: an error that it did not expect is a failed row.
pub(super) type Outcome = Result<Found, Failure>;

impl Found {
    /// `outcome`, as long as `error` is no larger than `bound`; a NaN is.
    pub(super) fn within(outcome: impl Into<String>, error: f64, bound: f64) -> Self {
        let (pass, outcome) = (error <= bound, outcome.into());
        let outcome = if pass { outcome } else { format!("off by {error:.1e} from: {outcome}") };
        Self { outcome, pass, error: Some(error), bound: Some(bound) }
    }

    /// `outcome`, where nothing but exactly the right answer passes and `wrong` counts the others.
    pub(super) fn exactly(outcome: impl Into<String>, wrong: usize) -> Self {
        Self::within(outcome, wrong as f64, 0.0)
    }

    /// Every one of the results has to be the error with the message beside it.
    pub(super) fn refused(results: Vec<(Result<(), String>, String)>) -> Self {
        let mut outcome = String::new();
        for (result, message) in results {
            match result {
                Err(said) if said == message => {
                    if outcome.is_empty() {
                        outcome = format!("error: {said}");
                    }
                }
                Err(said) => return Self::failed(format!("another error: {said}")),
                Ok(()) => return Self::failed(format!("no error, where one says: {message}")),
            }
        }
        Self { outcome, pass: true, error: None, bound: None }
    }

    /// A failure.
    pub(super) fn failed(outcome: impl Into<String>) -> Self {
        Self { outcome: outcome.into(), pass: false, error: None, bound: None }
    }

    /// The same, as long as another condition holds.
    pub(super) fn and(self, holds: bool, otherwise: impl Display) -> Self {
        if holds {
            return self;
        }
        Self { outcome: format!("{}; but {otherwise}", self.outcome), pass: false, ..self }
    }
}

/// A result whose value does not matter, with its error as text.
pub(super) fn told<V, E: Display>(result: Result<V, E>) -> Result<(), String> {
    result.map(drop).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_error_within_the_bound_passes() {
        assert!(Found::within("", 1.0, 1.0).pass);
        for (error, bound) in [(1.1, 1.0), (f64::NAN, 1.0), (f64::INFINITY, 1.0), (1.0, f64::NAN)] {
            assert!(!Found::within("", error, bound).pass);
        }
        assert_eq!(Found::exactly("none", 3).outcome, "off by 3.0e0 from: none");
        let found = Found::exactly("right", 0).and(false, "late");
        assert_eq!((found.pass, &*found.outcome), (false, "right; but late"));
    }

    #[test]
    fn only_the_expected_message_is_a_refusal() {
        let refused = |result| Found::refused(vec![(result, "no".to_owned())]);
        assert!(refused(Err("no".to_owned())).pass);
        assert!(!refused(Err("yes".to_owned())).pass && !refused(Ok(())).pass);
    }
}
