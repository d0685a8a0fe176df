use std::io::Cursor;

use approx::assert_relative_eq;
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::srgb_decode;
use exr::meta::attribute::IntegerBounds;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, Layer, LayerAttributes,
    Vec2, WritableImage as _, f16,
};

use super::decode::header_size;
use super::*;
use crate::error::{Location, SceneError};
use crate::folder::Folder;

mod kinds;

fn location() -> Location {
    Location::new("scene/image")
}

fn message(bytes: &[u8]) -> String {
    Picture::decode(bytes, &location()).unwrap_err().to_string()
}

/// An image of 3 x 2 pixels whose samples all differ.
fn numbered(channels: usize) -> Picture {
    let samples = Samples::U8((0..6 * channels).map(|k| (k * 10) as u8).collect());
    Picture { width: 3, height: 2, channels, samples }
}

/// A JPEG whose left half is dark and whose right half is light.
fn jpeg(width: u16, height: u16) -> Vec<u8> {
    let pixels: Vec<u8> =
        (0..width * height).map(|k| if k % width < width / 2 { 20 } else { 230 }).collect();
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, 95);
    encoder.encode(&pixels, width, height, jpeg_encoder::ColorType::Luma).unwrap();
    bytes
}

/// A JPEG with Exif data that say how to turn it.
fn turned_jpeg(orientation: u8) -> Vec<u8> {
    let plain = jpeg(32, 16);
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    let length = u16::try_from(exif.len() + 2).unwrap().to_be_bytes();
    [&plain[..2], &[0xff, 0xe1], &length, &exif, &plain[2..]].concat()
}

/// An EXR file of one layer, `size` pixels at `offset` of a display window.
fn exr_file(
    channels: Vec<(&str, FlatSamples)>,
    size: (usize, usize),
    offset: (i32, i32),
    display: IntegerBounds,
) -> Vec<u8> {
    let list = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples));
    let attributes =
        LayerAttributes { layer_position: Vec2(offset.0, offset.1), ..LayerAttributes::default() };
    let list = AnyChannels::sort(list.collect());
    let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, list);
    let mut bytes = Vec::new();
    let image = Image::new(ImageAttributes::new(display), layer);
    image.write().non_parallel().to_buffered(Cursor::new(&mut bytes)).unwrap();
    bytes
}

fn plain_exr(channels: Vec<(&str, FlatSamples)>, size: (usize, usize)) -> Vec<u8> {
    exr_file(channels, size, (0, 0), IntegerBounds::new((0, 0), size))
}

#[test]
fn a_png_holds_samples_of_each_width_and_number_of_channels() {
    for channels in 1..=4 {
        let picture = numbered(channels);
        let bytes = picture.encode_png(&location()).unwrap();
        assert_eq!(Picture::decode(&bytes, &location()).unwrap(), picture);
        assert_eq!(Picture::decode_size(&bytes, &location()).unwrap(), [3, 2]);
        assert_eq!(bytes, picture.encode_png(&location()).unwrap());
        let wide = (0..6 * channels).map(|k| (k * 2551 + 1) as u16).collect();
        let picture = Picture { samples: Samples::U16(wide), ..picture };
        let bytes = picture.encode_png(&location()).unwrap();
        assert_eq!(Picture::decode(&bytes, &location()).unwrap(), picture);
    }
}

#[test]
fn palettes_and_single_bits_become_channels_of_eight_bits() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::One);
    encoder.set_palette(vec![1, 2, 3, 250, 251, 252]);
    encoder.write_header().unwrap().write_image_data(&[0b0100_0000]).unwrap();
    let samples = Samples::U8(vec![1, 2, 3, 250, 251, 252]);
    let expected = Picture { width: 2, height: 1, channels: 3, samples };
    assert_eq!(Picture::decode(&bytes, &location()).unwrap(), expected);

    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 3, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    encoder.write_header().unwrap().write_image_data(&[0b1010_0000]).unwrap();
    let expected =
        Picture { width: 3, height: 1, channels: 1, samples: Samples::U8(vec![255, 0, 255]) };
    assert_eq!(Picture::decode(&bytes, &location()).unwrap(), expected);
}

