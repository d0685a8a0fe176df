//! Errors of fits.

use std::error::Error;
use std::fmt;
use std::sync::Arc;

use bokashi_core::{Shape, TensorError};

/// A quantity that is infinite or NaN.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quantity {
    /// The loss.
    Loss,
    /// The gradient of the loss with respect to the named parameter.
    Gradient(String),
    /// The square of the gradient with respect to the named parameter, which Adam averages.
    SquaredGradient(String),
    /// The value of the named parameter.
    Value(String),
    /// The named parameter, or its moments, as an update would leave them.
    Update(String),
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Loss => write!(f, "the loss"),
            Self::Gradient(name) => write!(f, "the gradient of {name:?}"),
            Self::SquaredGradient(name) => write!(f, "the squared gradient of {name:?}"),
            Self::Value(name) => write!(f, "the value of {name:?}"),
            Self::Update(name) => write!(f, "the update of {name:?}"),
        }
    }
}

/// The first place in a step with a number that is infinite or NaN.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Origin {
    /// The output of an operation.
    Output {
        /// The operation.
        operation: &'static str,
        /// The parameters among its inputs.
        parameters: Vec<String>,
    },
    /// A gradient that an operation's backward pass made of finite upstream gradients.
    Backward {
        /// The operation.
        operation: &'static str,
    },
    /// A value of the pipeline that no operation computed.
    Input {
        /// The shape of the value.
        shape: Shape,
    },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Output { operation, parameters } => {
                write!(f, "the output of {operation}")?;
                let words = ["of", "and"].into_iter().chain(std::iter::repeat("and"));
                parameters
                    .iter()
                    .zip(words)
                    .try_for_each(|(name, word)| write!(f, " {word} {name:?}"))
            }
            Self::Backward { operation } => write!(f, "the backward pass of {operation}"),
            Self::Input { shape } => write!(f, "an input of shape {shape}"),
        }
    }
}

/// An error of a fit. Each message says the rule, then the value that broke it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// A tensor operation refused its inputs.
    #[error(transparent)]
    Tensor(#[from] TensorError),
    /// A rendering operation refused its inputs.
    #[cfg(feature = "render")]
    #[error(transparent)]
    Render(#[from] bokashi_render_ops::RenderError),
    /// An operation of a user's own, or of another crate, refused its inputs.
    #[error(transparent)]
    Operation(OperationError),
    /// The loss of a view was refused. Of several views, it is the first.
    #[error("view {view}: {error}")]
    View {
        /// The index of the view.
        view: usize,
        /// The error of the view.
        error: Box<FitError>,
    },
    /// Another rank of the job had an error.
    #[error("rank {rank}: {message}")]
    Elsewhere {
        /// The rank. Of several ranks, it is the first.
        rank: usize,
        /// The message of its error.
        message: String,
    },
    /// The parameters of a rank differ from those of the first rank.
    #[error("all ranks need the same parameters, got others on rank {rank} at step {step}")]
    Apart {
        /// The number of updates that the parameters had.
        step: u64,
        /// The rank. Of several ranks, it is the first.
        rank: usize,
    },
    /// Ranks of a job were given other files or settings.
    #[error(
        "all ranks need the same files and settings, got another {name} on rank {}: it has {}, and rank {} \
         has {}",
        ranks[0], values[0], ranks[1], values[1]
    )]
    Unlike {
        /// The name of the file or setting.
        name: String,
        /// Two ranks that were given different ones.
        ranks: [usize; 2],
        /// The value on each of these ranks.
        values: [String; 2],
    },
    /// A number became infinite or NaN. Parameters and moments are as they were before the step.
    #[error(
        "{quantity} needs to be finite, got {value} at step {step}{}",
        origin.as_ref().map_or_else(String::new, |origin| format!(", first in {origin}"))
    )]
    NotFinite {
        /// The quantity.
        quantity: Quantity,
        /// The first value of it that is infinite or NaN.
        value: f64,
        /// The number of updates that the parameters had.
        step: u64,
        /// The first place in the step with such a number, for a loss or a gradient.
        origin: Option<Box<Origin>>,
    },
    /// No gradient can reach a parameter, by the operations that a fit's first step recorded.
    /// [`Parameter::optional`](crate::Parameter::optional) allows it.
    #[error("{parameter:?} needs a way to the loss, got {}", dead_end(*end, *is_detached))]
    NoInfluence {
        /// The name of the parameter.
        parameter: String,
        /// The last operation that depends on the parameter; `None` without one.
        end: Option<&'static str>,
        /// Whether the pipeline detached the parameter, or the output of that operation.
        is_detached: bool,
    },
    /// There is no parameter of this name.
    #[error("a parameter's name needs to be one of {known:?}, got {name:?}")]
    UnknownParameter {
        /// The name that was asked for.
        name: String,
        /// The names of all parameters.
        known: Vec<String>,
    },
    /// A file is no saved fit, or no saved fit of this kind.
    #[cfg(feature = "save")]
    #[error("a saved fit needs {rule}, got {value}")]
    Saved {
        /// The rule, as the end of "... needs ...".
        rule: String,
        /// What was found.
        value: String,
    },
    /// A file could not be read or written.
    #[cfg(feature = "save")]
    #[error("{path} could not be {done}: {message}", path = path.display())]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// The failed action: "read" or "written".
        done: &'static str,
        /// The message of the file system.
        message: String,
    },
    /// A setting breaks its rule.
    #[error("{setting} needs {rule}, got {value}")]
    Setting {
        /// The name of the setting.
        setting: &'static str,
        /// The rule, as the end of "... needs ...".
        rule: &'static str,
        /// The value given.
        value: String,
    },
}

