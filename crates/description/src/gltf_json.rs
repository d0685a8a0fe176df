//! The JSON of glTF files.

use gltf::json::Root;
use serde::Deserialize;
use serde_json::Value;

/// The parts that a text has. The crate `gltf` asks each scene for a list of nodes, which may be missing.
///
/// # Errors
/// Those of the parser: [`json_message`](crate::json_message) says them in words.
pub fn gltf_root(text: &[u8]) -> serde_json::Result<Root> {
    let error = match serde_json::from_slice(text) {
        Err(error) if error.to_string().starts_with("missing field `nodes`") => error,
        result => return result,
    };
    let mut whole: Value = serde_json::from_slice(text)?;
    let scenes = whole.get_mut("scenes").and_then(Value::as_array_mut).ok_or(error)?;
    for scene in scenes.iter_mut().filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
    serde_json::from_value(whole)
}

/// The version that a text says, whatever else it has: a text or, before version 2, a number.
pub fn gltf_version(text: &[u8]) -> Option<String> {
    #[derive(Deserialize)]
    struct Head {
        asset: Asset,
    }
    #[derive(Deserialize)]
    struct Asset {
        version: Value,
    }
    let Head { asset: Asset { version } } = serde_json::from_slice(text).ok()?;
    Some(version.as_str().map_or_else(|| version.to_string(), str::to_owned))
}
