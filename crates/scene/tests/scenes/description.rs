//! `docs/scene.md` has every key of `scene.toml`, and what it and `docs/recipes.md` show can be read.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use bokashi_scene::description::{Description, schema};
use serde_json::Value;
use toml::Value as Shown;

fn page(name: &str) -> String {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    fs::read_to_string(docs.join(name)).unwrap()
}

/// The blocks of TOML in a page.
fn blocks(page: &str) -> Vec<&str> {
    let parts = page.split("```toml\n").skip(1);
    parts.map(|part| part.split("```").next().unwrap()).collect()
}

/// What each definition of the schema is shown with, over all blocks; the root has no name.
#[derive(Default)]
struct Definitions<'s>(BTreeMap<&'s str, (&'s Value, Vec<&'s Shown>)>);

impl<'s> Definitions<'s> {
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
                let is_own = |value: &&&Shown| match kind.as_str() {
                    Some(kind) => value.get("kind").and_then(Shown::as_str) == Some(kind),
                    None => true,
                };
                let value: Vec<_> = shown.iter().filter(is_own).copied().collect();
                let name = match kind.as_str() {
                    Some(kind) => kind,
                    None if at == 0 => name,
                    None => "",
                };
                self.follow(root, name, variant, value);
            }
        }
        if node["items"].is_object() {
            let items = shown.iter().filter_map(|value| value.as_array()).flatten().collect();
            return self.follow(root, name, &node["items"], items);
        }
        let Some(properties) = node["properties"].as_object() else { return };
        self.0.entry(name).or_insert((node, Vec::new())).1.extend(&shown);
        for (key, below) in properties {
            let value = shown.iter().filter_map(|value| value.get(key)).collect();
            self.follow(root, name, below, value);
        }
    }
}

