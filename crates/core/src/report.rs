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

#[cfg(test)]
mod tests {
    use crate::tape::Tape;
    use std::time::Duration;

    #[test]
    fn a_report_counts_calls_passes_and_bytes_and_starts_anew_when_taken() {
        let tape = Tape::<f32>::new();
        let x = tape.leaf(&crate::Tensor::full([10], 0.5));
        let y = x.exp().exp().sum();
        let _ = y.backward().unwrap();
        let _ = y.backward().unwrap();
        let report = tape.take_report();
        let counts = report.operations.iter().map(|o| (o.name, o.calls, o.backward_calls, o.bytes));
        let counts: Vec<_> = counts.collect();
        assert_eq!(counts, [("exp", 2, 4, 2 * 10 * 4), ("sum", 1, 2, 4)]);
        assert!(report.operations.iter().all(|o| o.forward + o.backward == Duration::ZERO));
        assert!(tape.take_report().operations.is_empty());
    }

    #[test]
    fn time_is_taken_where_it_is_asked_for() {
        let tape = Tape::<f64>::new();
        tape.set_timed(true);
        let x = tape.leaf(&crate::Tensor::full([10_000], 0.5));
        let _ = x.exp().sum().backward().unwrap();
        let report = tape.take_report();
        assert!(report.operations[0].forward > Duration::ZERO);
        assert!(report.operations[0].backward > Duration::ZERO);
    }

    #[test]
    fn what_was_left_out_is_counted_by_name_and_reason() {
        let tape = Tape::<f64>::new();
        tape.leave_out("blur", "sigma is 0");
        tape.leave_out("blur", "the image is constant");
        tape.leave_out("blur", "sigma is 0");
        let report = tape.take_report();
        assert_eq!(report.left_out.iter().map(|entry| entry.count).collect::<Vec<_>>(), [2, 1]);
        assert!(report.to_string().contains("left out: blur (sigma is 0), 2 times"));
    }
}
