//! What a tape did: per operation, calls, time, bytes, and what was left out.
//!
//! While a step runs, an operation finds its counters by index; names, texts and lists are made
//! when the report is taken.

use std::borrow::Cow;
use std::fmt;
use std::time::Duration;

/// What one kind of operation did since the report was last taken.
#[derive(Debug, Clone, PartialEq)]
pub struct OperationReport {
    /// The operation's name.
    pub name: &'static str,
    /// How often it was computed.
    pub calls: u64,
    /// How often its backward pass ran.
    pub backward_calls: u64,
    /// Time spent in forward passes; zero unless the tape is timed.
    pub forward: Duration,
    /// Time spent in backward passes; zero unless the tape is timed.
    pub backward: Duration,
    /// Bytes of its outputs and of what it saved, over all calls.
    pub bytes: u64,
    /// The largest relative error of its outputs, where they were compared
    /// ([`TapeReport::with_errors`]).
    pub error: Option<f64>,
    /// The largest relative error of the gradients of its outputs, where they were compared
    /// ([`TapeReport::with_gradient_errors`]).
    pub gradient_error: Option<f64>,
}

impl OperationReport {
    /// Adds what the same kind of operation did on another tape.
    fn absorb(&mut self, other: &Self) {
        self.calls += other.calls;
        self.backward_calls += other.backward_calls;
        self.forward += other.forward;
        self.backward += other.backward;
        self.bytes += other.bytes;
    }
}

/// Adds to the entry of the same work, or makes one.
fn add_left_out(entries: &mut Vec<LeftOut>, more: LeftOut) {
    let is_same = |known: &&mut LeftOut| known.name == more.name && known.reason == more.reason;
    match entries.iter_mut().find(is_same) {
        Some(known) => known.count += more.count,
        None => entries.push(more),
    }
}

/// A piece of work that a scene did not need.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The operation.
    pub name: &'static str,
    /// Why its work was not needed.
    pub reason: Cow<'static, str>,
    /// How often.
    pub count: u64,
}

/// What a tape did since the report was last taken, in the order in which the tape first met each
/// kind of operation.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TapeReport {
    /// One entry per kind of operation.
    pub operations: Vec<OperationReport>,
    /// One entry per kind of work left out.
    pub left_out: Vec<LeftOut>,
}

impl TapeReport {
    /// Adds what another tape did.
    pub(crate) fn absorb(&mut self, other: Self) {
        for operation in other.operations {
            match self.operations.iter_mut().find(|known| known.name == operation.name) {
                Some(known) => known.absorb(&operation),
                None => self.operations.push(operation),
            }
        }
        for left_out in other.left_out {
            add_left_out(&mut self.left_out, left_out);
        }
    }

    /// The report with the largest relative error of each operation's outputs, of those of
    /// [`value_errors`](crate::value_errors).
    #[must_use]
    pub fn with_errors(mut self, errors: &[ValueError]) -> Self {
        self.fold(errors, |entry| &mut entry.error);
        self
    }

    /// The report with the largest relative error of the gradients of each operation's outputs, of
    /// those of [`gradient_errors`](crate::gradient_errors).
    #[must_use]
    pub fn with_gradient_errors(mut self, errors: &[ValueError]) -> Self {
        self.fold(errors, |entry| &mut entry.gradient_error);
        self
    }

    fn fold(
        &mut self,
        errors: &[ValueError],
        column: impl Fn(&mut OperationReport) -> &mut Option<f64>,
    ) {
        for entry in &mut self.operations {
            let matching = errors.iter().filter(|error| error.operation == Some(entry.name));
            *column(entry) = matching.filter_map(|error| error.error).reduce(f64::max);
        }
    }
}

/// How far a value, or the gradient at it, is from that of an exact recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueError {
    /// Which value of the step, in the order of recording.
    pub index: usize,
    /// The operation that computed the value; `None` for a leaf or a constant.
    pub operation: Option<&'static str>,
    /// The relative error, `max_k |rough_k - exact_k| / max_k |exact_k|`; `None` where the shapes
    /// differ, as those of what was rasterized can.
    pub error: Option<f64>,
}

/// Inputs and outputs whose unneeded gradients are counted apart; those beyond count together.
const COUNTED_APART: usize = 8;

/// The counters of one kind of operation.
#[derive(Debug)]
pub(crate) struct Count {
    pub(crate) operation: OperationReport,
    /// Calls that left no node, since no input needs a gradient.
    pub(crate) unrecorded: u64,
    /// Backward passes that did not run, since nothing that was asked for lies below.
    pub(crate) unwanted: u64,
    /// Backward passes that did not run, since nothing above used an output.
    pub(crate) unused: u64,
    inputs: [u64; COUNTED_APART],
    outputs: [u64; COUNTED_APART],
}

impl Count {
    fn new(name: &'static str) -> Self {
        let operation = OperationReport {
            name,
            calls: 0,
            backward_calls: 0,
            forward: Duration::ZERO,
            backward: Duration::ZERO,
            bytes: 0,
            error: None,
            gradient_error: None,
        };
        Self {
            operation,
            unrecorded: 0,
            unwanted: 0,
            unused: 0,
            inputs: [0; COUNTED_APART],
            outputs: [0; COUNTED_APART],
        }
    }