#[test]
fn a_jpeg_is_read_as_it_is_stored_and_turned_on_demand() {
    let offset = |picture: &Picture, row: usize, column: usize| {
        picture.channel(0).unwrap()[[row, column]] * 255.0
    };
    let stored = Picture::decode(&jpeg(32, 16), &location()).unwrap();
    assert_eq!((stored.width, stored.height, stored.channels), (32, 16, 1));
    assert!(
        (offset(&stored, 8, 4) - 20.0).abs() < 4.0 && (offset(&stored, 8, 28) - 230.0).abs() < 4.0
    );
    assert_eq!(Picture::decode_turn(&jpeg(32, 16), &location()).unwrap(), None);
    // Where the dark half is once viewers turned it: (row, column), and a place in the light half.
    let rows = [
        (1, [32, 16], (8, 4), (8, 28)),
        (2, [32, 16], (8, 28), (8, 4)),
        (3, [32, 16], (8, 28), (8, 4)),
        (4, [32, 16], (8, 4), (8, 28)),
        (5, [16, 32], (4, 8), (28, 8)),
        (6, [16, 32], (4, 8), (28, 8)),
        (7, [16, 32], (28, 8), (4, 8)),
        (8, [16, 32], (28, 8), (4, 8)),
    ];
    for (orientation, size, dark, light) in rows {
        let bytes = turned_jpeg(orientation);
        assert_eq!(Picture::decode_size(&bytes, &location()).unwrap(), [32, 16]);
        assert_eq!(Picture::decode(&bytes, &location()).unwrap(), stored, "{orientation}");
        let turn = Picture::decode_turn(&bytes, &location()).unwrap();
        assert_eq!(turn.map_or([32, 16], |turn| turn.size([32, 16])), size, "{orientation}");
        let upright = Picture::decode_upright(&bytes, &location()).unwrap();
        assert_eq!([upright.width, upright.height], size, "{orientation}");
        assert!((offset(&upright, dark.0, dark.1) - 20.0).abs() < 4.0, "{orientation}");
        assert!((offset(&upright, light.0, light.1) - 230.0).abs() < 4.0, "{orientation}");
        let remarks = Picture::remarks(&bytes, &location()).unwrap();
        assert_eq!(remarks.len(), usize::from(orientation != 1), "{remarks:?}");
    }
}

#[test]
fn an_image_of_another_size_is_refused_and_exif_data_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let folder = Folder::new(directory.path()).unwrap();
    std::fs::write(directory.path().join("a.jpg"), turned_jpeg(6)).unwrap();
    std::fs::write(directory.path().join("b.jpg"), jpeg(32, 16)).unwrap();
    assert!(Picture::read_sized(&folder, "a.jpg", [32, 16]).is_ok());
    let message = Picture::read_sized(&folder, "a.jpg", [16, 32]).unwrap_err().to_string();
    let rule = "an image has the size of its camera, 16 x 32, and this is 32 x 16; viewers turn it by a \
        quarter to the right, as its Exif data say";
    assert!(message.contains(rule), "{message}");
    let message = Picture::read_sized(&folder, "b.jpg", [16, 32]).unwrap_err().to_string();
    assert!(message.ends_with("16 x 32, and this is 32 x 16"), "{message}");
}

#[test]
fn an_exr_holds_the_same_numbers() {
    for channels in 1..=4 {
        let samples = (0..6 * channels).map(|k| (k as f32 - 5.0) * 1.7e3 / 7.0).collect();
        let picture = Picture { width: 3, height: 2, channels, samples: Samples::F32(samples) };
        let bytes = picture.encode_exr(&location()).unwrap();
        assert_eq!(Picture::decode(&bytes, &location()).unwrap(), picture);
        assert_eq!(Picture::decode_size(&bytes, &location()).unwrap(), [3, 2]);
        assert_eq!(bytes, picture.encode_exr(&location()).unwrap());
    }
}

