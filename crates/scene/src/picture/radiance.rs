//! Radiance's pictures, read: red, green and blue with a common exponent.
//!
//! What the header says was multiplied, `EXPOSURE` and `COLORCORR`, is divided out, so that numbers are
//! radiance. Lines run from the top, from left to right; others are refused, and so are XYZ's colours.
//!
//! # Source
//! Ward, *Radiance file formats*, section "Picture file format (.hdr)".

use std::io::Cursor;

use image::codecs::hdr::{HdrDecoder, HdrMetadata};
use image::{DynamicImage, ImageDecoder as _};

use super::samples::{DENSEST, Picture, Samples, check_size, claim};
use super::usual::{is_srgb, of_aspect};
use crate::error::{Place, SceneError};
use crate::memory::Memory;

/// What such files begin with; the second is that of other programs.
pub(super) const MARKS: [&[u8]; 2] = [b"#?RADIANCE", b"#?RGBE"];
/// The most bytes of a header.
const LONGEST: usize = 64 << 10;

type Decoder<'b> = HdrDecoder<Cursor<&'b [u8]>>;

/// A decoder that has read the header of an image that is not too large for a file of `length` bytes.
fn opened<'b>(
    bytes: &'b [u8],
    length: usize,
    place: &Place,
) -> Result<(Decoder<'b>, HdrMetadata), SceneError> {
    let ends = |end: &[u8]| bytes.windows(end.len()).take(LONGEST).any(|found| found == end);
    if !ends(b"\n\n") && !ends(b"\n\r\n") {
        let rule = "a picture of Radiance has a header of some lines and an empty one";
        return Err(SceneError::content(place.clone(), format!("{rule}, and this has none")));
    }
    // The mark is a comment to it.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|e| broken(&e, place))?;
    let (width, height) = decoder.dimensions();
    check_size([width.into(), height.into()], 3, (length, DENSEST), place)?;
    let metadata = decoder.metadata();
    Ok((decoder, metadata))
}

pub(super) fn size_of(
    bytes: &[u8],
    length: usize,
    place: &Place,
) -> Result<[usize; 2], SceneError> {
    let (width, height) = opened(bytes, length, place)?.0.dimensions();
    Ok([width as usize, height as usize])
}

pub(super) fn decode(bytes: &[u8], memory: &Memory, place: &Place) -> Result<Picture, SceneError> {
    let (decoder, metadata) = opened(bytes, bytes.len(), place)?;
    let (width, height) = decoder.dimensions();
    claim([width.into(), height.into()], decoder.total_bytes(), memory, place)?;
    let image = DynamicImage::from_decoder(decoder).map_err(|error| broken(&error, place))?;
    let mut picture = Picture::of_image(image)?;
    let exposure = metadata.exposure.unwrap_or(1.0);
    let (r, g, b) = metadata.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factors = [r, g, b].map(|color| color * exposure);
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        let rule = "EXPOSURE and COLORCORR are above 0";
        return Err(SceneError::content(
            place.clone(),
            format!("{rule}, and these make {factors:?}"),
        ));
    }
    if let Samples::F32(samples) = &mut picture.samples {
        for pixel in samples.chunks_exact_mut(3) {
            pixel.iter_mut().zip(factors).for_each(|(sample, factor)| *sample /= factor);
        }
        if let Some(sample) = samples.iter().find(|sample| !sample.is_finite()) {
            let found = format!("samples are finite, and EXPOSURE makes {sample} of one");
            return Err(SceneError::content(place.clone(), found));
        }
    }
    Ok(picture)
}

/// What a header says that is not done.
pub(super) fn remarks(bytes: &[u8], place: &Place) -> Result<Vec<String>, SceneError> {
    let (_, metadata) = opened(bytes, bytes.len(), place)?;
    let mut said = Vec::new();
    let lines = metadata.custom_attributes.iter();
    for (_, value) in lines.filter(|(key, _)| key == "PRIMARIES") {
        let found: Vec<f32> = value.split_whitespace().flat_map(str::parse).collect();
        // Red, green, blue, white.
        let is_usual = match *found {
            [rx, ry, gx, gy, bx, by, wx, wy] => is_srgb([wx, wy, rx, ry, gx, gy, bx, by]),
            _ => false,
        };
        if !is_usual {
            said.push("it says other primaries than sRGB's, which is left out".to_owned());
        }
    }
    // It has height by width.
    said.extend(metadata.pixel_aspect_ratio.and_then(|aspect| of_aspect(1.0 / f64::from(aspect))));
    Ok(said)
}