    /// Counts a backward pass that left out the gradient of input `i`.
    #[inline]
    pub(crate) fn leave_out_input(&mut self, i: usize) {
        self.inputs[i.min(COUNTED_APART - 1)] += 1;
    }

    /// Counts a backward pass without an upstream gradient of output `j`.
    #[inline]
    pub(crate) fn leave_out_output(&mut self, j: usize) {
        self.outputs[j.min(COUNTED_APART - 1)] += 1;
    }

    /// What was left out, in words.
    fn left_out(&self) -> impl Iterator<Item = LeftOut> {
        let whole: [(Cow<'static, str>, u64); 3] = [
            ("recording: no input needs a gradient".into(), self.unrecorded),
            ("backward: no gradient below is asked for".into(), self.unwanted),
            ("backward: no gradient reaches its outputs".into(), self.unused),
        ];
        let apart = |what: &'static str, counts: [u64; COUNTED_APART], why: &'static str| {
            counts.into_iter().enumerate().map(move |(k, count)| {
                let beyond = if k + 1 == COUNTED_APART { " and beyond" } else { "" };
                (format!("gradient of {what} {k}{beyond}: {why}").into(), count)
            })
        };
        let name = self.operation.name;
        whole
            .into_iter()
            .chain(apart("input", self.inputs, "not asked for"))
            .chain(apart("output", self.outputs, "nothing depends on it"))
            .filter(|&(_, count)| count > 0)
            .map(move |(reason, count)| LeftOut { name, reason, count })
    }
}

/// The counters of a tape. Entries stay where they are, so that operations can find theirs by
/// index.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    counts: Vec<Count>,
    /// What operations reported as left out.
    left_out: Vec<LeftOut>,
}

impl Tally {
    /// The entry of the operation `name`; a look at entry `guess` comes first.
    #[inline]
    pub(crate) fn entry(&mut self, name: &'static str, guess: u32) -> u32 {
        match self.counts.get(guess as usize) {
            Some(count) if std::ptr::eq(count.operation.name, name) => guess,
            _ => self.find(name),
        }
    }

    fn find(&mut self, name: &'static str) -> u32 {
        // A pipeline has a dozen kinds of operations: a scan beats a map.
        let known = self.counts.iter().position(|count| count.operation.name == name);
        let index = known.unwrap_or_else(|| {
            self.counts.push(Count::new(name));
            self.counts.len() - 1
        });
        index as u32
    }

    /// The counters of entry `entry`.
    #[inline]
    pub(crate) fn count(&mut self, entry: u32) -> &mut Count {
        &mut self.counts[entry as usize]
    }

    /// The name of the operation of entry `entry`.
    #[inline]
    pub(crate) fn name(&self, entry: u32) -> &'static str {
        self.counts[entry as usize].operation.name
    }

    /// Counts one piece of work left out.
    pub(crate) fn leave_out(&mut self, name: &'static str, reason: &'static str) {
        match self.left_out.iter_mut().find(|entry| entry.name == name && entry.reason == reason) {
            Some(entry) => entry.count += 1,
            None => self.left_out.push(LeftOut { name, reason: reason.into(), count: 1 }),
        }
    }

    /// Adds what another tape did.
    pub(crate) fn absorb(&mut self, other: TapeReport) {
        for operation in &other.operations {
            let entry = self.entry(operation.name, 0);
            self.count(entry).operation.absorb(operation);
        }
        for left_out in other.left_out {
            add_left_out(&mut self.left_out, left_out);
        }
    }

    /// The report so far; everything is counted from zero afterwards.
    pub(crate) fn take(&mut self) -> TapeReport {
        let mut report = TapeReport::default();
        for count in &mut self.counts {
            report.left_out.extend(count.left_out());
            let fresh = Count::new(count.operation.name);
            let Count { operation, .. } = std::mem::replace(count, fresh);
            if operation.calls + operation.backward_calls > 0 {
                report.operations.push(operation);
            }
        }
        for left_out in &mut self.left_out {
            if left_out.count > 0 {
                report.left_out.push(left_out.clone());
                left_out.count = 0;
            }
        }
        report
    }
}

/// A table for people.
impl fmt::Display for TapeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<22} {:>8} {:>8} {:>12} {:>12} {:>12} {:>9} {:>9}",
            "operation",
            "calls",
            "backward",
            "forward ms",
            "backward ms",
            "bytes",
            "error",
            "gradient"
        )?;
        let error = |error: Option<f64>| error.map_or("".into(), |error| format!("{error:.1e}"));
        for entry in &self.operations {
            writeln!(
                f,
                "{:<22} {:>8} {:>8} {:>12.3} {:>12.3} {:>12} {:>9} {:>9}",
                entry.name,
                entry.calls,
                entry.backward_calls,
                1e3 * entry.forward.as_secs_f64(),
                1e3 * entry.backward.as_secs_f64(),
                entry.bytes,
                error(entry.error),
                error(entry.gradient_error),
            )?;
        }
        for entry in &self.left_out {
            writeln!(f, "left out: {} ({}), {} times", entry.name, entry.reason, entry.count)?;
        }
        Ok(())
    }
}
