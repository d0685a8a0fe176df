//! What views are compared with: their images, decoded when their turn comes.
//!
//! Decoded images are kept as far as a budget of memory goes, the first that were asked for; all others are
//! decoded anew. Which of them are kept changes no bit.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{PixelLoss, RenderError, Size};

use crate::description::{LossKind, Tone};
use crate::error::{Place, SceneError};
use crate::picture::{ColorSpace, Picture, Samples};
use crate::renderer::Renderer;

/// The memory of decoded images, in bytes.
pub(crate) const BUDGET: usize = 384 << 20;

/// Below this a difference counts by its square, beyond it by its absolute value.
pub(crate) const HUBER: f64 = 0.1;

/// The image of a view as pixels stand for it.
pub(crate) struct Target {
    /// `[H, W, 3]`, or with a fourth channel that is 1 where the objects are.
    pub(crate) image: Tensor<f32>,
    /// The sum over pixels, where no operation sees a pixel's neighbours.
    pub(crate) loss: Option<PixelLoss<f32>>,
}

/// The images of all views.
pub(crate) struct Targets {
    renderer: Arc<Renderer>,
    /// Whether pictures become images before they are compared.
    is_dense: bool,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    bytes: usize,
    /// By view, and how many times smaller it is.
    images: HashMap<(usize, usize), Arc<Target>>,
}

impl Targets {
    /// The images of the renderer's scene.
    pub(crate) fn new(renderer: Arc<Renderer>, is_dense: bool) -> Self {
        Self { renderer, is_dense, kept: Mutex::default() }
    }

    /// Whether views are compared by their masks, too.
    pub(crate) fn has_mask(&self, view: usize) -> bool {
        let scene = self.renderer.scene();
        scene.description.loss.silhouette.is_some_and(|weight| weight.0 > 0.0)
            && scene.views[view].image.is_some()
    }

    /// The image of a view, made smaller `reduce` times along each axis.
    ///
    /// # Errors
    /// Whatever is wrong with the file; [`SceneError::Content`] for an image of another size than its
    /// camera's, for one without a mask where masks count, and for a view without an image.
    pub(crate) fn get(&self, view: usize, reduce: usize) -> Result<Arc<Target>, SceneError> {
        {
            let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(found) = kept.images.get(&(view, reduce)) {
                return Ok(Arc::clone(found));
            }
        }
        // Others go on while it is decoded.
        let target = Arc::new(self.decoded(view, reduce)?);
        let bytes = size_of_val(target.image.data()) * if target.loss.is_some() { 2 } else { 1 };
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.bytes + bytes <= BUDGET && !kept.images.contains_key(&(view, reduce)) {
            kept.bytes += bytes;
            kept.images.insert((view, reduce), Arc::clone(&target));
        }
        Ok(target)
    }

