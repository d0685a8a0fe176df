//! Alignment of held-out views before they are scored: a view's parameters, such as its camera, are fitted to its
//! image, and all others stay as they are.
//!
//! Steps of a fit learn the cameras of the views that they draw. A held-out view would be scored with the error of a
//! camera that was never learnt. So its parameters alone are fitted at the end, by the loss of the fit, from small
//! images to larger ones. That is usual where cameras are learnt: Wang et al., *NeRF--*, 2021, section 4, and Lin et
//! al., *BARF*, ICCV 2021, section 4.
//!
//! An alignment starts from the numbers of the scene, whatever was aligned before, and steps do not see its result. So
//! it is the same after any interruption. Each view is fitted on one thread, so its bits depend on no other view.

use std::ops::Range;

use bokashi_core::Tensor;
use bokashi_fit::{
    Fit, FitError, FitSettings, Optimizer, Parameter, Parameters, Schedule, from_fn,
};

use super::stage::{is_not_finite, loss_of_target};
use crate::learnables::Values;
use crate::renderer::Renderer;
use crate::targets::{Targets, fit_error};

/// A level of the alignment: image size and rate.
struct Level {
    /// The most pixels along the shorter side of an image; at least half of them, where it has as many.
    side: usize,
    steps: u64,
    /// The rate of the first step, over the rate of the fit.
    rate: f64,
}

/// At the usual rate the first level can turn a camera by some ten degrees, and change an exposure by a stop.
const LEVELS: [Level; 3] = [
    Level { side: 80, steps: 40, rate: 4.0 },
    Level { side: 160, steps: 40, rate: 2.0 },
    Level { side: 320, steps: 20, rate: 1.0 },
];

/// The result of an alignment.
pub(super) struct Aligned {
    /// The parameters of the fit, with the aligned numbers of held-out views.
    pub(super) parameters: Parameters<f32>,
    pub(super) views: Vec<AlignedView>,
}

/// A view that was aligned.
pub(super) struct AlignedView {
    pub(super) view: usize,
    /// The PSNR before the alignment.
    pub(super) psnr_before: Option<f64>,
}

/// The numbers of a parameter that belong to one view.
pub(super) struct Own {
    /// The name of the parameter.
    pub(super) name: String,
    /// The rate at which the fit learns the numbers of other views.
    pub(super) rate: f64,
    pub(super) numbers: Range<usize>,
}

impl Aligned {
    /// The PSNR of a view before its alignment, if it was aligned.
    pub(super) fn psnr_before(&self, view: usize) -> Option<f64> {
        self.views.iter().find(|aligned| aligned.view == view)?.psnr_before
    }
}

/// The fit to which views are aligned.
pub(super) struct Alignment<'a> {
    pub(super) renderer: &'a Renderer,
    pub(super) targets: &'a Targets,
    /// The parameters of the fit.
    pub(super) parameters: &'a Parameters<f32>,
    /// The values of the parameters, computed once: most of them are constants here.
    pub(super) constants: Vec<(String, Tensor<f32>)>,
}

impl Alignment<'_> {
    /// The raw numbers of a view with the least loss: those of the fit, or those after the steps of all levels.
    pub(super) fn numbers(&self, view: usize, own: &[Own]) -> Result<Vec<f32>, FitError> {
        let mut start = Parameters::new();
        for (name, value) in &self.constants {
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

    /// The least loss of a view in the steps of a level, and the parameters with this loss.
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
            // What moves the picture is found at once; a turn about the object is then left, whose gradients are small.
            optimizer: Optimizer::Adam { beta1: 0.9, beta2: 0.9, epsilon: 1e-8 },
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
