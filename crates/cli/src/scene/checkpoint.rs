//! The file in the folder of results that a fit goes on from.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bokashi_fit::{Answer, Listener, Stepped, Stop};
use bokashi_scene::{SceneError, SceneFit};
use bokashi_write::place_below;

/// Its name.
pub(super) const CHECKPOINT: &str = "checkpoint.safetensors";
/// Between two of them.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(60);

/// Saves the fit to the checkpoint of the folder `out`, which may be gone meanwhile. Of several ranks the first
/// does.
pub(super) fn save(fit: &SceneFit, out: &Path) -> Result<(), SceneError> {
    if !fit.is_first() {
        return Ok(());
    }
    let failed = |error| SceneError::Write { path: out.join(CHECKPOINT), error };
    fit.save(place_below(out, CHECKPOINT).map_err(failed)?)
}

/// Saves a fit each minute, and after every so many steps. Ranks share it: before a checkpoint that was asked for
/// they check that they have the same parameters, for only these are worth one.
pub(super) struct Checkpoint<W> {
    out: PathBuf,
    every: Option<u64>,
    saved: Instant,
    warn: W,
}

impl<W: Fn(&str)> Checkpoint<W> {
    /// In the folder `out`, after `every` so many steps, too. `warn` is told what goes wrong.
    pub(super) fn new(out: &Path, every: Option<u64>, warn: W) -> Self {
        Self { out: out.to_owned(), every, saved: Instant::now(), warn }
    }
}

impl<W: Fn(&str)> Listener<SceneFit> for Checkpoint<W> {
    fn is_shared(&self) -> bool {
        true
    }

    fn after_step(&mut self, fit: &SceneFit, _stepped: &Stepped) -> Answer<SceneError> {
        let is_due = self.every.is_some_and(|every| fit.steps_done().is_multiple_of(every));
        if is_due {
            fit.check_same()?;
        }
        if is_due || self.saved.elapsed() > BETWEEN_CHECKPOINTS {
            // Steps are worth more than a checkpoint: there may be room again before the end.
            if let Err(error) = save(fit, &self.out) {
                (self.warn)(&format!("the fit goes on, and was not saved: {error}"));
            }
            self.saved = Instant::now();
        }
        Ok(ControlFlow::Continue(()))
    }

    fn end(&mut self, fit: &SceneFit, _stop: Stop) -> Result<(), SceneError> {
        fit.check_same()
    }
}
