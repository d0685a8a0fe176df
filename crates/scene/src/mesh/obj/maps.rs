//! Images of MTL materials: the options before a path, and roughness and metallic in one image.

use std::collections::HashMap;

use bokashi_core::Tensor;
use bokashi_render_ops::TextureBorder;

use crate::mesh::context::{MeshContext, unquoted};
use crate::model::Borders;
use crate::picture::{Picture, Samples};

/// An image of a material, as a statement names it.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Map {
    /// The path.
    pub(super) file: String,
    /// What `-bm` says.
    pub(super) factor: f32,
    /// What `-clamp` says.
    pub(super) borders: Borders,
    /// The options that say something and are left out.
    pub(super) left_out: Vec<&'static str>,
}

/// The options, the least and the most arguments of each, and the numbers or words that say nothing.
const OPTIONS: [(&str, usize, usize, &[&str]); 13] = [
    ("-blendu", 1, 1, &["on"]),
    ("-blendv", 1, 1, &["on"]),
    ("-boost", 1, 1, &["0"]),
    ("-bm", 1, 1, &["1"]),
    ("-cc", 1, 1, &["off"]),
    ("-clamp", 1, 1, &["off"]),
    ("-imfchan", 1, 1, &[]),
    ("-mm", 2, 2, &["0", "1"]),
    ("-o", 1, 3, &["0", "0", "0"]),
    ("-s", 1, 3, &["1", "1", "1"]),
    ("-t", 1, 3, &["0", "0", "0"]),
    ("-texres", 1, 1, &[]),
    ("-type", 1, 1, &[]),
];

impl Map {
    /// The image with these arguments; nothing where no path is among them. Options stand before the path,
    /// and some programs write them after it.
    pub(super) fn parse(arguments: &str) -> Option<Self> {
        let mut map = Self { factor: 1.0, ..Self::default() };
        let file = map.options(arguments.trim());
        let mut ends = file.match_indices(" -").map(|(start, _)| start);
        let is_end = |&start: &usize| Self::default().options(&file[start..]).is_empty();
        let end = ends.find(is_end).unwrap_or(file.len());
        map.options(&file[end..]);
        map.file = unquoted(file[..end].trim()).to_owned();
        (!map.file.is_empty()).then_some(map)
    }

    /// Takes the options that `text` begins with, and returns what follows them.
    fn options<'t>(&mut self, text: &'t str) -> &'t str {
        let mut left = text;
        while let Some((first, after)) = word(left) {
            // What is no option is a path that begins so.
            let Some(&(option, least, most, nothing)) =
                OPTIONS.iter().find(|(option, ..)| option.eq_ignore_ascii_case(first))
            else {
                break;
            };
            left = after;
            let mut says_nothing = true;
            for k in 0..most {
                let Some((value, after)) = word(left) else { break };
                let number = value.parse::<f32>();
                if k >= least && number.is_err() {
                    break;
                }
                says_nothing &= nothing.get(k).is_some_and(|nothing| match &number {
                    Ok(number) => nothing.parse() == Ok(*number),
                    Err(_) => nothing.eq_ignore_ascii_case(value),
                });
                if let ("-bm", Ok(number)) = (option, number)
                    && number.is_finite()
                {
                    self.factor = number;
                }
                if option == "-clamp" && value.eq_ignore_ascii_case("on") {
                    // As other readers have it. The format has the plain material beyond the edges.
                    (self.borders, says_nothing) = ([TextureBorder::Clamp; 2], true);
                }
                left = after;
            }
            if !says_nothing {
                self.left_out.push(option);
            }
        }
        left
    }
}

/// The first word of a text, and what follows it.
fn word(text: &str) -> Option<(&str, &str)> {
    let word = text.split_whitespace().next()?;
    Some((word, text.trim_start().strip_prefix(word)?.trim_start()))
}

/// Samples of texels whose green and blue are these channels, as `sample` makes them. What is missing is 1.
fn packed<S: Copy>(
    channels: &[Option<Tensor<f32>>; 2],
    texels: usize,
    sample: impl Fn(f32) -> S,
) -> Vec<S> {
    let mut samples = vec![sample(1.0); 3 * texels];
    for (channel, numbers) in channels.iter().enumerate() {
        let Some(numbers) = numbers else { continue };
        for (texel, number) in samples.as_chunks_mut::<3>().0.iter_mut().zip(numbers.data()) {
            texel[1 + channel] = sample(*number);
        }
    }
    samples
}

/// Images of roughness and metallic in one, by the numbers of the two.
#[derive(Debug, Default)]
pub(super) struct Packed {
    numbers: HashMap<[Option<usize>; 2], usize>,
}

impl Packed {
    /// The number of an image with the first channels of the images with these numbers: roughness in green
    /// and metallic in blue. What is missing is 1. Images of different sizes are noted and left out.
    pub(super) fn image(
        &mut self,
        pair: [Option<usize>; 2],
        context: &mut MeshContext<'_>,
    ) -> Option<usize> {
        if let Some(&number) = self.numbers.get(&pair) {
            return Some(number);
        }
        let pictures = pair.map(|number| number.map(|number| &context.images[number]));
        let first = pictures[0].or(pictures[1])?;
        let [width, height] = [first.width, first.height];
        let fits = |picture: &&Picture| [picture.width, picture.height] == [width, height];
        if !pictures.iter().flatten().all(fits) {
            context.notes.add("images of roughness and metallic of different sizes were left out");
            return None;
        }
        // Pairs could be many more than images.
        if 2 * self.numbers.len() >= context.images.len() {
            context.notes.add("images of roughness and metallic in further pairs were left out");
            return None;
        }
        let are_bytes =
            pictures.iter().flatten().all(|picture| matches!(picture.samples, Samples::U8(_)));
        let channels = pictures.map(|picture| picture.and_then(|picture| picture.channel(0)));
        let texels = width * height;
        let samples = match are_bytes {
            true => Samples::U8(packed(&channels, texels, |x| (255.0 * x).round() as u8)),
            false => Samples::F32(packed(&channels, texels, |x| x)),
        };
        self.numbers.insert(pair, context.images.len());
        context.images.push(Picture { width, height, channels: 3, samples });
        Some(context.images.len() - 1)
    }
}
