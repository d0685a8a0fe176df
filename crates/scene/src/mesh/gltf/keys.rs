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

/// What is done with a key.
#[derive(Debug, Clone, Copy)]
enum Key {
    /// It is read, noted where it is read, or says nothing about surfaces.
    Read,
    /// It has a part, or a list of parts, with keys of their own.
    Parts(&'static Part),
    /// It is left out with this note, where it has something.
    Noted(&'static str),
}

use Key::{Noted, Parts, Read};

/// A part of a file.
#[derive(Debug)]
struct Part {
    /// In notes.
    what: &'static str,
    keys: &'static [(&'static str, Key)],
    /// The extensions of it that are read.
    extensions: &'static [(&'static str, Key)],
    /// Whether its keys are names of attributes.
    has_attributes: bool,
}

impl Part {
    /// A part without extensions that are read.
    const fn new(what: &'static str, keys: &'static [(&'static str, Key)]) -> Self {
        Self { what, keys, extensions: &[], has_attributes: false }
    }

    fn key(&self, key: &str) -> Option<Key> {
        // JOINTS_0 is in the table as JOINTS_.
        let numbered = |own: &str| {
            let number = own.ends_with('_').then(|| key.strip_prefix(own)).flatten();
            number.is_some_and(|number| number.parse::<u32>().is_ok())
        };
        let found = self.keys.iter().find(|(own, _)| *own == key || numbered(own));
        found.map(|(_, key)| *key)
    }
}

static ROOT: Part = Part::new(
    "the file",
    &[
        ("accessors", Parts(&ACCESSOR)),
        ("animations", Noted("animations were left out")),
        ("asset", Parts(&ASSET)),
        ("bufferViews", Parts(&VIEW)),
        ("buffers", Parts(&BUFFER)),
        ("cameras", Noted("cameras were left out")),
        ("extensionsRequired", Read),
        // Those that are used are noted where they are used.
        ("extensionsUsed", Read),
        ("images", Parts(&IMAGE)),
        ("materials", Parts(&MATERIAL)),
        ("meshes", Parts(&MESH)),
        ("nodes", Parts(&NODE)),
        ("samplers", Parts(&SAMPLER)),
        ("scene", Read),
        ("scenes", Parts(&SCENE)),
        ("skins", Parts(&SKIN)),
        ("textures", Parts(&TEXTURE)),
    ],
);
static ASSET: Part = Part::new(
    "the asset",
    &[("version", Read), ("minVersion", Read), ("generator", Read), ("copyright", Read)],
);
static ACCESSOR: Part = Part::new(
    "an accessor",
    &[
        ("bufferView", Read),
        ("byteOffset", Read),
        ("componentType", Read),
        ("normalized", Read),
        ("count", Read),
        ("type", Read),
        ("max", Read),
        ("min", Read),
        ("sparse", Parts(&SPARSE)),
        ("name", Read),
    ],
);
static SPARSE: Part = Part::new(
    "a sparse accessor",
    &[("count", Read), ("indices", Parts(&SPARSE_INDICES)), ("values", Parts(&SPARSE_VALUES))],
);
static SPARSE_INDICES: Part = Part::new(
    "sparse indices",
    &[("bufferView", Read), ("byteOffset", Read), ("componentType", Read)],
);
static SPARSE_VALUES: Part =
    Part::new("sparse values", &[("bufferView", Read), ("byteOffset", Read)]);
static BUFFER: Part = Part::new("a buffer", &[("uri", Read), ("byteLength", Read), ("name", Read)]);
static VIEW: Part = Part::new(
    "a buffer view",
    &[
        ("buffer", Read),
        ("byteOffset", Read),
        ("byteLength", Read),
        ("byteStride", Read),
        ("target", Read),
        ("name", Read),
    ],
);
static IMAGE: Part = Part::new(
    "an image",
    &[("uri", Read), ("mimeType", Read), ("bufferView", Read), ("name", Read)],
);
static MATERIAL: Part = Part::new(
    "a material",
    &[
        ("pbrMetallicRoughness", Parts(&SURFACE)),
        ("normalTexture", Parts(&NORMAL_TEXTURE)),
        ("occlusionTexture", Read),
        ("emissiveTexture", Read),
        ("emissiveFactor", Read),
        ("alphaMode", Read),
        ("alphaCutoff", Read),
        // Which faces are culled is the scene's to say.
        ("doubleSided", Read),
        ("name", Read),
    ],
);
static SURFACE: Part = Part::new(
    "metallic-roughness",
    &[
        ("baseColorFactor", Read),
        ("baseColorTexture", Parts(&USED_TEXTURE)),
        ("metallicFactor", Read),
        ("roughnessFactor", Read),
        ("metallicRoughnessTexture", Parts(&USED_TEXTURE)),
    ],
);
static USED_TEXTURE: Part = Part {
    extensions: &[("KHR_texture_transform", Parts(&TRANSFORM))],
    ..Part::new("a material's texture", &[("index", Read), ("texCoord", Read)])
};
static NORMAL_TEXTURE: Part = Part {
    extensions: &[("KHR_texture_transform", Parts(&TRANSFORM))],
    ..Part::new("a normal texture", &[("index", Read), ("texCoord", Read), ("scale", Read)])
};
static TRANSFORM: Part = Part::new(
    "a texture's transform",
    &[("offset", Read), ("rotation", Read), ("scale", Read), ("texCoord", Read)],
);
static MESH: Part =
    Part::new("a mesh", &[("primitives", Parts(&PRIMITIVE)), ("weights", Read), ("name", Read)]);
static PRIMITIVE: Part = Part::new(
    "a primitive",
    &[
        ("attributes", Parts(&ATTRIBUTES)),
        ("indices", Read),
        ("material", Read),
        ("mode", Read),
        ("targets", Parts(&TARGET)),
    ],
);
static ATTRIBUTES: Part = Part {
    has_attributes: true,
    ..Part::new(
        "a primitive",
        &[
            ("POSITION", Read),
            ("NORMAL", Read),
            ("TANGENT", Read),
            ("COLOR_0", Read),
            ("TEXCOORD_", Read),
            ("JOINTS_", Read),
            ("WEIGHTS_", Read),
        ],
    )
};
static TARGET: Part = Part {
    has_attributes: true,
    ..Part::new("a morph target", &[("POSITION", Read), ("NORMAL", Read), ("TANGENT", Read)])
};
static NODE: Part = Part::new(
    "a node",
    &[
        // The file's list of cameras is noted.
        ("camera", Read),
        ("children", Read),
        ("skin", Read),
        ("matrix", Read),
        ("mesh", Read),
        ("rotation", Read),
        ("scale", Read),
        ("translation", Read),
        ("weights", Read),
        ("name", Read),
    ],
);
static SAMPLER: Part = Part::new(
    "a sampler",
    &[("magFilter", Read), ("minFilter", Read), ("wrapS", Read), ("wrapT", Read), ("name", Read)],
);
static SCENE: Part = Part::new("a scene", &[("nodes", Read), ("name", Read)]);
static SKIN: Part = Part::new(
    "a skin",
    &[
        ("inverseBindMatrices", Read),
        ("joints", Read),
        // Where the joints' root is says nothing about where they are.
        ("skeleton", Read),
        ("name", Read),
    ],
);
static TEXTURE: Part =
    Part::new("a texture", &[("sampler", Read), ("source", Read), ("name", Read)]);

/// Notes what a text has that is not read.
pub(super) fn note(text: &[u8], notes: &mut Notes) -> serde_json::Result<()> {
    Walk { part: &ROOT, place: Place::Keys, notes }
        .deserialize(&mut serde_json::Deserializer::from_slice(text))
}

/// Where in a part a walk is.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// At its keys.
    Keys,
    /// At its extensions.
    Extensions,
}

/// A walk through a part, or through each of a list.
#[derive(Debug)]
struct Walk<'n> {
    part: &'static Part,
    place: Place,
    notes: &'n mut Notes,
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.part.what)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Self { part, place, notes } = self;
        while let Some(key) = map.next_key::<Cow<'de, str>>()? {
            let known = match place {
                Place::Keys => part.key(&key),
                Place::Extensions => {
                    part.extensions.iter().find(|(own, _)| *own == key).map(|(_, key)| *key)
                }
            };
            let left_out = match (known, place, &*key) {
                (Some(Read), ..) => None,
                (Some(Parts(part)), ..) => {
                    map.next_value_seed(Walk { part, place: Place::Keys, notes })?;
                    continue;
                }
                (Some(Noted(note)), ..) => Some(note.to_owned()),
                (None, Place::Keys, "extensions") => {
                    map.next_value_seed(Walk { part, place: Place::Extensions, notes })?;
                    continue;
                }
                (None, Place::Keys, "extras") => {
                    Some(format!("extras of {} were left out", part.what))
                }
                (None, ..) => {
                    let kind = match (place, part.has_attributes) {
                        (Place::Extensions, _) => "extension",
                        (Place::Keys, true) => "attribute",
                        (Place::Keys, false) => "key",
                    };
                    Some(format!("the {kind} {:?} of {} was left out", name(&key), part.what))
                }
            };
            match left_out {
                None => drop(map.next_value::<IgnoredAny>()?),
                Some(note) => {
                    if map.next_value_seed(HasSomething)? {
                        notes.add(note);
                    }
                }
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        let Self { part, place, notes } = self;
        while list.next_element_seed(Walk { part, place, notes })?.is_some() {}
        Ok(())
    }

    // What else stands in the place of a part is refused by those who read it.

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }
}

/// Whether a value is more than null and an empty list.
#[derive(Debug)]
struct HasSomething;

impl<'de> DeserializeSeed<'de> for HasSomething {
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<bool, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for HasSomething {
    type Value = bool;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a value")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<bool, A::Error> {
        // An extension may say something by being there.
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(true)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<bool, A::Error> {
        let mut is_empty = true;
        while list.next_element::<IgnoredAny>()?.is_some() {
            is_empty = false;
        }
        Ok(!is_empty)
    }

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
