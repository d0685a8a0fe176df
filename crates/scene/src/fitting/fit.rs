//! A fit of a scene, from its start or a file to its end.

use std::path::Path;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::{
    Alone, Fit, FitError, Given, Parameters, Preconditioner, Ranks, Stepped, Stop, agreed,
    check_alike, check_same, saved,
};

use super::alignment::Aligned;
use super::fields::{check_fields, check_stage_under_way, is_of_field, learns_fields, settled};
use super::remeshing::{Carried, check_remeshing, remeshed};
use super::stage::{
    StagePipeline, check_stages, drawing_of, set_rates, settings, stages, views_of, views_per_step,
    views_to_learn_from,
};
use super::starts::{Search, Start};
use super::texturing::{check_texturing, textured};
use crate::description::{Remesh, Stage};
use crate::error::SceneError;
use crate::given::starts;
use crate::learnables::{Frame, Values};
use crate::learning::{Learnt, LearntRate};
use crate::memory::OF_FITTED_PIXEL;
use crate::renderer::Renderer;
use crate::saved_fit::{self, Origin, Surface, surfaces_to_bytes};
use crate::scene::{Scene, check_views};
use crate::stopping::StopRules;
use crate::targets::Targets;

/// After so many steps the ranks of a job compare their parameters: seldom enough that nobody notices.
const BETWEEN_CHECKS: u64 = 100;

/// A fit of a scene, under way.
pub struct SceneFit {
    pub(super) renderer: Arc<Renderer>,
    pub(super) targets: Arc<Targets>,
    /// The views that are learnt from.
    learnt_from: Arc<[usize]>,
    pub(super) stages: Vec<Stage>,
    pub(super) stage: usize,
    pub(super) fit: Fit<f32>,
    pipeline: StagePipeline,
    pub(super) rates: Vec<LearntRate>,
    pub(super) ranks: Ranks<f32>,
    /// The scene as it was loaded, and where its parameters start, until the fit begins.
    given: Option<(Arc<Scene>, Given)>,
    /// What the fit was given that it goes on from, until it begins.
    from: Option<Origin>,
    /// What was changed since the fit was saved, in words.
    changed: Vec<String>,
    /// Which starts of poses were taken, in words.
    starts: Vec<String>,
    /// What was aligned since the last step.
    pub(super) aligned: Option<Aligned>,
}

/// What a fit goes on with whose meshes got other vertices, or a texture.
struct Remade {
    renderer: Arc<Renderer>,
    learnt: Learnt,
    parameters: Parameters<f32>,
    /// As they are saved.
    surfaces: Vec<u8>,
}

impl SceneFit {
    /// A fit of `scene` from its start.
    ///
    /// # Errors
    /// Whatever is wrong with what is to be learnt; [`SceneError::Content`] where no view can be learnt from.
    pub fn new(scene: Scene) -> Result<Self, SceneError> {
        Self::prepare(scene, None, Arc::new(Alone))?.begun()
    }

    /// [`SceneFit::new`] of a fit that the ranks of a job share: in steps each computes the losses of
    /// some of the views; of others it reads images only to compare what all ranks were given. All have the same
    /// parameters, to the bits of a fit alone.
    ///
    /// All ranks make the same calls of what says that they share it, and then an error of one is an error
    /// of all.
    ///
    /// # Errors
    /// As [`SceneFit::new`].
    pub fn among(scene: Scene, ranks: Ranks<f32>) -> Result<Self, SceneError> {
        let fit = Self::prepare(scene, None, Arc::clone(&ranks));
        agreed(&*ranks, fit)?.begun()
    }

    /// [`SceneFit::resume`] of a fit that the ranks of a job share, however many saved it: see
    /// [`SceneFit::among`]. The first rank reads the file.
    ///
    /// # Errors
    /// As [`SceneFit::resume`].
    pub fn resume_among(
        scene: Scene,
        path: impl AsRef<Path>,
        ranks: Ranks<f32>,
    ) -> Result<Self, SceneError> {
        let bytes = match ranks.rank() {
            0 => saved::read(path.as_ref()),
            _ => Ok(Vec::new()),
        };
        let mut bytes = agreed(&*ranks, bytes)?;
        ranks.broadcast_bytes(&mut bytes, 0);
        let fit = Self::prepare(scene, Some(&bytes), Arc::clone(&ranks));
        agreed(&*ranks, fit)?.begun()
    }

