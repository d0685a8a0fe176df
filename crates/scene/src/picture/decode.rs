//! Images from bytes. Sizes are checked before memory is taken for pixels.

use std::path::Path;

use super::header::Header;
use super::samples::{Picture, guarded};
use super::turn::Turn;
use super::{jpeg_file, open_exr, png_file, radiance};
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::memory::Memory;

/// The bytes of a file in which its size is looked for first; few have it later.
const START: u64 = 64 << 10;

/// A format of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Png,
    Jpeg,
    Exr,
    Radiance,
}

/// Formats that are not read: where a file has which bytes, and what to call it.
const OTHERS: [(usize, &[u8], &str); 9] = [
    (0, b"GIF8", "a GIF"),
    (0, b"BM", "a BMP"),
    (0, b"II*\0", "a TIFF, or a camera's raw file"),
    (0, b"MM\0*", "a TIFF, or a camera's raw file"),
    (8, b"WEBP", "a WebP"),
    (8, b"avif", "an AVIF"),
    (4, b"ftyp", "a HEIC"),
    (0, b"\xff\x0a", "a JPEG XL"),
    (4, b"JXL ", "a JPEG XL"),
];

impl Format {
    /// The format of a file, by its first bytes.
    pub(super) fn detect(bytes: &[u8], location: &Location) -> Result<Self, SceneError> {
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
        if radiance::MARKS.into_iter().any(begins) {
            return Ok(Self::Radiance);
        }
        let is = |(start, magic, _): &(usize, &[u8], &str)| {
            bytes.get(*start..).is_some_and(|bytes| bytes.starts_with(magic))
        };
        if let Some((_, _, name)) = OTHERS.iter().find(|other| is(other)) {
            let rule = "an image is a PNG, JPEG, EXR or HDR file";
            return Err(SceneError::content(
                location.clone(),
                format!("{rule}, and this is {name}"),
            ));
        }
        let first: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        let found = match first.is_empty() {
            true => "the file is empty".to_owned(),
            false => format!("the file begins with the bytes {}", first.join(" ")),
        };
        let message = format!("an image is a PNG, JPEG, EXR or HDR file, and {found}");
        Err(SceneError::content(location.clone(), message))
    }
}

impl Picture {
    /// The image of a PNG, JPEG, EXR or HDR file of these `bytes`, as it is stored. Errors name the file by
    /// `location`.
    ///
    /// # Errors
    /// [`SceneError::Content`] for another format, for a file that is cut short or broken, and for
    /// samples that are not finite; [`SceneError::TooLarge`] beyond [`MOST_SAMPLES`](super::MOST_SAMPLES);
    /// [`SceneError::Memory`] where that is less.
    pub fn decode(bytes: &[u8], location: &Location) -> Result<Self, SceneError> {
        Self::decode_within(bytes, &Memory::default(), location)
    }

    /// As [`Picture::decode`], of an image whose samples stay in `memory`.
    pub(crate) fn decode_within(
        bytes: &[u8],
        memory: &Memory,
        location: &Location,
    ) -> Result<Self, SceneError> {
        let decode = match Format::detect(bytes, location)? {
            Format::Png => png_file::decode,
            Format::Jpeg => jpeg_file::decode,
            Format::Exr => open_exr::decode,
            Format::Radiance => radiance::decode,
        };
        guarded(location, || decode(bytes, memory, location))
    }

    /// As [`Picture::decode`], turned as viewers turn it.
    ///
    /// # Errors
    /// As [`Picture::decode`].
    pub fn decode_upright(bytes: &[u8], location: &Location) -> Result<Self, SceneError> {
        let picture = Self::decode(bytes, location)?;
        Ok(match Self::decode_turn(bytes, location)? {
            Some(turn) => turn.apply(&picture),
            None => picture,
        })
    }

    /// How viewers turn the image of these `bytes` before they show it; `None` for one that is shown as it is
    /// stored. Exif data that can't be read turn nothing.
    ///
    /// # Errors
    /// As [`Picture::decode_size`].
    pub fn decode_turn(bytes: &[u8], location: &Location) -> Result<Option<Turn>, SceneError> {
        Ok(header(bytes, bytes.len(), location)?.turn())
    }

