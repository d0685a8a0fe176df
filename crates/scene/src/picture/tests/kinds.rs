//! Files of every kind have the numbers that they always had: checksums of their samples, made with the decoders
//! of the crate `image` 0.25.

use jpeg_encoder::{ColorType as Inks, Encoder, SamplingFactor};
use png::{BitDepth, ColorType};

use super::*;

/// Numbers that look random.
fn noise(count: usize) -> Vec<u8> {
    let step = |state: &mut u32| {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Some((*state >> 24) as u8)
    };
    std::iter::repeat_n((), count).scan(7, |state, ()| step(state)).collect()
}

/// A kind of PNG, what is transparent, and what its numbers are.
type Row<'r> = (ColorType, BitDepth, &'r [u8], (usize, u32));

/// A PNG of 19 x 5 pixels. A palette has a colour for each index.
fn png_file(color: ColorType, depth: BitDepth, transparent: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 19, 5);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == ColorType::Indexed {
        encoder.set_palette(noise(3 << (depth as usize)));
    }
    if !transparent.is_empty() {
        encoder.set_trns(transparent.to_vec());
    }
    let row = (19 * color.samples() * depth as usize).div_ceil(8);
    encoder.write_header().unwrap().write_image_data(&noise(5 * row)).unwrap();
    bytes
}

/// A JPEG of 37 x 21 pixels: slopes with a little noise.
fn jpeg_file(inks: Inks, change: impl FnOnce(&mut Encoder<&mut Vec<u8>>)) -> Vec<u8> {
    let channels = match inks {
        Inks::Luma => 1,
        Inks::Rgb => 3,
        _ => 4,
    };
    let (width, height) = (37, 21);
    let noise = noise(width * height * channels);
    let sample = |k: usize| {
        let (x, y, channel) = (k / channels % width, k / channels / width, k % channels);
        (5 * x + 3 * y * (channel + 1) + 40 * channel) as u8 / 2 + noise[k] / 8
    };
    let samples: Vec<u8> = (0..noise.len()).map(sample).collect();
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 90);
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    change(&mut encoder);
    encoder.encode(&samples, width as u16, height as u16, inks).unwrap();
    bytes
}

/// Channels, and the checksum of the samples, the high byte first.
fn numbers(bytes: &[u8]) -> (usize, u32) {
    let picture = Picture::decode(bytes, &location()).unwrap();
    let bytes: Vec<u8> = match picture.samples {
        Samples::U8(samples) => samples,
        Samples::U16(samples) => samples.iter().flat_map(|sample| sample.to_be_bytes()).collect(),
        Samples::F32(samples) => samples.iter().flat_map(|sample| sample.to_be_bytes()).collect(),
    };
    (picture.channels, crc32(&bytes))
}

#[test]
fn a_png_of_each_kind_has_the_numbers_that_it_had() {
    use BitDepth::{Eight, Four, One, Sixteen, Two};
    use ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
    let rows: [Row<'_>; 22] = [
        (Grayscale, One, &[], (1, 0xde21_2292)),
        (Grayscale, Two, &[], (1, 0xe995_1bf3)),
        (Grayscale, Four, &[], (1, 0xc71b_12d4)),
        (Grayscale, Eight, &[], (1, 0x30d9_501c)),
        (Grayscale, Sixteen, &[], (1, 0x04b3_ab41)),
        (Grayscale, One, &[0, 1], (2, 0x3dd3_cac3)),
        (Grayscale, Two, &[0, 1], (2, 0xe082_686e)),
        (Grayscale, Four, &[0, 1], (2, 0x6b94_ec6b)),
        (Grayscale, Eight, &[0, 33], (2, 0x4f91_b329)),
        (Grayscale, Sixteen, &[47, 33], (2, 0x24e0_93bb)),
        (GrayscaleAlpha, Eight, &[], (2, 0x04b3_ab41)),
        (GrayscaleAlpha, Sixteen, &[], (2, 0x8774_1fda)),
        (Indexed, One, &[], (3, 0xeade_c6cb)),
        (Indexed, Two, &[], (3, 0x0f8b_15e9)),
        (Indexed, Four, &[], (3, 0x86ea_a59f)),
        (Indexed, Eight, &[], (3, 0xa9ed_f754)),
        (Indexed, One, &[7], (4, 0x4bcc_e105)),
        (Indexed, Two, &[7, 8], (4, 0x40af_55a1)),
        (Rgb, Eight, &[], (3, 0xf659_9d54)),
        (Rgb, Sixteen, &[], (3, 0x2ce6_13e0)),
        (Rgba, Eight, &[], (4, 0x8774_1fda)),
        (Rgba, Sixteen, &[], (4, 0x9128_1abb)),
    ];
    for (color, depth, transparent, expected) in rows {
        let found = numbers(&png_file(color, depth, transparent));
        assert_eq!(found, expected, "{color:?}, {depth:?}, {transparent:?}");
    }
}