    /// [`SceneFit::among`], or [`SceneFit::resume_among`] of the file `resume`, of the scene that `load` gives: it
    /// is told whether this is the first of the ranks. `settings` are what a program was asked for, by name.
    ///
    /// # Errors
    /// Those of `load` and of the fit; [`FitError::Unlike`] where ranks have other settings, with which they
    /// would wait for each other for ever.
    pub fn begin_among<E: From<FitError> + From<SceneError> + ToString>(
        ranks: &Ranks<f32>,
        settings: &Given,
        resume: Option<&Path>,
        load: impl FnOnce(bool) -> Result<Scene, E>,
    ) -> Result<Self, E> {
        let scene = agreed(&**ranks, load(ranks.rank() == 0))?;
        check_alike(&**ranks, settings)?;
        let ranks = Arc::clone(ranks);
        Ok(match resume {
            Some(path) => Self::resume_among(scene, path, ranks)?,
            None => Self::among(scene, ranks)?,
        })
    }

    /// The fit that was saved to the file `path`. It goes on to the same bits as if it had not been
    /// interrupted, where the scene is the same. What was changed in the scene takes effect from the next
    /// step on, as if the fit had been so from its start: [`SceneFit::changed`] names it.
    ///
    /// # Errors
    /// As [`SceneFit::new`]; [`SceneError::Fit`] for a file that is no saved fit, and where the scene learns
    /// something else now, from elsewhere, or after other stages that are done.
    pub fn resume(scene: Scene, path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let bytes = saved::read(path.as_ref())?;
        Self::prepare(scene, Some(&bytes), Arc::new(Alone))?.begun()
    }

    fn prepare(
        scene: Scene,
        saved_fit: Option<&[u8]>,
        ranks: Ranks<f32>,
    ) -> Result<Self, SceneError> {
        check_views(&scene.folder, &scene.views, &scene.description, OF_FITTED_PIXEL)?;
        let learnt_from = views_to_learn_from(&scene)?;
        let description = &scene.description;
        let stages = stages(description);
        check_fields(&scene, &stages)?;
        check_remeshing(&scene, &stages)?;
        let (progress, surfaces, from) = saved_fit::read_file(saved_fit)?;
        let (rules, seed) = (StopRules::new(&description.stop, progress.rules), description.seed);
        let stage = progress.done.len();
        let first = stage_of(&stages, stage)?;
        let scene = Arc::new(scene);
        let learnt = Learnt::from_scene(&scene)?;
        let given = Some((Arc::clone(&scene), starts(&learnt.parameters)));
        check_stages(&scene, &learnt.rates)?;
        check_texturing(&scene, &stages, &learnt.rates)?;
        let (renderer, learnt) = with_surfaces(scene, learnt, &surfaces)?;
        check_stage_under_way(renderer.scene(), &first)?;
        let Learnt { parameters, rates, regularizers, preconditioners } = learnt;
        let targets = Arc::new(Targets::new(Arc::clone(&renderer), is_dense(&renderer)));
        let settings = settings(&first);
        let mut fit = match saved_fit {
            Some(bytes) => resumed(bytes, &preconditioners, &parameters)?,
            None => Fit::new(parameters, settings)?,
        };
        set_rates(fit.parameters_mut(), &rates, &first)?;
        fit.set_settings(settings)?;
        let drawing = drawing_of(&renderer);
        let pipeline = StagePipeline {
            done: progress.done,
            views: views_of(&drawing, &targets, &learnt_from, &first, seed)
                .among(Arc::clone(&ranks)),
            drawing,
            regularizers: regularizers.into(),
            rules,
            remeshed: progress.remeshed,
            surfaces: surfaces_to_bytes(&surfaces).into(),
            origin: Arc::new([]),
        };
        Ok(Self {
            renderer,
            targets,
            learnt_from,
            stages,
            stage,
            fit,
            pipeline,
            rates,
            ranks,
            given,
            from,
            changed: Vec::new(),
            starts: Vec::new(),
            aligned: None,
        })
    }

