//! Colours at vertices: the numbers of files as light.
//!
//! OBJ and PLY don't say how numbers stand for colours. MeshLab, Blender and three.js take 1, and 255 of a
//! byte, as white, and numbers between as encoded by the curve of sRGB. glTF's colours are linear.
//!
//! # Source
//! IEC 61966-2-1.

use crate::mesh::notes::Notes;
use crate::picture::ColorSpace;

/// Numbers up to here are up to 1: half a step of a byte beyond it is rounding.
const MOST_OF_ONE: f32 = 1.0 + 0.5 / 255.0;

/// How a file has the numbers of colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Written {
    /// As whole numbers of 8 bits.
    Bytes,
    /// As wider whole numbers.
    Whole,
    /// As fractions.
    Fractions,
}

/// Makes the numbers of a file linear light from 0 to 1. Nothing where no rule fits them, which is noted.
///
/// White is 1 for fractions up to 1, else 255 for numbers up to 255, else 65535. What a file does not say by
/// itself is noted.
pub(super) fn linear(
    mut rows: Vec<[f32; 3]>,
    written: Written,
    space: ColorSpace,
    notes: &mut Notes,
) -> Vec<[f32; 3]> {
    let numbers = || rows.iter().flatten().copied();
    let (least, largest) = (numbers().fold(0.0, f32::min), numbers().fold(0.0, f32::max));
    let left_out = match written {
        _ if largest > 65535.0 => Some("are up to 1, 255 or 65535, and the largest"),
        Written::Bytes | Written::Whole if least < 0.0 => Some("are from 0 on, and the least"),
        _ => None,
    };
    if let Some(rule) = left_out {
        let found = if largest > 65535.0 { largest } else { least };
        notes.add(format!("colours of vertices were left out: they {rule} is {found}"));
        return Vec::new();
    }
    let white = match written {
        Written::Fractions if largest <= MOST_OF_ONE => 1.0,
        _ if largest <= 255.0 => 255.0,
        _ => 65535.0,
    };
    if written != Written::Bytes && white > 1.0 {
        notes.add(format!("colours of vertices go up to {largest}: they were divided by {white}"));
    }
    for number in rows.as_flattened_mut() {
        let encoded = f64::from(*number) / white;
        *number = match space {
            ColorSpace::Srgb => decoded(encoded),
            ColorSpace::Linear => encoded as f32,
        };
    }
    rows
}

/// The light of a number of a file, both from 0 to 1. Numbers below 0, which no rule has, stay on the curve's
/// first line.
pub(super) fn decoded(number: f64) -> f32 {
    (if number < 0.0 { number / 12.92 } else { ColorSpace::Srgb.decode(number) }) as f32
}

/// The number of a file, from 0 to 255, of light from 0 to 1. Light beyond is cut.
pub(super) fn encoded(light: f32) -> u8 {
    (255.0 * share(light)).round() as u8
}

/// The number of a file, from 0 to 1, of light from 0 to 1. Light beyond is cut.
pub(super) fn share(light: f32) -> f64 {
    ColorSpace::Srgb.encode(light.clamp(0.0, 1.0).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_comes_back() {
        for byte in 0..=u8::MAX {
            assert_eq!(encoded(decoded(f64::from(byte) / 255.0)), byte);
        }
        assert_eq!([encoded(-1.0), encoded(2.0)], [0, 255]);
        // The curve's middle: 188 of 255 is half of the light.
        assert!((decoded(188.0 / 255.0) - 0.5).abs() < 0.004);
    }

    /// What becomes of a colour beside a number that is the least or the largest, and what is noted.
    fn converted(written: Written, rows: [f32; 3]) -> (Vec<f32>, Vec<String>) {
        let mut notes = Notes::default();
        let found = linear(vec![rows], written, ColorSpace::Linear, &mut notes);
        (found.as_flattened().to_vec(), notes.finish())
    }

    #[test]
    fn white_is_1_or_255_or_65535_and_what_was_taken_for_white_is_noted() {
        use Written::{Bytes, Fractions, Whole};
        // Which numbers, and what white is.
        let cases = [
            (Bytes, [0.0, 1.0, 2.0], 255.0, 0),
            (Bytes, [0.0, 51.0, 255.0], 255.0, 0),
            (Whole, [0.0, 1.0, 255.0], 255.0, 1),
            (Whole, [0.0, 1.0, 256.0], 65535.0, 1),
            (Fractions, [0.0, 0.5, 1.0], 1.0, 0),
            (Fractions, [-0.25, 0.5, 1.0001], 1.0, 0),
            (Fractions, [f32::NAN, 0.5, 1.5], 255.0, 1),
            (Fractions, [0.0, 0.5, 255.0], 255.0, 1),
            (Fractions, [0.0, 0.5, 65535.0], 65535.0, 1),
        ];
        for (written, rows, white, notes) in cases {
            let (found, message) = converted(written, rows);
            for k in 1..3 {
                assert_eq!(found[k], (f64::from(rows[k]) / white) as f32, "{written:?} {rows:?}");
            }
            assert_eq!(message.len(), notes, "{written:?} {rows:?}: {message:?}");
        }
        for (written, rows, named) in [
            (Whole, [0.0, 1.0, 65536.0], "65536"),
            (Fractions, [0.0, 1.0, 1e9], "1000000000"),
            (Bytes, [0.0, 1.0, -1.0], "-1"),
        ] {
            let (found, message) = converted(written, rows);
            assert!(found.is_empty(), "{found:?}");
            assert!(message[0].contains("left out") && message[0].contains(named), "{message:?}");
        }
    }
}
