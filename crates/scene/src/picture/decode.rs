//! Images from bytes.
//!
//! Sizes are checked before memory is taken for pixels. A JPEG must have its end marker, since its
//! decoder would make up what is missing.

use std::io::Cursor;
use std::ops::Range;
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::open_exr;
use super::samples::{DENSEST, MOST_SAMPLES, Picture, Samples, check_size, claim, guarded};
use crate::error::{Place, SceneError};
use crate::folder::Folder;
use crate::memory::Memory;

/// The largest sample that the decoders of PNG and JPEG give, in bytes.
const WIDEST_SAMPLE: u64 = 2;

/// The most channels of a PNG.
const MOST_CHANNELS: u64 = 4;

/// The bytes that a PNG may take beside its pixels, for texts and a colour profile, which are left out.
const BESIDE_PIXELS: u64 = 64 << 20;

/// The bytes of a file in which its size is looked for first; few have it later.
const START: u64 = 64 << 10;

/// Where a PNG has its columns and rows.
const PNG_SIZE: Range<usize> = 16..24;

/// A format of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Png,
    Jpeg,
    Exr,
}

impl Format {
    /// The format of a file, by its first bytes.
    fn of(bytes: &[u8], place: &Place) -> Result<Self, SceneError> {
        let begins = |magic: &[u8]| bytes.starts_with(magic);
        if begins(b"\x89PNG\r\n\x1a\n") {
            return Ok(Self::Png);
        }
        if begins(b"\xff\xd8\xff") {
            return Ok(Self::Jpeg);
        }
        if begins(&[0x76, 0x2f, 0x31, 0x01]) {
            return Ok(Self::Exr);
        }
        let first: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        let found = match first.is_empty() {
            true => "the file is empty".to_owned(),
            false => format!("the file begins with the bytes {}", first.join(" ")),
        };
        let found = format!("an image is a PNG, JPEG or EXR file, and {found}");
        Err(SceneError::content(place.clone(), found))
    }
}

impl Picture {
    /// The image of a PNG, JPEG or EXR file of these `bytes`. `place` names the file in errors.
    ///
    /// # Errors
    /// [`SceneError::Content`] for another format, for a file that is cut short or broken, and for
    /// samples that are not finite; [`SceneError::TooLarge`] beyond [`MOST_SAMPLES`];
    /// [`SceneError::Memory`] where that is less.
    pub fn decode(bytes: &[u8], place: &Place) -> Result<Self, SceneError> {
        Self::decode_within(bytes, &Memory::default(), place)
    }

    /// As [`Picture::decode`], of an image whose samples stay in `memory`.
    pub(crate) fn decode_within(
        bytes: &[u8],
        memory: &Memory,
        place: &Place,
    ) -> Result<Self, SceneError> {
        match Format::of(bytes, place)? {
            Format::Png => guarded(place, || decoded(bytes, ImageFormat::Png, memory, place)),
            Format::Jpeg => guarded(place, || decoded(bytes, ImageFormat::Jpeg, memory, place)),
            Format::Exr => guarded(place, || open_exr::decode(bytes, memory, place)),
        }
    }

    /// The columns and rows of the image that [`Picture::decode`] answers, from the header alone.
    ///
    /// # Errors
    /// [`SceneError::Content`] for another format and for a broken header; [`SceneError::TooLarge`]
    /// beyond [`MOST_SAMPLES`].
    pub fn size_of(bytes: &[u8], place: &Place) -> Result<[usize; 2], SceneError> {
        size_of_start(bytes, bytes.len(), place)
    }

    /// As [`Picture::size_of`], of the file at `path`, of which no more is read than is needed.
    ///
    /// # Errors
    /// As [`Folder::read`] and [`Picture::size_of`].
    pub fn size_in(folder: &Folder, path: impl AsRef<Path>) -> Result<[usize; 2], SceneError> {
        let path = path.as_ref();
        let place = Place::of(folder.join(path));
        let (bytes, length) = folder.read_start(path, START)?;
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        match size_of_start(&bytes, length, &place) {
            // A header may be longer.
            Err(_) if length > bytes.len() => Self::size_of(&folder.read(path)?, &place),
            found => found,
        }
    }
}

