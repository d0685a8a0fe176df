//! Pictures: image tensors as PNG files; small tensors are enlarged pixel by pixel.
//!
//! A value of 0 is black and 1 is full; there is no gamma curve between, since the fit's loss
//! knows none either. Values outside are clamped, and what is NaN shows as magenta, so that a
//! broken picture looks broken.

use bokashi_core::Tensor;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};

use crate::error::ReportError;
use crate::rgb_image::RgbImage;

/// The colour of a pixel that is not a number.
const BROKEN: [u8; 3] = [255, 0, 255];

/// The picture of `image: [H, W, 3]`.
///
/// # Errors
/// [`ReportError::Picture`] unless the shape is `[H, W, 3]` with no side 0.
pub fn picture_of(image: &Tensor<f64>) -> Result<RgbImage, ReportError> {
    let &[height, width, 3] = &image.shape()[..] else {
        return Err(ReportError::Picture(format!(
            "a picture needs [H, W, 3], got {}",
            image.shape()
        )));
    };
    if height == 0 || width == 0 {
        return Err(ReportError::Picture(format!("a picture needs pixels, got {}", image.shape())));
    }
    let entries = image.data();
    Ok(RgbImage::from_fn(width as u32, height as u32, |column, row| {
        let start = 3 * (row as usize * width + column as usize);
        let pixel = [entries[start], entries[start + 1], entries[start + 2]];
        if pixel.iter().any(|value| value.is_nan()) {
            return BROKEN;
        }
        pixel.map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8)
    }))
}

/// A picture enlarged by the whole factor that brings its height nearest to `height`, each
/// pixel a square; a picture that is higher already stays as it is.
pub fn enlarged(picture: &RgbImage, height: u32) -> RgbImage {
    let factor = (height / picture.height()).max(1);
    let (width, height) = (picture.width() * factor, picture.height() * factor);
    RgbImage::from_fn(width, height, |x, y| picture.pixel(x / factor, y / factor))
}

/// Rows of pictures with a gap between them, each centred in its cell.
pub fn sheet(rows: &[Vec<RgbImage>], gap: u32, ground: [u8; 3]) -> RgbImage {
    let all = || rows.iter().flatten();
    let cell_width = all().map(RgbImage::width).max().unwrap_or(1);
    let cell_height = all().map(RgbImage::height).max().unwrap_or(1);
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0).max(1) as u32;
    let lines = rows.len().max(1) as u32;
    let width = columns * cell_width + (columns + 1) * gap;
    let height = lines * cell_height + (lines + 1) * gap;
    let mut sheet = RgbImage::from_pixel(width, height, ground);
    for (line, row) in rows.iter().enumerate() {
        for (column, picture) in row.iter().enumerate() {
            let x = gap + column as u32 * (cell_width + gap) + (cell_width - picture.width()) / 2;
            let y = gap + line as u32 * (cell_height + gap) + (cell_height - picture.height()) / 2;
            sheet.replace(picture, [x, y]);
        }
    }
    sheet
}

/// A picture as a PNG file.
///
/// # Errors
/// [`ReportError::Picture`] for a picture without rows.
pub fn png(picture: &RgbImage) -> Result<Vec<u8>, ReportError> {
    packed(picture).map_err(|error| ReportError::Picture(error.to_string()))
}

fn packed(picture: &RgbImage) -> Result<Vec<u8>, EncodingError> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, picture.width(), picture.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(picture.bytes())?;
    writer.finish()?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clamped_and_nan_is_seen() {
        let values = vec![-1.0, 0.5, 2.0, f64::NAN, 0.0, 0.0];
        let image = Tensor::new([1, 2, 3], values).expect("six entries");
        let picture = picture_of(&image).expect("a picture");
        assert_eq!(picture.pixel(0, 0), [0, 128, 255]);
        assert_eq!(picture.pixel(1, 0), BROKEN);
    }

    #[test]
    fn only_images_are_pictures() {
        for shape in [&[2, 2][..], &[2, 2, 4], &[0, 2, 3], &[2, 0, 3]] {
            assert!(picture_of(&Tensor::zeros(shape)).is_err(), "{shape:?}");
        }
    }

    #[test]
    fn enlarging_repeats_pixels() {
        let small = RgbImage::from_fn(2, 1, |column, _| [column as u8; 3]);
        let large = enlarged(&small, 3);
        assert_eq!((large.width(), large.height()), (6, 3));
        assert_eq!(large, RgbImage::from_fn(6, 3, |column, _| [(column / 3) as u8; 3]));
        assert_eq!(enlarged(&large, 1), large);
    }

    #[test]
    fn a_sheet_holds_ragged_rows() {
        let tile = |side| RgbImage::from_pixel(side, side, [9; 3]);
        let sheet = sheet(&[vec![tile(2), tile(4)], vec![tile(4)]], 1, [0; 3]);
        assert_eq!((sheet.width(), sheet.height()), (11, 11));
        assert_eq!(sheet.pixel(2, 2), [9; 3]);
        assert_eq!(sheet.pixel(1, 1), [0; 3]);
    }
}
