//! PNG files, by the crate `png`: palettes and fewer bits become 8 bits, a transparent colour opacity.

use std::io::Cursor;
use std::ops::Range;

use png::{
    BitDepth, ColorType, Compression, Decoder, Encoder, EncodingError, Filter, Limits, Reader,
    Transformations,
};

use super::header::Header;
use super::samples::{DENSEST, Picture, Samples, broken, check_size, claim};
use crate::error::{Location, SceneError};
use crate::memory::Memory;

/// The most bytes of a pixel: four channels of 16 bits.
const WIDEST_PIXEL: u64 = 8;
/// The bytes that a file may take beside its pixels, for a colour profile, which is left out.
const BESIDE_PIXELS: u64 = 64 << 20;
/// Where a file has its columns and rows.
const SIZE: Range<usize> = 16..24;

/// A reader that has read the header of an image that is not too large for a file of `length` bytes.
fn opened<'b>(
    bytes: &'b [u8],
    length: usize,
    location: &Location,
) -> Result<Reader<Cursor<&'b [u8]>>, SceneError> {
    let mut most = BESIDE_PIXELS;
    if let Some(&[a, b, c, d, e, f, g, h]) = bytes.get(SIZE) {
        // The decoder takes memory for a row at once, and as much as it may for a colour profile.
        let [width, height] = [[a, b, c, d], [e, f, g, h]].map(|x| u32::from_be_bytes(x).into());
        check_size([width, height], 1, (length, DENSEST), location)?;
        most += width * height * WIDEST_PIXEL;
    }
    let limits = Limits { bytes: usize::try_from(most).unwrap_or(usize::MAX) };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_transformations(Transformations::EXPAND);
    let reader = decoder.read_info().map_err(|error| broken(&error, location))?;
    let (width, height) = reader.info().size();
    let channels = reader.output_color_type().0.samples() as u64;
    check_size([width.into(), height.into()], channels, (length, DENSEST), location)?;
    Ok(reader)
}

/// What a file of `length` bytes that begins with `bytes` says before its pixels.
pub(super) fn header(
    bytes: &[u8],
    length: usize,
    location: &Location,
) -> Result<Header, SceneError> {
    let reader = opened(bytes, length, location)?;
    let info = reader.info();
    Ok(Header {
        size: [info.width as usize, info.height as usize],
        profile: info.icc_profile.as_deref().map(<[u8]>::to_vec),
        exif: info.exif_metadata.as_deref().map(<[u8]>::to_vec),
    })
}

/// The image as it is stored; the first, where there are several.
pub(super) fn decode(
    bytes: &[u8],
    memory: &Memory,
    location: &Location,
) -> Result<Picture, SceneError> {
    let mut reader = opened(bytes, bytes.len(), location)?;
    let (width, height) = reader.info().size();
    let (color, depth) = reader.output_color_type();
    let count = reader.output_buffer_size().unwrap_or(usize::MAX);
    claim([width.into(), height.into()], count as u64, memory, location)?;
    let mut samples = vec![0; count];
    reader.next_frame(&mut samples).map_err(|error| broken(&error, location))?;
    let samples = match depth {
        BitDepth::Sixteen => Samples::U16(
            samples.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect(),
        ),
        _ => Samples::U8(samples),
    };
    let [width, height] = [width as usize, height as usize];
    let picture = Picture { width, height, channels: color.samples(), samples };
    picture.checked(location)?;
    Ok(picture)
}

impl Picture {
    /// A PNG file with the image's samples, of 8 or 16 bits: the same bytes for the same image, on every machine.
    /// `location` names the file in errors.
    ///
    /// # Errors
    /// [`SceneError::Content`] for samples of 32 bits, without a pixel, and where the number of
    /// samples is not that of the pixels.
    pub fn encode_png(&self, location: &Location) -> Result<Vec<u8>, SceneError> {
        self.checked(location)?;
        let wide: Vec<u8>;
        let (bytes, depth) = match &self.samples {
            Samples::U8(samples) => (samples.as_slice(), BitDepth::Eight),
            Samples::U16(samples) => {
                wide = samples.iter().flat_map(|sample| sample.to_be_bytes()).collect();
                (wide.as_slice(), BitDepth::Sixteen)
            }
            Samples::F32(_) => {
                let message = "a PNG has samples of 8 or 16 bits, and these have 32";
                return Err(SceneError::content(location.clone(), message));
            }
        };
        let failed = |error: &dyn std::fmt::Display| {
            SceneError::content(location.clone(), format!("the image can't be encoded: {error}"))
        };
        let width = u32::try_from(self.width).map_err(|error| failed(&error))?;
        let height = u32::try_from(self.height).map_err(|error| failed(&error))?;
        packed([width, height], self.channels, depth, bytes).map_err(|error| failed(&error))
    }
}

/// A file of `width` x `height` pixels with these bytes.
fn packed(
    [width, height]: [u32; 2],
    channels: usize,
    depth: BitDepth,
    bytes: &[u8],
) -> Result<Vec<u8>, EncodingError> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(match channels {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        _ => ColorType::Rgba,
    });
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Balanced);
    encoder.set_filter(Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(file)
}
