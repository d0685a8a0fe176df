//! What views are compared with: their images, decoded when their turn comes.
//!
//! Decoded images are kept as far as a budget of memory goes, the first that were asked for; all others are
//! decoded anew. Which of them are kept changes no bit.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{PixelLoss, RenderError};

use crate::description::{LossKind, Tone};
use crate::error::{Location, SceneError};
use crate::picture::{ColorSpace, Samples, reduced};
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
            if let Some(image) = kept.images.get(&(view, reduce)) {
                return Ok(Arc::clone(image));
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
        let scene = self.renderer.scene();
        scene.views[view].read_mask(&scene.folder)
    }

    fn decoded(&self, view: usize, reduce: usize) -> Result<Target, SceneError> {
        let scene = self.renderer.scene();
        let scene_view = &scene.views[view];
        let Some(file) = &scene_view.image else {
            let message =
                format!("a view that is compared has an image, and {:?} has none", scene_view.name);
            return Err(SceneError::content(Location::new(scene.folder.path()), message));
        };
        let picture = scene_view.read_picture(&scene.folder, file)?;
        let space = scene_view.color_space.unwrap_or_else(|| ColorSpace::for_picture(&picture));
        let mut mask = match &scene_view.mask {
            None => picture.opacity(),
            Some(_) => self.mask(view)?,
        };
        let tone = scene.description.pipeline.tone;
        let with_mask = self.has_mask(view);
        if with_mask && mask.is_none() {
            let rule =
                "masks count in the loss, and this image has no opacity and the view no mask";
            return Err(SceneError::content(Location::new(scene.folder.join(file)), rule));
        }
        let is_eight_bit = matches!(picture.samples, Samples::U8(_));
        let is_encoded = tone == Tone::Srgb && space == ColorSpace::Srgb;
        let mut image = if is_encoded && mask.is_none() && reduce == 1 && is_eight_bit {
            // As it stands in the file: decoding and encoding would change nothing.
            picture.color(ColorSpace::Linear)
        } else {
            let mut light = match &mask {
                None => picture.color(space),
                // OpenEXR's colours are multiplied by their own opacity already.
                Some(mask)
                    if scene_view.mask.is_none() && matches!(picture.samples, Samples::F32(_)) =>
                {
                    self.before_background(&picture.color(space), mask, true)
                }
                Some(mask) => self.before_background(&picture.straight_color(space), mask, false),
            };
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
            let color = if is_multiplied { light[k] } else { share * light[k] };
            color + (1.0 - share) * behind[k % 3]
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
        Ok(PixelLoss::new(image, &background, move |rows, reference| {
            let errors = errors(rows.try_sub(reference)?, kind)?;
            Ok(errors.try_mul(rows.tape().constant(&weights))?)
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

/// An error of a scene as one of a fit.
pub(crate) fn fit_error(error: SceneError) -> FitError {
    match error {
        SceneError::Fit(error) => error,
        SceneError::Render(error) => error.into(),
        error => FitError::operation(error),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::picture::{Depth, Picture};
    use crate::scene::Scene;

    const SIZE: [usize; 2] = [7, 5];
    const BEHIND: [f32; 3] = [0.5, 0.25, 1.0];

    /// Where a view has its mask.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Cover {
        Nowhere,
        Opacity,
        File,
        /// The file counts.
        Both,
    }

    /// An image of a combination: its depth, channels of colour, cover, and what the scene says of its space.
    type Case = (Depth, usize, Cover, Option<ColorSpace>);

    fn cases() -> Vec<Case> {
        let mut all = Vec::new();
        for depth in [Depth::Eight, Depth::Sixteen, Depth::ThirtyTwo] {
            for channels in [1, 3] {
                for cover in [Cover::Nowhere, Cover::Opacity, Cover::File, Cover::Both] {
                    for space in [None, Some(ColorSpace::Srgb), Some(ColorSpace::Linear)] {
                        all.push((depth, channels, cover, space));
                    }
                }
            }
        }
        all
    }

    /// A whole number of the file, of 255, for a pixel's channel; that of gray is that of red.
    fn number(pixel: usize, channel: usize, channels: usize) -> f64 {
        let channel = if channels == 1 { 0 } else { channel };
        ((pixel * 37 + channel * 101 + pixel * pixel) % 256) as f64
    }

    /// Opacity of 255, nowhere 0 where colours are divided by it; and the file's mask, which differs from it.
    fn opacity(pixel: usize) -> f64 {
        [255.0, 51.0, 102.0, 204.0][pixel % 4]
    }

    fn mask(pixel: usize) -> f64 {
        [0.0, 255.0, 255.0, 51.0, 153.0][pixel % 5]
    }

    /// The curve of sRGB, written anew.
    fn decode(y: f64) -> f64 {
        if y <= 0.04045 { y / 12.92 } else { ((y + 0.055) / 1.055).powf(2.4) }
    }

    fn encode(x: f64) -> f64 {
        if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
    }

    fn is_linear(&(depth, _, _, space): &Case) -> bool {
        match space {
            None => depth == Depth::ThirtyTwo,
            Some(space) => space == ColorSpace::Linear,
        }
    }

    fn picture(case: &Case) -> Picture {
        let &(depth, channels, cover, _) = case;
        let has_opacity = matches!(cover, Cover::Opacity | Cover::Both);
        let all = channels + usize::from(has_opacity);
        let [width, height] = SIZE;
        // In shares of the largest.
        let sample = |k: usize| {
            let (pixel, channel) = (k / all, k % all);
            let share = number(pixel, channel, channels) / 255.0;
            match (channel == channels, depth) {
                (true, _) => opacity(pixel) / 255.0,
                // Light is multiplied by opacity before it becomes a number.
                (false, Depth::ThirtyTwo) if has_opacity => match is_linear(case) {
                    true => share * opacity(pixel) / 255.0,
                    false => encode(decode(share) * opacity(pixel) / 255.0),
                },
                (false, _) => share,
            }
        };
        let shares = (0..width * height * all).map(sample);
        let samples = match depth {
            Depth::Eight => Samples::U8(shares.map(|x| (x * 255.0).round() as u8).collect()),
            Depth::Sixteen => Samples::U16(shares.map(|x| (x * 65535.0).round() as u16).collect()),
            Depth::ThirtyTwo => Samples::F32(shares.map(|x| x as f32).collect()),
        };
        Picture { width, height, channels: all, samples }
    }

    /// What a view is compared with, by the definitions: a pixel of so many times so many, as light before the
    /// background, in the tone; and the mean of its mask.
    fn expected(case: &Case, tone: Tone, reduce: usize, [row, column]: [usize; 2]) -> [f64; 4] {
        let &(_, channels, cover, _) = case;
        let mut sums = [0.0; 4];
        for n in 0..reduce * reduce {
            let pixel = (row * reduce + n / reduce) * SIZE[0] + column * reduce + n % reduce;
            let share = match cover {
                Cover::Nowhere => 1.0,
                Cover::Opacity => opacity(pixel) / 255.0,
                Cover::File | Cover::Both => mask(pixel) / 255.0,
            };
            for channel in 0..3 {
                let value = number(pixel, channel, channels) / 255.0;
                let light = if is_linear(case) { value } else { decode(value) };
                sums[channel] += share * light + (1.0 - share) * f64::from(BEHIND[channel]);
            }
            sums[3] += share;
        }
        let mut means = sums.map(|sum| sum / (reduce * reduce) as f64);
        if tone == Tone::Srgb {
            means[..3].iter_mut().for_each(|mean| *mean = encode(mean.clamp(0.0, 1.0)));
        }
        means
    }

    #[test]
    fn a_number_of_a_file_means_the_same_in_each_combination() {
        let directory = tempfile::tempdir().unwrap();
        let write =
            |name: &str, bytes: Vec<u8>| fs::write(directory.path().join(name), bytes).unwrap();
        let [width, height] = SIZE;
        let samples = Samples::U8((0..width * height).map(|pixel| mask(pixel) as u8).collect());
        let file = Picture { width, height, channels: 1, samples };
        write("mask.png", file.encode_png(&Location::new("mask")).unwrap());
        let mut views = String::new();
        for (k, case) in cases().iter().enumerate() {
            let (name, picture) = (Location::new("image"), picture(case));
            match case.0 {
                Depth::ThirtyTwo => write(&format!("{k}"), picture.encode_exr(&name).unwrap()),
                _ => write(&format!("{k}"), picture.encode_png(&name).unwrap()),
            }
            views += &format!(
                "[[views]]\nimage = \"{k}\"\ncamera = {{ position = [0, 0, 3], angle = 40 }}\n"
            );
            if matches!(case.2, Cover::File | Cover::Both) {
                views += "mask = \"mask.png\"\n";
            }
            views += match case.3 {
                None => "",
                Some(ColorSpace::Srgb) => "color_space = \"srgb\"\n",
                Some(ColorSpace::Linear) => "color_space = \"linear\"\n",
            };
        }
        for (tone, name) in [(Tone::Srgb, "srgb"), (Tone::Linear, "linear")] {
            for silhouette in [0, 1] {
                let text = format!(
                    "[[meshes]]\nshape = \"cube\"\n[pipeline]\ntone = \"{name}\"\n\
                     background = {BEHIND:?}\n[loss]\nsilhouette = {silhouette}\n{views}"
                );
                let file = directory.path().join("scene.toml");
                fs::write(&file, text).unwrap();
                let renderer = Renderer::new(Arc::new(Scene::load(&file).unwrap())).unwrap();
                let targets = Targets::new(Arc::new(renderer), true);
                for (view, case) in cases().iter().enumerate() {
                    for reduce in [1, 2, 3] {
                        let target = targets.get(view, reduce);
                        if silhouette == 1 && case.2 == Cover::Nowhere {
                            let message = target.err().map(|error| error.to_string());
                            assert!(message.is_some_and(|message| message.contains("masks count")));
                            continue;
                        }
                        let image = target.unwrap().image.clone();
                        let size = [SIZE[1] / reduce, SIZE[0] / reduce];
                        assert_eq!(**image.shape(), [size[0], size[1], 3 + silhouette]);
                        for pixel in 0..size[0] * size[1] {
                            let at = [pixel / size[1], pixel % size[1]];
                            let expected = expected(case, tone, reduce, at);
                            for channel in 0..3 + silhouette {
                                let found = f64::from(image[[at[0], at[1], channel]]);
                                let off = (found - expected[channel]).abs();
                                let what = format!("{case:?} {name} {reduce} {at:?} {channel}");
                                assert!(off < 1e-5, "{what}: {found} for {}", expected[channel]);
                            }
                        }
                    }
                }
            }
        }
    }
}
