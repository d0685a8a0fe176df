//! The curve of sRGB, by which colours of 8 bits in PLY files are encoded (IEC 61966-2-1).

/// The light of a number of a file, both from 0 to 1.
pub(super) fn decoded(number: f64) -> f32 {
    (match number <= 0.04045 {
        true => number / 12.92,
        false => ((number + 0.055) / 1.055).powf(2.4),
    }) as f32
}

/// The number of a file, from 0 to 255, of light from 0 to 1. Light beyond is cut.
pub(in crate::mesh) fn encoded(light: f32) -> u8 {
    let light = f64::from(light.clamp(0.0, 1.0));
    let number = match light <= 0.003_130_8 {
        true => 12.92 * light,
        false => 1.055 * light.powf(1.0 / 2.4) - 0.055,
    };
    (255.0 * number).round() as u8
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
}
