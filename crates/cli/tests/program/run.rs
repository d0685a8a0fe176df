//! What tests of programs share: a run in a folder, what is printed, and the files that it leaves. The laboratory's
//! tests have this file, too.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// Runs a program in `folder`.
pub(crate) fn run(program: &str, folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(program);
    command.args(words).current_dir(folder).stdin(Stdio::null());
    command.output().expect("the program starts")
}

pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Writes a file, in a folder that is made where it is missing.
pub(crate) fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    fs::write(path, bytes).expect("a file");
}

/// Every file below a folder, hidden ones too, by path.
pub(crate) fn files(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else {
                let below = path.strip_prefix(folder).expect("below");
                names.push(below.to_string_lossy().replace('\\', "/"));
            }
        }
    }
    names.sort();
    names
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("text")
}

/// The object on standard output, alone there.
pub(crate) fn object(output: &Output) -> Value {
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    let value: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(text(&output.stdout).lines().count(), 1);
    value
}

/// The pages of a report load nothing from elsewhere.
pub(crate) fn loads_nothing(page: &str) {
    for loads in ["<script", "src=\"http", "href=\"http", "url(", "@import", "<link"] {
        assert!(!page.contains(loads), "{loads}");
    }
}
