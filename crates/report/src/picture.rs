//! Pictures: image tensors as PNG files; small tensors are enlarged pixel by pixel.
//!
//! A value of 0 is black and 1 is full; there is no gamma curve between, since the fit's loss
//! knows none either. Values outside are clamped, and what is NaN shows as magenta, so that a
//! broken picture looks broken.

use std::io::Cursor;

use bokashi_core::Tensor;
use image::{ImageFormat, Rgb, RgbImage, imageops};

use crate::error::ReportError;

/// The colour of a pixel that is not a number.
const BROKEN: Rgb<u8> = Rgb([255, 0, 255]);

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
        let at = 3 * (row as usize * width + column as usize);
        let pixel = [entries[at], entries[at + 1], entries[at + 2]];
        if pixel.iter().any(|value| value.is_nan()) {
            return BROKEN;
        }
        Rgb(pixel.map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8))
    }))
}

/// A picture enlarged by the whole factor that brings its height nearest to `height`, each
/// pixel a square; a picture that is higher already stays as it is.
pub fn enlarged(picture: &RgbImage, height: u32) -> RgbImage {
    let factor = (height / picture.height()).max(1);
    let (width, height) = (picture.width() * factor, picture.height() * factor);
    imageops::resize(picture, width, height, imageops::FilterType::Nearest)
}

/// Rows of pictures with a gap between them, each centred in its cell.
pub fn sheet(rows: &[Vec<RgbImage>], gap: u32, ground: Rgb<u8>) -> RgbImage {
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
            imageops::replace(&mut sheet, picture, x.into(), y.into());
        }
    }
    sheet
}

/// A picture as a PNG file.
pub fn png(picture: &RgbImage) -> Result<Vec<u8>, ReportError> {
    let mut file = Cursor::new(Vec::new());
    picture
        .write_to(&mut file, ImageFormat::Png)
        .map_err(|error| ReportError::Picture(error.to_string()))?;
    Ok(file.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clamped_and_nan_is_seen() {
        let values = vec![-1.0, 0.5, 2.0, f64::NAN, 0.0, 0.0];
        let image = Tensor::new([1, 2, 3], values).expect("six entries");
        let picture = picture_of(&image).expect("a picture");
        assert_eq!(*picture.get_pixel(0, 0), Rgb([0, 128, 255]));
        assert_eq!(*picture.get_pixel(1, 0), BROKEN);
    }

    #[test]
    fn only_images_are_pictures() {
        for shape in [&[2, 2][..], &[2, 2, 4], &[0, 2, 3], &[2, 0, 3]] {
            assert!(picture_of(&Tensor::zeros(shape)).is_err(), "{shape:?}");
        }
    }

    #[test]
    fn enlarging_repeats_pixels() {
        let small = RgbImage::from_fn(2, 1, |column, _| Rgb([column as u8; 3]));
        let large = enlarged(&small, 3);
        assert_eq!(large.dimensions(), (6, 3));
        assert!(large.enumerate_pixels().all(|(x, _, pixel)| pixel[0] == (x / 3) as u8));
        assert_eq!(enlarged(&large, 1).dimensions(), (6, 3));
    }

    #[test]
    fn a_sheet_holds_ragged_rows() {
        let tile = |side| RgbImage::from_pixel(side, side, Rgb([9; 3]));
        let sheet = sheet(&[vec![tile(2), tile(4)], vec![tile(4)]], 1, Rgb([0; 3]));
        assert_eq!(sheet.dimensions(), (11, 11));
        assert_eq!(*sheet.get_pixel(2, 2), Rgb([9; 3]));
        assert_eq!(*sheet.get_pixel(1, 1), Rgb([0; 3]));
    }
}
