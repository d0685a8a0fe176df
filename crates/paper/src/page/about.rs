//! Circumstances of a report.

/// Circumstances of a report that its fits don't know.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct About {
    /// The program and its version.
    pub program: String,
    /// The command that made the report.
    pub command: String,
    /// How many threads it had.
    pub threads: usize,
}
