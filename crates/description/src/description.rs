//! What `scene.toml` says, checked key by key.
//!
//! Every number has its rule in its type, so that the parser knows where it stands. `docs/scene.md` has a
//! complete example, and [`schema`] lets editors complete one.

use std::collections::BTreeMap;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;
use toml::Spanned;

use crate::error::DescriptionError;
use crate::learn::{Learn, LossEntry, Stage, StopEntry};
use crate::location::{Location, shortened};
use crate::meshes::MeshEntry;
use crate::pipeline::{EnvironmentEntry, LightEntry, PipelineEntry};
use crate::schema::schema_of;
use crate::views::{CamerasEntry, ViewEntry};
use crate::words::{self, Keyed};

/// The most bytes of a description, and the most tables and lists in it: a view has a handful, and each takes
/// some hundred bytes of memory.
const MOST_BYTES: u64 = 64 << 20;
const MOST_TABLES: u64 = 1 << 20;

/// A scene, and what is learnt of it.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "A scene for bokashi")]
pub struct Description {
    /// Meshes.
    #[serde(default)]
    #[schemars(with = "Vec<MeshEntry>")]
    pub meshes: Vec<Spanned<MeshEntry>>,
    /// Views, one by one.
    #[serde(default, serialize_with = "left_out")]
    #[schemars(with = "Vec<ViewEntry>")]
    pub views: Vec<Spanned<ViewEntry>>,
    /// Views from a file of cameras.
    #[schemars(with = "Option<CamerasEntry>")]
    pub cameras: Option<Spanned<CamerasEntry>>,
    /// Lights.
    #[serde(default)]
    pub lights: Vec<LightEntry>,
    /// Light from all sides.
    #[schemars(with = "Option<EnvironmentEntry>")]
    pub environment: Option<Spanned<EnvironmentEntry>>,
    /// Which operations make a picture.
    #[serde(default)]
    pub pipeline: PipelineEntry,
    /// What is learnt.
    #[serde(default)]
    pub learn: Learn,
    /// What a fit makes small.
    #[serde(default)]
    pub loss: LossEntry,
    /// The parts of a fit, one after another.
    #[serde(default)]
    pub stages: Vec<Stage>,
    /// When a fit ends.
    #[serde(default)]
    pub stop: StopEntry,
    /// What views are drawn from; by default 0.
    #[serde(default)]
    pub seed: u64,
}

/// The schema of `scene.toml`, as JSON: an editor that is told of it completes such a file.
///
/// `#:schema ./scene.schema.json` in its first line tells it, where that file holds the schema.
pub fn schema() -> String {
    schema_of::<Description>()
}

impl Description {
    /// All keys but those of views, each with its value in words: `learn.vertices.rate` is `0.01`. What is
    /// absent is left out.
    pub fn keys(&self) -> BTreeMap<String, String> {
        let mut all = BTreeMap::new();
        let whole = serde_json::to_value(self).expect("a description is words and numbers");
        collect(&whole, String::new(), &mut all);
        all
    }

    /// What `text` says; `path` is the file's, for errors.
    ///
    /// # Errors
    /// [`DescriptionError::Content`] with line and column, for text that is no TOML, an unknown key, and a value
    /// against its rule; [`DescriptionError::TooLarge`] for a text that would take a gigabyte.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DescriptionError> {
        let opened = text.bytes().filter(|byte| b"[{".contains(byte)).count() as u64;
        for (what, most, found) in [
            ("bytes of a description", MOST_BYTES, text.len() as u64),
            ("tables and lists of a description", MOST_TABLES, opened),
        ] {
            if found > most {
                return Err(DescriptionError::TooLarge {
                    location: Location::new(path),
                    what,
                    most,
                    found,
                });
            }
        }
        toml::from_str(text).map_err(|error| {
            let location = match error.span() {
                Some(span) => Location::from_byte(text, path, span.start),
                None => Location::new(path),
            };
            let message = shortened(&reword_with_suggestion(error.message())).into_owned();
            DescriptionError::Content { location, message }
        })
    }
}

/// Views are described as they are loaded, not as they are written.
fn left_out<S: Serializer>(_: &[Spanned<ViewEntry>], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_none()
}

/// Adds what `value` holds, under its keys. Numbers of a list stand together.
fn collect(value: &Value, key: String, all: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(inner) => {
            for (name, value) in inner {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                collect(value, key, all);
            }
            // An empty table says something, too: its numbers are the usual ones.
            if !key.is_empty() && inner.values().all(Value::is_null) {
                all.insert(key, "there".to_owned());
            }
        }
        Value::Array(inner) if inner.iter().any(Value::is_object) => {
            for (index, value) in inner.iter().enumerate() {
                collect(value, format!("{key}[{index}]"), all);
            }
        }
        Value::Null => {}
        other => drop(all.insert(key, other.to_string())),
    }
}

/// What the parser says, and where it refuses a name, the nearest that it knows.
///
/// It says "unknown field `a`, expected `b` or `c`", or "unknown variant".
fn reword_with_suggestion(message: &str) -> String {
    let message = words::reword(message, Keyed::Table).replace("unknown field", "unknown key");
    let mut names = message.split('`').skip(1).step_by(2);
    let is_unknown = message.starts_with("unknown key") || message.starts_with("unknown variant");
    let nearest = names.next().filter(|_| is_unknown).and_then(|given| {
        let distance = |name: &str| strsim::damerau_levenshtein(given, name);
        let near = names.map(|name| (distance(name), name)).min()?;
        // Farther away it is another word.
        (near.0 <= given.chars().count().max(3) / 2).then_some(near.1)
    });
    match nearest {
        Some(name) => format!("{message}; is {name:?} meant?"),
        None => message,
    }
}

#[cfg(test)]
mod tests;
