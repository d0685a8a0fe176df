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

use bokashi_core::Tensor;
use bokashi_fit::{
    Fit, FitError, FitSettings, Optimizer, Parameter, Parameters, Schedule, from_fn,
};

use super::stage::{is_not_finite, loss_of_target};
use crate::learnables::Values;
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
    Level { side: 80, steps: 40, rate: 4.0 },
    Level { side: 160, steps: 40, rate: 2.0 },
    Level { side: 320, steps: 20, rate: 1.0 },
];

/// What was aligned.
pub(super) struct Aligned {
    /// The parameters of the fit, with what views that are held out have of their own.
    pub(super) parameters: Parameters<f32>,
    pub(super) views: Vec<AlignedView>,
}

/// A view that was aligned.
pub(super) struct AlignedView {
    pub(super) view: usize,
    /// Its PSNR before.
    pub(super) psnr_before: Option<f64>,
}

/// Numbers of a parameter that a view has of its own.
pub(super) struct Own {
    /// The parameter.
    pub(super) name: String,
    /// The rate at which they are learnt of other views.
    pub(super) rate: f64,
    pub(super) numbers: Range<usize>,
}

impl Aligned {
    /// The PSNR of a view before it was aligned, if it was.
    pub(super) fn psnr_before(&self, view: usize) -> Option<f64> {
        self.views.iter().find(|aligned| aligned.view == view)?.psnr_before
    }
}

/// What views are aligned with.
pub(super) struct Alignment<'a> {
    pub(super) renderer: &'a Renderer,
    pub(super) targets: &'a Targets,
    /// Those of the fit.
    pub(super) parameters: &'a Parameters<f32>,
    /// Their values: what nothing learns here is worked out once.
    pub(super) still: Vec<(String, Tensor<f32>)>,
}

impl Alignment<'_> {
    /// A view's own numbers, raw, where the loss of the view is least: as they are, or after the steps of all levels.
    pub(super) fn numbers(&self, view: usize, own: &[Own]) -> Result<Vec<f32>, FitError> {
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
