//! The paper's cube at four times the size, antialiased there and averaged down.
//!
//! `bokashi_paper::Silhouettes` has no such kind: it would be one more word of the program and of saved
//! fits, for a comparison alone. Starts, poses, errors and rates are the paper's own.

use std::time::Instant;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::{Fit, FitError, FitSettings, Parameters, Pipeline, Variables, squared_error};
use bokashi_paper::{CubeMeasure, CubePipeline, CubeSettings, FACES, VERTEX_COUNT, View, truth};
use bokashi_render_ops::{
    Background, Blur, Border, Filter, Mesh, RasterOptions, Size, downsample, gaussian_blur,
    project, render,
};

/// As many pixels along a side make one.
pub(super) const TIMES: usize = 4;

/// The cube of one of the paper's experiments.
struct Supersampled {
    /// It has the starts and measures errors.
    pipeline: CubePipeline<f64>,
    settings: CubeSettings,
    mesh: Mesh,
    blur: Option<Blur>,
    view: View,
    target: Tensor<f64>,
}

/// Vertices, colours and sigma, where there is a blur.
type Cube<'t> = (Var<'t, f64>, Var<'t, f64>, Option<Var<'t, f64>>);

impl Supersampled {
    fn new(settings: &CubeSettings) -> Result<(Self, Parameters<f64>), FitError> {
        let (pipeline, parameters) = CubePipeline::new(settings)?;
        let blur = settings.blurs().then(|| Blur {
            kernel: settings.kernel,
            border: settings.border,
            radius: settings.blur_radius(),
        });
        let pipeline = Self {
            pipeline,
            settings: settings.clone(),
            mesh: Mesh::new(FACES.to_vec(), VERTEX_COUNT)?,
            blur,
            view: View::fixed(),
            target: Tensor::zeros([1]),
        };
        Ok((pipeline, parameters))
    }

    /// The image `[H, W, 3]` of a cube in the present pose.
    fn image<'t>(&self, (vertices, colors, sigma): Cube<'t>) -> Result<Var<'t, f64>, FitError> {
        let clip = project(vertices, &self.view.camera(), None)?;
        let options = RasterOptions::new(Size::square(TIMES * self.settings.resolution));
        let large = render(clip, &self.mesh, colors, options, Background::Zero)?.image()?;
        let image = downsample(large, TIMES, &Filter::Box, Border::Clamp)?;
        match (&self.blur, sigma) {
            (Some(blur), Some(sigma)) => Ok(gaussian_blur(image, sigma, blur)?),
            _ => Ok(image),
        }
    }
}

impl Pipeline<f64> for Supersampled {
    type Measure = CubeMeasure;

    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        self.prepare_on(step, &Tape::new())
    }

    fn prepare_on(&mut self, step: u64, tape: &Tape<f64>) -> Result<(), FitError> {
        self.view = View::random(self.settings.seed, step);
        tape.recycle(std::mem::replace(&mut self.target, Tensor::scalar(0.0)));
        let truth = truth(self.settings.blurs().then_some(self.settings.sigma_target));
        self.target = tape.aside(|tape| -> Result<_, FitError> {
            let [vertices, colors] =
                [&truth.vertices, &truth.colors].map(|truth| tape.constant(truth));
            let sigma = truth.sigma.map(|sigma| tape.constant_scalar(sigma));
            Ok(self.image((vertices, colors, sigma))?.value())
        })?;
        Ok(())
    }

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<f64>,
        variables: &Variables<'t, f64>,
    ) -> Result<Var<'t, f64>, FitError> {
        let sigma = match self.blur {
            Some(_) => Some(variables.get("sigma")?),
            None => None,
        };
        let image = self.image((variables.get("vertices")?, variables.get("colors")?, sigma))?;
        Ok(squared_error(image, tape.constant(&self.target))?)
    }

    fn measure(&self, parameters: &Parameters<f64>) -> CubeMeasure {
        self.pipeline.measure(parameters)
    }
}

/// A fit of an experiment that learns vertices: of each step the seconds until then and the vertex error; and
/// all seconds.
pub(super) fn run(settings: &CubeSettings) -> Result<(Vec<[f64; 2]>, f64), FitError> {
    let (mut pipeline, parameters) = Supersampled::new(settings)?;
    let fit_settings = FitSettings {
        steps: settings.steps,
        optimizer: settings.optimizer,
        schedule: settings.rate_schedule(),
        ..FitSettings::default()
    };
    let start = Instant::now();
    let history = Fit::new(parameters, fit_settings)?.run(&mut pipeline)?;
    let seconds = start.elapsed().as_secs_f64();
    let steps = history.steps.iter();
    let all = steps.map(|step| [step.seconds, step.measure.vertex_error]);
    Ok((all.collect(), seconds))
}

#[cfg(test)]
mod tests {
    use bokashi_paper::{Experiment, Preset, Silhouettes, picture};

    use super::*;

    #[test]
    fn an_image_is_the_mean_of_the_papers_larger_one() {
        let settings = |resolution| CubeSettings {
            resolution,
            silhouettes: Silhouettes::Antialias,
            ..CubeSettings::new(Experiment::Vertices, Preset::Tuned)
        };
        let (mut pipeline, _) = Supersampled::new(&settings(8)).unwrap();
        pipeline.prepare(3).unwrap();
        let view = View::random(0, 3);
        let large = picture(&truth(None), 32, Silhouettes::Antialias, None, &view).unwrap();
        for pixel in 0..64 {
            let (row, column) = (pixel / 8 * TIMES, pixel % 8 * TIMES);
            for channel in 0..3 {
                let cells = (0..16).map(|k| large[[row + k / TIMES, column + k % TIMES, channel]]);
                let mean = cells.sum::<f64>() / 16.0;
                let found = pipeline.target.data()[3 * pixel + channel];
                assert!((found - mean).abs() < 1e-12, "{pixel} {channel}: {found} {mean}");
            }
        }
    }
}