/// Describes where the dependence on a parameter ends.
fn dead_end(end: Option<&'static str>, is_detached: bool) -> String {
    match (end, is_detached) {
        (None, false) => "a loss that does not use it".to_owned(),
        (None, true) => "one that ends where it is detached".to_owned(),
        (Some(end), false) => format!("one that ends at {end}"),
        (Some(end), true) => format!("one that ends at {end}, whose output is detached"),
    }
}

/// An error of any type, shared. Two are equal if they are the same object.
#[derive(Debug, Clone, thiserror::Error)]
#[error(transparent)]
pub struct OperationError(Arc<dyn Error + Send + Sync>);

impl PartialEq for OperationError {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl FitError {
    /// Makes a `FitError` of an error of any type, for `map_err`.
    pub fn operation(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Operation(OperationError(Arc::new(error)))
    }

    /// An error about a saved fit: its rule, as the end of "a saved fit needs ...", and what was found.
    #[cfg(feature = "save")]
    pub fn saved(rule: impl Into<String>, value: impl fmt::Display) -> Self {
        Self::Saved { rule: rule.into(), value: value.to_string() }
    }

    /// An error about `setting`: its rule, as the end of "... needs ...", and the value given.
    pub fn setting(setting: &'static str, rule: &'static str, value: impl fmt::Display) -> Self {
        Self::Setting { setting, rule, value: value.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_say_the_rule_and_then_the_value() {
        let quantity = Quantity::Gradient("sigma".into());
        let not_finite = |origin| {
            let quantity = quantity.clone();
            FitError::NotFinite { quantity, value: f64::NAN, step: 7, origin }.to_string()
        };
        let message = "the gradient of \"sigma\" needs to be finite, got NaN at step 7";
        assert_eq!(not_finite(None), message);
        let origin = |names: &[&str]| {
            let parameters = names.iter().map(|&name| name.into()).collect();
            Some(Box::new(Origin::Output { operation: "mul", parameters }))
        };
        for (names, inputs) in [
            (&[][..], ""),
            (&["a"], " of \"a\""),
            (&["a", "b", "c"], " of \"a\" and \"b\" and \"c\""),
        ] {
            let whole = format!("{message}, first in the output of mul{inputs}");
            assert_eq!(not_finite(origin(names)), whole);
        }
        let shape = [2, 3].into();
        let whole = format!("{message}, first in an input of shape [2, 3]");
        assert_eq!(not_finite(Some(Box::new(Origin::Input { shape }))), whole);

        let error = FitError::setting("resolution", "at least 1 pixel", 0);
        assert_eq!(error.to_string(), "resolution needs at least 1 pixel, got 0");

        let known = vec!["vertices".into(), "sigma".into()];
        let error = FitError::UnknownParameter { name: "sigm".into(), known };
        let message =
            "a parameter's name needs to be one of [\"vertices\", \"sigma\"], got \"sigm\"";
        assert_eq!(error.to_string(), message);
    }
}
