//! A fit of a scene under way: its steps and its state.

use std::path::Path;
use std::sync::Arc;

use bokashi_core::Tape;
use bokashi_fit::{Fit, FitError, Given, Parameters, Ranks, Stepped, Stop, agreed, check_same};

use super::alignment::Aligned;
use super::stage::{StagePipeline, views_per_step};
use crate::description::Stage;
use crate::error::SceneError;
use crate::learnables::Values;
use crate::learning::LearntRate;
use crate::renderer::Renderer;
use crate::saved_fit::Origin;
use crate::scene::Scene;
use crate::targets::Targets;

/// The number of steps between comparisons of the ranks' parameters, which then cost next to nothing.
const BETWEEN_CHECKS: u64 = 100;

/// A fit of a scene, under way.
pub struct SceneFit {
    pub(super) renderer: Arc<Renderer>,
    pub(super) targets: Arc<Targets>,
    /// The views that are learnt from.
    pub(super) learnt_from: Arc<[usize]>,
    pub(super) stages: Vec<Stage>,
    pub(super) stage: usize,
    pub(super) fit: Fit<f32>,
    pub(super) pipeline: StagePipeline,
    pub(super) rates: Vec<LearntRate>,
    pub(super) ranks: Ranks<f32>,
    /// The scene as it was loaded, and the starts of its parameters. `None` once the fit has begun.
    pub(super) given: Option<(Arc<Scene>, Given)>,
    /// The origin of the saved fit that is resumed. `None` once the fit has begun.
    pub(super) from: Option<Origin>,
    /// The changes of the scene since the fit was saved, in words.
    pub(super) changed: Vec<String>,
    /// The starts of poses that were chosen, in words.
    pub(super) starts: Vec<String>,
    /// The held-out views that were aligned since the last step.
    pub(super) aligned: Option<Aligned>,
}

impl SceneFit {
    /// The start that was chosen for each mesh whose pose has several (`starts` of `[learn.pose]`), in words. Empty
    /// after a resume.
    pub fn starts(&self) -> &[String] {
        &self.starts
    }

    /// The changes of the scene since the resumed fit was saved, in words. They take effect from the next step on.
    pub fn changed(&self) -> &[String] {
        &self.changed
    }

    /// The rule of the scene's `[stop]` that ended the fit with its last step, in words. The rules of steps and of time
    /// are left out. [`SceneFit::step`] goes on all the same.
    pub fn ended(&self) -> Option<String> {
        self.rule()?;
        self.pipeline.rules.ended()
    }

    /// The rule of [`SceneFit::ended`].
    pub(crate) fn rule(&self) -> Option<Stop> {
        let is_last = self.stage + 1 == self.stages.len();
        // Without progress an earlier stage ends, and the next one follows.
        self.pipeline.rules.stop().filter(|&stop| is_last || stop != Stop::NoProgress)
    }