#[test]
fn an_exr_of_halves_with_one_channel_of_any_name_is_gray() {
    let halves = vec![f16::from_f32(0.5), f16::from_f32(-2.0)];
    for name in ["Z", "A", "depth.V"] {
        let bytes = plain_exr(vec![(name, FlatSamples::F16(halves.clone()))], (2, 1));
        let samples = Samples::F32(vec![0.5, -2.0]);
        let expected = Picture { width: 2, height: 1, channels: 1, samples };
        assert_eq!(Picture::decode(&bytes, &location()).unwrap(), expected);
    }
}

#[test]
fn the_display_window_of_an_exr_is_what_is_shown() {
    // Three columns and two rows of numbers.
    let numbers = || FlatSamples::F32((1..=6).map(|k| k as f32).collect());
    let display = IntegerBounds::new((10, 20), (3, 2));
    for (offset, expected) in [
        // One to the right and one down.
        ((11, 21), [0.0, 0.0, 0.0, 0.0, 1.0, 2.0]),
        // One to the left and one up.
        ((9, 19), [5.0, 6.0, 0.0, 0.0, 0.0, 0.0]),
        // Outside, on each side.
        ((13, 20), [0.0; 6]),
        ((200, 20), [0.0; 6]),
        ((7, 20), [0.0; 6]),
        ((10, 22), [0.0; 6]),
        ((10, -200), [0.0; 6]),
    ] {
        let bytes = exr_file(vec![("Y", numbers())], (3, 2), offset, display);
        let samples = Samples::F32(expected.to_vec());
        let expected = Picture { width: 3, height: 2, channels: 1, samples };
        assert_eq!(Picture::decode(&bytes, &location()).unwrap(), expected, "{offset:?}");
        assert_eq!(Picture::decode_size(&bytes, &location()).unwrap(), [3, 2]);
    }
}

#[test]
fn a_sample_that_is_not_finite_is_refused_with_its_pixel() {
    for value in [f32::NAN, f32::INFINITY] {
        let mut red = vec![0.0; 6];
        red[4] = value;
        let zeros = || FlatSamples::F32(vec![0.0; 6]);
        let channels = vec![("R", FlatSamples::F32(red)), ("G", zeros()), ("B", zeros())];
        let message = message(&plain_exr(channels, (3, 2)));
        let expected = format!("scene/image: samples are finite, and pixel (1, 1) has {value}");
        assert_eq!(message, expected);
        let picture =
            Picture { width: 1, height: 1, channels: 1, samples: Samples::F32(vec![value]) };
        assert!(picture.encode_exr(&location()).is_err());
    }
}

#[test]
fn each_compression_but_dwa_is_read() {
    use exr::prelude::{Blocks, Compression, LineOrder};
    let numbers: Vec<f32> = (0..400).map(|k| (k as f32 * 0.1).sin()).collect();
    let file = |compression, blocks| {
        let list = AnyChannels::sort(
            ["R", "G", "B"]
                .into_iter()
                .map(|name| AnyChannel::new(name, FlatSamples::F32(numbers.clone())))
                .collect(),
        );
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let image = Image::from_encoded_channels((20, 20), encoding, list);
        let mut bytes = Vec::new();
        image.write().non_parallel().to_buffered(Cursor::new(&mut bytes)).unwrap();
        bytes
    };
    for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(8, 8))] {
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::ZIP16,
            Compression::PIZ,
            Compression::PXR24,
            Compression::B44,
        ] {
            let picture = Picture::decode(&file(compression, blocks), &location()).unwrap();
            let green = picture.channel(1).unwrap();
            let tolerance = if compression == Compression::PXR24 { 1e-4 } else { 0.0 };
            for (found, number) in green.data().iter().zip(&numbers) {
                assert!((found - number).abs() <= tolerance, "{compression}: {found}, {number}");
            }
        }
        let message = message(&file(Compression::DWAA(None), blocks));
        assert!(message.contains("the compressions DWAA and DWAB are not read"), "{message}");
    }
}

