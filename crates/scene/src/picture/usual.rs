//! What images usually are: sRGB's primaries, and pixels that are squares.
//!
//! # Source
//! IEC 61966-2-1, and ITU-R BT.709, which has the same primaries.

/// White, red, green and blue: x and y of each.
const SRGB: [f32; 8] = [0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06];
/// How far from them a file's may be.
const SAME: f32 = 2e-3;

/// Whether these are sRGB's white, red, green and blue.
pub(super) fn is_srgb(given: [f32; 8]) -> bool {
    given.iter().zip(SRGB).all(|(given, usual)| (given - usual).abs() <= SAME)
}

/// What is said of pixels that are no squares: so many times as wide as they are high.
pub(super) fn aspect_remark(aspect: f64) -> Option<String> {
    ((aspect - 1.0).abs() > 1e-3).then(|| {
        format!("its pixels are {aspect:.4} times as wide as high, and are taken as squares")
    })
}
