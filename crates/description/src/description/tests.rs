//! Laws of what `scene.toml` may say.

use super::*;

fn said_of(text: &str) -> String {
    match Description::parse(text, Path::new("scene.toml")) {
        Ok(_) => "fine".to_owned(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn an_unknown_key_is_refused_with_the_nearest_name() {
    let said = said_of("[pipeline]\nsilhouetes = \"exact\"\n");
    assert!(said.starts_with("scene.toml:2:1: unknown key `silhouetes`"), "{said}");
    assert!(said.ends_with("is \"silhouettes\" meant?"), "{said}");
    let said = said_of("[pipeline]\nsilhouettes = \"exakt\"\n");
    assert!(said.starts_with("scene.toml:2:15: unknown variant `exakt`"), "{said}");
    assert!(said.ends_with("is \"exact\" meant?"), "{said}");
    let said = said_of("zzzzzzzz = 1\n");
    assert!(said.contains("unknown key") && !said.contains("meant"), "{said}");
}

#[test]
fn numbers_against_their_rule_are_refused_where_they_stand() {
    let rows = [
        (
            "[stop]\nsteps = 0\n",
            "2:9: a whole number from 1 to 1000000000 is needed here, and this is 0",
        ),
        // As it stands there: the nearest number of 53 bits is another one.
        (
            "[stop]\nsteps = 9223372036854775807\n",
            "2:9: a whole number from 1 to 1000000000 is needed here, and this is 9223372036854775807",
        ),
        ("[stop]\nsteps = 1.5\n", "2:9: "),
        ("[pipeline]\nblur = -1\n", "2:8: a finite number above 0 is needed here, and this is -1"),
        ("[pipeline]\nblur = nan\n", "2:8: "),
        ("[loss]\nssim = 1.5\n", "2:8: a number from 0 to 1 is needed here, and this is 1.5"),
        ("[[meshes]]\nplace = { rotation = [0, 0, 0, 0] }\n", "2:"),
        ("[[lights]]\nkind = \"ambient\"\ncolor = [1, 1]\n", "1:"),
        ("seed = -1\n", "1:8: a whole number, 0 or above, is needed here, and this is -1"),
        ("meshes = [3]\n", "1:11: a table is needed here, and this is 3"),
        (
            "[[views]]\ncamera = { focal = [1, 0] }\n",
            "2:20: a finite number above 0 is needed here, or a list of two of them",
        ),
        ("a = \n", "1:5: "),
    ];
    for (text, expected) in rows {
        let said = said_of(text);
        assert!(said.starts_with(&format!("scene.toml:{expected}")), "{text:?}: {said}");
    }
}

#[test]
fn a_lens_has_one_opening() {
    let lens = |keys: &str| said_of(&format!("[pipeline]\nlens = {{ {keys} }}\n"));
    let own = |keys: &str| said_of(&format!("[[views]]\ncamera = {{}}\nlens = {{ {keys} }}\n"));
    assert_eq!(lens("aperture = 4, focus = 5, surfaces = 0, largest_radius = 20"), "fine");
    assert_eq!(lens("radius = 0.1, focus = 5"), "fine");
    assert_eq!(lens("radius = 0.1, focus = 5, samples = 8, slopes = true"), "fine");
    assert_eq!(lens("radius = 0.1, focus = 5, samples = 2, largest_radius = 512"), "fine");
    assert_eq!(lens("radius = 0.1, focus = 5, iris = { blades = 6, rotation = 15 }"), "fine");
    assert_eq!(own("focus = 5"), "fine");
    assert_eq!(own("aperture = 3"), "fine");
    let both = "a lens has either `aperture` or `radius`";
    for (said, expected) in [
        (lens("aperture = 4, radius = 0.1, focus = 5"), both),
        (own("aperture = 4, radius = 0.1"), both),
        (lens("focus = 5"), "a lens has `aperture` or `radius`"),
        (lens("aperture = 4"), "the key `focus` is missing"),
        (lens("aperture = -1, focus = 5"), "a finite number, 0 or above, is needed here"),
        (lens("aperture = 4, focus = 0"), "a finite number above 0 is needed here"),
        (lens("aperture = 4, focus = 5, surfaces = 9"), "a whole number from 0 to 8"),
        (lens("aperture = 4, focus = 5, largest_radius = 2000"), "a number from 1 to 1024"),
        (
            lens("aperture = 4, focus = 5, samples = 0"),
            "a whole number from 1 to 8 is needed here, and this is 0",
        ),
        (
            lens("aperture = 4, focus = 5, samples = 9"),
            "a whole number from 1 to 8 is needed here, and this is 9",
        ),
        (
            lens("aperture = 4, focus = 5, samples = 3, largest_radius = 400"),
            "`largest_radius` times `samples` is at most 1024, and this is 1200",
        ),
        (lens("aperture = 4, focus = 5, tolerance = 0.1"), "unknown key `tolerance`"),
        (lens("aperture = 4, focus = 5, iris = { blades = 2 }"), "a whole number from 3 to 16"),
        (own("surfaces = 2"), "unknown key `surfaces`"),
    ] {
        assert!(said.starts_with("scene.toml:") && said.contains(expected), "{said}");
    }
    // A resumed fit compares keys.
    let text =
        "[pipeline]\nlens = { radius = 0.5, focus = 5 }\n[learn.lens]\nper_view = [\"focus\"]\n";
    let keys = Description::parse(text, Path::new("scene.toml")).unwrap().keys();
    let value = |key: &str| keys.get(key).map(String::as_str);
    assert_eq!(value("pipeline.lens.radius"), Some("0.5"));
    assert_eq!(value("pipeline.lens.aperture"), None);
    assert_eq!(value("learn.lens.per_view"), Some("[\"focus\"]"));
}

#[test]
fn nesting_without_end_is_an_error() {
    let deep = format!("seed = {}", "[".repeat(1_000_000));
    assert!(said_of(&deep).starts_with("scene.toml:1:"));
    let dotted = format!("{}a = 1", "a.".repeat(1_000_000));
    assert!(said_of(&dotted).starts_with("scene.toml"));
}

#[test]
fn tables_and_lists_without_number_are_an_error() {
    let found = "at most 1048576 tables and lists of a description are read, and there are 1050001";
    let said = said_of(&format!("meshes = [{}]", "{},".repeat(1_050_000)));
    assert_eq!(said, format!("scene.toml: {found}"));
}

#[test]
fn the_schema_knows_every_key() {
    let schema: serde_json::Value = serde_json::from_str(&schema()).unwrap();
    let keys = schema["properties"].as_object().unwrap();
    for key in ["meshes", "views", "cameras", "pipeline", "learn", "stages", "stop"] {
        assert!(keys.contains_key(key), "{key}");
    }
    assert_eq!(schema["additionalProperties"], false);
    let steps = &schema["$defs"]["StopEntry"]["properties"]["steps"];
    assert_eq!((&steps["type"], &steps["minimum"]), (&"integer".into(), &1.into()), "{steps}");
    let about = steps["description"].as_str().unwrap();
    assert!(about.starts_with("After so many steps"), "{about}");
    // Editors offer no null, and offer keys behind a reference alone.
    let all = schema.to_string();
    assert!(!all.contains("null") && !all.contains("allOf"));
    let pipeline = &schema["properties"]["pipeline"];
    assert_eq!(pipeline["$ref"], "#/$defs/PipelineEntry");
}