/// The keys of the schema that these blocks lack.
fn missing(schema: &Value, blocks: &[Shown]) -> Vec<String> {
    let mut definitions = Definitions::default();
    definitions.follow(schema, "", schema, blocks.iter().collect());
    let keys = definitions.0.iter().flat_map(|(name, (node, shown))| {
        let keys = node["properties"].as_object().unwrap().keys();
        let lacks = |key: &&String| shown.iter().all(|value| value.get(key.as_str()).is_none());
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
fn every_block_of_the_pages_can_be_read() {
    for (name, least) in [("scene.md", 3), ("recipes.md", 4)] {
        let page = page(name);
        let blocks = blocks(&page);
        assert!(blocks.len() >= least, "{name}: {}", blocks.len());
        for block in blocks {
            if let Err(error) = Description::parse(block, Path::new(name)) {
                panic!("{error} in\n{block}");
            }
        }
    }
}

#[test]
fn every_key_of_the_schema_is_on_the_page() {
    let page = page("scene.md");
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
    let page = page("scene.md");
    let schema: Value = serde_json::from_str(&schema()).unwrap();
    let keys = [
        ("seed = 7\n", ".seed"),
        ("surfaces = 2\n", "LensEntry.surfaces"),
        ("patience = 300\n", "StopEntry.patience"),
        ("direction = [1, 2, 1]", "directional.direction"),
        ("colmap = \"sparse\"\n", "CamerasEntry.colmap"),
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

/// What is wrong with `value` by a schema. All words that the schema has are understood.
fn faults(root: &Value, node: &Value, value: &Value, at: &str) -> Vec<String> {
    let wrong = |rule: &dyn std::fmt::Display| vec![format!("{at}: {value} against {rule}")];
    let all = |key: &str| node[key].as_array().cloned().unwrap_or_default();
    let mut found = Vec::new();
    for (word, rule) in node.as_object().unwrap() {
        found.extend(match word.as_str() {
            "$schema" | "title" | "description" | "default" | "format" | "$defs" => vec![],
            "$ref" => {
                let name = rule.as_str().unwrap().strip_prefix("#/$defs/").unwrap();
                faults(root, &root["$defs"][name], value, at)
            }
            "type" => {
                let is_whole = value.as_f64().is_some_and(|x| x.fract() == 0.0);
                let is_kind = match rule.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "number" => value.is_number(),
                    "integer" => is_whole,
                    kind => panic!("{at} has a {kind}"),
                };
                if is_kind { vec![] } else { wrong(rule) }
            }
            "const" if value != rule => wrong(rule),
            "enum" if !rule.as_array().unwrap().contains(value) => wrong(rule),
            "const" | "enum" => vec![],
            "minimum" | "maximum" | "exclusiveMinimum" => match (value.as_f64(), rule.as_f64()) {
                (Some(x), Some(least)) if word == "minimum" && x < least => wrong(rule),
                (Some(x), Some(most)) if word == "maximum" && x > most => wrong(rule),
                (Some(x), Some(low)) if word == "exclusiveMinimum" && x <= low => wrong(rule),
                _ => vec![],
            },
            "minItems" | "maxItems" => {
                let count = value.as_array().map(|list| list.len() as u64);
                let is_broken = count.is_some_and(|count| match word.as_str() {
                    "minItems" => count < rule.as_u64().unwrap(),
                    _ => count > rule.as_u64().unwrap(),
                });
                if is_broken { wrong(&format!("{word} {rule}")) } else { vec![] }
            }
            "items" => {
                let list = value.as_array().into_iter().flatten().enumerate();
                list.flat_map(|(k, value)| faults(root, rule, value, &format!("{at}[{k}]")))
                    .collect()
            }
            "properties" | "additionalProperties" => {
                let keys = value.as_object().into_iter().flatten();
                keys.flat_map(|(key, value)| match (&node["properties"][key], word.as_str()) {
                    (Value::Null, "additionalProperties") => wrong(&format!("the key {key}")),
                    (Value::Null, _) | (_, "additionalProperties") => vec![],
                    (below, _) => faults(root, below, value, &format!("{at}.{key}")),
                })
                .collect()
            }
            "required" => {
                let keys = all("required");
                let lacks =
                    |key: &&Value| value.is_object() && value[key.as_str().unwrap()].is_null();
                keys.iter().filter(lacks).flat_map(|key| wrong(&format!("without {key}"))).collect()
            }
            "allOf" => all(word).iter().flat_map(|part| faults(root, part, value, at)).collect(),
            "anyOf" | "oneOf" => {
                let fits = |choice: &&Value| faults(root, choice, value, at).is_empty();
                match all(word).iter().filter(fits).count() {
                    1 => vec![],
                    2.. if word == "anyOf" => vec![],
                    count => wrong(&format!("{count} of {word}")),
                }
            }
            _ => panic!("{at} has the word {word}"),
        });
    }
    found
}

/// What is wrong with a text of TOML by the schema.
fn faults_of(text: &str) -> Vec<String> {
    let schema: Value = serde_json::from_str(&schema()).unwrap();
    let value = serde_json::to_value(toml::from_str::<Shown>(text).unwrap()).unwrap();
    faults(&schema, &schema, &value, "scene")
}

#[test]
fn an_editor_finds_nothing_wrong_with_the_page() {
    let pages = ["scene.md", "recipes.md"].map(page);
    for block in pages.iter().flat_map(|page| blocks(page)) {
        assert_eq!(faults_of(block), Vec::<String>::new(), "in\n{block}");
    }
}

/// An editor marks what the program would refuse, as far as a single value is at fault.
#[test]
fn an_editor_refuses_what_the_program_refuses() {
    let rows = [
        ("sead = 1", "scene: {\"sead\":1} against the key sead"),
        ("seed = -1", "scene.seed: -1 against 0"),
        ("[pipeline]\nblur = 0", "scene.pipeline.blur: 0 against 0"),
        ("[pipeline]\nsilhouettes = \"exakt\"", "scene.pipeline.silhouettes: \"exakt\" against"),
        ("[pipeline]\nbackground = [0, 0]", "scene.pipeline.background: [0,0] against minItems 3"),
        ("[stop]\nsteps = 1.5", "scene.stop.steps: 1.5 against \"integer\""),
        ("[stop]\nsteps = 0", "scene.stop.steps: 0 against 1"),
        ("[stop]\nsteps = 2000000000", "scene.stop.steps: 2000000000 against 1000000000"),
        ("[loss]\nssim = -0.5", "scene.loss.ssim: -0.5 against 0"),
        ("[loss]\nssim = 1.5", "scene.loss.ssim: 1.5 against 1"),
        ("[[meshes]]\nname = 1", "scene.meshes[0].name: 1 against \"string\""),
        (
            "[[lights]]\nkind = \"ambient\"",
            "scene.lights[0]: {\"kind\":\"ambient\"} against 0 of oneOf",
        ),
        ("[[views]]\nname = \"a\"", "scene.views[0]: {\"name\":\"a\"} against without \"camera\""),
    ];
    for (text, expected) in rows {
        let found = faults_of(text);
        assert!(found.len() == 1 && found[0].starts_with(expected), "{text}: {found:?}");
        assert!(Description::parse(text, Path::new("scene.toml")).is_err(), "{text}");
    }
    // Whole numbers may be written with a point.
    for text in ["[stop]\nsteps = 10.0", "[[views]]\ncamera = { focal = 7 }"] {
        assert_eq!(faults_of(text), Vec::<String>::new());
        Description::parse(text, Path::new("scene.toml")).unwrap();
    }
}
