//! What a tape did: per operation, calls, time, bytes, and what was left out.

use std::fmt;
use std::time::Duration;

/// What one kind of operation did since the report was last taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OperationReport {
    /// The operation's name.
    pub name: &'static str,
    /// How often it was recorded.
    pub calls: u64,
    /// How often its backward pass ran.
    pub backward_calls: u64,
    /// Time spent in forward passes; zero unless the tape is timed.
    pub forward: Duration,
    /// Time spent in backward passes; zero unless the tape is timed.
    pub backward: Duration,
    /// Bytes of its outputs and of what it saved, over all calls.
    pub bytes: u64,
}

/// A piece of work that a scene did not need.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The operation.
    pub name: &'static str,
    /// Why its work was not needed.
    pub reason: &'static str,
    /// How often.
    pub count: u64,
}

/// What a tape did since the report was last taken, in the order of first use.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// One entry per kind of operation.
    pub operations: Vec<OperationReport>,
    /// One entry per kind of work left out.
    pub left_out: Vec<LeftOut>,
}

impl Report {
    /// The entry of the operation `name`.
    pub(crate) fn operation(&mut self, name: &'static str) -> &mut OperationReport {
        // A pipeline has a dozen kinds of operations: a scan beats a map.
        let found = self.operations.iter().position(|entry| std::ptr::eq(entry.name, name));
        let found = found.or_else(|| self.operations.iter().position(|entry| entry.name == name));
        let at = found.unwrap_or_else(|| {
            self.operations.push(OperationReport {
                name,
                calls: 0,
                backward_calls: 0,
                forward: Duration::ZERO,
                backward: Duration::ZERO,
                bytes: 0,
            });
            self.operations.len() - 1
        });
        &mut self.operations[at]
    }

    /// Counts one piece of work left out.
    pub(crate) fn leave_out(&mut self, name: &'static str, reason: &'static str) {
        match self.left_out.iter_mut().find(|entry| entry.name == name && entry.reason == reason) {
            Some(entry) => entry.count += 1,
            None => self.left_out.push(LeftOut { name, reason, count: 1 }),
        }
    }
}

/// A table for people.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<22} {:>8} {:>8} {:>12} {:>12} {:>12}",
            "operation", "calls", "backward", "forward ms", "backward ms", "bytes"
        )?;
        for entry in &self.operations {
            writeln!(
                f,
                "{:<22} {:>8} {:>8} {:>12.3} {:>12.3} {:>12}",
                entry.name,
                entry.calls,
                entry.backward_calls,
                1e3 * entry.forward.as_secs_f64(),
                1e3 * entry.backward.as_secs_f64(),
                entry.bytes
            )?;
        }
        for entry in &self.left_out {
            writeln!(f, "left out: {} ({}), {} times", entry.name, entry.reason, entry.count)?;
        }
        Ok(())
    }
}
