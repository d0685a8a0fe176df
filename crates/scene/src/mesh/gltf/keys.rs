//! What a file says that nothing here reads: each key, attribute and extension of it is noted.
//!
//! The text is walked once more beside a table of the parts of the specification. A key of the table is read,
//! or noted by those who read its part, or noted here. Names, bounds of accessors, and who wrote the file say
//! nothing about surfaces. All else is noted by its name: keys that the specification does not have, too.
//!
//! # Source
//! Khronos Group, glTF 2.0 Specification, section 5, properties reference.

use std::borrow::Cow;
use std::fmt;

use serde::Deserializer;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};

use crate::mesh::notes::{Notes, name};

/// A part of a file. Keys of one kind are words of a text.
#[derive(Debug)]
struct Part {
    /// In notes.
    what: &'static str,
    /// Keys that are read, noted where they are read, or say nothing about surfaces. `JOINTS_0` is `JOINTS_`.
    read: &'static str,
    /// Keys that are left out.
    left_out: &'static str,
    /// Keys of parts, or of lists of parts, with keys of their own.
    parts: &'static [(&'static str, &'static Part)],
    /// The extensions of it that are read.
    extensions: &'static [(&'static str, &'static Part)],
    /// Whether its keys are names of attributes.
    has_attributes: bool,
}

impl Part {
    /// A part without extensions that are read.
    const fn new(
        what: &'static str,
        read: &'static str,
        parts: &'static [(&'static str, &'static Part)],
    ) -> Self {
        Self { what, read, left_out: "", parts, extensions: &[], has_attributes: false }
    }

    fn is_read(&self, key: &str) -> bool {
        let is_numbered = |start: &str| {
            let number = start.ends_with('_').then(|| key.strip_prefix(start)).flatten();
            number.is_some_and(|number| number.parse::<u32>().is_ok())
        };
        self.read.split_whitespace().any(|word| word == key || is_numbered(word))
    }
}

// Those of `extensionsUsed` that are used are noted where they are used.
static ROOT: Part = Part {
    left_out: "animations cameras",
    ..Part::new(
        "the file",
        "extensionsRequired extensionsUsed scene",
        &[
            ("accessors", &ACCESSOR),
            ("asset", &ASSET),
            ("bufferViews", &VIEW),
            ("buffers", &BUFFER),
            ("images", &IMAGE),
            ("materials", &MATERIAL),
            ("meshes", &MESH),
            ("nodes", &NODE),
            ("samplers", &SAMPLER),
            ("scenes", &SCENE),
            ("skins", &SKIN),
            ("textures", &TEXTURE),
        ],
    )
};
static ASSET: Part = Part::new("the asset", "version minVersion generator copyright", &[]);
static ACCESSOR: Part = Part::new(
    "an accessor",
    "bufferView byteOffset componentType normalized count type max min name",
    &[("sparse", &SPARSE)],
);
static SPARSE: Part = Part::new(
    "a sparse accessor",
    "count",
    &[("indices", &SPARSE_INDICES), ("values", &SPARSE_VALUES)],
);
static SPARSE_INDICES: Part =
    Part::new("sparse indices", "bufferView byteOffset componentType", &[]);
static SPARSE_VALUES: Part = Part::new("sparse values", "bufferView byteOffset", &[]);
static BUFFER: Part = Part::new("a buffer", "uri byteLength name", &[]);
static VIEW: Part =
    Part::new("a buffer view", "buffer byteOffset byteLength byteStride target name", &[]);
static IMAGE: Part = Part::new("an image", "uri mimeType bufferView name", &[]);
// Which faces are culled, `doubleSided`, is the scene's to say.
static MATERIAL: Part = Part::new(
    "a material",
    "occlusionTexture emissiveTexture emissiveFactor alphaMode alphaCutoff doubleSided name",
    &[("pbrMetallicRoughness", &SURFACE), ("normalTexture", &NORMAL_TEXTURE)],
);
static SURFACE: Part = Part::new(
    "metallic-roughness",
    "baseColorFactor metallicFactor roughnessFactor",
    &[("baseColorTexture", &USED_TEXTURE), ("metallicRoughnessTexture", &USED_TEXTURE)],
);
static USED_TEXTURE: Part = Part {
    extensions: &[("KHR_texture_transform", &TRANSFORM)],
    ..Part::new("a material's texture", "index texCoord", &[])
};
static NORMAL_TEXTURE: Part = Part {
    extensions: &[("KHR_texture_transform", &TRANSFORM)],
    ..Part::new("a normal texture", "index texCoord scale", &[])
};
static TRANSFORM: Part = Part::new("a texture's transform", "offset rotation scale texCoord", &[]);
static MESH: Part = Part::new("a mesh", "weights name", &[("primitives", &PRIMITIVE)]);
static PRIMITIVE: Part = Part::new(
    "a primitive",
    "indices material mode",
    &[("attributes", &ATTRIBUTES), ("targets", &TARGET)],
);
static ATTRIBUTES: Part = Part {
    has_attributes: true,
    ..Part::new("a primitive", "POSITION NORMAL TANGENT COLOR_0 TEXCOORD_ JOINTS_ WEIGHTS_", &[])
};
static TARGET: Part =
    Part { has_attributes: true, ..Part::new("a morph target", "POSITION NORMAL TANGENT", &[]) };
