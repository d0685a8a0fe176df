//! Names of files, and which names are those of files on this system and on others.

use std::collections::HashMap;
use std::path::Path;

/// Characters that no file's name has on Windows.
const FORBIDDEN: [char; 7] = ['<', '>', ':', '"', '|', '?', '*'];
/// Names of devices there, whatever follows them after a dot.
const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];
/// Likewise, with a digit.
const NUMBERED: [&str; 2] = ["com", "lpt"];

/// A path's last part without its ending.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Whether a file of a folder can have this name.
pub(crate) fn is_file_name(name: &str) -> bool {
    !name.is_empty() && !name.contains(['/', '\\', '\0']) && name != "." && name != ".."
}

/// What is to be said of names of meshes or views, `what`, of which results are called: nothing where each of them
/// is the name of a file of its own on every system.
pub(crate) fn notes_of_names<'a>(
    what: &str,
    names: impl Iterator<Item = &'a String>,
) -> Vec<String> {
    let (mut notes, mut seen) = (Vec::new(), HashMap::new());
    for name in names {
        if let Some(other) = seen.insert(name.to_lowercase(), name) {
            notes.push(format!(
                "{what} {other:?} and {name:?} differ in case alone: their files are one where a file system \
                 minds no case"
            ));
        }
        if !is_portable(name) {
            notes.push(format!("{what} {name:?} has a name that no file may have on Windows"));
        }
    }
    notes
}

fn is_portable(name: &str) -> bool {
    let first = name.split('.').next().unwrap_or(name).trim_end().to_lowercase();
    let is_numbered = |kind: &str| {
        first.strip_prefix(kind).is_some_and(|rest| matches!(rest.as_bytes(), [b'1'..=b'9']))
    };
    !name.contains(|c: char| FORBIDDEN.contains(&c) || c.is_ascii_control())
        && !DEVICES.contains(&&*first)
        && !NUMBERED.iter().any(|kind| is_numbered(kind))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_another_system_does_not_take_are_noted() {
        let notes = |names: &[&str]| {
            let names: Vec<_> = names.iter().map(|&name| name.to_owned()).collect();
            notes_of_names("the views", names.iter())
        };
        assert_eq!(notes(&["a", "b", "A1", "ü.x", "console", "com", "com10", "nulls"]), [""; 0]);
        let message = notes(&["a", "b", "A"]);
        assert_eq!(message.len(), 1);
        assert!(
            message[0].starts_with("the views \"a\" and \"A\" differ in case alone"),
            "{message:?}"
        );
        for name in ["con", "NUL", "aux.1", "Com1", "lpt9.x", "12:30", "a?", "a\u{7}"] {
            assert!(notes(&[name])[0].contains("Windows"), "{name}");
        }
    }
}
