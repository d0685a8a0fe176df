//! `docs/scene.md` has every key of `scene.toml`, and what it shows can be read.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use bokashi_scene::description::{Description, schema};
use serde_json::Value;
use toml::Value as Shown;

fn page() -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/scene.md")).unwrap()
}

/// The blocks of TOML in a page.
fn blocks(page: &str) -> Vec<&str> {
    let parts = page.split("```toml\n").skip(1);
    parts.map(|part| part.split("```").next().unwrap()).collect()
}

/// What each definition of the schema is shown with, over all blocks; the root has no name.
#[derive(Default)]
struct Seen<'s>(BTreeMap<&'s str, (&'s Value, Vec<&'s Shown>)>);

impl<'s> Seen<'s> {
    /// Follows `shown` where `node` describes it. `name` is that of the definition that `node` is.
    fn follow(&mut self, root: &'s Value, name: &'s str, node: &'s Value, shown: Vec<&'s Shown>) {
        if let Some(to) = node["$ref"].as_str() {
            let name = to.rsplit('/').next().unwrap();
            return self.follow(root, name, &root["$defs"][name], shown);
        }
        for key in ["anyOf", "oneOf", "allOf"] {
            for (at, variant) in node[key].as_array().into_iter().flatten().enumerate() {
                // Of variants with a tag only those that it names.
                let kind = &variant["properties"]["kind"]["const"];
                let is_own = |own: &&&Shown| match kind.as_str() {
                    Some(kind) => own.get("kind").and_then(Shown::as_str) == Some(kind),
                    None => true,
                };
                let own: Vec<_> = shown.iter().filter(is_own).copied().collect();
                let name = match kind.as_str() {
                    Some(kind) => kind,
                    None if at == 0 => name,
                    None => "",
                };
                self.follow(root, name, variant, own);
            }
        }
        if node["items"].is_object() {
            let items = shown.iter().filter_map(|own| own.as_array()).flatten().collect();
            return self.follow(root, name, &node["items"], items);
        }
        let Some(properties) = node["properties"].as_object() else { return };
        self.0.entry(name).or_insert((node, Vec::new())).1.extend(&shown);
        for (key, below) in properties {
            let own = shown.iter().filter_map(|own| own.get(key)).collect();
            self.follow(root, name, below, own);
        }
    }
}

/// The keys of the schema that these blocks lack.
fn missing(schema: &Value, blocks: &[Shown]) -> Vec<String> {
    let mut seen = Seen::default();
    seen.follow(schema, "", schema, blocks.iter().collect());
    let keys = seen.0.iter().flat_map(|(name, (node, shown))| {
        let keys = node["properties"].as_object().unwrap().keys();
        let lacks = |key: &&String| shown.iter().all(|own| own.get(key.as_str()).is_none());
        keys.filter(lacks).map(move |key| format!("{name}.{key}"))
    });
    keys.collect()
}

/// All words that some key takes: those of enumerations and tags.
fn words(node: &Value, found: &mut Vec<String>) {
    match node {
        Value::Object(map) => {
            found.extend(map.get("const").and_then(Value::as_str).map(str::to_owned));
            let all = map.get("enum").and_then(Value::as_array).into_iter().flatten();
            found.extend(all.filter_map(Value::as_str).map(str::to_owned));
            map.values().for_each(|below| words(below, found));
        }
        Value::Array(list) => list.iter().for_each(|below| words(below, found)),
        _ => {}
    }
}

#[test]
fn every_block_of_the_page_can_be_read() {
    let page = page();
    let blocks = blocks(&page);
    assert!(blocks.len() >= 3, "{}", blocks.len());
    for block in blocks {
        if let Err(error) = Description::parse(block, Path::new("docs/scene.md")) {
            panic!("{error} in\n{block}");
        }
    }
}

#[test]
fn every_key_of_the_schema_is_on_the_page() {
    let page = page();
    let schema: Value = serde_json::from_str(&schema()).unwrap();
    let read = |block: &&str| toml::from_str::<Shown>(block).unwrap();
    let blocks: Vec<_> = blocks(&page).iter().map(read).collect();
    assert_eq!(missing(&schema, &blocks), Vec::<String>::new());
    let mut all = Vec::new();
    words(&schema, &mut all);
    assert!(all.len() > 20, "{all:?}");
    for word in all {
        assert!(page.contains(&format!("{word:?}")), "the page does not have the word {word:?}");
    }
}

/// What the test above rests on: a key that is left out is found, at every depth.
#[test]
fn a_key_that_a_page_lacks_is_found() {
    let page = page();
    let schema: Value = serde_json::from_str(&schema()).unwrap();
    let keys = [
        ("seed = 7\n", ".seed"),
        ("tolerance = 1e-3\n", "LensEntry.tolerance"),
        ("patience = 300\n", "StopEntry.patience"),
        ("direction = [1, 2, 1]", "directional.direction"),
        ("colmap = \"sparse/0\"\n", "CamerasEntry.colmap"),
        ("up = [0, 0, -1]\n", "CameraEntry.up"),
        ("normals = 1e-3\n", "LearnVertices.normals"),
    ];
    for (line, key) in keys {
        assert_eq!(page.matches(line).count(), 1, "{line}");
        let page = page.replace(line, "");
        let read = |block: &&str| toml::from_str::<Shown>(block).unwrap();
        let blocks: Vec<_> = blocks(&page).iter().map(read).collect();
        assert_eq!(missing(&schema, &blocks), [key]);
    }
}
