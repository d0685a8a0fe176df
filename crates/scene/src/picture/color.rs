//! Images to tensors of light, and back.
//!
//! The curve of sRGB is that of IEC 61966-2-1: `x = y / 12.92` up to `y = 0.04045`, and
//! `x = ((y + 0.055) / 1.055)^2.4` from there on; with the sign below 0.

use std::cell::LazyCell;

use bokashi_core::{Shape, Tensor};
use bokashi_render_ops::RenderError;

use super::samples::{Picture, Samples};
use crate::error::SceneError;

/// How numbers of a file stand for light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorSpace {
    /// Encoded by the curve of sRGB, as in photographs.
    Srgb,
    /// In proportion to light, as in EXR files and normal maps.
    Linear,
}

impl ColorSpace {
    /// The usual space of a picture's colours: linear for samples of 32 bits, sRGB for others.
    pub const fn for_picture(picture: &Picture) -> Self {
        match picture.samples {
            Samples::F32(_) => Self::Linear,
            Samples::U8(_) | Samples::U16(_) => Self::Srgb,
        }
    }

    /// The light that a file's number stands for.
    pub(crate) fn decode(self, y: f64) -> f64 {
        let size = y.abs();
        match self {
            Self::Linear => y,
            Self::Srgb if size <= 0.04045 => y / 12.92,
            Self::Srgb => ((size + 0.055) / 1.055).powf(2.4).copysign(y),
        }
    }

    /// The light that each byte stands for.
    fn decoded_bytes(self) -> [f32; 256] {
        std::array::from_fn(|byte| self.decode(byte as f64 / 255.0) as f32)
    }

    /// The number of a file that stands for light.
    pub(crate) fn encode(self, x: f64) -> f64 {
        let size = x.abs();
        match self {
            Self::Linear => x,
            Self::Srgb if size <= 0.0031308 => x * 12.92,
            Self::Srgb => (1.055 * size.powf(1.0 / 2.4) - 0.055).copysign(x),
        }
    }
}

/// How many bits the samples of an image are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// 0 to 255 stand for 0 to 1.
    Eight,
    /// 0 to 65535 stand for 0 to 1.
    Sixteen,
    /// Any number, as `f32`.
    ThirtyTwo,
}

/// The space of each sample of pixels with so many channels. No curve changes opacity, the last of two or four.
fn spaces(channels: usize, space: ColorSpace) -> impl Fn(usize) -> ColorSpace {
    move |index| match matches!(channels, 2 | 4) && index % channels == channels - 1 {
        true => ColorSpace::Linear,
        false => space,
    }
}

impl Picture {
    /// All channels as linear light: `[H, W, C]`. No curve changes opacity.
    ///
    /// # Panics
    /// Where there are fewer samples than the size says.
    pub fn light(&self, space: ColorSpace) -> Tensor<f32> {
        let shape = [self.height, self.width, self.channels];
        self.decoded(shape, |k| k, spaces(self.channels, space))
    }

    /// The colours as linear light: `[H, W, 3]`, red, green, blue. Gray is repeated.
    ///
    /// # Panics
    /// Where there are fewer samples than the size says.
    pub fn color(&self, space: ColorSpace) -> Tensor<f32> {
        let channel = |k: usize| if self.channels < 3 { 0 } else { k % 3 };
        let index = |k: usize| k / 3 * self.channels + channel(k);
        self.decoded([self.height, self.width, 3], index, |_| space)
    }

    /// The light of the samples with these indices, in the space that each has.
    fn decoded(
        &self,
        shape: impl Into<Shape>,
        index: impl Fn(usize) -> usize,
        space: impl Fn(usize) -> ColorSpace,
    ) -> Tensor<f32> {
        match &self.samples {
            Samples::U8(samples) => {
                // Powers are taken for images that need them.
                let [srgb, linear] = [ColorSpace::Srgb, ColorSpace::Linear]
                    .map(|space| LazyCell::new(move || space.decoded_bytes()));
                Tensor::from_flat_fn(shape, |k| {
                    let position = index(k);
                    let byte = usize::from(samples[position]);
                    match space(position) {
                        ColorSpace::Srgb => srgb[byte],
                        ColorSpace::Linear => linear[byte],
                    }
                })
            }
            Samples::U16(samples) => Tensor::from_flat_fn(shape, |k| {
                space(index(k)).decode(f64::from(samples[index(k)]) / 65535.0) as f32
            }),
            Samples::F32(samples) => Tensor::from_flat_fn(shape, |k| match space(index(k)) {
                ColorSpace::Linear => samples[index(k)],
                ColorSpace::Srgb => ColorSpace::Srgb.decode(samples[index(k)].into()) as f32,
            }),
        }
    }