#[test]
fn a_jpeg_of_each_kind_has_the_numbers_that_it_had() {
    type Change = fn(&mut Encoder<&mut Vec<u8>>);
    let plain: Change = |_| {};
    let rows: [(Inks, Change, (usize, u32)); 14] = [
        (Inks::Luma, plain, (1, 0x3051_ef15)),
        (Inks::Luma, |file| file.set_progressive(true), (1, 0x3051_ef15)),
        (Inks::Rgb, plain, (3, 0xe478_7bee)),
        (Inks::Rgb, |file| file.set_sampling_factor(SamplingFactor::F_2_1), (3, 0x09a7_0793)),
        (Inks::Rgb, |file| file.set_sampling_factor(SamplingFactor::F_1_2), (3, 0x00cf_fa27)),
        (Inks::Rgb, |file| file.set_sampling_factor(SamplingFactor::F_2_2), (3, 0xe95b_9b73)),
        (Inks::Rgb, |file| file.set_sampling_factor(SamplingFactor::F_4_1), (3, 0x080a_40c1)),
        (Inks::Rgb, |file| file.set_restart_interval(2), (3, 0xe478_7bee)),
        (Inks::Rgb, |file| file.set_optimized_huffman_tables(true), (3, 0xe478_7bee)),
        (Inks::Rgb, |file| file.set_progressive(true), (3, 0xe478_7bee)),
        (
            Inks::Rgb,
            |file| {
                file.set_progressive(true);
                file.set_sampling_factor(SamplingFactor::F_2_2);
            },
            (3, 0xe95b_9b73),
        ),
        (Inks::Cmyk, plain, (3, 0x0e6a_56b9)),
        (Inks::Ycck, plain, (3, 0x0ec9_727c)),
        (Inks::CmykAsYcck, plain, (3, 0x82f2_746b)),
    ];
    for (k, (inks, change, expected)) in rows.into_iter().enumerate() {
        let found = numbers(&jpeg_file(inks, change));
        assert_eq!(found, expected, "{k}: {inks:?}");
    }
}

#[test]
fn an_interlaced_png_has_the_pixels_of_the_plain_one() {
    let pixels = noise(19 * 5);
    // First column and row of each pass, and the steps between those that follow.
    let passes = [
        [0, 0, 8, 8],
        [4, 0, 8, 8],
        [0, 4, 4, 8],
        [2, 0, 4, 4],
        [0, 2, 2, 4],
        [1, 0, 2, 2],
        [0, 1, 1, 2],
    ];
    let mut rows = Vec::new();
    for [column, row, columns, between] in passes {
        for y in (row..5).step_by(between) {
            // Each row begins with its filter, none.
            rows.push(0);
            rows.extend((column..19).step_by(columns).map(|x| pixels[19 * y + x]));
        }
    }
    // A block that is stored as it is, between the header of zlib and its checksum.
    let [a, b] = rows
        .iter()
        .fold([1, 0], |[a, b], &x| [(a + u32::from(x)) % 65521, (a + b + u32::from(x)) % 65521]);
    let length = rows.len() as u16;
    let stored =
        [&[0x78, 1, 1][..], &length.to_le_bytes(), &(!length).to_le_bytes(), &rows].concat();
    let stored = [&stored[..], &(b << 16 | a).to_be_bytes()].concat();
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    for (name, data) in [
        (b"IHDR", &[0, 0, 0, 19, 0, 0, 0, 5, 8, 0, 0, 0, 1][..]),
        (b"IDAT", &stored),
        (b"IEND", &[]),
    ] {
        let body = [&name[..], data].concat();
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(&body);
        bytes.extend(crc32(&body).to_be_bytes());
    }
    let expected = Picture { width: 19, height: 5, channels: 1, samples: Samples::U8(pixels) };
    assert_eq!(Picture::decode(&bytes, &location()).unwrap(), expected);
}

#[test]
fn pixels_are_packed_to_the_bytes_that_they_were() {
    let rows: [[u32; 2]; 4] = [
        [0x5afb_4461, 0x660d_dc11],
        [0x9a8c_fdf8, 0x92f7_e7f0],
        [0xc07c_be33, 0xb666_df45],
        [0x85b7_708d, 0xbf4e_1960],
    ];
    for (channels, expected) in (1..).zip(rows) {
        let narrow = noise(64 * channels);
        let wide = narrow.iter().map(|&x| 256 * u16::from(x) + 3).collect();
        let found = [Samples::U8(narrow), Samples::U16(wide)].map(|samples| {
            let picture = Picture { width: 16, height: 4, channels, samples };
            crc32(&picture.encode_png(&location()).unwrap())
        });
        assert_eq!(found, expected, "{channels}");
    }
}