    /// The fit, where all ranks, which share this call, were given the same; it knows what was changed since it
    /// was saved.
    fn begun(mut self) -> Result<Self, SceneError> {
        let Some((scene, starts)) = self.given.take() else { return Ok(self) };
        let origin = Origin { given: scene.given_among(&*self.ranks)?, starts };
        check_alike(&*self.ranks, &origin.starts)?;
        match self.from.take() {
            Some(from) => self.changed = from.changed_to(&origin, self.stage)?,
            None => self.choose_starts()?,
        }
        self.pipeline.origin = origin.to_bytes().into();
        self.fit.keep_state(&self.pipeline);
        Ok(self)
    }

    /// Moves poses to the best of the starts that the scene asks for.
    fn choose_starts(&mut self) -> Result<(), SceneError> {
        let Self { renderer, targets, ranks, .. } = self;
        let Some(search) = Search::new(renderer, targets, ranks) else { return Ok(()) };
        let starts = search.best(self.fit.parameters())?;
        for Start { name, motion, .. } in &starts {
            self.fit.parameters_mut().set_value(name, &Tensor::from(*motion))?;
        }
        self.starts = starts.iter().map(Start::to_string).collect();
        self.targets.forget();
        Ok(())
    }

    /// Of each mesh whose pose has several starts (`starts` of `[learn.pose]`), which of them was taken, in words.
    /// Empty of a fit that was resumed.
    pub fn starts(&self) -> &[String] {
        &self.starts
    }

    /// What was changed in the scene since the fit was saved that it goes on from, in words. It takes effect
    /// from the next step on.
    pub fn changed(&self) -> &[String] {
        &self.changed
    }

    /// The rule of the scene's `[stop]` that ended the fit with its last step, in words, but for those of
    /// steps and of time. [`SceneFit::step`] goes on all the same.
    pub fn ended(&self) -> Option<String> {
        self.rule()?;
        self.pipeline.rules.ended()
    }

    /// [`SceneFit::ended`], not in words.
    pub(crate) fn rule(&self) -> Option<Stop> {
        let is_last = self.stage + 1 == self.stages.len();
        // Without progress an earlier stage ends, and the next one follows.
        self.pipeline.rules.stop().filter(|&stop| is_last || stop != Stop::NoProgress)
    }