    /// The views whose images are kept, in ascending order.
    #[cfg(test)]
    pub(crate) fn kept_views(&self) -> Vec<usize> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let mut views: Vec<_> = kept.images.keys().map(|&(view, _)| view).collect();
        views.sort_unstable();
        views
    }

    /// Forgets all images that were kept: others are asked for from now on.
    pub(crate) fn forget(&self) {
        *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = Kept::default();
    }

    /// The mask of a view, `[H, W]`, if it has one: its file, or the image's opacity.
    ///
    /// # Errors
    /// As [`Targets::get`].
    pub(crate) fn mask(&self, view: usize) -> Result<Option<Tensor<f32>>, SceneError> {
        let own = &self.renderer.scene().views[view];
        match (&own.mask, &own.image) {
            (None, Some(image)) => Ok(self.picture(image, own.camera.size)?.0.opacity()),
            (Some(mask), _) => Ok(self.picture(mask, own.camera.size)?.0.channel(0)),
            (None, None) => Ok(None),
        }
    }

    /// The image of a file, which has this size; and where it is.
    fn picture(&self, file: &Path, size: Size) -> Result<(Picture, Place), SceneError> {
        let folder = &self.renderer.scene().folder;
        let place = Place::of(folder.join(file));
        let picture = Picture::decode(&folder.read(file)?, &place)?;
        let Size { width, height } = size;
        if [picture.width, picture.height] != [width, height] {
            let rule = format!("an image has the size of its view, {width} x {height}");
            let message = format!("{rule}, and this is {} x {}", picture.width, picture.height);
            return Err(SceneError::content(place, message));
        }
        Ok((picture, place))
    }

    fn decoded(&self, view: usize, reduce: usize) -> Result<Target, SceneError> {
        let scene = self.renderer.scene();
        let own = &scene.views[view];
        let Some(file) = &own.image else {
            let message =
                format!("a view that is compared has an image, and {:?} has none", own.name);
            return Err(SceneError::content(Place::of(scene.folder.path()), message));
        };
        let (picture, place) = self.picture(file, own.camera.size)?;
        let space = own.color_space.unwrap_or_else(|| ColorSpace::of(&picture));
        let mut mask = match &own.mask {
            None => picture.opacity(),
            Some(file) => self.picture(file, own.camera.size)?.0.channel(0),
        };
        let tone = scene.description.pipeline.tone;
        let with_mask = self.has_mask(view);
        if with_mask && mask.is_none() {
            let rule =
                "masks count in the loss, and this image has no opacity and the view no mask";
            return Err(SceneError::content(place, rule));
        }
        let is_eight_bit = matches!(picture.samples, Samples::U8(_));
        let mut image = if tone == Tone::Srgb && mask.is_none() && reduce == 1 && is_eight_bit {
            // As it stands in the file: decoding and encoding would change nothing.
            picture.color(ColorSpace::Linear)
        } else {
            let mut light = picture.color(space);
            if let Some(mask) = &mask {
                // OpenEXR's colours are multiplied already.
                let is_multiplied =
                    own.mask.is_none() && matches!(picture.samples, Samples::F32(_));
                light = self.before_background(&light, mask, is_multiplied);
            }
            if reduce > 1 {
                light = reduced(&light, reduce);
                mask = mask.map(|mask| reduced(&mask, reduce));
            }
            let tape = Tape::new();
            self.renderer.toned(tape.constant(&light))?.value()
        };
        if let Some(mask) = mask.filter(|_| with_mask) {
            let (colors, mask) = (image.data(), mask.data());
            let [height, width] = [image.shape()[0], image.shape()[1]];
            image = Tensor::from_flat_fn([height, width, 4], |k| match k % 4 {
                3 => mask[k / 4],
                channel => colors[k / 4 * 3 + channel],
            });
        }
        let loss = (!self.is_dense).then(|| self.loss(&image)).transpose()?;
        Ok(Target { image, loss })
    }

    /// Light `[H, W, 3]` where `mask` shows it, the scene's background elsewhere.
    fn before_background(
        &self,
        light: &Tensor<f32>,
        mask: &Tensor<f32>,
        is_multiplied: bool,
    ) -> Tensor<f32> {
        let background = self.renderer.scene().description.pipeline.background;
        let behind = background.map_or([0.0; 3], |color| color.map(|x| x.0 as f32));
        let (shape, light, mask) = (light.shape(), light.data(), mask.data());
        Tensor::from_flat_fn(shape, |k| {
            let share = mask[k / 3];
            let own = if is_multiplied { light[k] } else { share * light[k] };
            own + (1.0 - share) * behind[k % 3]
        })
    }

    /// What is summed over pixels, divided so that it is a mean.
    fn loss(&self, image: &Tensor<f32>) -> Result<PixelLoss<f32>, SceneError> {
        let scene = self.renderer.scene();
        let channels = image.shape()[2];
        let pixels = (image.size() / channels) as f64;
        let kind = scene.description.loss.kind;
        let silhouette = scene.description.loss.silhouette.map_or(0.0, |weight| weight.0);
        let weights: Vec<f32> = (0..channels)
            .map(|channel| if channel < 3 { 1.0 / (3.0 * pixels) } else { silhouette / pixels })
            .map(|weight| weight as f32)
            .collect();
        let weights = Tensor::from(weights.as_slice());
        let background = self.renderer.background(channels)?;
        Ok(PixelLoss::new(image, &background, move |seen, reference| {
            let errors = errors(seen.try_sub(reference)?, kind)?;
            Ok(errors.try_mul(seen.tape().constant(&weights))?)
        })?)
    }
}

/// What counts of differences, entry by entry.
pub(crate) fn errors<'t>(
    difference: Var<'t, f32>,
    kind: LossKind,
) -> Result<Var<'t, f32>, RenderError> {
    Ok(match kind {
        LossKind::Squared => difference.square(),
        LossKind::Absolute => difference.abs(),
        LossKind::Huber => {
            // With h = min(|d|, delta): h^2 / 2 + delta (|d| - h).
            let size = difference.abs();
            let near = size.clamp(0.0, HUBER as f32)?;
            (near.square() * 0.5).try_add(size.try_sub(near)? * HUBER as f32)?
        }
    })
}

/// Means over `k` x `k` pixels of an image `[H, W, C]` or `[H, W]`; what is left at the right and below is
/// cut off.
fn reduced(image: &Tensor<f32>, k: usize) -> Tensor<f32> {
    let shape = image.shape().to_vec();
    let channels = shape.get(2).copied().unwrap_or(1);
    let [height, width] = [(shape[0] / k).max(1), (shape[1] / k).max(1)];
    let [rows, columns] = [k.min(shape[0]), k.min(shape[1])];
    let data = image.data();
    let mut small = vec![0.0_f32; height * width * channels];
    for (at, mean) in small.iter_mut().enumerate() {
        let (pixel, channel) = (at / channels, at % channels);
        let (row, column) = (pixel / width * k, pixel % width * k);
        let block = (0..rows * columns).map(|n| {
            let (row, column) = (row + n / columns, column + n % columns);
            f64::from(data[(row * shape[1] + column) * channels + channel])
        });
        *mean = (block.sum::<f64>() / (rows * columns) as f64) as f32;
    }
    let mut small_shape = shape;
    (small_shape[0], small_shape[1]) = (height, width);
    Tensor::from_flat_fn(small_shape.as_slice(), |at| small[at])
}

/// An error of a scene as one of a fit.
pub(crate) fn fit_error(error: SceneError) -> FitError {
    match error {
        SceneError::Fit(error) => error,
        SceneError::Render(error) => error.into(),
        error => FitError::operation(error),
    }
}