#[test]
fn an_exr_whose_blocks_are_told_twice_lacks_pixels() {
    // Two blocks of 16 rows: the second entry of the table of offsets repeats the first.
    let numbers = FlatSamples::F32((0..32).map(|k| k as f32).collect());
    let mut bytes = plain_exr(vec![("Y", numbers)], (1, 32));
    let table = (0..bytes.len() - 16)
        .find(|&offset| {
            let entry =
                |offset: usize| u64::from_le_bytes(bytes[offset..offset + 8].try_into().unwrap());
            // The first block follows the table.
            entry(offset) == offset as u64 + 16 && entry(offset + 8) > entry(offset)
        })
        .unwrap();
    bytes.copy_within(table..table + 8, table + 8);
    assert_eq!(message(&bytes), "scene/image: samples are finite, and pixel (0, 16) has NaN");
}

#[test]
fn all_numbers_of_a_byte_survive_the_way_to_light_and_back() {
    let samples = Samples::U8((0..=255).collect());
    let picture = Picture { width: 64, height: 4, channels: 1, samples };
    for space in [ColorSpace::Srgb, ColorSpace::Linear] {
        let light = picture.color(space);
        assert_eq!(**light.shape(), [4, 64, 3]);
        let back = Picture::from_color(&light, space).unwrap();
        assert_eq!(back.channels, 3);
        let expected = (0..=255).flat_map(|byte| [byte; 3]).collect();
        assert_eq!(back.samples, Samples::U8(expected));
    }
}

#[test]
fn light_is_that_of_the_operation_on_the_tape() {
    let samples = Samples::U8((0..=255).collect());
    let picture = Picture { width: 256, height: 1, channels: 1, samples };
    let light = picture.color(ColorSpace::Srgb);
    let tape = Tape::<f64>::new();
    let numbers = tape.constant(&Tensor::from_flat_fn([256], |k| k as f64 / 255.0));
    let expected = srgb_decode(numbers).unwrap().value();
    for k in 0..256 {
        assert_eq!(light[[0, k, 0]], expected[[k]] as f32, "{k}");
    }
    // All numbers of 16 bits, of which some lie between the seam and where older texts have it.
    let samples = Samples::U16((0..=u16::MAX).collect());
    let light = Picture { width: 256, height: 256, channels: 1, samples }.color(ColorSpace::Srgb);
    let all = tape.constant(&Tensor::from_flat_fn([1 << 16], |k| k as f64 / 65535.0));
    let expected = srgb_decode(all).unwrap().value();
    for k in 0..1 << 16 {
        assert_eq!(light.data()[3 * k], expected[[k]] as f32, "{k}");
    }
    assert_eq!(light.data()[3 * 2621], (2621.0 / 65535.0 / 12.92) as f32);
    let light = Tensor::new([1, 1, 1], vec![0.0031_f32]).unwrap();
    let back = Picture::from_light(&light, ColorSpace::Srgb, Depth::ThirtyTwo).unwrap();
    assert_eq!(back.samples, Samples::F32(vec![(f64::from(0.0031_f32) * 12.92) as f32]));
    let light = picture.color(ColorSpace::Srgb);
    // Samples of 16 and 32 bits follow the same curve.
    let wide = Picture { samples: Samples::U16((0..=255).map(|k| k * 257).collect()), ..picture };
    assert_eq!(wide.color(ColorSpace::Srgb), light);
    let samples = Samples::F32(vec![-0.5, 0.5, 2.0]);
    let picture = Picture { width: 3, height: 1, channels: 1, samples };
    let light = picture.color(ColorSpace::Srgb);
    assert_relative_eq!(light[[0, 1, 0]], 0.214_041_14, max_relative = 1e-6);
    assert_eq!(light[[0, 0, 0]], -light[[0, 1, 0]]);
    assert_relative_eq!(light[[0, 2, 0]], 4.953_848, max_relative = 1e-6);
    assert_eq!(ColorSpace::for_picture(&picture), ColorSpace::Linear);
    assert_eq!(ColorSpace::for_picture(&wide), ColorSpace::Srgb);
}

