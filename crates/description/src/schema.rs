//! What `scene.toml` may say, for editors that complete it and mark what is wrong.
//!
//! The schema is written so that taplo 0.10, which is inside editors' extensions for TOML, offers the keys of
//! each table. It follows a `$ref`, with a description beside it, and neither `allOf` nor variants with null.

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema};
use serde_json::Value;

/// The JSON schema of a `T`.
pub(crate) fn schema_of<T: JsonSchema>() -> String {
    let settings = SchemaSettings::draft2020_12().with_transform(RecursiveTransform(without_null));
    let schema = settings.into_generator().into_root_schema_for::<T>();
    serde_json::to_string_pretty(&schema).unwrap_or_default() + "\n"
}

/// TOML has no null: a key is absent. An editor that knows so can say what is wrong with a value.
fn without_null(schema: &mut Schema) {
    // A table's default lists its keys as null; each key says its own.
    if schema.get("default").is_some_and(|get| get.is_object() || get.is_array() || get.is_null()) {
        schema.remove("default");
    }
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|kind| kind != "null");
        if let [only] = types.as_slice() {
            let only = only.clone();
            schema.insert("type".to_owned(), only);
        }
    }
    let Some(Value::Array(variants)) = schema.get_mut("anyOf") else { return };
    variants.retain(|variant| variant["type"] != "null");
    if let [Value::Object(only)] = variants.as_slice() {
        let only = only.clone();
        schema.remove("anyOf");
        for (word, rule) in only {
            // What is said of the key is more than what is said of its type.
            if schema.get(&word).is_none() {
                schema.insert(word, rule);
            }
        }
    }
}
