//! Fits of scenes from their start to their end, by the rules that their files have.

use std::time::Instant;

use bokashi_fit::{FitError, Stepped, agree};

use crate::description::StopEntry;
use crate::error::SceneError;
use crate::fitting::SceneFit;

/// What `[stop]` of a scene says beside the number of steps.
#[derive(Debug, Clone)]
pub struct StopRules {
    loss_below: Option<f64>,
    patience: Option<u64>,
    seconds: Option<f64>,
    started: Instant,
    least_loss: f64,
    /// Steps since the least loss.
    waited: u64,
}

impl StopRules {
    /// The rules of a fit that starts now.
    pub fn new(stop: &StopEntry) -> Self {
        Self {
            loss_below: stop.loss_below.map(|loss| loss.0),
            patience: stop.patience.map(|patience| patience.0 as u64),
            seconds: stop.seconds.map(|seconds| seconds.0),
            started: Instant::now(),
            least_loss: f64::INFINITY,
            waited: 0,
        }
    }

    /// Whether the fit ends with this step, which came after all that were asked about before.
    pub fn end_with(&mut self, step: &Stepped) -> bool {
        self.loss_ends_with(step) || self.time_is_up()
    }

    /// Whether the time is up that the fit may take. Clocks of several ranks do not agree: one decides.
    pub fn time_is_up(&self) -> bool {
        self.seconds.is_some_and(|most| self.started.elapsed().as_secs_f64() >= most)
    }

    /// As [`StopRules::end_with`], by losses alone: the same on all ranks.
    pub fn loss_ends_with(&mut self, step: &Stepped) -> bool {
        if step.loss < self.least_loss {
            (self.least_loss, self.waited) = (step.loss, 0);
        } else {
            self.waited += 1;
        }
        self.loss_below.is_some_and(|least| step.loss < least)
            || self.patience.is_some_and(|patience| self.waited >= patience)
    }
}

impl SceneFit {
    /// Steps until all steps are done, or until a rule of the scene's `[stop]` says stop. `seen` is told of
    /// each step. Of several ranks the first decides when time is up.
    ///
    /// ```no_run
    /// use bokashi_scene::{Scene, SceneFit};
    ///
    /// let mut fit = SceneFit::new(Scene::load("vase/scene.toml")?)?;
    /// fit.run(|step| println!("step {}: loss {:.3e}", step.step, step.loss))?;
    /// fit.learnt()?.save_results("vase/out")?;
    /// # Ok::<(), bokashi_scene::SceneError>(())
    /// ```
    ///
    /// # Errors
    /// As [`SceneFit::step`].
    pub fn run(&mut self, mut seen: impl FnMut(&Stepped)) -> Result<(), SceneError> {
        let mut rules = StopRules::new(self.stop());
        while let Some(step) = self.step()? {
            seen(&step);
            let ranks = self.ranks();
            let is_up = rules.time_is_up() && ranks.rank() == 0;
            let is_up = agree::<_, FitError>(&**ranks, Ok(vec![u8::from(is_up)]))?;
            if rules.loss_ends_with(&step) || is_up.iter().any(|said| *said == [1]) {
                break;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::{Count, Positive};

    /// How many of these losses are seen until the rules end the fit.
    fn seen(rules: StopEntry, losses: &[f64]) -> usize {
        let mut rules = StopRules::new(&rules);
        let steps = losses.iter().enumerate().map(|(k, &loss)| Stepped {
            step: k as u64,
            loss,
            ms: 1.0,
            preparation_ms: 0.0,
            vanished: 0,
        });
        let end = steps.into_iter().position(|step| rules.end_with(&step));
        end.map_or(losses.len(), |at| at + 1)
    }

    #[test]
    fn a_fit_ends_by_its_loss_by_patience_or_by_time() {
        let losses = [5.0, 3.0, 3.0, 4.0, 2.0, 9.0, 9.0, 9.0, 1.0];
        assert_eq!(seen(StopEntry::default(), &losses), 9);
        let below = StopEntry { loss_below: Some(Positive(3.0)), ..StopEntry::default() };
        assert_eq!(seen(below, &losses), 5);
        let patient = |steps| StopEntry { patience: Some(Count(steps)), ..StopEntry::default() };
        // The same loss again is no smaller one.
        assert_eq!(seen(patient(1), &losses), 3);
        assert_eq!(seen(patient(2), &losses), 4);
        assert_eq!(seen(patient(3), &losses), 8);
        assert_eq!(seen(patient(4), &losses), 9);
        let short = StopEntry { seconds: Some(Positive(1e-12)), ..StopEntry::default() };
        assert_eq!(seen(short, &losses), 1);
    }
}