    /// The columns and rows of the image that [`Picture::decode`] answers, from the header alone.
    ///
    /// # Errors
    /// [`SceneError::Content`] for another format and for a broken header; [`SceneError::TooLarge`]
    /// beyond [`MOST_SAMPLES`](super::MOST_SAMPLES).
    pub fn decode_size(bytes: &[u8], location: &Location) -> Result<[usize; 2], SceneError> {
        header_size(bytes, bytes.len(), location)
    }

    /// As [`Picture::decode_size`], of the file at `path`, of which no more is read than is needed.
    ///
    /// # Errors
    /// As [`Folder::read`] and [`Picture::decode_size`].
    pub fn read_size(folder: &Folder, path: impl AsRef<Path>) -> Result<[usize; 2], SceneError> {
        let path = path.as_ref();
        let location = Location::new(folder.join(path));
        let (bytes, length) = folder.read_start(path, START)?;
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        match header_size(&bytes, length, &location) {
            // A header may be longer.
            Err(_) if length > bytes.len() => Self::decode_size(&folder.read(path)?, &location),
            result => result,
        }
    }
}

/// The columns and rows of the image of a file of `length` bytes that begins with `bytes`.
pub(super) fn header_size(
    bytes: &[u8],
    length: usize,
    location: &Location,
) -> Result<[usize; 2], SceneError> {
    Ok(header(bytes, length, location)?.size)
}

