//! A fit that is watched.

use bokashi::fit::{Fitting, Rules, Steps as _, every as each};
use bokashi::prelude::*;

use super::outcome::Curve;

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
    let mut curves = [(); N].map(|()| Curve::starting_now());
    let mut fit = Fit::new(parameters, settings)?;
    let mut watch = each(every, |fit: &Fitting<'_, f32, P>| {
        for (curve, figure) in curves.iter_mut().zip(figures(fit.parameters())?) {
            curve.add(figure);
        }
        Ok(())
    });
    let rules = Rules { steps: Some(settings.steps), ..Rules::default() };
    fit.drive(pipeline, &rules, &mut [&mut watch])?;
    Ok((fit.into_parameters(), curves))
}