    /// The stages that a rule of the scene's `[stop]` ended early, by their indices: how many steps they did, of how
    /// many. But for the last one: see [`SceneFit::ended`].
    pub fn shortened_stages(&self) -> impl Iterator<Item = (usize, [u64; 2])> + '_ {
        let stages = self.stages.iter().map(|stage| stage.steps.0 as u64);
        let pairs = self.pipeline.done.iter().zip(stages).map(|(&done, steps)| [done, steps]);
        pairs.enumerate().filter(|(_, [done, steps])| done < steps)
    }

    /// Whether all runs of the fit together took the seconds that the scene gives it. Clocks of ranks do not
    /// agree: the first decides.
    pub fn is_time_up(&self) -> bool {
        self.pipeline.rules.is_time_up()
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        self.renderer.scene()
    }

    /// What is learnt.
    pub fn parameters(&self) -> &Parameters<f32> {
        self.fit.parameters()
    }

    /// The scene with what was learnt in the place of its own numbers, and of views that are
    /// [aligned](SceneFit::align) what is their own.
    ///
    /// # Errors
    /// None: those of a parameter that is no number of the scene.
    pub fn learnt(&self) -> Result<Scene, SceneError> {
        self.renderer.with_values(self.shown())
    }

    /// How many steps are done, of all stages.
    pub fn steps_done(&self) -> u64 {
        self.pipeline.done.iter().sum::<u64>() + self.fit.steps_done()
    }

    /// How many steps there are, of all stages: of those that are done, the steps that they did.
    pub fn steps(&self) -> u64 {
        let rest = self.stages[self.stage..].iter().map(|stage| stage.steps.0 as u64);
        self.pipeline.done.iter().copied().chain(rest).sum()
    }

    /// The stage of the next step, from 0.
    pub fn stage(&self) -> usize {
        self.stage
    }

    /// How many views a step draws, in the stage whose steps draw most.
    pub fn most_views_per_step(&self) -> usize {
        let count = |stage| views_per_step(stage, self.learnt_from.len());
        self.stages.iter().map(count).max().unwrap_or(0)
    }

    /// The ranks that share the fit: one, if nobody said otherwise.
    pub fn ranks(&self) -> &Ranks<f32> {
        &self.ranks
    }

    /// How many bytes all ranks together sent for the last step's gradients.
    pub fn bytes_sent(&self) -> u64 {
        self.pipeline.views.bytes_sent()
    }

    /// Does a step; `None` where all are done. Ranks share it.
    ///
    /// # Errors
    /// As [`Fit::step`], and what is wrong with an image. Parameters are then as they were. After every
    /// hundredth step, [`FitError::Apart`] where ranks have come apart, and where held-out views are measured what is
    /// wrong with their images: then parameters are those after the step.
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

    /// Checks that all ranks, which share this call, have the same parameters to the bit.
    ///
    /// # Errors
    /// [`FitError::Apart`].
    pub fn check_same(&self) -> Result<(), SceneError> {
        Ok(check_same(&*self.ranks, self.fit.parameters(), self.steps_done())?)
    }

    /// Whether the stage has done its steps, or one before the last is ended by a rule.
    fn is_stage_over(&self) -> bool {
        let is_last = self.stage + 1 == self.stages.len();
        self.fit.steps_done() >= self.stages[self.stage].steps.0 as u64
            || !is_last && self.pipeline.rules.stop() == Some(Stop::NoProgress)
    }

    /// Measures the views that are held out for a rule of the scene's `[stop]`, where it is their turn.
    ///
    /// # Errors
    /// As [`SceneFit::align`], and what is wrong with an image. The step is done then.
    fn measure_if_due(&mut self) -> Result<(), SceneError> {
        if self.pipeline.rules.measures_after(self.fit.steps_done()) {
            let reduce = self.stages[self.stage].reduce.map_or(1, |reduce| reduce.0);
            let psnr = self.held_out_psnr(reduce)?;
            self.pipeline.rules.measure(psnr);
        }
        Ok(())
    }

    fn next_stage(&mut self) -> Result<(), SceneError> {
        let next = &self.stages[self.stage + 1];
        let leaves_field = self.scene().objects.iter().any(|object| object.field.is_some())
            && !learns_fields(self.scene(), next);
        let mut parameters = match leaves_field {
            true => {
                // A rank may lack memory: then none goes on.
                let Remade { renderer, learnt, parameters, surfaces } =
                    agreed(&*self.ranks, self.settled())?;
                (self.rates, self.renderer) = (learnt.rates, renderer);
                self.pipeline.regularizers = learnt.regularizers.into();
                self.pipeline.surfaces = surfaces.into();
                parameters
            }
            false => self.fit.parameters().clone(),
        };
        self.pipeline.done.push(self.fit.steps_done());
        self.stage += 1;
        let next = &self.stages[self.stage];
        parameters.forget_moments();
        set_rates(&mut parameters, &self.rates, next)?;
        self.fit = Fit::new(parameters, settings(next))?;
        self.targets.forget();
        let seed = self.scene().description.seed;
        if leaves_field {
            self.pipeline.drawing = drawing_of(&self.renderer);
        }
        let drawing = &self.pipeline.drawing;
        self.pipeline.views = views_of(drawing, &self.targets, &self.learnt_from, next, seed)
            .among(Arc::clone(&self.ranks));
        self.pipeline.rules.begin_stage();
        // What follows may fail, and the fit is saved then.
        self.fit.keep_state(&self.pipeline);
        Ok(())
    }

    /// Gives meshes other vertices, where it is their turn before the next step.
    ///
    /// # Errors
    /// As [`remeshed`]. The fit is then as it was.
    fn remesh_if_due(&mut self) -> Result<(), SceneError> {
        let Some(to) = self.remesh_due() else { return Ok(()) };
        let made = remeshed(self.scene(), &to, |name| self.fit.parameters().value(name).ok());
        self.go_on_with(made.and_then(|(scene, carried)| self.remade(scene, &carried, true)))?;
        self.pipeline.remeshed = Some(self.steps_done());
        self.fit.keep_state(&self.pipeline);
        Ok(())
    }

    /// Gives meshes a texture, where a stage says so and they have none.
    ///
    /// # Errors
    /// As [`textured`]. The fit is then as it was.
    fn texture_if_due(&mut self) -> Result<(), SceneError> {
        let Some(to) = self.stages[self.stage].texture else { return Ok(()) };
        let scene = self.scene();
        if scene.objects.iter().all(|object| !scene.awaits_texture(object)) {
            return Ok(());
        }
        let made = textured(scene, to, |name| self.fit.parameters().value(name).ok());
        let was_remeshed = self.pipeline.remeshed.is_some();
        self.go_on_with(made.and_then(|scene| self.remade(scene, &Carried::new(), was_remeshed)))?;
        self.fit.keep_state(&self.pipeline);
        Ok(())
    }

    /// Goes on with meshes that were made anew, on all ranks.
    fn go_on_with(&mut self, made: Result<Remade, SceneError>) -> Result<(), SceneError> {
        // A rank may lack memory: then none goes on.
        let Remade { renderer, learnt, parameters, surfaces } = agreed(&*self.ranks, made)?;
        let (stage, seed) = (&self.stages[self.stage], renderer.scene().description.seed);
        *self.fit.parameters_mut() = parameters;
        (self.rates, self.renderer) = (learnt.rates, renderer);
        self.pipeline.drawing = drawing_of(&self.renderer);
        let drawing = &self.pipeline.drawing;
        self.pipeline.views = views_of(drawing, &self.targets, &self.learnt_from, stage, seed)
            .among(Arc::clone(&self.ranks));
        self.pipeline.regularizers = learnt.regularizers.into();
        self.pipeline.surfaces = surfaces.into();
        Ok(())
    }

    /// How meshes are remeshed before the next step, if they are.
    fn remesh_due(&self) -> Option<Remesh> {
        let (to, done) = (self.stages[self.stage].remesh.as_ref()?, self.fit.steps_done());
        let is_turn = match to.every {
            None => done == 0,
            Some(every) => done.is_multiple_of(every.0 as u64),
        };
        (is_turn && self.pipeline.remeshed != Some(self.steps_done())).then(|| to.clone())
    }

    /// What a fit of another scene goes on with.
    fn remade(
        &self,
        scene: Scene,
        carried: &Carried,
        was_remeshed: bool,
    ) -> Result<Remade, SceneError> {
        let learnt = Learnt::from_scene(&scene)?;
        let surfaces = surfaces_to_bytes(&Surface::all(&scene, was_remeshed)?);
        let frame = self.renderer.frame().clone();
        let renderer = Arc::new(Renderer::with_frame(Arc::new(scene), frame)?);
        let mut parameters = self.fit.parameters().with_those_of(&learnt.parameters);
        for parameter in learnt.parameters.iter() {
            if let Some(carry) = carried.get(parameter.name()) {
                let carry = |old: &_| carry.carried(old).map_err(FitError::operation);
                parameters.replace(parameter, carry)?;
            }
        }
        set_rates(&mut parameters, &learnt.rates, &self.stages[self.stage])?;
        Ok(Remade { renderer, learnt, parameters, surfaces })
    }

    /// What a fit goes on with whose fields are no longer learnt: their surfaces are meshes from then on.
    fn settled(&self) -> Result<Remade, SceneError> {
        let (before, frame) = (self.fit.parameters(), self.renderer.frame().clone());
        let scene = settled(self.scene(), &frame, before)?;
        let learnt = Learnt::from_scene(&scene)?;
        let surfaces = surfaces_to_bytes(&Surface::all(&scene, false)?);
        let mut parameters = learnt.parameters.clone();
        for parameter in before.iter() {
            let is_there = parameters.get(parameter.name()).is_ok();
            if is_there && !is_of_field(self.scene(), parameter.name()) {
                parameters.replace(parameter, |moments| Ok(moments.clone()))?;
            }
        }
        let renderer = Arc::new(Renderer::with_frame(Arc::new(scene), frame)?);
        Ok(Remade { renderer, learnt, parameters, surfaces })
    }

    /// Saves the fit to the file `path`, whole or not at all.
    ///
    /// # Errors
    /// As [`Fit::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SceneError> {
        Ok(self.fit.save(path)?)
    }

    /// Whether this is the rank that speaks and writes, of those that share the fit.
    pub fn is_first(&self) -> bool {
        self.ranks.rank() == 0
    }

    /// Does `work` on the first of the ranks, all of which make this call. They return when it is done.
    ///
    /// # Errors
    /// Its error, on all of them.
    pub fn on_first<E: From<FitError> + ToString>(
        &self,
        work: impl FnOnce() -> Result<(), E>,
    ) -> Result<(), E> {
        agreed(&*self.ranks, if self.is_first() { work() } else { Ok(()) })
    }

    /// How many ranks share the fit.
    pub fn size(&self) -> usize {
        self.ranks.size()
    }

    /// What drawing a view leaves out, and why, by operation.
    ///
    /// # Errors
    /// What the operations refuse.
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