#[test]
fn colours_are_clamped_and_rounded_and_opacity_has_no_curve() {
    let light = Tensor::new([1, 2, 2], vec![-1.0, 0.5, 7.0, 0.25]).unwrap();
    let picture = Picture::from_color(&light, ColorSpace::Srgb).unwrap();
    assert_eq!(picture.samples, Samples::U8(vec![0, 128, 255, 64]));
    let nan = Tensor::new([1, 1], vec![f32::NAN]).unwrap();
    let picture = Picture::from_color(&nan, ColorSpace::Srgb).unwrap();
    assert_eq!(picture.samples, Samples::U8(vec![0]));
}

#[test]
fn channels_are_told_apart() {
    let picture = numbered(4);
    assert_eq!(picture.opacity(), picture.channel(3));
    assert_eq!(picture.channel(1).unwrap()[[1, 2]], (10 * (4 * 5 + 1)) as f32 / 255.0);
    assert_eq!(picture.color(ColorSpace::Linear)[[1, 2, 1]], picture.channel(1).unwrap()[[1, 2]]);
    assert_eq!(picture.primary(1), picture.channel(1).unwrap());
    assert!(picture.channel(4).is_none());
    let picture = numbered(2);
    // Gray is red, green and blue, and the opacity beside it none of them.
    assert_eq!([0, 1, 2].map(|k| picture.primary(k)), [0; 3].map(|_| picture.channel(0).unwrap()));
    assert_eq!(picture.opacity(), picture.channel(1));
    assert_eq!(picture.color(ColorSpace::Linear)[[1, 0, 2]], picture.channel(0).unwrap()[[1, 0]]);
    assert!(numbered(3).opacity().is_none() && numbered(1).opacity().is_none());
}

#[test]
fn tensors_that_are_no_images_are_refused() {
    for shape in [vec![3], vec![2, 2, 5], vec![0, 2, 3], vec![1, 2, 3, 1]] {
        let tensor = Tensor::<f32>::zeros(shape.as_slice());
        let error = Picture::from_color(&tensor, ColorSpace::Srgb).unwrap_err();
        assert!(error.to_string().contains("one to four channels, got shape"), "{error}");
        assert!(Picture::from_numbers(&tensor).is_err());
    }
    let numbers = Tensor::from_fn([2, 3], |[i, j]| (i * 3 + j) as f32);
    let picture = Picture::from_numbers(&numbers).unwrap();
    assert_eq!(picture.channel(0).unwrap(), numbers);
}

#[test]
fn files_that_are_no_images_are_refused_with_the_rule() {
    let rule = "scene/image: an image is a PNG, JPEG, EXR or HDR file, and the file";
    assert_eq!(message(b""), format!("{rule} is empty"));
    assert_eq!(message(b"hello"), format!("{rule} begins with the bytes 68 65 6c 6c"));
    let rule = "scene/image: an image is a PNG, JPEG, EXR or HDR file, and this is";
    assert_eq!(message(b"GIF89a"), format!("{rule} a GIF"));
    assert_eq!(message(b"RIFF\x10\0\0\0WEBPVP8 "), format!("{rule} a WebP"));
    assert_eq!(message(b"\0\0\0\x18ftypheic"), format!("{rule} a HEIC"));
    assert_eq!(message(b"\0\0\0\x1cftypavif"), format!("{rule} an AVIF"));
    assert!(Picture::decode_size(b"hello", &location()).is_err());
    let exr = plain_exr(
        vec![("X", FlatSamples::F32(vec![0.0])), ("Z", FlatSamples::F32(vec![0.0]))],
        (1, 1),
    );
    assert!(
        message(&exr).contains("R, G and B, or Y and A, or a single channel"),
        "{}",
        message(&exr)
    );
    let float = Picture { width: 1, height: 1, channels: 1, samples: Samples::F32(vec![0.0]) };
    assert!(float.encode_png(&location()).is_err());
    assert!(numbered(3).encode_exr(&location()).is_err());
    let wrong = Picture { width: 4, ..numbered(3) };
    let message = wrong.encode_png(&location()).unwrap_err().to_string();
    assert!(
        message.contains("has 3 samples for each pixel, and this has 18 altogether"),
        "{message}"
    );
}

