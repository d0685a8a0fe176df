//! Views that are held out are aligned before they are scored: what they have of their own is fitted to their images,
//! and everything else stands still.
//!
//! Steps move what views have of their own, such as cameras, of views that are learnt from. A view that is held out
//! would be measured with the error of a camera that nobody learnt. So its own numbers alone are learnt at the end, by
//! the loss of the fit, from small images to larger ones. That is the custom of the field where cameras are learnt
//! (Wang et al., *NeRF--*, 2021, section 4; Lin et al., *BARF*, ICCV 2021, section 4).
//!
//! The scene's own numbers are where it starts, whatever was aligned before, and steps know nothing of it. So it is
//! the same after any interruption. Each view is a fit of its own, on one thread, so its bits depend on nothing else.

use std::ops::Range;

use bokashi_core::{Tensor, parallel};
use bokashi_fit::{
    Fit, FitError, FitSettings, Optimizer, Parameter, Parameters, Schedule, agree, block, from_fn,
};

use super::fit::SceneFit;
use super::stage::{is_not_finite, loss_of_target};
use crate::error::SceneError;
use crate::learnables::{TABLE, Values};
use crate::renderer::Renderer;
use crate::targets::{Targets, fit_error};

/// How views are aligned, one level after another.
struct Level {
    /// The most pixels along the shorter side of an image; at least half of them, where it has as many.
    side: usize,
    steps: u64,
    /// The rate of the first step, as a multiple of the one of the fit.
    rate: f64,
}

/// At the usual rate the first level can turn a camera by some ten degrees, and change an exposure by a stop.
const LEVELS: [Level; 3] = [
    Level { side: 80, steps: 24, rate: 4.0 },
    Level { side: 160, steps: 16, rate: 1.5 },
    Level { side: 320, steps: 12, rate: 0.5 },
];

/// What was aligned.
pub(super) struct Aligned {
    /// The parameters of the fit, with what views that are held out have of their own.
    pub(super) parameters: Parameters<f32>,
    views: Vec<AlignedView>,
}

/// A view that was aligned.
struct AlignedView {
    view: usize,
    /// Its PSNR before.
    psnr_before: Option<f64>,
}

/// Numbers of a parameter that a view has of its own.
struct Own {
    /// The parameter.
    name: String,
    /// The rate at which they are learnt of other views.
    rate: f64,
    numbers: Range<usize>,
}

impl Aligned {
    /// The PSNR of a view before it was aligned, if it was.
    pub(super) fn psnr_before(&self, view: usize) -> Option<f64> {
        self.views.iter().find(|aligned| aligned.view == view)?.psnr_before
    }
}

impl SceneFit {
    /// Fits what each view that is held out has of its own, as its camera, to its image, where that was learnt of
    /// other views. Everything else stands still. Scores, pictures and [`SceneFit::learnt`] then have it, until the
    /// next step, which knows nothing of it. Ranks share it.
    ///
    /// It costs some 50 steps on each of these views, on images of at most 320 pixels along the shorter side.
    ///
    /// # Errors
    /// Those of a step on the views.
    pub fn align(&mut self) -> Result<(), SceneError> {
        self.aligned = None;
        let views = self.scene().views_with_image(true).map(|view| (view, self.own(view)));
        let views: Vec<_> = views.filter(|(_, own)| !own.is_empty()).collect();
        if views.is_empty() {
            return Ok(());
        }
        let range = block(views.len(), self.ranks.rank(), self.ranks.size());
        let bytes = agree(&*self.ranks, self.aligned_bytes(&views[range]))?.concat();
        let mut parameters = self.fit.parameters().clone();
        let (mut words, mut aligned) = (bytes.as_chunks::<8>().0.iter(), Vec::new());
        let mut next = || words.next().map_or(f64::NAN, |&word| f64::from_le_bytes(word));
        for (view, own) in &views {
            let psnr = next();
            aligned
                .push(AlignedView { view: *view, psnr_before: (!psnr.is_nan()).then_some(psnr) });
            for Own { name, numbers, .. } in own {
                let raw = parameters.get(name)?.raw().clone();
                let mut data = raw.data().to_vec();
                data[numbers.clone()].fill_with(|| next() as f32);
                parameters.set_raw(name, Tensor::from_flat_fn(raw.shape(), |k| data[k]))?;
            }
        }
        self.aligned = Some(Aligned { parameters, views: aligned });
        Ok(())
    }

