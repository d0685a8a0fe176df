//! OpenEXR files, read and written.

use std::io::Cursor;

use exr::block::reader::Reader;
use exr::image::read::specific_channels::ReadSpecificChannel as _;
use exr::meta::attribute::{ChannelDescription, Text};
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, ReadChannels as _,
    ReadLayers as _, Vec2, WritableImage as _, read,
};

use super::samples::{DENSEST, Picture, Samples, broken, check_size, claim};
use super::usual::{aspect_remark, is_srgb};
use crate::error::{Location, SceneError};
use crate::memory::Memory;

/// A file whose header has been read.
type File<'b> = Reader<Cursor<&'b [u8]>>;

/// The most samples that a byte of a file stands for: deflate makes 1032 bytes of one, and a sample has two. A
/// display window has no bytes.
const DENSEST_DATA: u64 = 516;

/// Names of the channels, for one to four of them.
const NAMES: [&[&str]; 4] = [&["Y"], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]];

/// The channels of a part that make an image.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Chosen {
    /// R, G and B after this beginning of their names, which is empty or ends with a point.
    Color(String),
    /// A single channel of this name.
    Gray(Text),
}

impl Chosen {
    fn new(header: &Header) -> Option<Self> {
        if header.deep {
            return None;
        }
        if is_color(header, "") {
            return Some(Self::Color(String::new()));
        }
        match header.channels.list.as_slice() {
            [only] => Some(Self::Gray(only.name.clone())),
            [opacity, gray] if opacity.name == *"A" && gray.name == *"Y" => {
                Some(Self::Gray(gray.name.clone()))
            }
            _ => None,
        }
    }
}

fn has(header: &Header, name: &str) -> bool {
    header.channels.list.iter().any(|channel| channel.name == *name)
}

/// Whether a part has R, G and B after this beginning.
fn is_color(header: &Header, layer: &str) -> bool {
    ["R", "G", "B"].into_iter().all(|name| has(header, &format!("{layer}{name}")))
}

/// The beginnings of names that a part has before R, G and B, each with its last point.
fn layers(header: &Header) -> Vec<String> {
    let names = header.channels.list.iter().map(|channel| channel.name.to_string());
    let layers = names.filter_map(|name| name.strip_suffix(".R").map(|layer| format!("{layer}.")));
    layers.filter(|layer| !header.deep && is_color(header, layer)).collect()
}

/// The part that is read, by its number, and its channels.
///
/// # Errors
/// [`SceneError::Content`] where there is none, or one of several layers.
fn chosen(headers: &[Header], location: &Location) -> Result<(usize, Chosen), SceneError> {
    let choice = headers.iter().enumerate().find_map(|(k, header)| Some((k, Chosen::new(header)?)));
    // A part is found by the names of its channels, the first one that has them.
    let choice = choice.filter(|(k, chosen)| match chosen {
        Chosen::Color(_) => true,
        Chosen::Gray(name) => {
            let is_same = |channel: &ChannelDescription| channel.name == *name;
            !headers[..*k].iter().any(|header| header.channels.list.iter().any(is_same))
        }
    });
    let has_gray = matches!(choice, Some((_, Chosen::Gray(_))));
    let all = headers.iter().enumerate();
    let all = all.flat_map(|(k, header)| layers(header).into_iter().map(move |layer| (k, layer)));
    let all: Vec<_> = all.collect();
    match (choice, all.as_slice()) {
        (Some(choice), _) if !has_gray => Ok(choice),
        (_, [(k, layer)]) => Ok((*k, Chosen::Color(layer.clone()))),
        (Some(choice), []) => Ok(choice),
        (None, []) => {
            let rule = "an EXR image has the channels R, G and B, or Y and A, or a single channel";
            let message = format!("{rule}, and no flat layer of this file has");
            Err(SceneError::content(location.clone(), message))
        }
        (_, several) => {
            let names = several.iter().map(|(_, layer)| layer.trim_end_matches('.'));
            let names = names.collect::<Vec<_>>().join(", ");
            let rule = "of an EXR image the only layer with R, G and B is read";
            let message = format!("{rule}, and this has {}: {names}", several.len());
            Err(SceneError::content(location.clone(), message))
        }
    }
}

