//! What samples came to, in lines and in JSON.

use std::fmt::Write as _;

use bokashi_examples::{Found, Goal, Sample, Silhouettes};
use serde_json::{Value, json};

/// What a sample came to with one seed: figures, or an error.
pub(super) struct Run {
    pub(super) sample: Sample,
    pub(super) seed: u64,
    pub(super) silhouettes: Silhouettes,
    pub(super) result: Result<Vec<Found>, String>,
}

impl Run {
    /// The figures as lines of a table.
    pub(super) fn lines(&self) -> String {
        let name = format!("{} (seed {})", self.sample.name, self.seed);
        match &self.result {
            Err(error) => format!("{name:22} {error}\n"),
            Ok(found) => found.iter().fold(String::new(), |mut lines, found| {
                // Writing to a string cannot fail.
                let _ = writeln!(lines, "{name:22} {found}");
                lines
            }),
        }
    }

    /// The figures as JSON objects; a run that failed has none.
    pub(super) fn json(&self) -> impl Iterator<Item = Value> + '_ {
        self.result.iter().flatten().map(|found| {
            let goal = match found.goal {
                Goal::None => Value::Null,
                goal => goal.to_string().into(),
            };
            json!({
                "sample": self.sample.name,
                "seed": self.seed,
                "metric": found.metric,
                "value": found.value,
                "goal": goal,
                "pass": found.passes(),
                "steps": found.steps,
                "seconds": found.seconds,
            })
        })
    }
}
