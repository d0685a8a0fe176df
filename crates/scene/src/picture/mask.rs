//! What a mask says of where objects are.
//!
//! # What is read
//! Programs write masks in several ways, and which one a file has is told by what is in it:
//!
//! - Opacity that differs from pixel to pixel is the mask; what colours it has does not matter.
//! - Gray, or shades of one colour, up to white: the share of each pixel that objects cover.
//! - Two values, of which one is 0: the other is the object, whatever it is.
//! - Labels, as numbers or as colours of a palette: 0 or black is no object, all others are.
//!
//! What can't be told is refused.

use std::collections::HashSet;
use std::fmt;

use bokashi_core::Tensor;

use super::color::ColorSpace;
use super::samples::{Picture, Samples};
use crate::error::{Location, SceneError};
use crate::memory::Memory;

/// Bytes that a pixel of a mask takes while it is read: its colour twice, and numbers of it.
const OF_MASK_PIXEL: u64 = 32;

/// From here on a shade is white: JPEG and resampling leave less than 1.
const WHITE: f32 = 0.9;
/// Up to here a number may be a label of 8 bits: there are 64.
const LABEL: f32 = 0.25;
/// The most numbers that are labels beside one another, and the most colours.
const MOST_LABELS: usize = 64;
const MOST_COLORS: usize = 256;
/// Channels that differ by less are one gray: JPEG leaves as much.
const GRAY: f32 = 8.0 / 255.0;
/// Likewise of shades of one colour.
const SHADE: f32 = 4.0 / 255.0;

/// Where objects are in an image.
#[derive(Debug, Clone)]
pub struct Mask {
    /// The share of each pixel that objects cover: `[H, W]`.
    pub share: Tensor<f32>,
    /// How the file says it.
    pub kind: MaskKind,
}

/// How a file says where objects are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskKind {
    /// By opacity.
    Opacity,
    /// By shades from black to white.
    Shades,
    /// By two values, one of them 0.
    TwoValues,
    /// By so many labels beside 0.
    Labels(usize),
    /// Not at all: all of it is an object, or nothing is.
    Even,
}

impl fmt::Display for MaskKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Opacity => f.write_str("opacity"),
            Self::Shades => f.write_str("shades"),
            Self::TwoValues => f.write_str("two values"),
            Self::Labels(1) => f.write_str("1 label"),
            Self::Labels(count) => write!(f, "{count} labels"),
            Self::Even => f.write_str("one value"),
        }
    }
}

impl Mask {
    /// What the image of a mask's file says. `location` names the file in errors.
    ///
    /// # Errors
    /// [`SceneError::Content`] for numbers that are below 0, beyond 1 or in no way a mask; [`SceneError::Memory`]
    /// for more pixels than the process may have.
    ///
    /// # Panics
    /// As [`Picture::color`].
    pub fn from_picture(picture: &Picture, location: &Location) -> Result<Self, SceneError> {
        let wrong = |message: String| SceneError::content(location.clone(), message);
        let what = || format!("a mask of {} x {}", picture.width, picture.height);
        let bytes = OF_MASK_PIXEL * picture.pixels() as u64;
        Memory::default().check(bytes, location, what)?;
        let is_whole = !matches!(picture.samples, Samples::F32(_));
        let shape = [picture.height, picture.width];
        let of_numbers = |numbers: Vec<f32>| {
            let (share, kind) = read_shares(&numbers, is_whole).map_err(wrong)?;
            Ok(Self { share: Tensor::from_flat_fn(shape, |k| share[k]), kind })
        };
        if let Some(opacity) = picture.opacity() {
            let first = opacity.data()[0];
            if opacity.data().iter().any(|&x| x != first) {
                let mask = of_numbers(opacity.data().to_vec())?;
                return Ok(Self { kind: MaskKind::Opacity, ..mask });
            }
        }
        if let (1 | 2, Some(gray)) = (picture.channels, picture.channel(0)) {
            return of_numbers(gray.data().to_vec());
        }
        let colors = picture.color(ColorSpace::Linear);
        let colors: Vec<[f32; 3]> =
            colors.data().chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        if let Some(numbers) = shades(&colors) {
            return of_numbers(numbers);
        }
        let all = distinct(colors.iter().map(|c| c.map(f32::to_bits)), MOST_COLORS);
        let Some(all) = all else {
            let rule = "a mask is gray, or has labels in up to 256 colours";
            return Err(wrong(format!("{rule}, and this has more colours")));
        };
        if !all.contains(&[0; 3]) {
            let rule = "labels in colours are black where no object is";
            return Err(wrong(format!("{rule}, and this is nowhere black")));
        }
        let share = Tensor::from_flat_fn(shape, |k| f32::from(u8::from(colors[k] != [0.0; 3])));
        Ok(Self { share, kind: MaskKind::Labels(all.len() - 1) })
    }

