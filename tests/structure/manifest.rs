//! Every test file and every example is listed in its manifest, or in the `main.rs` of its folder: with
//! `autotests = false` and `autoexamples = false` a forgotten file would never run. And every file that
//! the documents name is there.

use std::fs;
use std::path::{Path, PathBuf};

/// The project's folder.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The names of the Rust files right inside `directory`.
fn sources(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let sources = entries.filter(|path| path.extension().is_some_and(|ending| ending == "rs"));
    sources.map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect()
}

/// Asserts it of the Rust files right inside `directory`, and returns how many there are.
fn assert_all_listed(directory: &Path) -> usize {
    let manifest = fs::read_to_string(directory.join("Cargo.toml")).unwrap();
    let sources = sources(directory);
    for source in &sources {
        let listed = manifest.lines().any(|line| line == format!("path = \"{source}\""));
        assert!(listed, "{} is missing from {}/Cargo.toml", source, directory.display());
    }
    sources.len()
}

#[test]
fn every_file_of_a_test_of_several_files_is_a_module_of_it() {
    let root = root();
    let folders = fs::read_dir(root.join("tests")).unwrap().map(|entry| entry.unwrap().path());
    let folders = folders.filter(|path| path.is_dir() && !sources(path).is_empty());
    let others = [
        "lab/tests",
        "crates/cli/tests/program",
        "crates/core/tests/operations",
        "crates/mesh/tests/operations",
        "crates/render-ops/tests/operations",
        "crates/scene/tests/scenes",
    ];
    let mut count = 0;
    for folder in folders.chain(others.map(|folder| root.join(folder))) {
        let name = folder.display();
        // A folder is a test of the package above it, or a package.
        let manifests = folder.ancestors().take(3).map(|package| package.join("Cargo.toml"));
        let manifest = manifests.into_iter().find(|file| file.is_file()).unwrap();
        let path = folder.strip_prefix(manifest.parent().unwrap()).unwrap().join("main.rs");
        let line = format!("path = \"{}\"", path.display());
        let text = fs::read_to_string(&manifest).unwrap();
        // Without `autotests = false` cargo finds the folder itself.
        let is_found = !text.contains("autotests = false");
        let listed = is_found || text.lines().any(|listed| listed == line);
        assert!(listed, "{name}/main.rs is missing from {}", manifest.display());
        let main = fs::read_to_string(folder.join("main.rs")).unwrap();
        for file in sources(&folder).iter().filter(|file| *file != "main.rs") {
            let module = format!("mod {};", file.trim_end_matches(".rs"));
            assert!(main.lines().any(|line| line == module), "{name}/main.rs has no {module}");
            count += 1;
        }
    }
    assert!(count > 20, "only {count} files were found");
}

#[test]
fn every_example_is_listed() {
    assert!(assert_all_listed(&root().join("examples")) > 0);
}

#[test]
fn every_file_that_a_document_names_exists() {
    let root = root();
    let mut named = 0;
    for page in pages(&root) {
        let document = page.display();
        let text = fs::read_to_string(&page).unwrap();
        let words = text.split(|c: char| c.is_whitespace() || "`()[],;:".contains(c));
        let is_path = |word: &&str| {
            ["docs/", "examples/", "tests/", "crates/", "lab/"]
                .iter()
                .any(|folder| word.starts_with(folder))
        };
        for path in words.filter(is_path) {
            assert!(root.join(path).exists(), "{document} names {path}, which is not there");
            named += 1;
        }
        assert!(!text.contains("@@"), "{document} holds a placeholder");
    }
    assert!(named > 10, "only {named} paths were found");
}

/// The pages in Markdown, in all folders but hidden ones and those that `.gitignore` names.
fn pages(root: &Path) -> Vec<PathBuf> {
    let ignored = fs::read_to_string(root.join(".gitignore")).unwrap();
    let ignored: Vec<_> = ignored.lines().map(|line| root.join(&line[1..])).collect();
    let (mut folders, mut pages) = (vec![root.to_owned()], Vec::new());
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let is_hidden = path.file_name().unwrap().to_str().unwrap().starts_with('.');
            match path.extension() {
                _ if is_hidden || ignored.contains(&path) => {}
                _ if path.is_dir() => folders.push(path),
                Some(ending) if ending == "md" => pages.push(path),
                _ => {}
            }
        }
    }
    pages
}

#[test]
fn every_link_between_pages_leads_to_a_file_and_a_heading() {
    let root = root();
    let mut count = 0;
    for page in pages(&root) {
        let text = fs::read_to_string(&page).unwrap();
        let links = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for link in links.filter(|link| !link.starts_with("http") && !link.contains(' ')) {
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() { page.clone() } else { page.with_file_name(file) };
            assert!(target.exists(), "{} links to {link}, which is not there", page.display());
            let is_heading = |line: &str| line.starts_with('#') && anchor(line) == heading;
            assert!(
                heading.is_empty() || fs::read_to_string(&target).unwrap().lines().any(is_heading),
                "{} links to {link}, and there is no such heading",
                page.display()
            );
            count += 1;
        }
    }
    assert!(count > 10, "only {count} links were found");
}

/// The name under which readers of Markdown find a heading.
fn anchor(heading: &str) -> String {
    let title = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}
