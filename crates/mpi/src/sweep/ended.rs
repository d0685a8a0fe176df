//! How the fits of a sweep end.

use serde::{Deserialize, Serialize};

/// How a fit ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Ended {
    pub(super) fit: usize,
    pub(super) rank: usize,
    pub(super) seconds: f64,
    /// What it said where it failed.
    pub(super) failure: Option<String>,
}