/// Whether a loss sees neighbours of pixels.
/// A stage by its index, which a saved fit may say.
fn stage_of(stages: &[Stage], index: usize) -> Result<Stage, SceneError> {
    let missing = || {
        let rule = format!("one of the scene's {} stages", stages.len());
        FitError::saved(rule, format!("number {}", index + 1))
    };
    Ok(stages.get(index).cloned().ok_or_else(missing)?)
}

fn is_dense(renderer: &Renderer) -> bool {
    let ssim = renderer.scene().description.loss.ssim;
    renderer.is_dense() || ssim.is_some_and(|share| share.0 > 0.0)
}

/// What draws a scene, and what is learnt of it, after its meshes got other vertices.
fn with_surfaces(
    scene: Arc<Scene>,
    learnt: Learnt,
    surfaces: &[Surface],
) -> Result<(Arc<Renderer>, Learnt), SceneError> {
    if surfaces.is_empty() {
        return Ok((Arc::new(Renderer::new(scene)?), learnt));
    }
    let (frame, mut scene) = (Frame::new(&scene), Scene::clone(&scene));
    surfaces.iter().try_for_each(|surface| surface.put(&mut scene))?;
    let learnt = Learnt::from_scene(&scene)?;
    Ok((Arc::new(Renderer::with_frame(Arc::new(scene), frame)?), learnt))
}

/// The fit in a file, which learns what a fit of the scene learns that starts now.
fn resumed(
    bytes: &[u8],
    preconditioners: &[(String, Preconditioner)],
    fresh: &Parameters<f32>,
) -> Result<Fit<f32>, SceneError> {
    let by_name: Vec<_> = preconditioners
        .iter()
        .map(|(name, preconditioner)| (name.as_str(), preconditioner))
        .collect();
    let fit = Fit::from_bytes_with(bytes, &by_name)?;
    let shapes = |list: &Parameters<f32>| {
        let all = list
            .iter()
            .map(|parameter| format!("{} {}", parameter.name(), parameter.raw().shape()));
        all.collect::<Vec<_>>().join(", ")
    };
    let (expected, found) = (shapes(fresh), shapes(fit.parameters()));
    match expected == found {
        true => Ok(fit),
        false => Err(FitError::saved(format!("the scene's parameters, {expected}"), found).into()),
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
