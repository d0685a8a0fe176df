//! Changes between two steps: the next stage, and meshes with other vertices or a texture.

use std::sync::Arc;

use bokashi_fit::{Fit, FitError, Parameters, agreed};

use super::fields::{is_of_field, learns_fields, settled};
use super::fit::SceneFit;
use super::remeshing::{Carried, remeshed};
use super::stage::{drawing_of, set_rates, settings, views_of};
use super::texturing::textured;
use crate::description::Remesh;
use crate::error::SceneError;
use crate::learning::Learnt;
use crate::renderer::Renderer;
use crate::saved_fit::{Surface, surfaces_to_bytes};
use crate::scene::Scene;

/// The parts of a fit that are new after its meshes got other vertices, or a texture.
struct Remade {
    renderer: Arc<Renderer>,
    learnt: Learnt,
    parameters: Parameters<f32>,
    /// The bytes of changed surfaces in a saved fit.
    surfaces: Vec<u8>,
}

impl SceneFit {
    /// Begins the next stage. Where its fields are no longer learnt, their surfaces become meshes.
    ///
    /// # Errors
    /// As [`settled`]. The fit is then as it was.
    pub(super) fn next_stage(&mut self) -> Result<(), SceneError> {
        let next = &self.stages[self.stage + 1];
        let leaves_field = self.scene().objects.iter().any(|object| object.field.is_some())
            && !learns_fields(self.scene(), next);
        let mut parameters = match leaves_field {
            true => {
                // A rank may lack memory: then all ranks stop.
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

    /// Remeshes, if a remeshing is due before the next step.
    ///
    /// # Errors
    /// As [`remeshed`]. The fit is then as it was.
    pub(super) fn remesh_if_due(&mut self) -> Result<(), SceneError> {
        let Some(to) = self.remesh_due() else { return Ok(()) };
        let made = remeshed(self.scene(), &to, |name| self.fit.parameters().value(name).ok());
        self.go_on_with(made.and_then(|(scene, carried)| self.remade(scene, &carried, true)))?;
        self.pipeline.remeshed = Some(self.steps_done());
        self.fit.keep_state(&self.pipeline);
        Ok(())
    }

    /// Gives meshes a texture, if the stage does so and they have none.
    ///
    /// # Errors
    /// As [`textured`]. The fit is then as it was.
    pub(super) fn texture_if_due(&mut self) -> Result<(), SceneError> {
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

    /// Puts the new parts in the place of the old ones, on all ranks or, after an error, on none.
    fn go_on_with(&mut self, made: Result<Remade, SceneError>) -> Result<(), SceneError> {
        // A rank may lack memory: then all ranks stop.
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

    /// The remeshing that is due before the next step, if one is.
    fn remesh_due(&self) -> Option<Remesh> {
        let (to, done) = (self.stages[self.stage].remesh.as_ref()?, self.fit.steps_done());
        let is_turn = match to.every {
            None => done == 0,
            Some(every) => done.is_multiple_of(every.0 as u64),
        };
        (is_turn && self.pipeline.remeshed != Some(self.steps_done())).then(|| to.clone())
    }

    /// The new parts for a scene with other meshes. `carried` has the numbers at new vertices.
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

    /// The new parts once fields are no longer learnt: their surfaces become meshes.
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
}
