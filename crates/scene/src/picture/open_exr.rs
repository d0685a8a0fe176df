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

use super::samples::{DENSEST, Picture, Samples, check_size, claim};
use crate::error::{Place, SceneError};
use crate::memory::Memory;

/// A file whose header has been read.
type File<'b> = Reader<Cursor<&'b [u8]>>;

/// The most samples that a byte of a file stands for: deflate makes 1032 bytes of one, and a sample has two. A
/// display window has no bytes.
const DENSEST_DATA: u64 = 516;

/// Names of the channels, for one to four of them.
const NAMES: [&[&str]; 4] = [&["Y"], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]];

/// The channels of a layer that make an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Chosen<'h> {
    /// R, G and B.
    Color,
    /// A single channel of this name.
    Gray(&'h Text),
}

impl<'h> Chosen<'h> {
    fn of(header: &'h Header) -> Option<Self> {
        if header.deep {
            return None;
        }
        if ["R", "G", "B"].into_iter().all(|name| has(header, name)) {
            return Some(Self::Color);
        }
        match header.channels.list.as_slice() {
            [only] => Some(Self::Gray(&only.name)),
            [opacity, gray] if opacity.name == *"A" && gray.name == *"Y" => {
                Some(Self::Gray(&gray.name))
            }
            _ => None,
        }
    }
}

fn has(header: &Header, name: &str) -> bool {
    header.channels.list.iter().any(|channel| channel.name == *name)
}

/// A file whose header has been read and is not too large for its `length`, and the number of its layer.
fn opened<'b>(
    bytes: &'b [u8],
    length: usize,
    place: &Place,
) -> Result<(File<'b>, usize), SceneError> {
    let content = |found: String| SceneError::content(place.clone(), found);
    let reader =
        exr::block::read(Cursor::new(bytes), false).map_err(|error| broken(&error, place))?;
    let headers = reader.headers();
    let found = headers.iter().enumerate().find_map(|(k, header)| Some((k, Chosen::of(header)?)));
    // A layer is found by the names of its channels, the first one that has them.
    let found = found.filter(|(k, chosen)| match chosen {
        Chosen::Color => true,
        Chosen::Gray(name) => {
            let is_same = |channel: &ChannelDescription| channel.name == **name;
            !headers[..*k].iter().any(|header| header.channels.list.iter().any(is_same))
        }
    });
    let Some((layer, _)) = found else {
        let rule = "an EXR image has the channels R, G and B, or Y and A, or a single channel";
        return Err(content(format!("{rule}, and no flat layer of this file has")));
    };
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
        check_size(size, count as u64, (length, densest), place)?;
    }
    Ok((reader, layer))
}

/// The columns and rows of the display window, of a file of `length` bytes that begins with `bytes`.
pub(super) fn size_of(
    bytes: &[u8],
    length: usize,
    place: &Place,
) -> Result<[usize; 2], SceneError> {
    let (reader, layer) = opened(bytes, length, place)?;
    let size = reader.headers()[layer].shared_attributes.display_window.size;
    Ok([size.width(), size.height()])
}

pub(super) fn decode(bytes: &[u8], memory: &Memory, place: &Place) -> Result<Picture, SceneError> {
    let (reader, layer) = opened(bytes, bytes.len(), place)?;
    let header = &reader.headers()[layer];
    let has_alpha = has(header, "A");
    let display = header.shared_attributes.display_window;
    let (size, position) = (header.layer_size, header.own_attributes.layer_position);
    let bytes =
        |size: Vec2<usize>| 4 * size.area() as u64 * header.channels.list.len().min(4) as u64;
    let [width, height] = [display.size.width(), display.size.height()];
    claim([width as u64, height as u64], bytes(display.size), memory, place)?;
    // The data window is there for a time.
    let window = || format!("a data window of {} x {}", size.width(), size.height());
    memory.check(bytes(size), place, window)?;
    let (channels, samples) = match Chosen::of(header) {
        Some(Chosen::Gray(name)) => {
            let name = name.clone();
            // A channel may be asked for once.
            let is_alpha = name == *"A";
            let other = if is_alpha { "Y" } else { "A" };
            let channels = if has_alpha && !is_alpha { 2 } else { 1 };
            (channels, gray(reader, name, other, channels, size))
        }
        _ => {
            let channels = if has_alpha { 4 } else { 3 };
            (channels, color(reader, channels, size))
        }
    };
    let samples = samples.map_err(|error| broken(&error, place))?;
    let offset = position - display.position;
    if let Some(at) = samples.iter().position(|sample| !sample.is_finite()) {
        let pixel = at / channels;
        let column = (pixel % size.width()) as i64 + i64::from(offset.x());
        let row = (pixel / size.width()) as i64 + i64::from(offset.y());
        let found = format!("pixel ({column}, {row}) has {}", samples[at]);
        return Err(SceneError::content(place.clone(), format!("samples are finite, and {found}")));
    }
    let samples = match offset == Vec2(0, 0) && size == display.size {
        true => samples,
        false => shown(&samples, size.width(), offset, display.size, channels),
    };
    Ok(Picture { width, height, channels, samples: Samples::F32(samples) })
}

/// R, G, B, and A where there are four channels, of the data window.
fn color(reader: File<'_>, channels: usize, size: Vec2<usize>) -> exr::error::Result<Vec<f32>> {
    let names = read().no_deep_data().largest_resolution_level().specific_channels();
    let names = names.required("R").required("G").required("B").optional("A", 1.0_f32);
    let pixels = names.collect_pixels(
        move |_, _| blank(size, channels),
        move |samples: &mut Vec<f32>, at, (r, g, b, a): (f32, f32, f32, f32)| {
            let from = (at.y() * size.width() + at.x()) * channels;
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
        move |samples: &mut Vec<f32>, at, (y, a): (f32, f32)| {
            let from = (at.y() * size.width() + at.x()) * channels;
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
            let place = &mut shown[row * display.width() * channels..][from..until];
            place.copy_from_slice(&samples[skipped..skipped + until - from]);
        }
    }
    shown
}

pub(super) fn encode(picture: &Picture, place: &Place) -> Result<Vec<u8>, SceneError> {
    let content = |found: String| SceneError::content(place.clone(), found);
    let Samples::F32(samples) = &picture.samples else {
        return Err(content(
            "an EXR image has samples of 32 bits, and these have fewer".to_owned(),
        ));
    };
    let channels = picture.channels;
    if let Some(at) = samples.iter().position(|sample| !sample.is_finite()) {
        let pixel = at / channels;
        let [column, row] = [pixel % picture.width, pixel / picture.width];
        let found = format!("pixel ({column}, {row}) has {}", samples[at]);
        return Err(content(format!("samples are finite, and {found}")));
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

fn broken(error: &exr::error::Error, place: &Place) -> SceneError {
    SceneError::content(place.clone(), format!("the image can't be decoded: {error}"))
}