/// The columns and rows of the image of a file of `length` bytes that begins with `bytes`.
pub(super) fn size_of_start(
    bytes: &[u8],
    length: usize,
    place: &Place,
) -> Result<[usize; 2], SceneError> {
    match Format::of(bytes, place)? {
        Format::Png => guarded(place, || size(bytes, length, ImageFormat::Png, place)),
        Format::Jpeg => guarded(place, || size(bytes, length, ImageFormat::Jpeg, place)),
        Format::Exr => guarded(place, || open_exr::size_of(bytes, length, place)),
    }
}

/// A decoder that has read the header of an image that is not too large for a file of `length` bytes.
fn opened<'b>(
    bytes: &'b [u8],
    length: usize,
    format: ImageFormat,
    place: &Place,
) -> Result<impl ImageDecoder + 'b, SceneError> {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MOST_SAMPLES * WIDEST_SAMPLE);
    if format == ImageFormat::Png
        && let Some(&[a, b, c, d, e, f, g, h]) = bytes.get(PNG_SIZE)
    {
        // Its decoder takes memory for a row at once, and as much as it may for a colour profile.
        let size = [[a, b, c, d], [e, f, g, h]].map(|bytes| u32::from_be_bytes(bytes).into());
        check_size(size, 1, (length, DENSEST), place)?;
        let [width, height] = size;
        limits.max_alloc = Some(width * height * MOST_CHANNELS * WIDEST_SAMPLE + BESIDE_PIXELS);
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| broken(&error, place))?;
    let (width, height) = decoder.dimensions();
    let channels = decoder.color_type().channel_count();
    let size = [width.into(), height.into()];
    check_size(size, channels.into(), (length, DENSEST), place)?;
    Ok(decoder)
}

fn size(
    bytes: &[u8],
    length: usize,
    format: ImageFormat,
    place: &Place,
) -> Result<[usize; 2], SceneError> {
    let mut decoder = opened(bytes, length, format, place)?;
    let (width, height) = decoder.dimensions();
    let size = [width as usize, height as usize];
    // The five others leave an image as wide as it is.
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    Ok(match orientation(&mut decoder) {
        Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH => [size[1], size[0]],
        _ => size,
    })
}

fn decoded(
    bytes: &[u8],
    format: ImageFormat,
    memory: &Memory,
    place: &Place,
) -> Result<Picture, SceneError> {
    if format == ImageFormat::Jpeg && !has_end(bytes) {
        let found = "a JPEG has a marker at the end of its pixels, and this is cut short";
        return Err(SceneError::content(place.clone(), found));
    }
    let mut decoder = opened(bytes, bytes.len(), format, place)?;
    let (width, height) = decoder.dimensions();
    claim([width.into(), height.into()], decoder.total_bytes(), memory, place)?;
    let orientation = orientation(&mut decoder);
    let image = DynamicImage::from_decoder(decoder).map_err(|error| broken(&error, place));
    let mut image = image?;
    image.apply_orientation(orientation);
    let picture = Picture::of_image(image)?;
    if let Samples::F32(_) = picture.samples {
        let found = "samples of PNG and JPEG have 8 or 16 bits, and these have 32";
        return Err(SceneError::content(place.clone(), found));
    }
    Ok(picture)
}

/// How an image is to be turned. Exif data that can't be read turns nothing.
fn orientation(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(Orientation::NoTransforms)
}

fn broken(error: &image::ImageError, place: &Place) -> SceneError {
    SceneError::content(place.clone(), format!("the image can't be decoded: {error}"))
}

/// Whether a JPEG has the marker of its end after the beginning of its first scan. A scan has no
/// such bytes by chance: after a byte 255 it has a 0 or the number of a restart.
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
