//! Radiance's pictures, read: red, green and blue with a common exponent.
//!
//! What the header says was multiplied, `EXPOSURE` and `COLORCORR`, is divided out, so that numbers are
//! radiance. Lines run from the top, from left to right; others are refused, and so are XYZ's colours.
//!
//! A byte `m` of a pixel with the exponent `e` stands for `m 2^(e - 136)`, and for 0 where `e` is 0.
//!
//! # Lines of pixels
//! Of 8 to 32767 pixels, those that begin with 2, 2 and the length: the four channels one after the other, in
//! runs. All others: pixel by pixel, where 1, 1, 1, n repeats the last pixel n times, and each further one of such
//! pixels n times 256 as many.
//!
//! By hand, since the small crates that read it, as zune-hdr 0.5, lose exponents and make up what is cut short.
//!
//! # Source
//! Ward, *Radiance file formats*, section "Picture file format (.hdr)"; his `freadcolrs` for lines of pixels.

use super::header::Header;
use super::samples::{DENSEST, Picture, Samples, broken, check_size, claim};
use super::usual::{aspect_remark, is_srgb};
use crate::error::{Location, SceneError};
use crate::memory::Memory;

/// What such files begin with; the second is that of other programs.
pub(super) const MARKS: [&[u8]; 2] = [b"#?RADIANCE", b"#?RGBE"];
/// The most bytes of a header.
const LONGEST: usize = 64 << 10;
/// The only format whose colours are red, green and blue.
const FORMAT: &str = "32-bit_rle_rgbe";

/// A file whose header has been read.
struct File<'b> {
    /// Keys and values of the header, in its order.
    attributes: Vec<(String, String)>,
    /// Columns and rows.
    size: [u32; 2],
    /// What follows the header.
    pixels: &'b [u8],
}

impl<'b> File<'b> {
    /// A file of `length` bytes that begins with `bytes`, of an image that is not too large for it.
    fn new(bytes: &'b [u8], length: usize, location: &Location) -> Result<Self, SceneError> {
        let wrong = |message: String| SceneError::content(location.clone(), message);
        let mut rest = bytes;
        let mut attributes = Vec::new();
        loop {
            let line = match next_line(&mut rest) {
                Some(line) if bytes.len() - rest.len() <= LONGEST => line,
                _ => {
                    let rule = "a picture of Radiance has a header of some lines and an empty one";
                    return Err(wrong(format!("{rule}, and this has none")));
                }
            };
            match line.split_once('=') {
                _ if line.is_empty() => break,
                // The mark is a comment, too.
                _ if line.starts_with('#') => {}
                Some((key, value)) => {
                    attributes.push((key.trim().to_owned(), value.trim().to_owned()));
                }
                None => {}
            }
        }
        let formats = attributes.iter().filter(|(key, _)| key == "FORMAT");
        if let Some((_, other)) = formats.into_iter().find(|(_, format)| format != FORMAT) {
            return Err(wrong(format!("Radiance's {FORMAT} is read, and this is {other:.40}")));
        }
        let size = size(&next_line(&mut rest).unwrap_or_default()).map_err(wrong)?;
        check_size(size.map(u64::from), 3, (length, DENSEST), location)?;
        Ok(Self { attributes, size, pixels: rest })
    }