    /// The views that are aligned.
    pub fn aligned_views(&self) -> impl Iterator<Item = usize> + '_ {
        self.aligned.iter().flat_map(|aligned| aligned.views.iter().map(|aligned| aligned.view))
    }

    /// What is shown of the fit: what was learnt, and of views that are aligned what is their own.
    pub(super) fn shown(&self) -> &Parameters<f32> {
        self.aligned.as_ref().map_or(self.fit.parameters(), |aligned| &aligned.parameters)
    }

    /// What a view has of its own that steps so far have learnt of other views.
    fn own(&self, view: usize) -> Vec<Own> {
        let begun = self.stage + usize::from(self.fit.steps_done() > 0);
        let was_learnt = |key: &str| {
            let mut stages = self.stages[..begun].iter();
            stages.any(|stage| {
                stage.learn.as_ref().is_none_or(|keys| keys.iter().any(|learnt| learnt == key))
            })
        };
        let count = self.scene().views.len();
        let own = TABLE.iter().filter_map(|row| {
            let name = row.own_name(self.scene(), view)?;
            let rate = self.rates.iter().find(|rate| rate.name == name)?.rate;
            let size = self.fit.parameters().get(&name).ok()?.raw().size();
            let numbers = match row.has_rows_of_views {
                true => size / count * view..size / count * (view + 1),
                false => 0..size,
            };
            was_learnt(row.key).then_some(Own { name, rate, numbers })
        });
        own.collect()
    }

    /// Of each view its PSNR as it is, NaN without one, and its own numbers, aligned.
    fn aligned_bytes(&self, views: &[(usize, Vec<Own>)]) -> Result<Vec<u8>, SceneError> {
        let parameters = self.fit.parameters();
        let still = parameters.iter().map(|of| (of.name().to_owned(), of.value())).collect();
        let Self { renderer, targets, .. } = self;
        let alignment = Alignment { renderer, targets, parameters, still };
        let mut results: Vec<_> = views.iter().map(|_| None).collect();
        parallel::write_each(&mut results, 1, |k| {
            let (view, own) = &views[k];
            Some(parallel::alone(|| alignment.numbers(*view, own)))
        });
        let mut bytes = Vec::new();
        for ((view, _), numbers) in views.iter().zip(results.into_iter().flatten()) {
            let psnr = self.score(*view)?.psnr.unwrap_or(f64::NAN);
            let numbers = numbers?.into_iter().map(f64::from);
            bytes.extend(std::iter::once(psnr).chain(numbers).flat_map(f64::to_le_bytes));
        }
        Ok(bytes)
    }
}

/// What views are aligned with.
struct Alignment<'a> {
    renderer: &'a Renderer,
    targets: &'a Targets,
    /// Those of the fit.
    parameters: &'a Parameters<f32>,
    /// Their values: what nothing learns here is worked out once.
    still: Vec<(String, Tensor<f32>)>,
}

impl Alignment<'_> {
    /// A view's own numbers, raw, where the loss of the view is least: as they are, or after the steps of all levels.
    fn numbers(&self, view: usize, own: &[Own]) -> Result<Vec<f32>, FitError> {
        let mut start = Parameters::new();
        for (name, value) in &self.still {
            let parameter = Parameter::new(name, value.clone()).optional();
            let parameter = match own.iter().any(|own| own.name == *name) {
                true => parameter.mapping(self.parameters.get(name)?.mapped_by()),
                false => parameter.frozen(),
            };
            start = start.with(parameter)?;
        }
        let mut best = (f64::INFINITY, start.clone());
        for level in &LEVELS {
            best = self.descended(view, own, level, best.1)?;
        }
        let last = Level { steps: 1, ..LEVELS[LEVELS.len() - 1] };
        let is_better = best.0 < self.descended(view, own, &last, start)?.0;
        let parameters = if is_better { &best.1 } else { self.parameters };
        let mut numbers = Vec::new();
        for Own { name, numbers: range, .. } in own {
            numbers.extend(&parameters.get(name)?.raw().data()[range.clone()]);
        }
        Ok(numbers)
    }

    /// The least loss of a view in the steps of a level, and the parameters there.
    fn descended(
        &self,
        view: usize,
        own: &[Own],
        level: &Level,
        mut parameters: Parameters<f32>,
    ) -> Result<(f64, Parameters<f32>), FitError> {
        let size = self.renderer.scene().views[view].camera.size;
        let reduce = size.width.min(size.height).div_ceil(level.side);
        let target = self.targets.get(view, reduce).map_err(fit_error)?;
        let mut loss = from_fn(|tape, variables| {
            let values = Values { tape, learnt: Some(variables) };
            let has_mask = self.targets.has_mask(view);
            loss_of_target(self.renderer, &target, has_mask, &values, view, reduce)
        });
        parameters.forget_moments();
        for Own { name, rate, .. } in own {
            parameters.set_rate(name, rate * level.rate)?;
        }
        let settings = FitSettings {
            steps: level.steps,
            schedule: Schedule::Cosine { steps: level.steps, floor: 0.1 },
            optimizer: Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 },
            ..FitSettings::default()
        };
        let mut fit = Fit::new(parameters, settings)?;
        let mut best = (f64::INFINITY, fit.parameters().clone());
        for _ in 0..level.steps {
            let before = fit.parameters().clone();
            match fit.step(&mut loss) {
                Ok(stepped) if stepped.loss < best.0 => best = (stepped.loss, before),
                Ok(_) => {}
                // It has left the range of the numbers, and was somewhere better before.
                Err(error) if is_not_finite(&error) => break,
                Err(error) => return Err(error),
            }
        }
        Ok(best)
    }
}