/// A file whose header has been read and is not too large for its `length`, the number of the part that is read,
/// and its channels.
fn opened<'b>(
    bytes: &'b [u8],
    length: usize,
    location: &Location,
) -> Result<(File<'b>, usize, Chosen), SceneError> {
    let content = |message: String| SceneError::content(location.clone(), message);
    let reader =
        exr::block::read(Cursor::new(bytes), false).map_err(|error| broken(&error, location))?;
    let headers = reader.headers();
    let (layer, chosen) = chosen(headers, location)?;
    let header = &headers[layer];
    if let Compression::DWAA(_) | Compression::DWAB(_) = header.compression {
        // Their decoder takes as much memory as a block says.
        let rule = "the compressions DWAA and DWAB are not read";
        return Err(content(format!("{rule}, and this is {}", header.compression)));
    }
    let list = &header.channels.list;
    if let Some(channel) = list.iter().find(|channel| channel.sampling != Vec2(1, 1)) {
        let (name, Vec2(x, y)) = (&channel.name, channel.sampling);
        let rule = "a channel has a sample for each pixel";
        return Err(content(format!("{rule}, and {name} has one for {x} x {y} pixels")));
    }
    // All channels of the data window are decompressed, and the display window is what is answered.
    let display = header.shared_attributes.display_window.size;
    let rules =
        [(header.layer_size, list.len(), DENSEST_DATA), (display, list.len().min(4), DENSEST)];
    for (size, count, densest) in rules {
        let size = [size.width() as u64, size.height() as u64];
        check_size(size, count as u64, (length, densest), location)?;
    }
    Ok((reader, layer, chosen))
}

/// What a file of `length` bytes that begins with `bytes` says before its pixels: the size of the display window.
pub(super) fn header(
    bytes: &[u8],
    length: usize,
    location: &Location,
) -> Result<super::header::Header, SceneError> {
    let (reader, layer, _) = opened(bytes, length, location)?;
    let size = reader.headers()[layer].shared_attributes.display_window.size;
    Ok(super::header::Header::from_size([size.width(), size.height()]))
}

/// What a file says that is not done.
pub(super) fn remarks(bytes: &[u8], location: &Location) -> Result<Vec<String>, SceneError> {
    let (reader, layer, chosen) = opened(bytes, bytes.len(), location)?;
    let headers = reader.headers();
    let (header, shared) = (&headers[layer], &headers[layer].shared_attributes);
    let mut remarks = Vec::new();
    if let Some(primaries) = shared.chromaticities {
        let all = [primaries.white, primaries.red, primaries.green, primaries.blue];
        let all: Vec<f32> =
            all.iter().flat_map(|coordinate| [coordinate.x(), coordinate.y()]).collect();
        if !<[f32; 8]>::try_from(all).is_ok_and(is_srgb) {
            remarks.push("it says other primaries than sRGB's, which is left out".to_owned());
        }
    }
    remarks.extend(aspect_remark(shared.pixel_aspect.into()));
    let display = shared.display_window;
    let (size, position) = (header.layer_size, header.own_attributes.layer_position);
    if size != display.size || position != display.position {
        let [data, shown] = [size, display.size].map(|size| format!("{} x {}", size.0, size.1));
        let rule = "what lies outside is left out, and what is missing is 0";
        remarks.push(format!("it shows a window of {shown} of {data} pixels: {rule}"));
    }
    if header.own_attributes.environment_map.is_some() {
        remarks.push("it says which environment map it is, which is left out".to_owned());
    }
    // Channels that are no part of the image.
    let is_read = |name: &Text| match &chosen {
        Chosen::Gray(gray) => name == gray || *gray == *"Y" && *name == *"A",
        Chosen::Color(layer) => {
            ["R", "G", "B", "A"].iter().any(|channel| *name == *format!("{layer}{channel}"))
        }
    };
    let others = header.channels.list.iter().map(|channel| &channel.name);
    let others: Vec<_> = others.filter(|name| !is_read(name)).map(Text::to_string).collect();
    if !others.is_empty() {
        remarks.push(format!("other channels are left out: {}", named(&others)));
    }
    let parts = headers.iter().enumerate().filter(|(k, _)| *k != layer).map(|(k, header)| {
        let name = &header.own_attributes.layer_name;
        name.as_ref().map_or_else(|| format!("number {}", k + 1), Text::to_string)
    });
    let parts: Vec<_> = parts.collect();
    if !parts.is_empty() {
        remarks.push(format!("other parts are left out: {}", named(&parts)));
    }
    Ok(remarks)
}

