//! A fit that is watched.

use std::ops::ControlFlow;

use bokashi::fit::{Answer, Listener, Rules, Stepped, Steps, Stop};
use bokashi::prelude::*;

use super::found::Curve;

/// Fits `parameters` and takes figures of them: before the first step, each `every` steps (1 or more), and at
/// the end. The seconds of a curve include those that its figures take. All of `settings.steps` are taken, unless
/// the loss or a lack of patience stops the fit.
///
/// # Errors
/// Whatever the pipeline and the figures run into.
pub fn learn<P: Pipeline<f32>, const N: usize>(
    parameters: Parameters<f32>,
    settings: FitSettings,
    pipeline: &mut P,
    every: u64,
    figures: impl Fn(&Parameters<f32>) -> Result<[f64; N], FitError>,
) -> Result<(Parameters<f32>, [Curve; N]), FitError> {
    let curves = [(); N].map(|()| Curve::starting_now());
    let mut watched = Watched { every, figures, curves };
    let mut fit = Fit::new(parameters, settings)?;
    let rules = Rules { steps: Some(settings.steps), ..Rules::default() };
    fit.drive(pipeline, &rules, &mut [&mut watched])?;
    Ok((fit.into_parameters(), watched.curves))
}

/// A listener that takes figures.
struct Watched<F, const N: usize> {
    every: u64,
    figures: F,
    curves: [Curve; N],
}

impl<F, const N: usize> Watched<F, N>
where
    F: Fn(&Parameters<f32>) -> Result<[f64; N], FitError>,
{
    fn look(&mut self, parameters: &Parameters<f32>) -> Answer<FitError> {
        for (curve, figure) in self.curves.iter_mut().zip((self.figures)(parameters)?) {
            curve.add(figure);
        }
        Ok(ControlFlow::Continue(()))
    }
}

impl<S, F, const N: usize> Listener<S> for Watched<F, N>
where
    S: Steps<Number = f32, Error = FitError>,
    F: Fn(&Parameters<f32>) -> Result<[f64; N], FitError>,
{
    fn begin(&mut self, fit: &S) -> Answer<FitError> {
        self.look(fit.parameters())
    }

    fn after_step(&mut self, fit: &S, _stepped: &Stepped) -> Answer<FitError> {
        match fit.steps_done().is_multiple_of(self.every) {
            true => self.look(fit.parameters()),
            false => Ok(ControlFlow::Continue(())),
        }
    }

    fn end(&mut self, fit: &S, _stop: Stop) -> Result<(), FitError> {
        match fit.steps_done().is_multiple_of(self.every) {
            true => Ok(()),
            false => self.look(fit.parameters()).map(drop),
        }
    }
}
