//! Tensors from and to the images of the crate `image`.

use bokashi_core::Tensor;
use image::DynamicImage;

use crate::error::SceneError;
use crate::picture::{ColorSpace, Depth, Picture};

/// The light of an image, an `ImageBuffer` or a `DynamicImage`: `[H, W, C]`, with its channels, one to four.
///
/// `space` says how its numbers stand for light. Opacity, the second channel of two and the fourth of four, has
/// no curve.
///
/// # Errors
/// [`SceneError::Content`] without a pixel.
pub fn tensor_of_image(
    image: impl Into<DynamicImage>,
    space: ColorSpace,
) -> Result<Tensor<f32>, SceneError> {
    Ok(Picture::from_image(image.into())?.light(space))
}

/// The image of linear light `[H, W, C]` with one to four channels, or `[H, W]`: [`tensor_of_image`] the other
/// way. Numbers of 8 and 16 bits are clamped to 0 .. 1 and rounded, and a NaN is 0 there; those of 32 bits stay
/// what they are.
///
/// An `ImageBuffer` comes out of a `DynamicImage` by `into_rgb8` and its like.
///
/// # Errors
/// [`SceneError::Render`] for another shape; [`SceneError::Content`] for 32 bits of one channel or two, which
/// the crate `image` does not have.
pub fn image_of(
    light: &Tensor<f32>,
    space: ColorSpace,
    depth: Depth,
) -> Result<DynamicImage, SceneError> {
    Picture::from_light(light, space, depth)?.into_image()
}
