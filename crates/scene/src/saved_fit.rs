//! What is saved with a fit of a scene beside its numbers: how far it is, and what it was given.

use bokashi_fit::{Difference, FitError, Given, described, differences};
use serde::{Deserialize, Serialize};

use crate::stopping::Seen;

/// The version of what follows.
const VERSION: u64 = 1;

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Progress {
    pub(crate) stage: usize,
    pub(crate) seen: Seen,
}

/// What a fit was given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Origin {
    /// Files and settings.
    pub(crate) given: Given,
    /// Where its parameters started.
    pub(crate) starts: Given,
}

impl Progress {
    /// The bytes of both; `origin` is as [`Origin::to_bytes`] made it, once for all steps.
    pub(crate) fn write(&self, origin: &[u8], bytes: &mut Vec<u8>) {
        bytes.extend(format!("scene {VERSION}\n").bytes());
        bytes.extend(serde_json::to_vec(self).expect("they are numbers"));
        bytes.push(b'\n');
        bytes.extend(origin);
    }
}

impl Origin {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("they are words")
    }

    /// What changes nothing of what is done, and takes effect from now on, in words.
    ///
    /// # Errors
    /// [`FitError::Saved`] where parameters start elsewhere: what was learnt since has their place; and
    /// where stages were changed that are done, before `stage`.
    pub(crate) fn changed_to(&self, now: &Self, stage: usize) -> Result<Vec<String>, FitError> {
        let refused = |rule: &str, difference: &Difference| {
            let (before, other) =
                (described(difference.this.as_ref()), described(difference.other.as_ref()));
            FitError::saved(format!("{rule}: {}, {before}", difference.name), other)
        };
        if let Some(difference) = differences(&self.starts, &now.starts).first() {
            return Err(refused("the start that it learnt from", difference));
        }
        let changed = differences(&self.given, &now.given);
        let is_done = |difference: &&Difference| {
            (0..stage).any(|stage| difference.name.starts_with(&format!("`stages[{stage}]")))
        };
        if let Some(difference) = changed.iter().find(is_done) {
            return Err(refused("the stages that are done as they were", difference));
        }
        let words = changed.into_iter().map(|difference| {
            let (was, is) =
                (described(difference.this.as_ref()), described(difference.other.as_ref()));
            format!("{}: {is} from now on, and {was} before", difference.name)
        });
        Ok(words.collect())
    }
}

/// What [`Progress::write`] wrote.
///
/// # Errors
/// [`FitError::Saved`] for anything else.
pub(crate) fn read(state: &[u8]) -> Result<(Progress, Origin), FitError> {
    let rule = || "a fit of a scene, as this version saves it".to_owned();
    let mut parts = state.splitn(3, |&byte| byte == b'\n');
    let (head, progress, origin) = (parts.next(), parts.next(), parts.next());
    if head != Some(format!("scene {VERSION}").as_bytes()) {
        return Err(FitError::saved(rule(), "another"));
    }
    let foreign = |error: serde_json::Error| FitError::saved(rule(), error);
    let progress = serde_json::from_slice(progress.unwrap_or_default()).map_err(foreign)?;
    let origin = serde_json::from_slice(origin.unwrap_or_default()).map_err(foreign)?;
    Ok((progress, origin))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::StopEntry;
    use crate::stopping::StopRules;

    #[test]
    fn whatever_a_state_is_it_is_a_fits_or_refused() {
        let mut rules = StopRules::new(&StopEntry::default(), Seen::default());
        rules.count(0.1 + 0.2);
        let progress = Progress { stage: 3, seen: rules.seen() };
        let words = |all: &[(&str, &str)]| -> Given {
            all.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
        };
        let origin = Origin { given: words(&[("a\n", "\"1\"")]), starts: words(&[("b", "")]) };
        let mut bytes = Vec::new();
        progress.write(&origin.to_bytes(), &mut bytes);
        assert_eq!(read(&bytes).unwrap(), (progress, origin));
        for length in 0..bytes.len() {
            assert!(read(&bytes[..length]).is_err(), "{length}");
        }
    }
}