    /// What an image's own opacity says; `None` where it has none.
    ///
    /// # Panics
    /// As [`Picture::color`].
    pub fn from_opacity(picture: &Picture) -> Option<Self> {
        let share = picture.opacity()?;
        let first = share.data()[0];
        let is_even = [0.0, 1.0].contains(&first) && share.data().iter().all(|&x| x == first);
        Some(Self { share, kind: if is_even { MaskKind::Even } else { MaskKind::Opacity } })
    }

    /// The mean share.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.share.data().iter().map(|&share| f64::from(share)).sum();
        sum / self.share.size() as f64
    }

    /// What is wrong with a mask that says nothing: a rule and what broke it.
    pub fn fault(&self) -> Option<&'static str> {
        match self.kind {
            MaskKind::Even if self.share.data()[0] == 0.0 => {
                Some("a mask tells objects from background, and this has no object")
            }
            MaskKind::Even => {
                Some("a mask tells objects from background, and this has no background")
            }
            _ => None,
        }
    }
}

/// The brightness of gray, or of shades of a single colour as shares of the brightest. None where there are
/// several colours.
fn shades(colors: &[[f32; 3]]) -> Option<Vec<f32>> {
    let largest = |color: &[f32; 3]| color.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let least = |color: &[f32; 3]| color.iter().copied().fold(f32::INFINITY, f32::min);
    if colors.iter().all(|color| largest(color) - least(color) <= GRAY) {
        return Some(colors.iter().map(largest).collect());
    }
    let brightest = colors.iter().max_by(|a, b| largest(a).total_cmp(&largest(b)))?;
    let scale = largest(brightest);
    let is_shade = |color: &[f32; 3]| {
        let share = largest(color) / scale;
        (0..3).all(|k| (color[k] - share * brightest[k]).abs() <= SHADE)
    };
    colors.iter().all(is_shade).then(|| colors.iter().map(|c| largest(c) / scale).collect())
}

/// The different ones, unless there are more than `most`.
fn distinct<K: std::hash::Hash + Eq + Copy>(
    keys: impl Iterator<Item = K>,
    most: usize,
) -> Option<HashSet<K>> {
    let (mut all, mut last) = (HashSet::new(), None);
    for key in keys {
        // Masks have long runs.
        if last == Some(key) {
            continue;
        }
        last = Some(key);
        all.insert(key);
        if all.len() > most {
            return None;
        }
    }
    Some(all)
}

