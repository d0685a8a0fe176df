//! What is known of one operation.

use bokashi_check::Check;

use crate::benchmark::Benchmark;
use crate::extreme::Extreme;

/// An operation, or a few with one subject: everything that a harness needs to examine it.
#[derive(Debug, Clone)]
pub struct Entry {
    name: &'static str,
    cases: u32,
    checks: Vec<Check>,
    extremes: Vec<Extreme>,
    benchmarks: Vec<Benchmark>,
}

impl Entry {
    /// An entry that has no check so far, and 24 cases for each.
    pub(crate) fn new(name: &'static str) -> Self {
        Self { name, cases: 24, checks: Vec::new(), extremes: Vec::new(), benchmarks: Vec::new() }
    }

    /// How many cases are drawn for each check that follows.
    pub(crate) fn cases(self, cases: u32) -> Self {
        Self { cases, ..self }
    }

    /// Adds a subject, a strategy for its inputs, and what it refuses.
    pub(crate) fn check(&mut self, check: Check) {
        self.checks.push(check.cases(self.cases));
    }

    /// With further extreme cases.
    pub(crate) fn with_extremes(mut self, extremes: &[Extreme]) -> Self {
        self.extremes.extend(extremes);
        self
    }

    /// Adds inputs on which time, memory and threads are examined.
    pub(crate) fn benchmark(&mut self, benchmark: Benchmark) {
        self.benchmarks.push(benchmark);
    }

    /// The name of the operation, or of the family.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Subjects, strategies for their inputs, and wrong inputs.
    pub fn checks(&self) -> &[Check] {
        &self.checks
    }

    /// Extreme inputs whose results are known.
    pub fn extremes(&self) -> &[Extreme] {
        &self.extremes
    }

    /// On what time, memory and threads are examined: none where other entries have all that it is made of.
    pub fn benchmarks(&self) -> &[Benchmark] {
        &self.benchmarks
    }
}
