//! Imports run one way: between crates, between the files of a crate, and from floor to floor as the
//! tables of docs/architecture-floors.md have them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::modules::{Module, imports};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The crates by name, with their folders.
fn crates() -> BTreeMap<String, PathBuf> {
    let folders = fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let folders = folders.chain([root().join("lab")]);
    let named = folders.map(|folder| {
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let name = manifest.lines().find_map(|line| line.strip_prefix("name = ")).unwrap();
        (name.trim_matches('"').to_owned(), folder)
    });
    named.collect()
}

/// The files that begin a crate: its library, and its program.
fn roots(folder: &Path) -> Vec<PathBuf> {
    let all = ["src/lib.rs", "src/main.rs"].map(|file| folder.join(file));
    all.into_iter().filter(|file| file.is_file()).collect()
}

/// The tables of docs/architecture-floors.md whose heading begins with `heading`: what the rest of the
/// heading names, and the floor of each name in the second column.
fn tables(heading: &str) -> Vec<(String, Vec<(String, usize)>)> {
    let page = fs::read_to_string(root().join("docs/architecture-floors.md")).unwrap();
    let sections = page.split("\n### ").filter_map(|section| section.strip_prefix(heading));
    let read = |section: &str| {
        let (subject, body) = section.split_once('\n').unwrap();
        let rows = body.lines().skip_while(|line| !line.starts_with('|'));
        let rows = rows.take_while(|line| line.starts_with('|')).skip(2);
        let floors = rows.enumerate().flat_map(|(floor, row)| {
            let names = row.split('|').nth(2).unwrap().split('`').skip(1).step_by(2);
            names.map(move |name| (name.trim_end_matches('/').to_owned(), floor))
        });
        (subject.replace('`', "").trim().to_owned(), floors.collect())
    };
    sections.map(read).collect()
}

/// The files and folders right inside `within`, and which others of them each imports.
fn units(
    within: &[String],
    imports: &BTreeMap<Module, BTreeSet<Module>>,
) -> BTreeMap<String, BTreeSet<String>> {
    let unit = |module: &Module| module.strip_prefix(within).and_then(|rest| rest.first()).cloned();
    let mut found = BTreeMap::<_, BTreeSet<_>>::new();
    for (module, imported) in imports {
        let Some(own) = unit(module) else { continue };
        let others = imported.iter().filter_map(unit).filter(|other| *other != own);
        found.entry(own.clone()).or_default().extend(others);
    }
    found
}

/// A circle in `graph`, if there is one: its members in order.
fn circle<N: Ord + Clone>(graph: &BTreeMap<N, BTreeSet<N>>) -> Option<Vec<N>> {
    // Whoever imports nothing that is left is in no circle.
    let mut left = graph.clone();
    while let Some(end) =
        left.keys().find(|name| left[*name].iter().all(|to| !left.contains_key(to)))
    {
        let end = end.clone();
        left.remove(&end);
    }
    let mut way = vec![left.keys().next()?.clone()];
    loop {
        let next = left[way.last()?].iter().find(|to| left.contains_key(*to))?.clone();
        if let Some(start) = way.iter().position(|name| *name == next) {
            return Some(way.split_off(start));
        }
        way.push(next);
    }
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    for (name, folder) in crates() {
        for root in roots(&folder) {
            let imports = imports(&root);
            let found =
                circle(&imports).map(|way| way.iter().map(|m| m.join("/")).collect::<Vec<_>>());
            assert_eq!(found, None, "files of {name} import each other");
        }
    }
}

#[test]
fn a_file_imports_only_from_its_own_floor_and_those_below() {
    let (crates, tables) = (crates(), tables("Floors of "));
    for (name, folder) in &crates {
        let units = units(&[], &imports(&folder.join("src/lib.rs")));
        let has_table = tables.iter().any(|(subject, _)| subject == name);
        assert!(
            has_table || units.is_empty(),
            "docs/architecture-floors.md has no floors of {name}"
        );
    }
    for (subject, floors) in tables {
        let (name, within) = subject.split_once(", ").unwrap_or((&subject, ""));
        let within: Module =
            within.split('/').filter(|w| !w.is_empty()).map(str::to_owned).collect();
        let found = units(&within, &imports(&crates[name].join("src/lib.rs")));
        let floor_of: BTreeMap<_, _> = floors.iter().cloned().collect();
        assert_eq!(floor_of.len(), floors.len(), "{subject} has a file on two floors");
        let listed: BTreeSet<_> = floor_of.keys().collect();
        // It stands above all: nobody calls it, and it names everything.
        let files: BTreeSet<_> = found.keys().filter(|name| *name != "precompiled").collect();
        assert_eq!(listed, files, "the floors of {subject} name other files than there are");
        for (file, imported) in found.iter().filter(|(file, _)| *file != "precompiled") {
            for other in imported {
                assert!(floor_of[other] <= floor_of[file], "{subject}: {file} imports {other}");
            }
        }
    }
}

