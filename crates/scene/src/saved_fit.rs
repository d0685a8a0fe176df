//! What is saved with a fit of a scene beside its numbers: how far it is, and what it was given.

use bokashi_fit::{Difference, FitError, Given, described, differences, saved};
use serde::{Deserialize, Serialize};

use crate::stopping::StopState;

/// The version of what follows.
const VERSION: u64 = 3;

/// How far a fit is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Progress {
    /// How many steps each of the stages did that are done.
    pub(crate) done: Vec<u64>,
    #[serde(rename = "seen")]
    pub(crate) rules: StopState,
    /// How many steps were done when meshes got other vertices last.
    pub(crate) remeshed: Option<u64>,
}

/// The surface of an object that got other vertices, or a texture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Surface {
    /// The object's name.
    pub(crate) object: String,
    /// Other vertices and faces.
    pub(crate) shape: Option<Shape>,
    pub(crate) texture: Option<TexturedSurface>,
}

/// Vertices and faces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Shape {
    #[serde(with = "rows")]
    pub(crate) faces: Vec<[u32; 3]>,
    #[serde(with = "rows")]
    pub(crate) positions: Vec<[f32; 3]>,
    /// Colours at vertices; empty without any.
    #[serde(with = "rows")]
    pub(crate) colors: Vec<[f32; 3]>,
}

/// Where a texture that was made in the fit lies on a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TexturedSurface {
    /// Texture coordinates.
    #[serde(with = "rows")]
    pub(crate) coordinates: Vec<[f32; 2]>,
    /// Which of them the corners of faces have.
    #[serde(with = "rows")]
    pub(crate) corners: Vec<[u32; 3]>,
    /// The coarsest level of detail that keeps its charts apart.
    pub(crate) levels: usize,
}

/// Rows of two or three numbers as base64 of their bytes, little-endian.
mod rows {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;
    use serde::de::Error as _;
    use serde::{Deserialize as _, Deserializer, Serializer};

    /// A number of four bytes.
    pub(super) trait Word: Copy {
        fn to_bytes(self) -> [u8; 4];
        fn from_bytes(bytes: [u8; 4]) -> Self;
    }

    macro_rules! words {
        ($($word:ty),*) => {$(
            impl Word for $word {
                fn to_bytes(self) -> [u8; 4] {
                    self.to_le_bytes()
                }
                fn from_bytes(bytes: [u8; 4]) -> Self {
                    Self::from_le_bytes(bytes)
                }
            }
        )*};
    }
    words!(u32, f32);

    pub(super) fn serialize<const N: usize, W: Word, S: Serializer>(
        rows: &[[W; N]],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let bytes: Vec<_> = rows.as_flattened().iter().flat_map(|word| word.to_bytes()).collect();
        serializer.serialize_str(&STANDARD.encode(bytes))
    }

    pub(super) fn deserialize<'de, const N: usize, W: Word, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<[W; N]>, D::Error> {
        let bytes =
            STANDARD.decode(String::deserialize(deserializer)?).map_err(D::Error::custom)?;
        let words: Vec<W> = match bytes.as_chunks::<4>() {
            (words, []) => words.iter().copied().map(W::from_bytes).collect(),
            _ => return Err(D::Error::custom("numbers have four bytes")),
        };
        match words.as_chunks::<N>() {
            (rows, []) => Ok(rows.to_vec()),
            _ => Err(D::Error::custom(format!("rows have {N} numbers"))),
        }
    }
}

/// What a fit was given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Origin {
    /// Files and settings.
    pub(crate) given: Given,
    /// Where its parameters started.
    pub(crate) starts: Given,
}

impl Progress {
    /// The bytes of all three; `surfaces` and `origin` are as they were made by [`surfaces_to_bytes`] and
    /// [`Origin::to_bytes`], once for many steps.
    pub(crate) fn write(&self, surfaces: &[u8], origin: &[u8], bytes: &mut Vec<u8>) {
        bytes.extend(format!("scene {VERSION}\n").bytes());
        bytes.extend(serde_json::to_vec(self).expect("they are numbers"));
        bytes.push(b'\n');
        bytes.extend(surfaces);
        bytes.push(b'\n');
        bytes.extend(origin);
    }
}

/// The text of surfaces, on one line.
pub(crate) fn surfaces_to_bytes(surfaces: &[Surface]) -> Vec<u8> {
    serde_json::to_vec(surfaces).expect("they are numbers and letters")
}

