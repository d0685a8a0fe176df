//! The cube over a fixed set of poses, as residuals: what least-squares methods need.
//!
//! # Forward
//! `r = image - target`, `[views, H, W, 3]`, over all views; the sum of its squares is the sum of
//! the losses of the views.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::Blur;
use glam::DMat4;

use super::cube::{View, truth};
use super::scene::Scene;
use super::settings::CubeSettings;
use crate::error::FitError;

/// A cube's experiment over a fixed set of poses. Numbers of any kind go through it, dual ones
/// too.
#[derive(Debug, Clone)]
pub struct CubeViews {
    scene: Scene,
    cameras: Vec<DMat4>,
    /// One image per view, `[H, W, 3]`.
    targets: Vec<Tensor<f64>>,
    blurs: bool,
}

impl CubeViews {
    /// The scene of `settings`, seen in each of `views`, with its targets.
    ///
    /// # Errors
    /// [`FitError::Setting`] for settings outside their range, or without any view.
    pub fn new(settings: &CubeSettings, views: &[View]) -> Result<Self, FitError> {
        settings.check()?;
        if views.is_empty() {
            return Err(FitError::setting("a set of views", "at least one", 0));
        }
        let blurs = settings.blurs();
        let blur = blurs.then(|| Blur {
            kernel: settings.kernel,
            border: settings.border,
            radius: settings.blur_radius(),
        });
        let scene = Scene::new(settings.resolution, settings.silhouettes, blur)?;
        let truth = truth(blurs.then_some(settings.sigma_target));
        let cameras: Vec<DMat4> = views.iter().map(View::camera).collect();
        let target = |camera: &DMat4| -> Result<Tensor<f64>, FitError> {
            let tape = Tape::new();
            let (vertices, colors) = (tape.constant(&truth.vertices), tape.constant(&truth.colors));
            let sigma = truth.sigma.map(|sigma| tape.constant_scalar(sigma));
            Ok(scene.image(camera, vertices, colors, sigma)?.value())
        };
        let targets = cameras.iter().map(target).collect::<Result<_, _>>()?;
        Ok(Self { scene, cameras, targets, blurs })
    }

    /// Whether there is a blur, and with it a sigma.
    pub fn blurs(&self) -> bool {
        self.blurs
    }

    /// How many views there are.
    pub fn count(&self) -> usize {
        self.cameras.len()
    }

    /// The image of one view, `[H, W, C]`, for `vertices: [8, 3]`, `colors: [8, C]` and `sigma: []`.
    pub(super) fn image<T: Scalar>(
        &self,
        view: usize,
        vertices: &Tensor<T>,
        colors: &Tensor<T>,
        sigma: Option<&Tensor<T>>,
    ) -> Result<Tensor<T>, FitError> {
        let tape = Tape::new();
        let (vertices, colors) = (tape.constant(vertices), tape.constant(colors));
        let sigma = sigma.map(|sigma| tape.constant(sigma));
        Ok(self.scene.image(&self.cameras[view], vertices, colors, sigma)?.value())
    }

    /// `image - target` of one view, `[H, W, 3]`.
    pub(super) fn residual(
        &self,
        view: usize,
        vertices: &Tensor<f64>,
        colors: &Tensor<f64>,
        sigma: Option<&Tensor<f64>>,
    ) -> Result<Tensor<f64>, FitError> {
        let image = self.image(view, vertices, colors, sigma)?;
        let target = self.targets[view].data();
        Ok(Tensor::from_flat_fn(image.shape(), |k| image.data()[k] - target[k]))
    }

    /// Records `image - target` over all views, flat, for `vertices` and `colors`, `[8, 3]` each,
    /// and `sigma`, `[]`, in pixels, where there is a blur.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn residuals<'t, T: Scalar>(
        &self,
        vertices: Var<'t, T>,
        colors: Var<'t, T>,
        sigma: Option<Var<'t, T>>,
    ) -> Result<Var<'t, T>, FitError> {
        let residual = |(camera, target): (&DMat4, &Tensor<f64>)| -> Result<_, FitError> {
            let image = self.scene.image(camera, vertices, colors, sigma)?;
            let target = vertices.tape().constant(&target.map(T::from_f64));
            Ok((image - target).reshape([target.shape().size()])?)
        };
        let views = self.cameras.iter().zip(&self.targets);
        let residuals = views.map(residual).collect::<Result<Vec<_>, _>>()?;
        Ok(Var::concat(&residuals, 0)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Pipeline as _;
    use crate::scenes::{CubePipeline, Experiment, Preset, random_start};

    #[test]
    fn squares_of_residuals_sum_to_the_losses_of_the_views() {
        for experiment in [Experiment::Vertices, Experiment::Joint] {
            let new = CubeSettings::new(experiment, Preset::Paper);
            let settings = CubeSettings { resolution: 16, seed: 3, ..new };
            let (mut pipeline, parameters) = CubePipeline::<f64>::new(&settings).unwrap();
            let tape = Tape::new();
            let variables = parameters.record(&tape);
            let mut losses = 0.0;
            let views = [4, 7].map(|step| View::random(settings.seed, step));
            for step in [4, 7] {
                pipeline.prepare(step).unwrap();
                losses += pipeline.loss(&tape, &variables).unwrap().item();
            }
            let cube = CubeViews::new(&settings, &views).unwrap();
            let start = random_start(settings.seed, None);
            let [vertices, colors] = [&start.vertices, &start.colors].map(|x| tape.leaf(x));
            let sigma = cube.blurs().then(|| tape.leaf_scalar(settings.sigma_start));
            let residuals = cube.residuals(vertices, colors, sigma).unwrap();
            let squares = residuals.square().sum().item();
            assert!(losses > 1.0 && (squares - losses).abs() < 1e-12 * losses);
        }
    }

    #[test]
    fn without_a_view_there_is_nothing_to_fit() {
        let settings = CubeSettings::new(Experiment::Joint, Preset::Paper);
        let message = "a set of views needs at least one, got 0";
        assert_eq!(CubeViews::new(&settings, &[]).unwrap_err().to_string(), message);
    }
}
