//! What a caller can get wrong with tensors and tapes.

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;

use crate::shape::Shape;

/// An error of a tensor operation. Each message says the rule, then the value that broke it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TensorError {
    /// The data has not as many entries as the shape.
    Length {
        /// The shape asked for.
        shape: Shape,
        /// The number of entries given.
        entries: usize,
    },
    /// Two shapes do not broadcast.
    Broadcast {
        /// The operation.
        operation: &'static str,
        /// The operands' shapes, left and right; boxed, so that a `Result` stays small.
        shapes: Box<[Shape; 2]>,
    },
    /// An input's shape breaks the operation's rule.
    Shape {
        /// The operation.
        operation: &'static str,
        /// The rule, as the end of "... needs ..."; it can name what it expected.
        rule: Cow<'static, str>,
        /// The shape given.
        shape: Shape,
    },
    /// Two shapes that must fit each other do not.
    Mismatch {
        /// The operation.
        operation: &'static str,
        /// The rule, as the end of "... needs ..."; it can name what it expected.
        rule: Cow<'static, str>,
        /// The two shapes; boxed, so that a `Result` stays small.
        shapes: Box<[Shape; 2]>,
    },
    /// There is no such axis.
    Axis {
        /// The operation.
        operation: &'static str,
        /// The axis given.
        axis: usize,
        /// The shape of the input.
        shape: Shape,
    },
    /// A list of axes breaks the operation's rule.
    Axes {
        /// The operation.
        operation: &'static str,
        /// The axes given.
        axes: Box<[usize]>,
        /// The shape of the input.
        shape: Shape,
    },
    /// A range lies outside an axis, or ends before it starts.
    Range {
        /// The operation.
        operation: &'static str,
        /// The range given.
        range: Range<usize>,
        /// The extent of the axis.
        extent: usize,
    },
    /// An index lies outside an axis.
    Index {
        /// The operation.
        operation: &'static str,
        /// The first index that is too large.
        index: usize,
        /// The extent of the axis.
        extent: usize,
    },
    /// There is no room for an operation's output.
    Memory {
        /// The operation.
        operation: &'static str,
        /// The shape of the output.
        shape: Shape,
    },
    /// A parameter of an operation breaks its rule.
    Value {
        /// The operation.
        operation: &'static str,
        /// The rule, as the end of "... needs ..."; it can name what it expected.
        rule: Cow<'static, str>,
        /// The value given.
        value: f64,
    },
    /// The bounds of an interval are not in order.
    Bounds {
        /// The operation.
        operation: &'static str,
        /// The lower one given.
        low: f64,
        /// The upper one given.
        high: f64,
    },
    /// An operation got the wrong number of inputs.
    Inputs {
        /// The operation.
        operation: &'static str,
        /// The rule, as the end of "... needs ..."; it can name what it expected.
        rule: Cow<'static, str>,
        /// The number given.
        given: usize,
    },
    /// A variable belongs to another tape.
    ForeignVariable {
        /// The operation.
        operation: &'static str,
    },
    /// A backward pass without an upstream gradient starts at something other than a scalar.
    NotScalar {
        /// The shape of the variable.
        shape: Shape,
    },
    /// A backward pass is asked for over numbers that have none.
    ForwardOnly {
        /// Their type.
        numbers: &'static str,
    },
    /// Two recordings are not of one pipeline.
    Recordings {
        /// The first value that differs, in the order of recording.
        value: usize,
        /// What computed it on either tape.
        operations: [&'static str; 2],
    },
}

impl fmt::Display for TensorError {
    // In one piece: a list of messages.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length { shape, entries } => match shape.checked_size() {
                Some(size) => write!(f, "shape {shape} needs {size} entries, got {entries}"),
                None => {
                    write!(f, "shape {shape} needs more entries than fit an index, got {entries}")
                }
            },
            Self::Broadcast { operation, shapes } => {
                let [left, right] = &**shapes;
                write!(f, "{operation} needs shapes that broadcast, got {left} and {right}")
            }
            Self::Shape { operation, rule, shape } => {
                write!(f, "{operation} needs {rule}, got shape {shape}")
            }
            Self::Mismatch { operation, rule, shapes } => {
                let [left, right] = &**shapes;
                write!(f, "{operation} needs {rule}, got shapes {left} and {right}")
            }
            Self::Axis { operation, axis, shape } => write!(
                f,
                "{operation} needs an axis below the rank {}, got axis {axis} of shape {shape}",
                shape.rank()
            ),
            Self::Axes { operation, axes, shape } => {
                write!(f, "{operation} needs each axis of shape {shape} once, got axes {axes:?}")
            }
            Self::Range { operation, range: Range { start, end }, extent } => write!(
                f,
                "{operation} needs a range within an axis of extent {extent}, got {start}..{end}"
            ),
            Self::Index { operation, index, extent } => {
                write!(
                    f,
                    "{operation} needs indices within an axis of extent {extent}, got {index}"
                )
            }
            Self::Value { operation, rule, value } => {
                write!(f, "{operation} needs {rule}, got {value}")
            }
            Self::Memory { operation, shape } => {
                write!(f, "{operation} needs memory for its output, got shape {shape}")
            }
            Self::Bounds { operation, low, high } => {
                write!(f, "{operation} needs bounds with low <= high, got {low} and {high}")
            }
            Self::Inputs { operation, rule, given } => {
                write!(f, "{operation} needs {rule}, got {given} inputs")
            }
            Self::ForeignVariable { operation } => {
                write!(f, "{operation} needs variables of one tape, got one of another")
            }
            Self::NotScalar { shape } => write!(
                f,
                "a backward pass without an upstream gradient needs a scalar, got shape {shape}"
            ),
            Self::ForwardOnly { numbers } => {
                write!(f, "a backward pass needs numbers that are not forward-only, got {numbers}")
            }
            Self::Recordings { value, operations: [rough, exact] } => write!(
                f,
                "a comparison needs two recordings of one pipeline, \
                 got {rough} and {exact} as value {value}"
            ),
        }
    }
}

impl std::error::Error for TensorError {}