fn broken(error: &image::ImageError, place: &Place) -> SceneError {
    SceneError::content(place.clone(), format!("the image can't be decoded: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of 2 x 1 pixels, red of 1 and white of 4, with these lines in its header.
    fn file(lines: &str, size: &str) -> Vec<u8> {
        let header = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{lines}\n{size}\n");
        [header.as_bytes(), &[128, 0, 0, 129, 128, 128, 128, 131]].concat()
    }

    fn decoded(bytes: &[u8]) -> Result<Picture, String> {
        Picture::decode(bytes, &Place::of("sky.hdr")).map_err(|error| error.to_string())
    }

    #[test]
    fn what_a_header_says_was_multiplied_is_divided_out() {
        let rows = [
            ("", [1.0, 0.0, 0.0, 4.0, 4.0, 4.0]),
            ("EXPOSURE=2\n", [0.5, 0.0, 0.0, 2.0, 2.0, 2.0]),
            ("EXPOSURE=2\nEXPOSURE= 4.0\n", [0.125, 0.0, 0.0, 0.5, 0.5, 0.5]),
            ("COLORCORR=2 4 1\nEXPOSURE=0.5\n", [1.0, 0.0, 0.0, 4.0, 2.0, 8.0]),
        ];
        for (lines, expected) in rows {
            let bytes = file(lines, "-Y 1 +X 2");
            let picture = decoded(&bytes).unwrap();
            assert_eq!([picture.width, picture.height, picture.channels], [2, 1, 3]);
            assert_eq!(picture.samples, Samples::F32(expected.to_vec()), "{lines}");
            assert_eq!(Picture::size_of(&bytes, &Place::of("a")).unwrap(), [2, 1]);
            assert!(Picture::remarks(&bytes, &Place::of("a")).unwrap().is_empty());
        }
        let other = file("", "-Y 1 +X 2");
        let other = [b"#?RGBE", &other[10..]].concat();
        assert!(decoded(&other).is_ok());
    }

    #[test]
    fn what_is_not_done_is_refused_or_told() {
        let rows = [
            (file("", "+Y 1 +X 2"), "Orientation +Y +X"),
            (file("", "-Y 1 -X 2"), "Orientation -Y -X"),
            (file("FORMAT=32-bit_rle_xyze\n", "-Y 1 +X 2"), "32-bit_rle_xyze"),
            (file("EXPOSURE=0\n", "-Y 1 +X 2"), "above 0"),
            (file("EXPOSURE=1e-38\nEXPOSURE=1e-3\n", "-Y 1 +X 2"), "samples are finite"),
            (file("", "-Y 2 +X 2"), "can't be decoded"),
            (file("", "-Y 100000 +X 100000"), "at most"),
            (file("", "-Y 0 +X 2"), "has pixels, and this is 2 x 0"),
            (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n".to_vec(), "an empty one"),
        ];
        for (bytes, rule) in rows {
            let said = decoded(&bytes).unwrap_err();
            assert!(said.starts_with("sky.hdr: ") && said.contains(rule), "{rule}: {said}");
        }
        let lines = "PRIMARIES= .64 .33 .29 .6 .15 .06 .333 .333\nPIXASPECT=2\n";
        let said = Picture::remarks(&file(lines, "-Y 1 +X 2"), &Place::of("a")).unwrap();
        assert!(said.len() == 2 && said[0].contains("primaries"), "{said:?}");
        assert!(said[1].contains("0.5000 times as wide"), "{said:?}");
        let usual = "PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329\n";
        assert!(Picture::remarks(&file(usual, "-Y 1 +X 2"), &Place::of("a")).unwrap().is_empty());
    }

    #[test]
    fn a_file_that_is_cut_short_has_an_answer_at_each_length() {
        let bytes = file("EXPOSURE=2\n", "-Y 1 +X 2");
        for length in 0..bytes.len() {
            assert!(decoded(&bytes[..length]).is_err(), "{length}");
        }
    }
}