/// The bytes with a new width and height in the header of a PNG, and its checksum.
fn resized_png(bytes: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let checksum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    bytes
}

/// The checksum of PNG: CRC-32, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |sum: u32| if sum & 1 == 1 { 0xedb8_8320 ^ (sum >> 1) } else { sum >> 1 };
    let byte = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), |sum, _| step(sum));
    !bytes.iter().fold(u32::MAX, byte)
}

#[test]
fn a_header_that_claims_too_much_takes_no_memory() {
    let png = numbered(3).encode_png(&location()).unwrap();
    assert_eq!(Picture::decode(&resized_png(&png, 3, 2), &location()).unwrap(), numbered(3));
    for (width, height) in [(1 << 30, 1 << 30), (u32::MAX >> 1, 1), (100_000, 10_000)] {
        let bytes = resized_png(&png, width, height);
        for error in [
            Picture::decode(&bytes, &location()).map(drop).unwrap_err(),
            Picture::decode_size(&bytes, &location()).map(drop).unwrap_err(),
        ] {
            assert!(matches!(error, SceneError::TooLarge { .. }), "{error}");
        }
    }
    // Fewer than the most samples, and still more than the file can have.
    let dense = message(&resized_png(&png, 8000, 8000));
    assert!(dense.contains("8000 x 8000 needs more bytes than its file has"), "{dense}");
    assert!(message(&resized_png(&png, 0, 1)).contains("an image has pixels, and this is 0 x 1"));

    let mut large = jpeg(32, 16);
    let frame = large.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    large[frame + 5..frame + 9].copy_from_slice(&[0xff; 4]);
    assert!(matches!(Picture::decode(&large, &location()), Err(SceneError::TooLarge { .. })));

    for size in [(1 << 20, 1 << 20), (1 << 14, 1 << 12), (1 << 18, 1 << 4)] {
        // The header claims more columns and rows than there are.
        let mut bytes = plain_exr(vec![("Y", FlatSamples::F32(vec![1.0]))], (1, 1));
        for name in ["dataWindow\0box2i\0", "displayWindow\0box2i\0"] {
            let offset =
                bytes.windows(name.len()).position(|found| found == name.as_bytes()).unwrap();
            // After the name come the length of the value and the value.
            let from = offset + name.len() + 4;
            let ends: [i32; 4] = [0, 0, size.0 - 1, size.1 - 1];
            let ends: Vec<u8> = ends.iter().flat_map(|end| end.to_le_bytes()).collect();
            bytes[from..from + 16].copy_from_slice(&ends);
        }
        let error = Picture::decode(&bytes, &location()).unwrap_err();
        let message = error.to_string();
        let is_too_large = matches!(error, SceneError::TooLarge { .. });
        // The library counts blocks of 16 rows, and one is there.
        let is_too_large = is_too_large || message.contains("chunk count not matching");
        assert!(
            is_too_large && size.1 > 16 || message.contains("needs more bytes than its file has"),
            "{message}"
        );
        assert!(Picture::decode_size(&bytes, &location()).is_err());
    }
}

#[test]
fn the_densest_files_are_read() {
    let black = FlatSamples::F16(vec![f16::ZERO; 4096 * 512]);
    let bytes = plain_exr(vec![("Y", black)], (4096, 512));
    assert!(bytes.len() < 3 * 4096, "{}", bytes.len());
    assert_eq!(Picture::decode(&bytes, &location()).unwrap().pixels(), 4096 * 512);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 16384, 512);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::One);
    encoder.set_palette(vec![1, 2, 3]);
    encoder.set_trns(vec![9]);
    encoder.write_header().unwrap().write_image_data(&vec![0; 2048 * 512]).unwrap();
    assert!(bytes.len() < 4096, "{}", bytes.len());
    assert_eq!(Picture::decode(&bytes, &location()).unwrap().pixels(), 16384 * 512);
}