// The file's list of cameras is noted.
static NODE: Part = Part::new(
    "a node",
    "camera children skin matrix mesh rotation scale translation weights name",
    &[],
);
static SAMPLER: Part = Part::new("a sampler", "magFilter minFilter wrapS wrapT name", &[]);
static SCENE: Part = Part::new("a scene", "nodes name", &[]);
// Where the joints' root is, `skeleton`, says nothing about where they are.
static SKIN: Part = Part::new("a skin", "inverseBindMatrices joints skeleton name", &[]);
static TEXTURE: Part = Part::new("a texture", "sampler source name", &[]);

/// Notes what a text has that is not read.
pub(super) fn note(text: &[u8], notes: &mut Notes) -> serde_json::Result<()> {
    let walk = Walk { part: Some(&ROOT), level: Level::Keys, notes };
    walk.deserialize(&mut serde_json::Deserializer::from_slice(text)).map(drop)
}

/// Where in a part a walk is.
#[derive(Debug, Clone, Copy)]
enum Level {
    /// At its keys.
    Keys,
    /// At its extensions.
    Extensions,
}

/// A walk through a part, or through each of a list; without a part, through anything. It answers whether there
/// is more than null and an empty list.
#[derive(Debug)]
struct Walk<'n> {
    part: Option<&'static Part>,
    level: Level,
    notes: &'n mut Notes,
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<bool, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = bool;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.part.map_or("a value", |part| part.what))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<bool, A::Error> {
        let Self { part, level, notes } = self;
        let Some(part) = part else {
            // An extension may say something by being there.
            while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
            return Ok(true);
        };
        while let Some(key) = map.next_key::<Cow<'de, str>>()? {
            let parts = match level {
                Level::Keys => part.parts,
                Level::Extensions => part.extensions,
            };
            let inner = match (parts.iter().find(|(name, _)| *name == key), level, &*key) {
                (Some((_, part)), ..) => Some((*part, Level::Keys)),
                (None, Level::Keys, "extensions") => Some((part, Level::Extensions)),
                _ => None,
            };
            if let Some((part, level)) = inner {
                map.next_value_seed(Walk { part: Some(part), level, notes })?;
                continue;
            }
            let is_key = matches!(level, Level::Keys);
            if is_key && part.is_read(&key) {
                map.next_value::<IgnoredAny>()?;
                continue;
            }
            let note = match &*key {
                key if is_key && part.left_out.split_whitespace().any(|word| word == key) => {
                    format!("{key} were left out")
                }
                "extras" if is_key => format!("extras of {} were left out", part.what),
                key => {
                    let kind = match (level, part.has_attributes) {
                        (Level::Extensions, _) => "extension",
                        (Level::Keys, true) => "attribute",
                        (Level::Keys, false) => "key",
                    };
                    format!("the {kind} {:?} of {} was left out", name(key), part.what)
                }
            };
            if map.next_value_seed(Walk { part: None, level, notes })? {
                notes.add(note);
            }
        }
        Ok(true)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<bool, A::Error> {
        let Self { part, level, notes } = self;
        let mut has_element = false;
        while match part {
            Some(_) => list.next_element_seed(Walk { part, level, notes })?.is_some(),
            None => list.next_element::<IgnoredAny>()?.is_some(),
        } {
            has_element = true;
        }
        Ok(has_element)
    }

    // What else stands in the place of a part is refused by those who read it.
    fn visit_unit<E>(self) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_bool<E>(self, _: bool) -> Result<bool, E> {
        Ok(true)
    }

    fn visit_i64<E>(self, _: i64) -> Result<bool, E> {
        Ok(true)
    }

    fn visit_u64<E>(self, _: u64) -> Result<bool, E> {
        Ok(true)
    }

    fn visit_f64<E>(self, _: f64) -> Result<bool, E> {
        Ok(true)
    }

    fn visit_str<E>(self, _: &str) -> Result<bool, E> {
        Ok(true)
    }
}
