//! Images of MTL materials: the options before a path, and roughness and metallic in one image.

use std::collections::HashMap;

use bokashi_render_ops::TextureBorder;

use crate::mesh::beside::Beside;
use crate::model::Borders;
use crate::picture::{Picture, Samples};

/// An image of a material, as a statement names it.
#[derive(Debug, PartialEq)]
pub(super) struct Map {
    /// The path.
    pub(super) file: String,
    /// What `-bm` says.
    pub(super) factor: f32,
    /// Whether `-o`, `-s` or `-t` move it.
    pub(super) is_moved: bool,
    /// What `-clamp` says.
    pub(super) borders: Borders,
}

impl Map {
    /// The image with these arguments; nothing where no path is among them.
    pub(super) fn of(arguments: &str) -> Option<Self> {
        let (mut left, mut factor, mut is_moved) = (arguments.trim(), 1.0, false);
        let mut borders = Borders::default();
        while let Some((option, after)) = word(left).filter(|(word, _)| word.starts_with('-')) {
            let (least, most) = match option {
                "-blendu" | "-blendv" | "-boost" | "-cc" | "-clamp" | "-imfchan" | "-texres"
                | "-type" | "-bm" => (1, 1),
                "-mm" => (2, 2),
                "-o" | "-s" | "-t" => (1, 3),
                // A path that begins so.
                _ => break,
            };
            is_moved |= most == 3;
            left = after;
            for k in 0..most {
                let Some((value, after)) = word(left) else { break };
                let number = value.parse::<f32>();
                if k >= least && number.is_err() {
                    break;
                }
                if let ("-bm", Ok(number)) = (option, number) {
                    factor = number;
                }
                if option == "-clamp" {
                    // As other readers have it. The format has the plain material beyond the edges.
                    let is_clamped = value.eq_ignore_ascii_case("on");
                    let border =
                        if is_clamped { TextureBorder::Clamp } else { TextureBorder::Wrap };
                    borders = [border; 2];
                }
                left = after;
            }
        }
        let is_file = !left.is_empty() && factor.is_finite();
        is_file.then(|| Self { file: left.to_owned(), factor, is_moved, borders })
    }
}

/// The first word of a text, and what follows it.
fn word(text: &str) -> Option<(&str, &str)> {
    let word = text.split_whitespace().next()?;
    Some((word, text.trim_start().strip_prefix(word)?.trim_start()))
}

/// Images of roughness and metallic in one, by the numbers of the two.
#[derive(Debug, Default)]
pub(super) struct Packed {
    numbers: HashMap<[Option<usize>; 2], usize>,
}

impl Packed {
    /// The number of an image with the first channels of the images with these numbers: roughness in green
    /// and metallic in blue. What is missing is 1. Images of different sizes are noted and left out.
    pub(super) fn of(
        &mut self,
        pair: [Option<usize>; 2],
        beside: &mut Beside<'_>,
    ) -> Option<usize> {
        if let Some(&number) = self.numbers.get(&pair) {
            return Some(number);
        }
        let pictures = pair.map(|number| number.map(|number| &beside.images[number]));
        let first = pictures[0].or(pictures[1])?;
        let [width, height] = [first.width, first.height];
        let fits = |picture: &&Picture| [picture.width, picture.height] == [width, height];
        if !pictures.iter().flatten().all(fits) {
            beside.notes.add("images of roughness and metallic of different sizes were left out");
            return None;
        }
        // Pairs could be many more than images.
        if 2 * self.numbers.len() >= beside.images.len() {
            beside.notes.add("images of roughness and metallic in further pairs were left out");
            return None;
        }
        let samples = match pictures.map(|picture| picture.map(|picture| &picture.samples)) {
            [None | Some(Samples::U8(_)), None | Some(Samples::U8(_))] => {
                let samples = pictures.map(|picture| picture.and_then(bytes));
                Samples::U8(merged(samples, pictures, u8::MAX))
            }
            _ => {
                let samples = pictures.map(|picture| picture.map(floats));
                Samples::F32(merged(samples.each_ref().map(Option::as_deref), pictures, 1.0))
            }
        };
        self.numbers.insert(pair, beside.images.len());
        beside.images.push(Picture { width, height, channels: 3, samples });
        Some(beside.images.len() - 1)
    }
}

fn bytes(picture: &Picture) -> Option<&[u8]> {
    match &picture.samples {
        Samples::U8(samples) => Some(samples),
        _ => None,
    }
}

fn floats(picture: &Picture) -> Vec<f32> {
    match &picture.samples {
        Samples::U8(samples) => samples.iter().map(|&x| f32::from(x) / 255.0).collect(),
        Samples::U16(samples) => samples.iter().map(|&x| f32::from(x) / 65535.0).collect(),
        Samples::F32(samples) => samples.clone(),
    }
}

/// The pixels [1, green, blue], with `one` as 1.
fn merged<S: Copy>(samples: [Option<&[S]>; 2], pair: [Option<&Picture>; 2], one: S) -> Vec<S> {
    let pixels = pair.into_iter().flatten().map(Picture::pixels).next().unwrap_or(0);
    let sample = |k: usize, pixel: usize| match (samples[k], pair[k]) {
        (Some(samples), Some(picture)) => samples[pixel * picture.channels],
        _ => one,
    };
    (0..pixels).flat_map(|pixel| [one, sample(0, pixel), sample(1, pixel)]).collect()
}