#[test]
fn operations_do_not_import_operations() {
    let crates = crates();
    let of = |name: &str, within: &[&str]| {
        let within: Vec<String> = within.iter().map(|&segment| segment.to_owned()).collect();
        units(&within, &imports(&crates[name].join("src/lib.rs")))
    };
    let on_tensors = of("bokashi-core", &["ops"]);
    let floors =
        tables("Floors of ").into_iter().find(|(name, _)| name == "bokashi-render-ops").unwrap().1;
    // Above them stands what is composed of operations.
    let (_, own) = *floors.iter().find(|(name, _)| name == "rasterize").unwrap();
    let rendering: BTreeSet<_> =
        floors.into_iter().filter(|(_, floor)| *floor == own).map(|(name, _)| name).collect();
    let mut on_surfaces = of("bokashi-render-ops", &[]);
    on_surfaces.retain(|name, _| rendering.contains(name));
    assert!(on_tensors.len() > 20 && on_surfaces.len() > 5);
    for (name, imported) in on_tensors.iter().chain(&on_surfaces) {
        let others = imported
            .iter()
            .filter(|other| on_tensors.contains_key(*other) || rendering.contains(*other));
        assert_eq!(others.collect::<Vec<_>>(), Vec::<&String>::new(), "{name} imports operations");
    }
}

/// A dependency of examples that none of them imports: with it the examples and the program are built with
/// the same features of all crates, so that the engine is compiled once for both.
const DEPENDENCY_FOR_FEATURES: (&str, &str) = ("bokashi-examples", "bokashi-cli");

#[test]
fn crates_depend_on_floors_below_alone() {
    let [(_, floors)] = &tables("The crates' floors")[..] else { panic!("one table of crates") };
    let floor_of: BTreeMap<_, _> = floors.iter().cloned().collect();
    let mut crates = crates();
    // The samples, which the program runs; their files have no floors.
    crates.insert("bokashi-examples".to_owned(), root().join("examples"));
    assert_eq!(floor_of.keys().collect::<Vec<_>>(), crates.keys().collect::<Vec<_>>());
    for (name, folder) in &crates {
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        // Those of its tests and benchmarks too.
        let others = manifest.lines().filter_map(|line| line.split(['.', ' ']).next());
        let others = others.filter(|other| floor_of.contains_key(*other));
        for other in others.filter(|other| (name.as_str(), *other) != DEPENDENCY_FOR_FEATURES) {
            assert!(floor_of[other] < floor_of[name], "{name} depends on {other}");
        }
    }
}

#[test]
fn no_example_imports_the_program() {
    let mut folders = vec![root().join("examples")];
    let mut count = 0;
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                assert!(!text.contains("bokashi_cli"), "{} imports the program", path.display());
                count += 1;
            }
        }
    }
    assert!(count > 10, "only {count} files were found");
}

/// What the tests above rest on: circles and floors are seen where there are some.
#[test]
fn a_circle_is_found_and_a_tree_has_none() {
    let graph = |edges: &[(&'static str, &[&'static str])]| -> BTreeMap<_, BTreeSet<_>> {
        edges.iter().map(|&(from, to)| (from, to.iter().copied().collect())).collect()
    };
    assert_eq!(circle(&graph(&[("a", &["b", "c"]), ("b", &["c"]), ("c", &[])])), None);
    let found = circle(&graph(&[("a", &["b"]), ("b", &["c"]), ("c", &["b"]), ("d", &[])]));
    assert_eq!(found, Some(vec!["b", "c"]));
}
