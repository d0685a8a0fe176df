//! Fits of scenes from their start to their end, by the rules that their files have.

use bokashi_fit::{FitError, Stepped, agree};

use crate::error::SceneError;
use crate::fitting::SceneFit;

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
        while self.ended().is_none() && !self.is_out_of_time()? {
            let Some(step) = self.step()? else { break };
            seen(&step);
        }
        Ok(())
    }

    /// Whether the first rank says that time is up, which it never is before the first step.
    fn is_out_of_time(&self) -> Result<bool, SceneError> {
        let ranks = self.ranks();
        let is_up = self.steps_done() > 0 && self.time_is_up() && ranks.rank() == 0;
        let is_up = agree::<_, FitError>(&**ranks, Ok(vec![u8::from(is_up)]))?;
        Ok(is_up.iter().any(|said| *said == [1]))
    }
}