    /// The values of a key.
    fn values<'a>(&'a self, key: &'a str) -> impl Iterator<Item = &'a str> {
        self.attributes.iter().filter(move |(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// The product of a key's values; those that are no numbers are left out.
    fn product(&self, key: &str) -> Option<f32> {
        self.values(key).filter_map(|value| value.parse().ok()).reduce(|a: f32, b| a * b)
    }

    /// What red, green and blue were multiplied by.
    fn factors(&self) -> [f32; 3] {
        let mut factors = [1.0; 3];
        for value in self.values("COLORCORR") {
            let numbers: Vec<f32> =
                value.split_whitespace().map_while(|word| word.parse().ok()).collect();
            if let Some(numbers) = numbers.first_chunk::<3>() {
                factors.iter_mut().zip(numbers).for_each(|(factor, number)| *factor *= number);
            }
        }
        let exposure = self.product("EXPOSURE").unwrap_or(1.0);
        factors.map(|factor| factor * exposure)
    }
}

/// The next line, without its end.
fn next_line(rest: &mut &[u8]) -> Option<String> {
    let end = rest.iter().position(|&byte| byte == b'\n')?;
    let line = String::from_utf8_lossy(&rest[..end]);
    let line = line.strip_suffix('\r').unwrap_or(&line).to_owned();
    *rest = &rest[end + 1..];
    Some(line)
}

/// The columns and rows of a line as `-Y 2 +X 3`.
fn size(line: &str) -> Result<[u32; 2], String> {
    let words: Vec<&str> = line.split_whitespace().take(4).collect();
    match *words {
        ["-Y", height, "+X", width] => match (width.parse(), height.parse()) {
            (Ok(width), Ok(height)) => Ok([width, height]),
            _ => Err(format!("columns and rows are whole numbers, and these are {line:.40}")),
        },
        [rows, _, columns, _] => Err(format!(
            "Orientation -Y +X is read, and this is Orientation {rows:.4} {columns:.4}"
        )),
        _ => Err(format!("a header ends with -Y, rows, +X and columns, and this with {line:.40}")),
    }
}

/// What the file says before its pixels.
pub(super) fn header(
    bytes: &[u8],
    length: usize,
    location: &Location,
) -> Result<Header, SceneError> {
    let [width, height] = File::new(bytes, length, location)?.size;
    Ok(Header::from_size([width as usize, height as usize]))
}

pub(super) fn decode(
    bytes: &[u8],
    memory: &Memory,
    location: &Location,
) -> Result<Picture, SceneError> {
    let file = File::new(bytes, bytes.len(), location)?;
    let [width, height] = file.size.map(|extent| extent as usize);
    claim(file.size.map(u64::from), 12 * (width * height) as u64, memory, location)?;
    let factors = file.factors();
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        let rule = "EXPOSURE and COLORCORR are above 0";
        let message = format!("{rule}, and these make {factors:?}");
        return Err(SceneError::content(location.clone(), message));
    }
    let mut samples = Vec::with_capacity(3 * width * height);
    let (mut rest, mut pixels) = (file.pixels, vec![[0; 4]; width]);
    for row in 0..height {
        if read_row(&mut rest, &mut pixels).is_none() {
            let message = format!("row {row} does not have {width} pixels");
            return Err(broken(&message, location));
        }
        for pixel in &pixels {
            samples
                .extend(light(*pixel).iter().zip(factors).map(|(sample, factor)| sample / factor));
        }
    }
    if let Some(sample) = samples.iter().find(|sample| !sample.is_finite()) {
        let message = format!("samples are finite, and EXPOSURE makes {sample} of one");
        return Err(SceneError::content(location.clone(), message));
    }
    Ok(Picture { width, height, channels: 3, samples: Samples::F32(samples) })
}

/// Red, green and blue of a pixel: exact, since the least is a multiple of 2^-135.
fn light([r, g, b, exponent]: [u8; 4]) -> [f32; 3] {
    if exponent == 0 {
        return [0.0; 3];
    }
    // 2^(exponent - 136), by its bits.
    let unit = f64::from_bits((u64::from(exponent) + 1023 - 136) << 52);
    [r, g, b].map(|number| (f64::from(number) * unit) as f32)
}

/// The next `N` bytes.
fn take<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (bytes, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(*bytes)
}

/// Reads a row of pixels; none where the bytes end or a run leads beyond the row.
fn read_row(rest: &mut &[u8], pixels: &mut [[u8; 4]]) -> Option<()> {
    let first = take(rest)?;
    match first {
        [2, 2, high @ 0..128, low] if (8..0x8000).contains(&pixels.len()) => {
            if usize::from(u16::from_be_bytes([high, low])) != pixels.len() {
                return None;
            }
            (0..4).try_for_each(|channel| read_channel(rest, pixels, channel))
        }
        _ => read_pixels(rest, first, pixels),
    }
}

/// A channel of a row in runs: a byte above 128 repeats what follows, another says how many bytes follow.
fn read_channel(rest: &mut &[u8], pixels: &mut [[u8; 4]], channel: usize) -> Option<()> {
    let mut start = 0;
    while start < pixels.len() {
        let [code] = take(rest)?;
        let count = usize::from(if code > 128 { code - 128 } else { code });
        let run = pixels.get_mut(start..start + count)?;
        if code > 128 {
            let [value] = take(rest)?;
            run.iter_mut().for_each(|pixel| pixel[channel] = value);
        } else {
            let (values, after) = rest.split_at_checked(count)?;
            *rest = after;
            run.iter_mut().zip(values).for_each(|(pixel, value)| pixel[channel] = *value);
        }
        start += count;
    }
    Some(())
}

/// A row pixel by pixel, of which the first has been read.
fn read_pixels(rest: &mut &[u8], first: [u8; 4], pixels: &mut [[u8; 4]]) -> Option<()> {
    let (mut start, mut shift, mut next) = (0_usize, 0, first);
    loop {
        if let [1, 1, 1, count] = next {
            let last = *pixels.get(start.checked_sub(1)?)?;
            // No row is as long as a fifth of such pixels says.
            let count = usize::from(count) << (shift < 32).then_some(shift)?;
            pixels.get_mut(start..start.checked_add(count)?)?.fill(last);
            (start, shift) = (start + count, shift + 8);
        } else {
            *pixels.get_mut(start)? = next;
            (start, shift) = (start + 1, 0);
        }
        if start == pixels.len() {
            return Some(());
        }
        next = take(rest)?;
    }
}

/// What a header says that is not done.
pub(super) fn remarks(bytes: &[u8], location: &Location) -> Result<Vec<String>, SceneError> {
    let file = File::new(bytes, bytes.len(), location)?;
    let mut remarks = Vec::new();
    for value in file.values("PRIMARIES") {
        let numbers: Vec<f32> = value.split_whitespace().flat_map(str::parse).collect();
        // Red, green, blue, white.
        let is_usual = match *numbers {
            [rx, ry, gx, gy, bx, by, wx, wy] => is_srgb([wx, wy, rx, ry, gx, gy, bx, by]),
            _ => false,
        };
        if !is_usual {
            remarks.push("it says other primaries than sRGB's, which is left out".to_owned());
        }
    }
    // It has height by width.
    let aspect = file.product("PIXASPECT");
    remarks.extend(aspect.and_then(|aspect| aspect_remark(1.0 / f64::from(aspect))));
    Ok(remarks)
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
        Picture::decode(bytes, &Location::new("sky.hdr")).map_err(|error| error.to_string())
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
            assert_eq!(Picture::decode_size(&bytes, &Location::new("a")).unwrap(), [2, 1]);
            assert!(Picture::remarks(&bytes, &Location::new("a")).unwrap().is_empty());
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
            let message = decoded(&bytes).unwrap_err();
            assert!(
                message.starts_with("sky.hdr: ") && message.contains(rule),
                "{rule}: {message}"
            );
        }
        let lines = "PRIMARIES= .64 .33 .29 .6 .15 .06 .333 .333\nPIXASPECT=2\n";
        let message = Picture::remarks(&file(lines, "-Y 1 +X 2"), &Location::new("a")).unwrap();
        assert!(message.len() == 2 && message[0].contains("primaries"), "{message:?}");
        assert!(message[1].contains("0.5000 times as wide"), "{message:?}");
        let usual = "PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329\n";
        assert!(
            Picture::remarks(&file(usual, "-Y 1 +X 2"), &Location::new("a")).unwrap().is_empty()
        );
    }

