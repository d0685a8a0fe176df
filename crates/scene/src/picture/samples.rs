//! An image in memory, and how large it may be.

use std::cell::Cell;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::{Location, SceneError};
use crate::memory::Memory;

/// The most samples of an image that is read, over all its channels: 16384 pixels squared in one
/// channel.
pub const MOST_SAMPLES: u64 = 1 << 28;

/// The most samples of an image for each byte of its file, whatever the format.
///
/// The densest that a format can pack is a row of one colour of a palette in a PNG, 33000 samples a
/// byte: a file that claims more is broken, and takes no memory.
pub(super) const DENSEST: u64 = 1 << 16;

/// The samples of an image, as few bytes each as the file had.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 0 to 255 stand for 0 to 1.
    U8(Vec<u8>),
    /// 0 to 65535 stand for 0 to 1.
    U16(Vec<u16>),
    /// As they are.
    F32(Vec<f32>),
}

impl Samples {
    /// How many there are.
    pub fn count(&self) -> usize {
        match self {
            Self::U8(samples) => samples.len(),
            Self::U16(samples) => samples.len(),
            Self::F32(samples) => samples.len(),
        }
    }

    /// Those with these indices.
    pub(crate) fn picked(&self, indices: impl Iterator<Item = usize>) -> Self {
        match self {
            Self::U8(samples) => Self::U8(indices.map(|index| samples[index]).collect()),
            Self::U16(samples) => Self::U16(indices.map(|index| samples[index]).collect()),
            Self::F32(samples) => Self::F32(indices.map(|index| samples[index]).collect()),
        }
    }
}

/// An image in memory, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples of a pixel: 1 to 4. The second of two and the fourth of four are opacity.
    pub channels: usize,
    /// The samples.
    pub samples: Samples,
}

impl Picture {
    /// The number of pixels.
    pub const fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The channel of the opacity.
    pub(super) fn opacity_channel(&self) -> Option<usize> {
        matches!(self.channels, 2 | 4).then(|| self.channels - 1)
    }

    /// Whether there are as many samples as the size says.
    pub(super) fn checked(&self, location: &Location) -> Result<&Self, SceneError> {
        let Self { width, height, channels, .. } = self;
        let expected = width.checked_mul(*height).and_then(|pixels| pixels.checked_mul(*channels));
        if !(1..=4).contains(channels) || expected == Some(0) {
            let rule = "an image has pixels, of one to four channels";
            let message = format!("{rule}, and this is {width} x {height} of {channels}");
            return Err(SceneError::content(location.clone(), message));
        }
        if expected != Some(self.samples.count()) {
            let rule =
                format!("an image of {width} x {height} has {channels} samples for each pixel");
            let message = format!("{rule}, and this has {} altogether", self.samples.count());
            return Err(SceneError::content(location.clone(), message));
        }
        Ok(self)
    }
}

/// Refuses an image that takes too much memory: one of `width` x `height` pixels in a file of
/// `bytes`, each of which has `densest` samples at most.
pub(super) fn check_size(
    [width, height]: [u64; 2],
    channels: u64,
    (bytes, densest): (usize, u64),
    location: &Location,
) -> Result<(), SceneError> {
    if width == 0 || height == 0 {
        let message = format!("an image has pixels, and this is {width} x {height}");
        return Err(SceneError::content(location.clone(), message));
    }
    let samples = width.saturating_mul(height).saturating_mul(channels);
    let location = location.clone();
    if samples > MOST_SAMPLES {
        let (what, most) = ("samples of an image", MOST_SAMPLES);
        return Err(SceneError::TooLarge { location, what, most, found: samples });
    }
    if samples / densest > bytes as u64 {
        let rule = format!("an image of {width} x {height} needs more bytes than its file has");
        return Err(SceneError::content(location, format!("{rule}, {bytes}")));
    }
    Ok(())
}

/// Takes the memory of an image of `width` x `height` pixels whose samples have so many bytes. Decoding takes as
/// much again for a time: a turned copy, a data window, what a progressive file keeps.
pub(super) fn claim(
    [width, height]: [u64; 2],
    bytes: u64,
    memory: &Memory,
    location: &Location,
) -> Result<(), SceneError> {
    memory.take(bytes, bytes, location, || format!("an image of {width} x {height}"))
}

/// The error of a decoder.
pub(super) fn broken(error: &dyn fmt::Display, location: &Location) -> SceneError {
    SceneError::content(location.clone(), format!("the image can't be decoded: {error}"))
}

thread_local! {
    /// Whether this thread runs a decoder.
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread decodes an image: a panic becomes an error there, so that a hook for panics has nothing
/// to say.
pub fn is_guarded() -> bool {
    IS_GUARDED.get()
}

/// What `decode` answers. A decoder that panics is one that met a broken file: its libraries check
/// much of what they read by assertions.
pub(super) fn guarded<R>(
    location: &Location,
    decode: impl FnOnce() -> Result<R, SceneError>,
) -> Result<R, SceneError> {
    let before = IS_GUARDED.replace(true);
    let decoded = catch_unwind(AssertUnwindSafe(decode));
    IS_GUARDED.set(before);
    decoded.unwrap_or_else(|_| {
        let message = "an image has a header and pixels that fit each other, and these don't";
        Err(SceneError::content(location.clone(), message))
    })
}
