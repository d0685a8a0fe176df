//! What a case came to.

use serde::Serialize;

/// One case in one precision: a row of the grid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The case's number; `None` for what an operation refuses.
    pub case: Option<u32>,
    /// What is put in, in a few words.
    pub name: String,
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