/// The first of some names, and how many others there are.
fn named(names: &[String]) -> String {
    const SHOWN: usize = 8;
    const LONGEST: usize = 60;
    let first = names.iter().take(SHOWN).map(|name| name.chars().take(LONGEST).collect::<String>());
    let shown = first.collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

pub(super) fn decode(
    bytes: &[u8],
    memory: &Memory,
    location: &Location,
) -> Result<Picture, SceneError> {
    let (reader, layer, chosen) = opened(bytes, bytes.len(), location)?;
    let header = &reader.headers()[layer];
    let display = header.shared_attributes.display_window;
    let (size, position) = (header.layer_size, header.own_attributes.layer_position);
    let bytes =
        |size: Vec2<usize>| 4 * size.area() as u64 * header.channels.list.len().min(4) as u64;
    let [width, height] = [display.size.width(), display.size.height()];
    claim([width as u64, height as u64], bytes(display.size), memory, location)?;
    // The data window is there for a time.
    let window = || format!("a data window of {} x {}", size.width(), size.height());
    memory.check(bytes(size), location, window)?;
    let (channels, samples) = match chosen {
        Chosen::Gray(name) => {
            // A channel may be asked for once.
            let is_alpha = name == *"A";
            let other = if is_alpha { "Y" } else { "A" };
            let channels = if has(header, "A") && !is_alpha { 2 } else { 1 };
            (channels, gray(reader, name, other, channels, size))
        }
        Chosen::Color(layer) => {
            let channels = if has(header, &format!("{layer}A")) { 4 } else { 3 };
            (channels, color(reader, &layer, channels, size))
        }
    };
    let samples = samples.map_err(|error| broken(&error, location))?;
    let offset = position - display.position;
    if let Some(index) = samples.iter().position(|sample| !sample.is_finite()) {
        let pixel = index / channels;
        let column = (pixel % size.width()) as i64 + i64::from(offset.x());
        let row = (pixel / size.width()) as i64 + i64::from(offset.y());
        let message = format!("pixel ({column}, {row}) has {}", samples[index]);
        return Err(SceneError::content(
            location.clone(),
            format!("samples are finite, and {message}"),
        ));
    }
    let samples = match offset == Vec2(0, 0) && size == display.size {
        true => samples,
        false => shown(&samples, size.width(), offset, display.size, channels),
    };
    Ok(Picture { width, height, channels, samples: Samples::F32(samples) })
}

/// R, G, B, and A where there are four channels, of a layer's data window.
fn color(
    reader: File<'_>,
    layer: &str,
    channels: usize,
    size: Vec2<usize>,
) -> exr::error::Result<Vec<f32>> {
    let [r, g, b, a] = ["R", "G", "B", "A"].map(|name| Text::from(&*format!("{layer}{name}")));
    let names = read().no_deep_data().largest_resolution_level().specific_channels();
    let names = names.required(r).required(g).required(b).optional(a, 1.0_f32);
    let pixels = names.collect_pixels(
        move |_, _| blank(size, channels),
        move |samples: &mut Vec<f32>, pixel, (r, g, b, a): (f32, f32, f32, f32)| {
            let from = (pixel.y() * size.width() + pixel.x()) * channels;
            samples[from..from + channels].copy_from_slice(&[r, g, b, a][..channels]);
        },
    );
    let image = pixels.first_valid_layer().all_attributes().non_parallel().from_chunks(reader)?;
    Ok(image.layer_data.channel_data.pixels)
}

/// The channel `name`, and where there are two channels the `other`, of the data window.
fn gray(
    reader: File<'_>,
    name: Text,
    other: &str,
    channels: usize,
    size: Vec2<usize>,
) -> exr::error::Result<Vec<f32>> {
    let names = read().no_deep_data().largest_resolution_level().specific_channels();
    let names = names.required(name).optional(other, 1.0_f32);
    let pixels = names.collect_pixels(
        move |_, _| blank(size, channels),
        move |samples: &mut Vec<f32>, pixel, (y, a): (f32, f32)| {
            let from = (pixel.y() * size.width() + pixel.x()) * channels;
            samples[from..from + channels].copy_from_slice(&[y, a][..channels]);
        },
    );
    let image = pixels.first_valid_layer().all_attributes().non_parallel().from_chunks(reader)?;
    Ok(image.layer_data.channel_data.pixels)
}

/// Samples before they are read. A pixel that no block of the file has stays NaN, which is refused.
fn blank(size: Vec2<usize>, channels: usize) -> Vec<f32> {
    vec![f32::NAN; size.area() * channels]
}

/// What a display window shows of a data window with rows of `data_width` pixels, whose first pixel
/// is at `offset` in the display window. It is 0 elsewhere.
fn shown(
    samples: &[f32],
    data_width: usize,
    offset: Vec2<i32>,
    display: Vec2<usize>,
    channels: usize,
) -> Vec<f32> {
    let mut shown = vec![0.0; display.area() * channels];
    let width = display.width() as i64;
    // The columns that the two windows share, in the display window.
    let first = i64::from(offset.x());
    let from = first.clamp(0, width);
    let until = (first + data_width as i64).clamp(from, width);
    if until == from {
        return shown;
    }
    let [skipped, from, until] = [from - first, from, until].map(|k| k as usize * channels);
    for (row, samples) in samples.chunks_exact(data_width * channels).enumerate() {
        let row = usize::try_from(row as i64 + i64::from(offset.y()));
        if let Ok(row) = row
            && row < display.height()
        {
            let target = &mut shown[row * display.width() * channels..][from..until];
            target.copy_from_slice(&samples[skipped..skipped + until - from]);
        }
    }
    shown
}

impl Picture {
    /// An EXR file with the image's samples, compressed without loss: channels Y or R, G, B, and A; the same bytes
    /// for the same image, on every machine. `location` names the file in errors.
    ///
    /// # Errors
    /// [`SceneError::Content`] for samples of 8 or 16 bits and for those that are not finite,
    /// without a pixel, and where the number of samples is not that of the pixels.
    pub fn encode_exr(&self, location: &Location) -> Result<Vec<u8>, SceneError> {
        encode(self.checked(location)?, location)
    }
}

fn encode(picture: &Picture, location: &Location) -> Result<Vec<u8>, SceneError> {
    let content = |message: String| SceneError::content(location.clone(), message);
    let Samples::F32(samples) = &picture.samples else {
        return Err(content(
            "an EXR image has samples of 32 bits, and these have fewer".to_owned(),
        ));
    };
    let channels = picture.channels;
    if let Some(index) = samples.iter().position(|sample| !sample.is_finite()) {
        let pixel = index / channels;
        let [column, row] = [pixel % picture.width, pixel / picture.width];
        let message = format!("pixel ({column}, {row}) has {}", samples[index]);
        return Err(content(format!("samples are finite, and {message}")));
    }
    let list = NAMES[channels - 1].iter().enumerate().map(|(k, name)| {
        let plane = samples.iter().skip(k).step_by(channels).copied().collect();
        AnyChannel::new(*name, FlatSamples::F32(plane))
    });
    let list = AnyChannels::sort(list.collect());
    let size = (picture.width, picture.height);
    let image = Image::from_encoded_channels(size, Encoding::SMALL_LOSSLESS, list);
    let mut bytes = Vec::new();
    let written = image.write().non_parallel().to_buffered(Cursor::new(&mut bytes));
    written.map_err(|error| content(format!("the image can't be encoded: {error}")))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of 2 x 1 pixels with these channels, whose numbers are 1, 2 and so on.
    fn file(names: &[&str]) -> Vec<u8> {
        let list = names.iter().enumerate().map(|(k, name)| {
            let samples = FlatSamples::F32(vec![k as f32 + 1.0, k as f32 + 1.5]);
            AnyChannel::new(*name, samples)
        });
        let list = AnyChannels::sort(list.collect());
        let image = Image::from_encoded_channels((2, 1), Encoding::SMALL_LOSSLESS, list);
        let mut bytes = Vec::new();
        image.write().non_parallel().to_buffered(Cursor::new(&mut bytes)).unwrap();
        bytes
    }

    fn location() -> Location {
        Location::new("a.exr")
    }

    #[test]
    fn the_only_layer_with_colours_is_read() {
        let blender = ["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"];
        let others = ["ViewLayer.Depth.Z", "ViewLayer.Normal.X", "ViewLayer.Normal.Y"];
        for (more, channels) in [("ViewLayer.Combined.A", 4), ("ViewLayer.Mist.Z", 3)] {
            let names = [&blender[..], &[more], &others].concat();
            let bytes = file(&names);
            let picture = Picture::decode(&bytes, &location()).unwrap();
            assert_eq!([picture.width, picture.height, picture.channels], [2, 1, channels]);
            let expected = [[1.0, 2.0, 3.0, 4.0], [1.5, 2.5, 3.5, 4.5]];
            let expected = expected.iter().flat_map(|pixel| pixel[..channels].to_vec()).collect();
            assert_eq!(picture.samples, Samples::F32(expected));
            assert_eq!(Picture::decode_size(&bytes, &location()).unwrap(), [2, 1]);
            let message = Picture::remarks(&bytes, &location()).unwrap();
            assert!(message.len() == 1 && message[0].contains("ViewLayer.Depth.Z"), "{message:?}");
        }
    }

    #[test]
    fn of_several_layers_the_one_without_a_name_is_read_or_none() {
        let two = ["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"];
        let message = Picture::decode(&file(&two), &location()).unwrap_err().to_string();
        let rule = "of an EXR image the only layer with R, G and B is read, and this has 2: a, b";
        assert_eq!(message, format!("a.exr: {rule}"));
        let bytes = file(&[&["R", "G", "B"][..], &two].concat());
        let picture = Picture::decode(&bytes, &location()).unwrap();
        assert_eq!(picture.samples, Samples::F32(vec![1.0, 2.0, 3.0, 1.5, 2.5, 3.5]));
        let message = Picture::remarks(&bytes, &location()).unwrap();
        assert_eq!(message, ["other channels are left out: a.B, a.G, a.R, b.B, b.G, b.R"]);
        // A layer that lacks one is none.
        let bytes = file(&["a.R", "a.G", "b.R", "b.G", "b.B"]);
        assert_eq!(Picture::decode(&bytes, &location()).unwrap().samples.count(), 6);
        assert!(Picture::remarks(&file(&["R", "G", "B", "A"]), &location()).unwrap().is_empty());
    }
}
