//! What samples came to, in lines and in JSON.

use std::fmt::Write as _;

use bokashi_examples::{Goal, Outcome, Sample, Silhouettes};
use serde_json::{Value, json};

/// What a sample came to with one seed: figures, or an error.
pub(super) struct Run {
    pub(super) sample: Sample,
    pub(super) seed: u64,
    pub(super) silhouettes: Silhouettes,
    pub(super) result: Result<Vec<Outcome>, String>,
}

impl Run {
    /// The figures as lines of a table.
    pub(super) fn lines(&self) -> String {
        let name = format!("{} (seed {})", self.sample.name, self.seed);
        match &self.result {
            Err(error) => format!("{name:22} {error}\n"),
            Ok(outcomes) => outcomes.iter().fold(String::new(), |mut lines, outcome| {
                // Writing to a string cannot fail.
                let _ = writeln!(lines, "{name:22} {outcome}");
                lines
            }),
        }
    }

    /// The figures as JSON objects; a run that failed has none.
    pub(super) fn json(&self) -> impl Iterator<Item = Value> + '_ {
        self.result.iter().flatten().map(|outcome| {
            let goal = match outcome.goal {
                Goal::None => Value::Null,
                goal => goal.to_string().into(),
            };
            json!({
                "sample": self.sample.name,
                "seed": self.seed,
                "metric": outcome.metric,
                "value": outcome.value,
                "goal": goal,
                "pass": outcome.passes(),
                "steps": outcome.steps,
                "seconds": outcome.seconds,
            })
        })
    }
}