    #[test]
    fn a_file_that_is_cut_short_has_an_answer_at_each_length() {
        let bytes = file("EXPOSURE=2\n", "-Y 1 +X 2");
        for length in 0..bytes.len() {
            assert!(decoded(&bytes[..length]).is_err(), "{length}");
        }
    }

    /// A file of one row, with these bytes after its header.
    fn row(width: usize, pixels: &[u8]) -> Vec<u8> {
        [format!("#?RADIANCE\n\n-Y 1 +X {width}\n").as_bytes(), pixels].concat()
    }

    /// The numbers of red of a file.
    fn red(bytes: &[u8]) -> Vec<f32> {
        let Samples::F32(samples) = decoded(bytes).unwrap().samples else { panic!("numbers") };
        samples.into_iter().step_by(3).collect()
    }

    #[test]
    fn each_exponent_has_its_power_of_two() {
        let pixels = |exponent: u8| row(1, &[1, 255, 128, exponent]);
        for exponent in 1..=255 {
            let unit = 2_f64.powi(i32::from(exponent) - 136);
            let expected = [1.0, 255.0, 128.0].map(|number| (number * unit) as f32);
            let picture = decoded(&pixels(exponent)).unwrap();
            assert_eq!(picture.samples, Samples::F32(expected.to_vec()), "{exponent}");
        }
        assert_eq!(decoded(&pixels(0)).unwrap().samples, Samples::F32(vec![0.0; 3]));
    }

    #[test]
    fn runs_of_each_kind_are_the_pixels_that_they_repeat() {
        let pixel = |red: u8| [red, 0, 0, 136];
        // The channels one after the other: seven times 3, then 4, 5, 6.
        let channels =
            [&[2, 2, 0, 10, 135, 3, 3, 4, 5, 6][..], &[138, 0, 138, 0, 138, 136]].concat();
        let expected = [&[3.0; 7][..], &[4.0, 5.0, 6.0]].concat();
        assert_eq!(red(&row(10, &channels)), expected);
        // Pixel by pixel, one repeated 3 + 256 times; a run of none changes nothing.
        let marks = [pixel(9), [1, 1, 1, 3], [1, 1, 1, 1], pixel(8), [1, 1, 1, 0], pixel(7)];
        let expected = [&[9.0; 260][..], &[8.0, 7.0]].concat();
        assert_eq!(red(&row(262, marks.as_flattened())), expected);
        // Few pixels are never channels.
        assert_eq!(
            red(&row(3, [[2, 2, 0, 136], pixel(2), pixel(3)].as_flattened())),
            [2.0, 2.0, 3.0]
        );
        for (width, pixels) in [
            (11, &channels[..]),
            (10, &[2, 2, 0, 10, 139, 3]),
            (10, &[2, 2, 0, 10, 10, 3, 4]),
            (2, &[1, 1, 1, 2]),
            (2, &[9, 0, 0, 136, 1, 1, 1, 2]),
            (2, &[[9, 0, 0, 136]; 1].concat()),
        ] {
            let message = decoded(&row(width, pixels)).unwrap_err();
            assert!(message.contains(&format!("row 0 does not have {width} pixels")), "{message}");
        }
    }
}
