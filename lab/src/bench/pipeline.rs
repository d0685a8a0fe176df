//! The pipeline whose time is taken: from positions to a loss and its gradients.

use std::hint::black_box;

use bokashi_core::{Gradients, Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Cull, Picture, PixelLoss, RasterOptions, interpolate, project, rasterize,
};
use rayon::ThreadPool;

use crate::bench::sampling::Contestant;
use crate::bench::scenes::Scene;

/// The picture of `scene` with other positions and colours.
pub(crate) fn picture<'t, T: Scalar>(
    scene: &Scene,
    options: RasterOptions,
    positions: Var<'t, T>,
    colors: Var<'t, T>,
) -> Result<Picture<'t, T>, FitError> {
    let clip = project(positions, &scene.camera, None)?;
    let shown = [colors.into()];
    let creases = if scene.has_creases { &shown[..] } else { &[] };
    let fragments = rasterize(clip, &scene.mesh, options.creases(creases))?;
    Ok(fragments.picture(interpolate(colors, &fragments)?, Background::Zero)?)
}

/// The antialiased image of `scene` with other positions and colours.
pub(crate) fn render<'t, T: Scalar>(
    scene: &Scene,
    cull: Cull,
    positions: Var<'t, T>,
    colors: Var<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let options = RasterOptions::new(scene.size).cull(cull);
    Ok(picture(scene, options, positions, colors)?.image()?)
}

/// What is compared with the reference image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compared {
    /// The pixels that can differ from the background; what the others cost is known beforehand.
    Picture,
    /// Every pixel of the image.
    Image,
}

/// A scene whose positions and colours are a little off a reference image.
pub(crate) struct Learner<T: Scalar> {
    scene: Scene,
    options: RasterOptions,
    compared: Compared,
    positions: Tensor<T>,
    colors: Tensor<T>,
    reference: PixelLoss<T>,
    tape: Tape<T>,
}

/// The standard deviation of how far positions are off in x and in y, as a share of the image: 0.3
/// pixels at 256 px, as in DEODR's figures (`lab/peers`).
const SHIFT: f64 = 0.3 / 256.0;
/// Colours are this far off.
const TINT: f64 = 0.05;

impl<T: Scalar> Learner<T> {
    pub(crate) fn new(scene: &Scene, cull: Cull, compared: Compared) -> Result<Self, FitError> {
        Self::with(scene, RasterOptions::new(scene.size).cull(cull), compared)
    }

    /// [`Learner::new`], with options for rasterization.
    pub(crate) fn with(
        scene: &Scene,
        options: RasterOptions,
        compared: Compared,
    ) -> Result<Self, FitError> {
        let mut tape = Tape::new();
        let reference = {
            let positions = tape.constant(&scene.positions.cast());
            let colors = tape.constant(&scene.colors.cast());
            picture(scene, options, positions, colors)?.image()?.value()
        };
        tape.reset();
        let reference = PixelLoss::squared(&reference, &Tensor::zeros([3]))?;
        let positions = scene.jittered(SHIFT * scene.size.width as f64, 0).cast();
        let colors = scene.colors.map(|color: f64| T::from_f64((color + TINT).min(1.0)));
        Ok(Self { scene: scene.clone(), options, compared, positions, colors, reference, tape })
    }

    /// One step of a fit without its optimizer: render, loss, gradients.
    pub(crate) fn step(&mut self) -> Result<(), FitError> {
        let positions = self.tape.leaf(&self.positions);
        let colors = self.tape.leaf(&self.colors);
        let picture = picture(&self.scene, self.options, positions, colors)?;
        let loss = match self.compared {
            Compared::Picture => picture.loss(&self.reference)?,
            Compared::Image => self.reference.evaluate(picture.image()?)?,
        };
        let gradients: Gradients<'_, T> = loss.backward()?;
        black_box((loss.item(), gradients.get(positions), gradients.get(colors)));
        drop(gradients);
        self.tape.reset();
        Ok(())
    }
}

impl Scene {
    /// Steps on this scene in `f32`, back faces drawn, as a function that takes one.
    ///
    /// # Errors
    /// What an operation refuses: none does.
    pub fn steps(&self) -> Result<impl FnMut() -> Result<(), FitError> + Send, FitError> {
        let options = RasterOptions::new(self.size);
        let mut learner = Learner::<f32>::with(self, options, Compared::Picture)?;
        Ok(move || learner.step())
    }
}

/// Takes steps of `learner` on the threads of `pool`.
pub(crate) fn contestant<'a, T: Scalar>(
    mut learner: Learner<T>,
    pool: &'a ThreadPool,
) -> Contestant<'a> {
    Contestant::new(pool, move || learner.step())
}
