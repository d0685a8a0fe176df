//! What an entry refuses, as a case.

use bokashi_catalogue::{Entry, Outcome, Verdict};

/// Whether an entry has any wrong input.
pub(super) fn are_in(entry: &Entry) -> bool {
    entry.checks().iter().any(|check| check.refusals().next().is_some())
}

/// Every wrong input of `entry` in `f64`: its error has to have the message that the entry gives.
pub(super) fn in_double(entry: &Entry) -> Outcome {
    let refusals = entry.checks().iter().flat_map(|check| check.refusals());
    compare(refusals, |message| message)
}

/// The same in `f32`, up to the value that broke the rule: that is rounded.
pub(super) fn in_single(entry: &Entry) -> Outcome {
    let refusals = entry.checks().iter().flat_map(|check| check.refusals_in_single());
    compare(refusals, |message| message.split(", got ").next().unwrap_or(message))
}

/// What came out is the messages, a line each.
fn compare<'a, E: ToString>(
    refusals: impl Iterator<Item = (&'a str, Option<E>)>,
    rule: impl Fn(&str) -> &str,
) -> Outcome {
    let mut messages: Vec<String> = Vec::new();
    for (expected, error) in refusals {
        let Some(error) = error else {
            return Ok(Verdict::failed(format!("no error, where one says: {expected}")));
        };
        let message = error.to_string();
        if rule(&message) != rule(expected) {
            return Ok(Verdict::failed(format!("another error: {message}, not: {expected}")));
        }
        let line = format!("error: {message}");
        if !messages.contains(&line) {
            messages.push(line);
        }
    }
    if messages.is_empty() {
        return Ok(Verdict::failed("nothing was refused".to_owned()));
    }
    Ok(Verdict { outcome: messages.join("\n"), pass: true, error: None, bound: None })
}
