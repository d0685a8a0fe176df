//! COLMAP's binary files: little endian, without padding, a count of records first.

use glam::{DQuat, DVec3};

use super::records::{self, ColmapPoint, Lens, MODELS, Numbered, Shot, camera};
use crate::error::{Location, SceneError};

/// The least bytes of a record of each file.
const LEAST_OF_CAMERA: usize = 4 + 4 + 8 + 8 + 3 * 8;
const LEAST_OF_IMAGE: usize = 4 + 7 * 8 + 4 + 1 + 8;
const LEAST_OF_POINT: usize = 8 + 3 * 8 + 3 + 8 + 8;
/// The bytes of a feature of an image, and of an entry of a point's track.
const FEATURE: usize = 8 + 8 + 8;
const TRACK_ENTRY: usize = 4 + 4;

/// What is left of a file.
struct Bytes<'b> {
    all: usize,
    rest: &'b [u8],
    location: &'b Location,
}

impl<'b> Bytes<'b> {
    fn new(bytes: &'b [u8], location: &'b Location) -> Self {
        Self { all: bytes.len(), rest: bytes, location }
    }

    fn error(&self, message: impl std::fmt::Display) -> SceneError {
        let at = self.all - self.rest.len();
        SceneError::content(self.location.clone(), format!("byte {at}: {message}"))
    }

    fn take(&mut self, count: usize) -> Result<&'b [u8], SceneError> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let message = format!("{count} bytes follow, and {} are left", self.rest.len());
            return Err(self.error(message));
        };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SceneError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, SceneError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, SceneError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Result<f64, SceneError> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    fn vector(&mut self) -> Result<DVec3, SceneError> {
        Ok(DVec3::new(self.f64()?, self.f64()?, self.f64()?))
    }

    /// A count of records that have at least `least` bytes each, and fit in what is left.
    fn count(&mut self, least: usize) -> Result<usize, SceneError> {
        let count = self.u64()?;
        let most = self.rest.len() / least;
        match usize::try_from(count) {
            Ok(count) if count <= most => Ok(count),
            _ => {
                let rule = format!("at most {most} records fit in the bytes that are left");
                Err(self.error(format!("{rule}, and their count is {count}")))
            }
        }
    }

    /// The bytes up to the next 0, which is left out.
    fn text(&mut self) -> Result<String, SceneError> {
        let Some(end) = self.rest.iter().position(|byte| *byte == 0) else {
            return Err(self.error("a name ends with a byte 0, and there is none"));
        };
        let text = std::str::from_utf8(&self.rest[..end]);
        let text = text.map_err(|error| self.error(format!("a name is UTF-8: {error}")))?;
        self.rest = &self.rest[end + 1..];
        Ok(text.to_owned())
    }
}

pub(super) fn lenses(bytes: &[u8], location: &Location) -> Result<Vec<Lens>, SceneError> {
    let mut bytes = Bytes::new(bytes, location);
    let lens = |bytes: &mut Bytes<'_>| {
        let number = bytes.u32()?;
        let model = bytes.u32()?;
        let known = usize::try_from(model).ok().and_then(|model| MODELS.get(model));
        let model = known.map_or_else(|| format!("number {model}"), |(name, _)| (*name).to_owned());
        let size = [bytes.u64()?, bytes.u64()?];
        let count = records::model(&model).map_err(|rule| bytes.error(rule))?.parameters();
        let parameters: Result<Vec<f64>, _> = (0..count).map(|_| bytes.f64()).collect();
        let camera = camera(&model, size, &parameters?).map_err(|rule| bytes.error(rule))?;
        Ok(Lens { number, camera })
    };
    let count = bytes.count(LEAST_OF_CAMERA)?;
    (0..count).map(|_| lens(&mut bytes)).collect()
}

pub(super) fn shots(bytes: &[u8], location: &Location) -> Result<Vec<Shot>, SceneError> {
    let mut bytes = Bytes::new(bytes, location);
    let shot = |bytes: &mut Bytes<'_>| {
        let _number = bytes.u32()?;
        let w = bytes.f64()?;
        let DVec3 { x, y, z } = bytes.vector()?;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let translation = bytes.vector()?;
        let camera = bytes.u32()?;
        let name = bytes.text()?;
        if name.is_empty() {
            return Err(bytes.error("an image has a name, and this is empty"));
        }
        let features = bytes.count(FEATURE)?;
        bytes.take(features * FEATURE)?;
        Ok(Shot { rotation, translation, camera, name })
    };
    let count = bytes.count(LEAST_OF_IMAGE)?;
    (0..count).map(|_| shot(&mut bytes)).collect()
}

pub(super) fn points(bytes: &[u8], location: &Location) -> Result<Vec<Numbered>, SceneError> {
    let mut bytes = Bytes::new(bytes, location);
    let point = |bytes: &mut Bytes<'_>| {
        let number = bytes.u64()?;
        let position = bytes.vector()?;
        if !position.is_finite() {
            return Err(bytes.error(format!("a point is finite, and this is {position}")));
        }
        let color = bytes.array()?;
        let _error = bytes.f64()?;
        let track = bytes.count(TRACK_ENTRY)?;
        bytes.take(track * TRACK_ENTRY)?;
        Ok(Numbered { number, point: ColmapPoint { position, color } })
    };
    let count = bytes.count(LEAST_OF_POINT)?;
    (0..count).map(|_| point(&mut bytes)).collect()
}
