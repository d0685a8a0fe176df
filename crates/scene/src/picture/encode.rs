//! Images to bytes: the same bytes for the same image, on every machine.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::open_exr;
use super::samples::{Picture, Samples};
use crate::error::{Place, SceneError};

impl Picture {
    /// A PNG file with the image's samples, of 8 or 16 bits. `place` names the file in errors.
    ///
    /// # Errors
    /// [`SceneError::Content`] for samples of 32 bits, without a pixel, and where the number of
    /// samples is not that of the pixels.
    pub fn encode_png(&self, place: &Place) -> Result<Vec<u8>, SceneError> {
        self.checked(place)?;
        let wide: Vec<u8>;
        let (bytes, is_wide) = match &self.samples {
            Samples::U8(samples) => (samples.as_slice(), false),
            Samples::U16(samples) => {
                wide = samples.iter().flat_map(|sample| sample.to_ne_bytes()).collect();
                (wide.as_slice(), true)
            }
            Samples::F32(_) => {
                let found = "a PNG has samples of 8 or 16 bits, and these have 32";
                return Err(SceneError::content(place.clone(), found));
            }
        };
        let color = match (self.channels, is_wide) {
            (1, false) => ExtendedColorType::L8,
            (2, false) => ExtendedColorType::La8,
            (3, false) => ExtendedColorType::Rgb8,
            (_, false) => ExtendedColorType::Rgba8,
            (1, true) => ExtendedColorType::L16,
            (2, true) => ExtendedColorType::La16,
            (3, true) => ExtendedColorType::Rgb16,
            (_, true) => ExtendedColorType::Rgba16,
        };
        let failed = |error: &dyn std::fmt::Display| {
            SceneError::content(place.clone(), format!("the image can't be encoded: {error}"))
        };
        let width = u32::try_from(self.width).map_err(|error| failed(&error))?;
        let height = u32::try_from(self.height).map_err(|error| failed(&error))?;
        let mut png = Vec::new();
        let (compression, filter) = (CompressionType::Default, FilterType::Adaptive);
        let encoder = PngEncoder::new_with_quality(&mut png, compression, filter);
        encoder.write_image(bytes, width, height, color).map_err(|error| failed(&error))?;
        Ok(png)
    }

    /// An EXR file with the image's samples, compressed without loss: channels Y or R, G, B, and A.
    /// `place` names the file in errors.
    ///
    /// # Errors
    /// [`SceneError::Content`] for samples of 8 or 16 bits and for those that are not finite,
    /// without a pixel, and where the number of samples is not that of the pixels.
    pub fn encode_exr(&self, place: &Place) -> Result<Vec<u8>, SceneError> {
        open_exr::encode(self.checked(place)?, place)
    }
}