    /// The colours as [`Picture::color`], not multiplied by the image's own opacity. Samples of 32 bits are
    /// multiplied by it in their file, and so are divided by it here where it is above 0.
    ///
    /// # Panics
    /// As [`Picture::color`].
    pub fn straight_color(&self, space: ColorSpace) -> Tensor<f32> {
        let color = self.color(space);
        match (&self.samples, self.opacity()) {
            (Samples::F32(_), Some(opacity)) => {
                let (color, opacity) = (color.data(), opacity.data());
                Tensor::from_flat_fn([self.height, self.width, 3], |k| match opacity[k / 3] {
                    share if share > 0.0 => color[k] / share,
                    _ => color[k],
                })
            }
            _ => color,
        }
    }

    /// The opacity, from 0 to 1: `[H, W]`. None where the image has two or four channels less.
    ///
    /// # Panics
    /// As [`Picture::color`].
    pub fn opacity(&self) -> Option<Tensor<f32>> {
        self.channel(self.opacity_channel()?)
    }

    /// The numbers of red, green or blue as they are, for `k` from 0 to 2, whole ones divided by the largest:
    /// `[H, W]`. Gray is all three of them.
    ///
    /// # Panics
    /// As [`Picture::color`], and for another `k`.
    pub fn primary(&self, k: usize) -> Tensor<f32> {
        assert!(k < 3, "red, green and blue are 0 to 2, and this is {k}");
        let k = if self.channels < 3 { 0 } else { k };
        self.channel(k).expect("an image has a channel, and three for colours")
    }

    /// The numbers of channel `k` as they are, whole ones divided by the largest: `[H, W]`. None
    /// where the image has fewer channels.
    ///
    /// # Panics
    /// As [`Picture::color`].
    pub fn channel(&self, k: usize) -> Option<Tensor<f32>> {
        let index = |pixel: usize| pixel * self.channels + k;
        let shape = [self.height, self.width];
        (k < self.channels).then(|| self.decoded(shape, index, |_| ColorSpace::Linear))
    }

    /// The image of 8 bits of linear light `color: [H, W, C]`, clamped to 0 .. 1 and rounded; a NaN
    /// is 0. With two or four channels the last is opacity, which no curve changes.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless there are rows, columns, and one to four channels.
    pub fn from_color(color: &Tensor<f32>, space: ColorSpace) -> Result<Self, SceneError> {
        Self::from_light(color, space, Depth::Eight)
    }

    /// The image of linear light `light: [H, W, C]`. Numbers of 8 and 16 bits are clamped to 0 .. 1 and
    /// rounded, and a NaN is 0 there. With two or four channels the last is opacity, which no curve changes.
    ///
    /// # Errors
    /// As [`Picture::from_color`].
    pub fn from_light(
        light: &Tensor<f32>,
        space: ColorSpace,
        depth: Depth,
    ) -> Result<Self, SceneError> {
        let [height, width, channels] = extents("an image of colours", light)?;
        let spaces = spaces(channels, space);
        let all = light.data().iter().copied().enumerate();
        let whole =
            all.clone().map(|(index, light)| spaces(index).encode(light.clamp(0.0, 1.0).into()));
        let samples = match depth {
            // A NaN becomes 0.
            Depth::Eight => Samples::U8(whole.map(|y| (y * 255.0).round() as u8).collect()),
            Depth::Sixteen => Samples::U16(whole.map(|y| (y * 65535.0).round() as u16).collect()),
            Depth::ThirtyTwo => {
                let sample = |(index, light): (usize, f32)| match spaces(index) {
                    ColorSpace::Linear => light,
                    space => space.encode(light.into()) as f32,
                };
                Samples::F32(all.map(sample).collect())
            }
        };
        Ok(Self { width, height, channels, samples })
    }

    /// The image of 32 bits with the entries of `numbers: [H, W]` or `[H, W, C]`.
    ///
    /// # Errors
    /// As [`Picture::from_color`].
    pub fn from_numbers(numbers: &Tensor<f32>) -> Result<Self, SceneError> {
        let [height, width, channels] = extents("an image of numbers", numbers)?;
        let samples = Samples::F32(numbers.data().to_vec());
        Ok(Self { width, height, channels, samples })
    }
}

/// Rows, columns and channels.
fn extents(operation: &'static str, tensor: &Tensor<f32>) -> Result<[usize; 3], SceneError> {
    let extents = match **tensor.shape() {
        [height, width] => [height, width, 1],
        [height, width, channels] => [height, width, channels],
        _ => [0; 3],
    };
    if extents.contains(&0) || extents[2] > 4 {
        let rule = "shape [H, W] or [H, W, C], with pixels and one to four channels".to_owned();
        let shape = tensor.shape().clone();
        return Err(RenderError::Shape { operation, rule, shape }.into());
    }
    Ok(extents)
}
