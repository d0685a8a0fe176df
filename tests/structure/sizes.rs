//! No function of the crates has more than 60 lines, unless its header says why it stays in one piece. (Entries
//! of the catalogue are lists, and studies of the laboratory columns of tables.)

use std::fs;
use std::path::{Path, PathBuf};

const MOST: usize = 60;

/// The Rust files of the crates that are no tests.
fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() && name != "tests" {
            sources(&path, files);
        } else if name.ends_with(".rs") && name != "tests.rs" {
            files.push(path);
        }
    }
}

/// The functions of a file that begin before its tests: their names, how many lines they have, and the
/// comment above each.
fn functions(text: &str) -> Vec<(String, usize, String)> {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
    let lines: Vec<&str> = code.lines().collect();
    let mut found = Vec::new();
    for (first, line) in lines.iter().enumerate() {
        let words = line.trim_start().trim_start_matches("pub ");
        let words = words.split_once(") ").map_or(words, |(visible, rest)| {
            if visible.starts_with("pub(") { rest } else { words }
        });
        let Some(rest) = words.trim_start_matches("const ").strip_prefix("fn ") else { continue };
        let indent = &line[..line.len() - line.trim_start().len()];
        let end = format!("{indent}}}");
        // A function of a trait without a body ends with its signature.
        let has_body = |line: &&str| line.ends_with('{') || line.ends_with(';');
        let Some(signature) = lines[first..].iter().position(has_body) else {
            continue;
        };
        if lines[first + signature].ends_with(';') {
            continue;
        }
        let count = lines[first..].iter().position(|line| *line == end).map_or(1, |last| last + 1);
        let is_above = |line: &&&str| line.trim_start().starts_with(['/', '#']);
        let above: Vec<&str> = lines[..first].iter().rev().take_while(is_above).copied().collect();
        let name = rest.split(['(', '<']).next().unwrap();
        found.push((name.to_owned(), count, above.join("\n")));
    }
    found
}

#[test]
fn long_functions_say_why_they_stay_in_one_piece() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates");
    let (mut files, mut count, mut long) = (Vec::new(), 0, Vec::new());
    for entry in fs::read_dir(&crates).unwrap().map(|entry| entry.unwrap()) {
        if entry.file_name() != "catalogue" {
            sources(&entry.path().join("src"), &mut files);
        }
    }
    for file in files {
        for (name, lines, above) in functions(&fs::read_to_string(&file).unwrap()) {
            count += 1;
            if lines > MOST && !above.contains("In one piece:") {
                long.push(format!("{}: {name}, {lines} lines", file.display()));
            }
        }
    }
    assert!(count > 2000, "only {count} functions were found");
    assert!(long.is_empty(), "functions with more than {MOST} lines:\n{}", long.join("\n"));
}