/// What a file of `length` bytes that begins with `bytes` says before its pixels.
pub(super) fn header(
    bytes: &[u8],
    length: usize,
    location: &Location,
) -> Result<Header, SceneError> {
    let read = match Format::detect(bytes, location)? {
        Format::Png => png_file::header,
        Format::Jpeg => jpeg_file::header,
        Format::Exr => open_exr::header,
        Format::Radiance => radiance::header,
    };
    guarded(location, || read(bytes, length, location))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Samples;

    fn decoded(bytes: &[u8]) -> Picture {
        Picture::decode(bytes, &Location::new("a")).unwrap()
    }

    type Kind = (png::ColorType, png::BitDepth);
    /// What a PNG is made of, and the channels and samples that it becomes.
    type Row<'r> = (Kind, u32, [&'r [u8]; 3], usize, &'r [u8]);

    /// A PNG of one row with these bytes, what is transparent, and the palette.
    fn png((color, depth): Kind, width: u32, [row, transparent, palette]: [&[u8]; 3]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, 1);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if !palette.is_empty() {
            encoder.set_palette(palette.to_vec());
        }
        if !transparent.is_empty() {
            encoder.set_trns(transparent.to_vec());
        }
        encoder.write_header().unwrap().write_image_data(row).unwrap();
        bytes
    }

    #[test]
    fn each_kind_of_png_becomes_its_numbers() {
        use png::BitDepth::{Eight, Four, One, Sixteen, Two};
        use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb};
        let palette = [10, 20, 30, 40, 50, 60, 70, 80, 90];
        // Bits of gray fill the range: 85 is 255 / 3, and 17 is 255 / 15.
        let rows: [Row<'_>; 8] = [
            ((Grayscale, One), 3, [&[0b1010_0000], &[], &[]], 1, &[255, 0, 255]),
            ((Grayscale, Two), 4, [&[0b0001_1011], &[], &[]], 1, &[0, 85, 170, 255]),
            ((Grayscale, Four), 2, [&[0x2f], &[], &[]], 1, &[34, 255]),
            // The gray 1 of 3 is transparent.
            ((Grayscale, Two), 2, [&[0b0111_0000], &[0, 1], &[]], 2, &[85, 0, 255, 255]),
            ((Indexed, Two), 2, [&[0b1000_0000], &[], &palette], 3, &[70, 80, 90, 10, 20, 30]),
            // The first colour has an opacity of 7.
            ((Indexed, Four), 2, [&[0x01], &[7], &palette], 4, &[10, 20, 30, 7, 40, 50, 60, 255]),
            ((GrayscaleAlpha, Eight), 1, [&[9, 8], &[], &[]], 2, &[9, 8]),
            ((Rgb, Eight), 1, [&[4, 5, 6], &[0, 4, 0, 5, 0, 6], &[]], 4, &[4, 5, 6, 0]),
        ];
        for (kind, width, parts, channels, expected) in rows {
            let found = decoded(&png(kind, width, parts));
            assert_eq!((found.width, found.channels), (width as usize, channels), "{kind:?}");
            assert_eq!(found.samples, Samples::U8(expected.to_vec()), "{kind:?}");
        }
        let row = [0x12, 0x34, 0xff, 0xff];
        let found = decoded(&png((Grayscale, Sixteen), 2, [&row, &[], &[]]));
        assert_eq!(found.samples, Samples::U16(vec![0x1234, 0xffff]));
        let found = decoded(&png((Grayscale, Sixteen), 2, [&row, &[0x12, 0x34], &[]]));
        assert_eq!(found.samples, Samples::U16(vec![0x1234, 0, 0xffff, 0xffff]));
    }

    /// A JPEG of 8 x 8 pixels of one colour in four inks, as Adobe's programs write it: 255 is no ink.
    fn inks(levels: [u8; 4]) -> Vec<u8> {
        let mut bytes = vec![0xff, 0xd8];
        let mut segment = |marker: u8, body: &[u8]| {
            bytes.extend([0xff, marker, 0, body.len() as u8 + 2]);
            bytes.extend(body);
        };
        segment(0xee, b"Adobe\0\x64\0\0\0\0\0");
        segment(0xdb, &[&[0][..], &[1; 64]].concat());
        let parts = (1..=4).flat_map(|part| [part, 0x11, 0]);
        segment(0xc0, &[8, 0, 8, 0, 8, 4].into_iter().chain(parts).collect::<Vec<_>>());
        // Twelve codes of 4 bits for lengths of means, one of 1 bit for the end of a block.
        let [mut means, mut others] = [[0_u8; 17]; 2];
        (means[4], others[0], others[1]) = (12, 0x10, 1);
        segment(0xc4, &means.into_iter().chain(0..12).collect::<Vec<_>>());
        segment(0xc4, &others.into_iter().chain([0]).collect::<Vec<_>>());
        let parts = (1..=4).flat_map(|part| [part, 0]);
        segment(0xda, &[4].into_iter().chain(parts).chain([0, 63, 0]).collect::<Vec<_>>());
        let mut bits = String::new();
        for level in levels {
            // The mean is 8 times how far the level lies above 128.
            let mean = 8 * (i32::from(level) - 128);
            let length = (32 - mean.unsigned_abs().leading_zeros()) as usize;
            let shown = if mean < 0 { mean + (1 << length) - 1 } else { mean };
            bits += &format!("{length:04b}");
            if length > 0 {
                bits += &format!("{shown:0length$b}");
            }
            bits.push('0');
        }
        bits += &"1".repeat((8 - bits.len() % 8) % 8);
        for byte in bits.as_bytes().chunks(8) {
            let byte = byte.iter().fold(0, |byte, bit| byte << 1 | (bit - b'0'));
            bytes.push(byte);
            if byte == 0xff {
                bytes.push(0);
            }
        }
        bytes.extend([0xff, 0xd9]);
        bytes
    }

    #[test]
    fn four_inks_become_red_green_and_blue() {
        for (levels, expected) in [
            ([255, 255, 255, 255], [255, 255, 255]),
            ([255, 128, 64, 200], [200, 100, 50]),
            ([10, 20, 30, 0], [0, 0, 0]),
        ] {
            let found = decoded(&inks(levels));
            assert_eq!([found.width, found.height, found.channels], [8, 8, 3]);
            let Samples::U8(samples) = found.samples else { panic!("bytes") };
            let off = samples.iter().enumerate().map(|(k, &x)| x.abs_diff(expected[k % 3]));
            assert!(off.max() <= Some(1), "{levels:?}: {:?}", &samples[..3]);
        }
    }
}
