//! Arbitrary files as images.

use bokashi_scene::{ColorSpace, Location, Mask, Picture, Samples};

use super::files::in_short;

/// The largest image that is decoded here: others are as good, and take longer.
const MOST_PIXELS: usize = 1 << 16;

/// Decodes the image that `bytes` are; returns the number of its pixels.
pub fn image_file(bytes: &[u8]) -> usize {
    let place = Location::new("image");
    let size = match Picture::decode_size(bytes, &place) {
        Ok([width, height]) if width * height > MOST_PIXELS => return 0,
        Ok(size) => size,
        Err(error) => {
            assert!(Picture::decode(bytes, &place).is_err(), "an image without a size");
            return in_short(&error);
        }
    };
    let picture = match Picture::decode(bytes, &place) {
        Ok(picture) => picture,
        Err(error) => return in_short(&error),
    };
    assert_eq!(size, [picture.width, picture.height]);
    assert_eq!(picture.samples.count(), picture.pixels() * picture.channels);
    if let Samples::F32(samples) = &picture.samples {
        assert!(samples.iter().all(|sample| sample.is_finite()));
    }
    let written = match &picture.samples {
        Samples::F32(_) => picture.encode_exr(&place),
        _ => picture.encode_png(&place),
    };
    let written = written.expect("what was read can be written");
    let back = Picture::decode(&written, &place).expect("what was written can be read");
    assert_eq!(back, picture);
    for space in [ColorSpace::Srgb, ColorSpace::Linear] {
        let light = picture.color(space);
        assert_eq!(light.shape().to_vec(), [picture.height, picture.width, 3]);
    }
    let remarks = Picture::remarks(bytes, &place).expect("what was read is told of");
    assert!(remarks.iter().all(|remark| remark.len() < 2000), "{remarks:?}");
    let turn = Picture::decode_turn(bytes, &place).expect("what was read is told of");
    let upright = Picture::decode_upright(bytes, &place).expect("what was read can be turned");
    assert_eq!([upright.width, upright.height], turn.map_or(size, |turn| turn.size(size)));
    match Mask::from_picture(&picture, &place) {
        Ok(mask) => assert!(mask.share.data().iter().all(|share| (0.0..=1.0).contains(share))),
        Err(error) => drop(in_short(&error)),
    }
    picture.pixels()
}
