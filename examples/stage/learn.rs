//! A fit that is watched.

use bokashi::prelude::*;

use super::found::Curve;

/// Fits `parameters` and takes figures of them: before the first step, each `every` steps (1 or more), and at
/// the end. The seconds of a curve include those that its figures take. All of `settings.steps` are taken: a
/// watched fit stops for no loss and for no lack of patience.
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
    loop {
        let (step, is_last) = (fit.steps_done(), fit.steps_done() >= settings.steps);
        if step % every == 0 || is_last {
            for (curve, figure) in curves.iter_mut().zip(figures(fit.parameters())?) {
                curve.add(figure);
            }
        }
        if is_last {
            return Ok((fit.into_parameters(), curves));
        }
        fit.step(pipeline)?;
    }
}