    /// The stages that a rule of the scene's `[stop]` ended early: index, steps done, and steps planned. The last stage
    /// is left out: see [`SceneFit::ended`].
    pub fn shortened_stages(&self) -> impl Iterator<Item = (usize, [u64; 2])> + '_ {
        let stages = self.stages.iter().map(|stage| stage.steps.0 as u64);
        let pairs = self.pipeline.done.iter().zip(stages).map(|(&done, steps)| [done, steps]);
        pairs.enumerate().filter(|(_, [done, steps])| done < steps)
    }

    /// Whether all runs of the fit together have taken the seconds that the scene allows. The clock of the first rank
    /// decides.
    pub fn is_time_up(&self) -> bool {
        self.pipeline.rules.is_time_up()
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        self.renderer.scene()
    }

    /// The parameters that are learnt.
    pub fn parameters(&self) -> &Parameters<f32> {
        self.fit.parameters()
    }

    /// The scene with its learnt numbers, and those of [aligned](SceneFit::align) views.
    ///
    /// # Errors
    /// Those of a parameter that is no number of the scene; no fit has one.
    pub fn learnt(&self) -> Result<Scene, SceneError> {
        self.renderer.with_values(self.shown())
    }

    /// The number of steps done, in all stages.
    pub fn steps_done(&self) -> u64 {
        self.pipeline.done.iter().sum::<u64>() + self.fit.steps_done()
    }

    /// The number of steps in all stages. A stage that is over counts with the steps that it did.
    pub fn steps(&self) -> u64 {
        let rest = self.stages[self.stage..].iter().map(|stage| stage.steps.0 as u64);
        self.pipeline.done.iter().copied().chain(rest).sum()
    }

    /// The stage of the next step, from 0.
    pub fn stage(&self) -> usize {
        self.stage
    }

    /// The number of views that a step draws, in the stage with the most.
    pub fn most_views_per_step(&self) -> usize {
        let count = |stage| views_per_step(stage, self.learnt_from.len());
        self.stages.iter().map(count).max().unwrap_or(0)
    }

    /// The ranks that share the fit; one by default.
    pub fn ranks(&self) -> &Ranks<f32> {
        &self.ranks
    }

    /// The number of bytes that all ranks together sent for the last step's gradients.
    pub fn bytes_sent(&self) -> u64 {
        self.pipeline.views.bytes_sent()
    }

    /// Does a step; `None` where all are done. All ranks make this call.
    ///
    /// # Errors
    /// As [`Fit::step`], and those of images. Parameters are then as they were before. Two errors come after the step:
    /// [`FitError::Apart`] at every hundredth step where the ranks' parameters differ, and those of held-out views that
    /// are measured.
    pub fn step(&mut self) -> Result<Option<Stepped>, SceneError> {
        self.aligned = None;
        if self.is_stage_over() {
            if self.stage + 1 == self.stages.len() {
                return Ok(None);
            }
            self.next_stage()?;
        }
        self.remesh_if_due()?;
        self.texture_if_due()?;
        let stepped = self.fit.step(&mut self.pipeline)?;
        self.pipeline.rules.count(stepped.loss);
        let measured = self.measure_if_due();
        self.fit.keep_state(&self.pipeline);
        measured?;
        if self.steps_done().is_multiple_of(BETWEEN_CHECKS) {
            self.check_same()?;
        }
        Ok(Some(stepped))
    }

    /// Checks that all ranks have the same parameters, to the bit. All ranks make this call.
    ///
    /// # Errors
    /// [`FitError::Apart`] otherwise.
    pub fn check_same(&self) -> Result<(), SceneError> {
        Ok(check_same(&*self.ranks, self.fit.parameters(), self.steps_done())?)
    }

    /// Whether the stage has done its steps, or a rule ends it and it is not the last.
    fn is_stage_over(&self) -> bool {
        let is_last = self.stage + 1 == self.stages.len();
        self.fit.steps_done() >= self.stages[self.stage].steps.0 as u64
            || !is_last && self.pipeline.rules.stop() == Some(Stop::NoProgress)
    }

    /// Measures held-out views for a rule of the scene's `[stop]`, if they are due after this step.
    ///
    /// # Errors
    /// As [`SceneFit::align`], and those of images. The step is done then.
    fn measure_if_due(&mut self) -> Result<(), SceneError> {
        if self.pipeline.rules.measures_after(self.fit.steps_done()) {
            let reduce = self.stages[self.stage].reduce.map_or(1, |reduce| reduce.0);
            let psnr = self.held_out_psnr(reduce)?;
            self.pipeline.rules.measure(psnr);
        }
        Ok(())
    }

    /// Saves the fit to the file `path`. After an error the file is as it was.
    ///
    /// # Errors
    /// As [`Fit::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SceneError> {
        Ok(self.fit.save(path)?)
    }

    /// Whether this is the first rank, which prints and writes files.
    pub fn is_first(&self) -> bool {
        self.ranks.rank() == 0
    }

    /// Does `work` on the first rank. All ranks make this call, and return when it is done.
    ///
    /// # Errors
    /// That of `work`, on all ranks.
    pub fn on_first<E: From<FitError> + ToString>(
        &self,
        work: impl FnOnce() -> Result<(), E>,
    ) -> Result<(), E> {
        agreed(&*self.ranks, if self.is_first() { work() } else { Ok(()) })
    }

    /// The number of ranks that share the fit.
    pub fn size(&self) -> usize {
        self.ranks.size()
    }

    /// The work that drawing a view leaves out, and why, by operation.
    ///
    /// # Errors
    /// Those of the operations.
    pub fn left_out(&self, view: usize) -> Result<Vec<(&'static str, String)>, SceneError> {
        let tape = Tape::new();
        let variables = self.fit.parameters().record(&tape);
        let values = Values { tape: &tape, learnt: Some(&variables) };
        let drawn = self.renderer.draw(&values, view, 1, false)?;
        self.renderer.image(&values, &drawn, 1)?;
        let report = tape.take_report();
        let all = report.left_out.into_iter();
        Ok(all.map(|entry| (entry.name, entry.reason.into_owned())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Location;
    use crate::picture::{Picture, Samples};
    use bokashi_fit::on_ranks;
    use std::fs;

    #[test]
    fn ranks_read_their_own_images_alone_and_have_the_bits_of_a_fit_alone() {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        let mut text = String::new();
        for view in 0..7 {
            let samples =
                Samples::U8((0..12 * 12 * 3).map(|k| (k * (view + 3) % 256) as u8).collect());
            let picture = Picture { width: 12, height: 12, channels: 3, samples };
            let file = folder.join(format!("{view}.png"));
            fs::write(&file, picture.encode_png(&Location::new(&file)).unwrap()).unwrap();
            text += &format!("[[views]]\nimage = \"{view}.png\"\nheld_out = {}\n", view == 2);
            text += &format!("camera = {{ position = [0.3, {view}.0, 4.0], angle = 40.0 }}\n");
        }
        text += "[[meshes]]\nshape = \"cube\"\n[learn.vertices]\n[learn.pose]\n\
                 [stop]\nsteps = 3\nviews_per_step = 6\n";
        fs::write(folder.join("scene.toml"), text).unwrap();
        let load = || Scene::load(folder.join("scene.toml")).unwrap();
        let fitted = |mut fit: SceneFit| {
            while fit.step().unwrap().is_some() {}
            let raw = fit.parameters().iter().flat_map(|parameter| parameter.raw().data().to_vec());
            (raw.map(f32::to_bits).collect::<Vec<_>>(), fit.targets.kept_views())
        };
        let (expected, all) = fitted(SceneFit::new(load()).unwrap());
        assert_eq!(all, [0, 1, 3, 4, 5, 6]);
        for size in [2, 3, 7] {
            let found = on_ranks(size, |ranks| fitted(SceneFit::among(load(), ranks).unwrap()));
            assert!(found.iter().all(|(bits, _)| *bits == expected), "{size} ranks");
            // Each image is on one rank.
            assert_eq!(found.into_iter().flat_map(|(_, views)| views).collect::<Vec<_>>(), all);
        }
    }

    /// What follows in a step may fail, meshes that get other vertices among it, and whoever saves the fit then needs
    /// all of it.
    #[test]
    fn a_fit_that_is_saved_as_a_stage_begins_goes_on_from_there() {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        let samples = Samples::U8((0..12 * 12 * 3).map(|k| (k * 5 % 256) as u8).collect());
        let picture = Picture { width: 12, height: 12, channels: 3, samples };
        let file = folder.join("0.png");
        fs::write(&file, picture.encode_png(&Location::new(&file)).unwrap()).unwrap();
        let text = "[[views]]\nimage = \"0.png\"\ncamera = { position = [0, 0, 4], angle = 40 }\n\
                    [[meshes]]\nshape = \"cube\"\n[learn.vertices]\n\
                    [[stages]]\nsteps = 2\n[[stages]]\nsteps = 2\nremesh = { length = 0.9 }\n";
        fs::write(folder.join("scene.toml"), text).unwrap();
        let fit = || SceneFit::new(Scene::load(folder.join("scene.toml")).unwrap()).unwrap();
        let bits = |mut fit: SceneFit| {
            while fit.step().unwrap().is_some() {}
            let raw = fit.parameters().iter().flat_map(|parameter| parameter.raw().data().to_vec());
            raw.map(f32::to_bits).collect::<Vec<_>>()
        };
        let mut begun = fit();
        for _ in 0..2 {
            begun.step().unwrap();
        }
        begun.next_stage().unwrap();
        let saved = folder.join("saved");
        begun.save(&saved).unwrap();
        let scene = Scene::load(folder.join("scene.toml")).unwrap();
        assert_eq!(bits(SceneFit::resume(scene, &saved).unwrap()), bits(fit()));
    }
}
