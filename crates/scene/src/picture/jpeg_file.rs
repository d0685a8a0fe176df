//! JPEG files, by the crate `zune-jpeg`. An image with four inks becomes red, green and blue.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::header::Header;
use super::samples::{DENSEST, Picture, Samples, broken, check_size, claim};
use crate::error::{Location, SceneError};
use crate::memory::Memory;

type Decoder<'b> = JpegDecoder<ZCursor<&'b [u8]>>;

/// A decoder that has read the header of an image that is not too large for a file of `length` bytes, and the
/// columns, rows and channels of what it will give.
fn opened<'b>(
    bytes: &'b [u8],
    length: usize,
    location: &Location,
) -> Result<(Decoder<'b>, [usize; 3]), SceneError> {
    // Sizes are checked below. What is odd and can be read is read.
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| broken(&error, location))?;
    let color = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => ColorSpace::Luma,
        _ => ColorSpace::RGB,
    };
    decoder.set_options(options.jpeg_set_out_colorspace(color));
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let channels = color.num_components();
    check_size([width as u64, height as u64], channels as u64, (length, DENSEST), location)?;
    Ok((decoder, [width, height, channels]))
}

/// What a file of `length` bytes that begins with `bytes` says before its pixels.
pub(super) fn header(
    bytes: &[u8],
    length: usize,
    location: &Location,
) -> Result<Header, SceneError> {
    let (decoder, [width, height, _]) = opened(bytes, length, location)?;
    let (profile, exif) = (decoder.icc_profile(), decoder.exif().cloned());
    Ok(Header { size: [width, height], profile, exif })
}

/// The image as it is stored.
pub(super) fn decode(
    bytes: &[u8],
    memory: &Memory,
    location: &Location,
) -> Result<Picture, SceneError> {
    if !has_end(bytes) {
        let message = "a JPEG has a marker at the end of its pixels, and this is cut short";
        return Err(SceneError::content(location.clone(), message));
    }
    let (mut decoder, [width, height, channels]) = opened(bytes, bytes.len(), location)?;
    let count = width * height * channels;
    claim([width as u64, height as u64], count as u64, memory, location)?;
    let mut samples = vec![0; count];
    decoder.decode_into(&mut samples).map_err(|error| broken(&error, location))?;
    Ok(Picture { width, height, channels, samples: Samples::U8(samples) })
}

/// Whether a JPEG has the marker of its end after the beginning of its first scan. A scan has no
/// such bytes by chance: after a byte 255 it has a 0 or the number of a restart. Without it the decoder would
/// make up what is missing.
fn has_end(bytes: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xda;
    const END: u8 = 0xd9;
    // The segments before the scan, which say how long they are; the first marker has no segment.
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        match *rest {
            [0xff, 0xff, ..] => rest = &rest[1..],
            [0xff, START_OF_SCAN, ..] => break,
            [0xff, _, high, low, ..] => {
                let length = usize::from(u16::from_be_bytes([high, low]));
                rest = rest.get(2 + length.max(2)..).unwrap_or_default();
            }
            // Fill bytes that some cameras leave between segments.
            [_, _, ..] => rest = &rest[1..],
            _ => return false,
        }
    }
    rest.windows(2).any(|pair| pair == [0xff, END])
}
