//! Fits of scenes as what is driven: from their start to their end, by the rules that their files have.

use std::ops::ControlFlow;

use bokashi_fit::{
    Communicator, Observer, Parameters, Rules, Stepped, Steps, Stop, after_step, drive,
};

use crate::error::SceneError;
use crate::fitting::SceneFit;

impl SceneFit {
    /// Steps until all steps are done, or until a rule of the scene's `[stop]` says stop, and [aligns](SceneFit::align)
    /// the views that are held out. `each` is told of each step. With rules of a run and other listeners: [`drive`].
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
    pub fn run(&mut self, mut each: impl FnMut(&Stepped)) -> Result<(), SceneError> {
        let mut listener = after_step(|stepped: &Stepped| {
            each(stepped);
            ControlFlow::Continue(())
        });
        drive(self, &Rules::default(), &mut [&mut listener])?;
        self.align()
    }
}

/// A scene's rules act before a step, on the losses of those that are done; its states before updates are shown to
/// nobody.
impl Steps for SceneFit {
    type Number = f32;
    type Measure = ();
    type Error = SceneError;

    fn steps_done(&self) -> u64 {
        self.steps_done()
    }

    fn parameters(&self) -> &Parameters<f32> {
        self.parameters()
    }

    fn ranks(&self) -> &dyn Communicator<f32> {
        &**self.ranks()
    }

    fn stop(&self) -> Option<Stop> {
        self.rule().or((self.steps_done() >= self.steps()).then_some(Stop::Steps))
    }

    fn is_time_up(&self) -> bool {
        self.is_time_up()
    }

    fn step(
        &mut self,
        _observer: &mut Observer<'_, f32, ()>,
    ) -> Result<ControlFlow<Stop, Stepped>, SceneError> {
        Ok(match self.step()? {
            Some(stepped) => ControlFlow::Continue(stepped),
            None => ControlFlow::Break(Stop::Steps),
        })
    }
}
