//! How a fit of a scene begins: from the scene or from a saved fit, on one rank or on several.

use std::path::Path;
use std::sync::Arc;

use bokashi_core::Tensor;
use bokashi_fit::{
    Alone, Fit, FitError, Given, Parameters, Preconditioner, Ranks, agreed, check_alike, saved,
};

use super::fields::{check_fields, check_stage_under_way};
use super::fit::SceneFit;
use super::remeshing::check_remeshing;
use super::stage::{
    StagePipeline, check_stages, drawing_of, set_rates, settings, stages, views_of,
    views_to_learn_from,
};
use super::starts::{Search, Start};
use super::texturing::check_texturing;
use crate::description::Stage;
use crate::error::SceneError;
use crate::given::starts;
use crate::learnables::Frame;
use crate::learning::Learnt;
use crate::memory::OF_FITTED_PIXEL;
use crate::renderer::Renderer;
use crate::saved_fit::{self, Origin, Surface, surfaces_to_bytes};
use crate::scene::{Scene, check_views};
use crate::stopping::StopRules;
use crate::targets::Targets;

impl SceneFit {
    /// Begins a fit of `scene` from its start.
    ///
    /// # Errors
    /// Whatever is wrong with the scene's learnables; [`SceneError::Content`] where no view can be learnt from.
    pub fn new(scene: Scene) -> Result<Self, SceneError> {
        Self::prepare(scene, None, Arc::new(Alone))?.begun()
    }

    /// Begins a fit that the ranks of a job share, as [`SceneFit::new`]. In a step each rank computes the losses of
    /// some of the views. Images of other views are read once, to check that all ranks have the same. All ranks have
    /// the same parameters, with the bits of a fit on one rank.
    ///
    /// All ranks must make the same calls of functions that say so. An error on one of them is then an error on all.
    ///
    /// # Errors
    /// As [`SceneFit::new`].
    pub fn among(scene: Scene, ranks: Ranks<f32>) -> Result<Self, SceneError> {
        let fit = Self::prepare(scene, None, Arc::clone(&ranks));
        agreed(&*ranks, fit)?.begun()
    }

    /// Resumes a fit that the ranks of a job share, as [`SceneFit::among`]. Any number of ranks may have saved it. The
    /// first rank reads the file.
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

    /// Begins a fit that ranks share, or resumes it from the file `resume`, of the scene that `load` returns. The
    /// argument of `load` is whether this is the first rank. `settings` are the options of the program, by name.
    ///
    /// # Errors
    /// Those of `load` and of the fit; [`FitError::Unlike`] where the settings of ranks differ: they would wait for
    /// each other for ever.
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

    /// Resumes the fit that was saved to the file `path`. If the scene is the same, it goes on to the same bits as
    /// without an interruption. Changes of the scene take effect from the next step on; [`SceneFit::changed`] names
    /// them.
    ///
    /// # Errors
    /// As [`SceneFit::new`]; [`SceneError::Fit`] for a file that is no saved fit. The same error for a scene with
    /// other learnables, other starts of them, or other stages before the present one.
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

    /// Checks that all ranks were given the same scene, and finds out what was changed since the fit was saved. All
    /// ranks make this call.
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

    /// Moves poses to the best of their starts, if the scene asks for a search.
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
}

/// The stage with an index that may come from a saved fit.
fn stage_of(stages: &[Stage], index: usize) -> Result<Stage, SceneError> {
    let missing = || {
        let rule = format!("one of the scene's {} stages", stages.len());
        FitError::saved(rule, format!("number {}", index + 1))
    };
    Ok(stages.get(index).cloned().ok_or_else(missing)?)
}

/// Whether the loss of a pixel depends on its neighbours, so that whole images are drawn.
fn is_dense(renderer: &Renderer) -> bool {
    let ssim = renderer.scene().description.loss.ssim;
    renderer.is_dense() || ssim.is_some_and(|share| share.0 > 0.0)
}

/// The renderer and the learnables of a scene with the changed surfaces of a saved fit.
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

/// The fit in a file, whose parameters must have the names and shapes of `fresh`.
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