impl Origin {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("they are words")
    }

    /// What changes nothing of what is done, and takes effect from now on, in words.
    ///
    /// # Errors
    /// [`FitError::Saved`] where parameters start elsewhere: what was learnt since has their place; and
    /// where stages were changed that are done, before `stage`, the starts of poses that were tried, or how smooth
    /// a field's surface is.
    pub(crate) fn changed_to(&self, now: &Self, stage: usize) -> Result<Vec<String>, FitError> {
        let refused = |rule: &str, difference: &Difference| {
            let (before, other) =
                (described(difference.this.as_ref()), described(difference.other.as_ref()));
            FitError::saved(format!("{rule}: {}, {before}", difference.name), other)
        };
        if let Some(difference) = differences(&self.starts, &now.starts).first() {
            return Err(refused("the start that it learnt from", difference));
        }
        let changed = differences(&self.given, &now.given);
        // The second one makes the surface that a scene's measures, and so learnt motions, are of.
        for (name, rule) in [
            ("`learn.pose.starts`", "the starts that were tried"),
            ("`learn.field.smoothing`", "the surface that it learnt from"),
        ] {
            if let Some(difference) = changed.iter().find(|difference| difference.name == name) {
                return Err(refused(rule, difference));
            }
        }
        let is_done = |difference: &&Difference| {
            (0..stage).any(|stage| difference.name.starts_with(&format!("`stages[{stage}]")))
        };
        if let Some(difference) = changed.iter().find(is_done) {
            return Err(refused("the stages that are done as they were", difference));
        }
        let words = changed.into_iter().map(|difference| {
            let (was, is) =
                (described(difference.this.as_ref()), described(difference.other.as_ref()));
            format!("{}: {is} from now on, and {was} before", difference.name)
        });
        Ok(words.collect())
    }
}

/// What [`Progress::write`] wrote, in the file of a fit; without one, of a fit that begins.
///
/// # Errors
/// [`FitError::Saved`] for anything else.
pub(crate) fn read_file(
    bytes: Option<&[u8]>,
) -> Result<(Progress, Vec<Surface>, Option<Origin>), FitError> {
    let Some(bytes) = bytes else { return Ok((Progress::default(), Vec::new(), None)) };
    let (_, state) = saved::precision_and_state(bytes)?;
    let (progress, surfaces, origin) = read(state.unwrap_or_default())?;
    Ok((progress, surfaces, Some(origin)))
}

/// What [`Progress::write`] wrote.
///
/// # Errors
/// [`FitError::Saved`] for anything else.
fn read(state: &[u8]) -> Result<(Progress, Vec<Surface>, Origin), FitError> {
    let rule = || "a fit of a scene, as this version saves it".to_owned();
    let mut parts = state.splitn(4, |&byte| byte == b'\n');
    if parts.next() != Some(format!("scene {VERSION}").as_bytes()) {
        return Err(FitError::saved(rule(), "another"));
    }
    let foreign = |error: serde_json::Error| FitError::saved(rule(), error);
    let mut next = || parts.next().unwrap_or_default();
    let progress = serde_json::from_slice(next()).map_err(foreign)?;
    let surfaces = serde_json::from_slice(next()).map_err(foreign)?;
    Ok((progress, surfaces, serde_json::from_slice(next()).map_err(foreign)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::StopEntry;
    use crate::stopping::StopRules;

    #[test]
    fn whatever_a_state_is_it_is_a_fits_or_refused() {
        let mut rules = StopRules::new(&StopEntry::default(), StopState::default());
        rules.count(0.1 + 0.2);
        let progress = Progress { done: vec![2, 0, 5], rules: rules.state(), remeshed: Some(7) };
        let rows = vec![[0.1, -0.0, f32::INFINITY]; 2];
        let faces = vec![[0, 1, u32::MAX]];
        let object = "vase".to_owned();
        let texture = TexturedSurface {
            coordinates: vec![[0.5, f32::MIN_POSITIVE]; 3],
            corners: faces.clone(),
            levels: 2,
        };
        let shape = Some(Shape { faces, positions: rows, colors: Vec::new() });
        let surface = Surface { object, shape, texture: Some(texture) };
        let surfaces = vec![surface];
        let words = |all: &[(&str, &str)]| -> Given {
            all.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
        };
        let origin = Origin { given: words(&[("a\n", "\"1\"")]), starts: words(&[("b", "")]) };
        let mut bytes = Vec::new();
        progress.write(&surfaces_to_bytes(&surfaces), &origin.to_bytes(), &mut bytes);
        assert_eq!(read(&bytes).unwrap(), (progress, surfaces, origin));
        for length in 0..bytes.len() {
            assert!(read(&bytes[..length]).is_err(), "{length}");
        }
    }
}