/// A small file of each format.
fn small_files() -> [Vec<u8>; 4] {
    let samples = (0..18).map(|k| k as f32).collect();
    let exr = Picture { width: 3, height: 2, channels: 3, samples: Samples::F32(samples) };
    let png = numbered(3).encode_png(&location()).unwrap();
    let head = b"#?RADIANCE\nEXPOSURE=2\nPRIMARIES=.64 .33 .3 .6 .15 .06 .3 .3\n\n-Y 1 +X 2\n";
    let radiance = [&head[..], &[128, 0, 0, 129, 128, 128, 128, 131]].concat();
    [png, jpeg(16, 16), exr.encode_exr(&location()).unwrap(), radiance]
}

#[test]
fn files_that_are_cut_short_are_refused_at_each_length() {
    for file in &small_files() {
        let whole = Picture::decode(file, &location()).unwrap();
        for length in 0..file.len() {
            // What a PNG has after its pixels is not needed.
            if let Ok(picture) = Picture::decode(&file[..length], &location()) {
                assert!(file.starts_with(b"\x89PNG") && file.len() - length <= 16, "{length}");
                assert_eq!(picture, whole);
            }
            let _ = Picture::decode_size(&file[..length], &location());
        }
    }
}

/// A JPEG as it is, with its Exif data behind `before`.
fn late_exif(before: &[u8]) -> Vec<u8> {
    let turned = turned_jpeg(6);
    [&turned[..2], before, &turned[2..]].concat()
}

#[test]
fn the_start_of_a_file_has_the_size_of_the_whole_or_none() {
    let [png, _, exr, _] = small_files();
    for file in [png, turned_jpeg(6), late_exif(&[0xff, 0xfe, 0, 4, 1, 2]), exr] {
        let whole = Picture::decode_size(&file, &location()).unwrap();
        let sizes = (0..file.len())
            .filter_map(|length| header_size(&file[..length], file.len(), &location()).ok());
        let sizes: Vec<_> = sizes.collect();
        assert!(
            !sizes.is_empty() && sizes.iter().all(|size| *size == whole),
            "{whole:?}: {sizes:?}"
        );
    }
}

#[test]
fn the_size_of_a_file_is_found_however_long_its_header() {
    let directory = tempfile::tempdir().unwrap();
    let folder = Folder::new(directory.path()).unwrap();
    // Comments of 60,000 bytes: the third lies beyond what is read at first.
    let comment = [&[0xff, 0xfe, 0xea, 0x62][..], &[7; 60_000]].concat();
    for count in 0..4 {
        let file = late_exif(&comment.repeat(count));
        std::fs::write(directory.path().join("a.jpg"), &file).unwrap();
        assert_eq!(Picture::read_size(&folder, "a.jpg").unwrap(), [32, 16], "{count}");
    }
    // A header is enough: what follows is read when its turn comes.
    let long = [&small_files()[0][..], &vec![0; 1 << 20]].concat();
    std::fs::write(directory.path().join("a.png"), &long).unwrap();
    assert_eq!(Picture::read_size(&folder, "a.png").unwrap(), [3, 2]);
    let error = Picture::read_size(&folder, "b.png").unwrap_err();
    assert!(error.to_string().contains("b.png could not be read"), "{error}");
}

#[test]
fn files_with_a_wrong_byte_have_an_answer() {
    for file in &small_files() {
        for offset in 0..file.len() {
            for value in [0, 1, 127, 128, 255] {
                let mut bytes = file.clone();
                bytes[offset] = value;
                if let Ok(picture) = Picture::decode(&bytes, &location()) {
                    assert!(picture.checked(&location()).is_ok());
                    let size = Picture::decode_size(&bytes, &location()).unwrap();
                    assert_eq!(size, [picture.width, picture.height]);
                    assert!(Picture::remarks(&bytes, &location()).is_ok());
                    assert!(Picture::decode_upright(&bytes, &location()).is_ok());
                    if let Ok(mask) = Mask::from_picture(&picture, &location()) {
                        assert!(mask.share.data().iter().all(|x| (0.0..=1.0).contains(x)));
                    }
                }
            }
        }
    }
}