/// The shares that numbers stand for, and how they say it.
fn read_shares(numbers: &[f32], is_whole: bool) -> Result<(Vec<f32>, MaskKind), String> {
    let least = numbers.iter().copied().fold(f32::INFINITY, f32::min);
    let most = numbers.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if least < 0.0 {
        return Err(format!("a mask lies between 0 and 1, and this has {least}"));
    }
    if least == most {
        return match most {
            0.0 => Ok((vec![0.0; numbers.len()], MaskKind::Even)),
            1.0 => Ok((vec![1.0; numbers.len()], MaskKind::Even)),
            _ => Err(format!("a mask shows where objects are, and this is {most} everywhere")),
        };
    }
    // Zeros with a sign are zeros.
    let all = distinct(numbers.iter().map(|x| (x + 0.0).to_bits()), MOST_LABELS);
    let labelled = |kind| {
        let share = numbers.iter().map(|&x| f32::from(u8::from(x > 0.0)));
        Ok((share.collect(), kind))
    };
    match &all {
        Some(all) if all.len() == 2 && least == 0.0 => return labelled(MaskKind::TwoValues),
        Some(all) if !is_whole && most > 1.0 && numbers.iter().all(|x| x.fract() == 0.0) => {
            return match least {
                0.0 => labelled(MaskKind::Labels(all.len() - 1)),
                _ => Err(format!("labels are 0 where no object is, and these begin at {least}")),
            };
        }
        _ => {}
    }
    if most > 1.0 {
        return Err(format!("a mask lies between 0 and 1, and this has {most}"));
    }
    if most >= WHITE {
        // Labels with white between them, as in Pascal VOC, have no shade between, and a single white.
        let is_label = |x: &&f32| **x > 0.0 && **x <= LABEL;
        let is_white = |x: &&f32| **x == most;
        let has_shades = numbers.iter().any(|&x| x > LABEL && x < most);
        let count = numbers.iter().filter(is_label).count();
        if all.is_some() && !has_shades && count > numbers.iter().filter(is_white).count() {
            let rule = "a mask has shades up to white, or labels";
            return Err(format!("{rule}, and this has labels and white beside them"));
        }
        return Ok((numbers.to_vec(), MaskKind::Shades));
    }
    match all {
        Some(all) if is_whole && least == 0.0 => labelled(MaskKind::Labels(all.len() - 1)),
        Some(_) if is_whole => {
            Err("labels are 0 where no object is, and these are nowhere 0".to_owned())
        }
        _ => Err(format!("shades of a mask reach white, and these reach {most} of 1")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 16;

    /// An image whose pixels have these samples, by whether they are inside a square.
    fn bytes(channels: usize, sample: impl Fn(usize, bool) -> u8) -> Picture {
        let samples =
            (0..SIDE * SIDE * channels).map(|k| sample(k, inside(k / channels))).collect();
        Picture { width: SIDE, height: SIDE, channels, samples: Samples::U8(samples) }
    }

    fn inside(pixel: usize) -> bool {
        (4..10).contains(&(pixel % SIDE)) && (4..10).contains(&(pixel / SIDE))
    }

    fn mask(picture: &Picture) -> Result<Mask, String> {
        Mask::from_picture(picture, &Location::new("m.png")).map_err(|error| error.to_string())
    }

    /// Checks that the square is the object, said in this way.
    fn check(picture: &Picture, kind: MaskKind) {
        let found = mask(picture).unwrap();
        assert_eq!(found.kind, kind);
        for (pixel, share) in found.share.data().iter().enumerate() {
            assert_eq!(*share, f32::from(u8::from(inside(pixel))), "{kind:?}: {pixel}");
        }
        assert!((found.mean() - 36.0 / 256.0).abs() < 1e-12 && found.fault().is_none());
    }

    #[test]
    fn two_values_are_background_and_object_whatever_the_second_is() {
        for object in [1, 2, 77, 128, 254, 255] {
            for channels in [1, 3] {
                let picture = bytes(channels, |_, inside| if inside { object } else { 0 });
                check(&picture, MaskKind::TwoValues);
            }
            let wide = bytes(1, |_, inside| if inside { object } else { 0 });
            let Samples::U8(samples) = &wide.samples else { panic!("bytes") };
            for scale in [1_u16, 257] {
                let samples = samples.iter().map(|&x| u16::from(x) * scale).collect();
                check(
                    &Picture { samples: Samples::U16(samples), ..wide.clone() },
                    MaskKind::TwoValues,
                );
            }
            let samples = samples.iter().map(|&x| f32::from(x)).collect();
            check(&Picture { samples: Samples::F32(samples), ..wide }, MaskKind::TwoValues);
        }
    }

    #[test]
    fn shades_up_to_white_are_shares() {
        let picture = bytes(1, |k, _| (k % 256) as u8);
        let found = mask(&picture).unwrap();
        assert_eq!((found.kind, &found.share), (MaskKind::Shades, &picture.channel(0).unwrap()));
        // JPEG leaves less than white, more than black, and channels that differ.
        let noise =
            |k: usize, inside: bool| if inside { 250 + (k % 5) as u8 } else { (k % 4) as u8 };
        let found = mask(&bytes(3, noise)).unwrap();
        assert_eq!(found.kind, MaskKind::Shades);
        let shares = found.share.data().iter().enumerate();
        assert!(shares.clone().all(|(pixel, &x)| (x > 0.9) == inside(pixel) && x.fract() < 1.0));
        // Shades of one colour: blue, and red as it is in palettes.
        for (channel, full) in [(2, 255), (0, 128)] {
            let shade = |k: usize, inside: bool| match (k % 3 == channel, inside) {
                (true, true) if k / 3 % SIDE == 4 => full / 2,
                (true, true) => full,
                _ => 0,
            };
            let found = mask(&bytes(3, shade)).unwrap();
            assert_eq!(found.kind, MaskKind::Shades);
            assert!((found.share[[5, 4]] - 0.5).abs() < 0.01 && found.share[[5, 5]] == 1.0);
        }
    }

    #[test]
    fn labels_but_the_first_are_objects() {
        let label = |k: usize, inside: bool| if inside { 1 + (k % 7) as u8 } else { 0 };
        check(&bytes(1, label), MaskKind::Labels(7));
        let many = |k: usize, inside: bool| if inside { 1 + (k % 2 * 180) as u8 } else { 0 };
        check(&bytes(1, many), MaskKind::Labels(2));
        // Colours of Pascal VOC's palette: dark red, green, olive.
        let palette = [[128, 0, 0], [0, 128, 0], [64, 128, 0]];
        let color = |k: usize, inside: bool| if inside { palette[k / 3 % 3][k % 3] } else { 0 };
        check(&bytes(3, color), MaskKind::Labels(3));
        let whole = bytes(1, label);
        let Samples::U8(samples) = &whole.samples else { panic!("bytes") };
        let samples = samples.iter().map(|&x| f32::from(x)).collect();
        check(&Picture { samples: Samples::F32(samples), ..whole }, MaskKind::Labels(7));
    }

    #[test]
    fn opacity_goes_before_colours_where_it_tells_something() {
        for white in [0, 9, 255] {
            let cut = |k: usize, inside: bool| match k % 4 {
                3 => u8::from(inside) * 255,
                _ => white,
            };
            check(&bytes(4, cut), MaskKind::Opacity);
            let cut = |k: usize, inside: bool| if k % 2 == 1 { u8::from(inside) } else { white };
            check(&bytes(2, cut), MaskKind::Opacity);
        }
        // It is the same everywhere.
        for opacity in [0, 128, 255] {
            let gray = |k: usize, inside: bool| if k % 4 == 3 { opacity } else { u8::from(inside) };
            check(&bytes(4, gray), MaskKind::TwoValues);
        }
    }

    #[test]
    fn a_mask_that_tells_nothing_has_a_fault_or_is_refused() {
        for (value, fault) in [(0, "no object"), (255, "no background")] {
            let found = mask(&bytes(1, |_, _| value)).unwrap();
            assert_eq!(found.kind, MaskKind::Even);
            assert!(found.fault().unwrap().contains(fault));
        }
        let floats = |sample: fn(usize) -> f32| {
            let samples = Samples::F32((0..SIDE * SIDE).map(sample).collect());
            Picture { width: SIDE, height: SIDE, channels: 1, samples }
        };
        let samples = Samples::U8((0..1200_usize).map(|k| ((k * 40_503) >> 7) as u8).collect());
        let photograph = Picture { width: 20, height: 20, channels: 3, samples };
        let rows = [
            (bytes(1, |_, _| 1), "and this is 0.003921569 everywhere"),
            (floats(|k| if k == 3 { -0.5 } else { 1.0 }), "between 0 and 1, and this has -0.5"),
            (floats(|k| k as f32 / 100.0), "between 0 and 1, and this has 2.55"),
            (
                floats(|k| 1.0 + (k % 3) as f32),
                "labels are 0 where no object is, and these begin at 1",
            ),
            (floats(|k| k as f32 / 512.0), "reach white, and these reach 0.498"),
            (bytes(1, |k, _| 1 + (k % 3) as u8), "these are nowhere 0"),
            (bytes(1, |k, _| (k % 128) as u8), "reach white, and these reach 0.498"),
            // Labels, and white between them.
            (bytes(1, |k, _| [0, 1, 15, 15, 255][k % 5]), "labels and white beside them"),
            (photograph, "up to 256 colours, and this has more"),
            (bytes(3, |k, _| [200, 0, 0, 0, 200, 0][k % 6]), "and this is nowhere black"),
        ];
        for (picture, rule) in rows {
            let message = mask(&picture).unwrap_err();
            assert!(message.starts_with("m.png: ") && message.contains(rule), "{message}");
        }
    }

    #[test]
    fn an_image_s_own_opacity_tells_nothing_where_it_is_the_same() {
        let opaque = |opacity: u8| Mask::from_opacity(&bytes(4, move |_, _| opacity)).unwrap();
        assert!(opaque(255).fault().is_some() && opaque(0).fault().is_some());
        let cut = bytes(2, |_, inside| if inside { 255 } else { 3 });
        let found = Mask::from_opacity(&cut).unwrap();
        assert_eq!((found.kind, found.share), (MaskKind::Opacity, cut.opacity().unwrap()));
        assert!(Mask::from_opacity(&bytes(3, |_, _| 1)).is_none());
    }
}
