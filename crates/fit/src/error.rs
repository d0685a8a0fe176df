//! What a caller can get wrong with fits, and what a fit can run into.

use std::error::Error;
use std::fmt;
use std::sync::Arc;

use bokashi_core::{Shape, TensorError};

/// What was found to be infinite or NaN.
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
    /// What an update would make of the named parameter, or of its moments.
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

/// Where a step was infinite or NaN first.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Origin {
    /// In an operation's output.
    Output {
        /// The operation.
        operation: &'static str,
        /// The parameters among its inputs.
        parameters: Vec<String>,
    },
    /// In what an operation's backward pass made of finite upstream gradients.
    Backward {
        /// The operation.
        operation: &'static str,
    },
    /// In a value that the pipeline brought, and no operation computed.
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
    /// The loss of a view was refused: of several, the first.
    #[error("view {view}: {error}")]
    View {
        /// The index of the view.
        view: usize,
        /// What was wrong with it.
        error: Box<FitError>,
    },
    /// Another rank of the job had an error.
    #[error("rank {rank}: {message}")]
    Elsewhere {
        /// The rank: of several, the first.
        rank: usize,
        /// What it said.
        message: String,
    },
    /// Ranks of a job have other parameters than the first one.
    #[error("all ranks need the same parameters, got others on rank {rank} at step {step}")]
    Apart {
        /// How many updates the parameters had.
        step: u64,
        /// The rank: of several, the first.
        rank: usize,
    },
    /// Ranks of a job were given other files or settings.
    #[error(
        "all ranks need the same files and settings, got another {name} on rank {}: it has {}, and rank {} \
         has {}",
        ranks[0], values[0], ranks[1], values[1]
    )]
    Unlike {
        /// The file or setting.
        name: String,
        /// Two ranks that differ.
        ranks: [usize; 2],
        /// What each of them has.
        values: [String; 2],
    },
    /// A number became infinite or NaN. Parameters and moments are as they were before the step.
    #[error(
        "{quantity} needs to be finite, got {value} at step {step}{}",
        origin.as_ref().map_or_else(String::new, |origin| format!(", first in {origin}"))
    )]
    NotFinite {
        /// What it was.
        quantity: Quantity,
        /// The first such value.
        value: f64,
        /// How many updates the parameters had.
        step: u64,
        /// Where the step was so first, of a loss or a gradient.
        origin: Option<Box<Origin>>,
    },
    /// No gradient can ever reach a parameter, in what a fit's first step recorded.
    /// [`Parameter::optional`](crate::Parameter::optional) allows it.
    #[error("{parameter:?} needs a way to the loss, got {}", dead_end(*end, *is_detached))]
    NoWay {
        /// The parameter.
        parameter: String,
        /// The last operation that depends on it; `None` where none does.
        end: Option<&'static str>,
        /// Whether the pipeline detached it, or what that operation made of it.
        is_detached: bool,
    },
    /// There is no parameter of this name.
    #[error("a parameter's name needs to be one of {known:?}, got {name:?}")]
    UnknownParameter {
        /// The name given.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// A file or its contents are no saved fit, or not one of this fit's kind.
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
        /// What should have been done to it: "read" or "written".
        done: &'static str,
        /// What the file system said.
        message: String,
    },
    /// A setting breaks its rule.
    #[error("{setting} needs {rule}, got {value}")]
    Setting {
        /// What was set.
        setting: &'static str,
        /// The rule, as the end of "... needs ...".
        rule: &'static str,
        /// The value given.
        value: String,
    },
}

/// Where the way from a parameter ends.
fn dead_end(end: Option<&'static str>, is_detached: bool) -> String {
    match (end, is_detached) {
        (None, false) => "a loss that does not use it".to_owned(),
        (None, true) => "one that ends where it is detached".to_owned(),
        (Some(end), false) => format!("one that ends at {end}"),
        (Some(end), true) => format!("one that ends at {end}, whose output is detached"),
    }
}

/// An error of any type, shared. Two are equal where they are the same one.
#[derive(Debug, Clone, thiserror::Error)]
#[error(transparent)]
pub struct OperationError(Arc<dyn Error + Send + Sync>);

impl PartialEq for OperationError {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl FitError {
    /// An error of an operation in a pipeline, whatever its type: for `map_err`.
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
