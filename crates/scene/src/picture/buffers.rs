//! Images from and to those of the crate `image`.

use image::{DynamicImage, ImageBuffer, Pixel};

use super::samples::{Picture, Samples};
use crate::error::{Location, SceneError};

/// What errors call an image that comes from no file.
const NOWHERE: &str = "an image";

impl Picture {
    /// The same samples.
    ///
    /// # Errors
    /// [`SceneError::Content`] without a pixel, and for samples of another type than 8, 16 and 32 bits.
    pub fn from_image(image: DynamicImage) -> Result<Self, SceneError> {
        let [width, height] = [image.width() as usize, image.height() as usize];
        let channels = usize::from(image.color().channel_count());
        let samples = match image {
            DynamicImage::ImageLuma8(image) => Samples::U8(image.into_raw()),
            DynamicImage::ImageLumaA8(image) => Samples::U8(image.into_raw()),
            DynamicImage::ImageRgb8(image) => Samples::U8(image.into_raw()),
            DynamicImage::ImageRgba8(image) => Samples::U8(image.into_raw()),
            DynamicImage::ImageLuma16(image) => Samples::U16(image.into_raw()),
            DynamicImage::ImageLumaA16(image) => Samples::U16(image.into_raw()),
            DynamicImage::ImageRgb16(image) => Samples::U16(image.into_raw()),
            DynamicImage::ImageRgba16(image) => Samples::U16(image.into_raw()),
            DynamicImage::ImageRgb32F(image) => Samples::F32(image.into_raw()),
            DynamicImage::ImageRgba32F(image) => Samples::F32(image.into_raw()),
            other => {
                let rule = "samples of an image have 8, 16 or 32 bits";
                let message = format!("{rule}, and these are {:?}", other.color());
                return Err(SceneError::content(Location::new(NOWHERE), message));
            }
        };
        let picture = Self { width, height, channels, samples };
        picture.checked(&Location::new(NOWHERE))?;
        Ok(picture)
    }

    /// The same samples.
    ///
    /// # Errors
    /// [`SceneError::Content`] without a pixel, where the number of samples is not that of the pixels, and for
    /// 32 bits of one channel or two, which the crate `image` does not have.
    pub fn into_image(self) -> Result<DynamicImage, SceneError> {
        let location = Location::new(NOWHERE);
        self.checked(&location)?;
        let wrong = |message: String| SceneError::content(location.clone(), message);
        let (Ok(width), Ok(height)) = (u32::try_from(self.width), u32::try_from(self.height))
        else {
            let [width, height] = [self.width, self.height];
            let rule = format!("an image has at most {} columns and rows", u32::MAX);
            return Err(wrong(format!("{rule}, and this is {width} x {height}")));
        };
        let size = [width, height];
        let image = match (self.samples, self.channels) {
            (Samples::U8(samples), 1) => buffer(size, samples).map(DynamicImage::ImageLuma8),
            (Samples::U8(samples), 2) => buffer(size, samples).map(DynamicImage::ImageLumaA8),
            (Samples::U8(samples), 3) => buffer(size, samples).map(DynamicImage::ImageRgb8),
            (Samples::U8(samples), _) => buffer(size, samples).map(DynamicImage::ImageRgba8),
            (Samples::U16(samples), 1) => buffer(size, samples).map(DynamicImage::ImageLuma16),
            (Samples::U16(samples), 2) => buffer(size, samples).map(DynamicImage::ImageLumaA16),
            (Samples::U16(samples), 3) => buffer(size, samples).map(DynamicImage::ImageRgb16),
            (Samples::U16(samples), _) => buffer(size, samples).map(DynamicImage::ImageRgba16),
            (Samples::F32(samples), 3) => buffer(size, samples).map(DynamicImage::ImageRgb32F),
            (Samples::F32(samples), 4) => buffer(size, samples).map(DynamicImage::ImageRgba32F),
            (Samples::F32(_), channels) => {
                let rule = "an image of 32 bits has three or four channels";
                return Err(wrong(format!("{rule}, and this has {channels}")));
            }
        };
        // Its samples were counted above.
        image.ok_or_else(|| wrong("an image has as many samples as its size says".to_owned()))
    }
}

/// An image with these samples, if there are enough of them.
fn buffer<P: Pixel>(
    [width, height]: [u32; 2],
    samples: Vec<P::Subpixel>,
) -> Option<ImageBuffer<P, Vec<P::Subpixel>>> {
    ImageBuffer::from_raw(width, height, samples)
}
