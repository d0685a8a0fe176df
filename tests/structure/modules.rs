//! The modules of a crate and what each of them imports, read from its files.
//!
//! Tests are left out: they may look anywhere. A re-export is no import: who names it imports the
//! file that it leads to.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A module by its path from the root of its crate; the root's is empty.
pub(crate) type Module = Vec<String>;

/// A module's file as it is read.
#[derive(Debug, Default)]
struct Source {
    /// Paths in `use` items, segment by segment.
    uses: Vec<Module>,
    /// Those of `pub use` items: what the module re-exports.
    exports: Vec<Module>,
    /// Paths elsewhere in the code that begin with `crate`, `super`, `self` or a module below.
    inline: Vec<Module>,
}

/// The modules of a crate, and which of its own modules each of them imports.
pub(crate) fn imports(root: &Path) -> BTreeMap<Module, BTreeSet<Module>> {
    let mut sources = BTreeMap::new();
    read(root, Vec::new(), &mut sources);
    let names: BTreeSet<Module> = sources.keys().cloned().collect();
    let found = sources.iter().map(|(module, source)| {
        let paths = source.uses.iter().chain(&source.inline);
        let mut found: BTreeSet<_> =
            paths.filter_map(|path| resolved(module, path, &names, &sources)).collect();
        found.remove(module);
        (module.clone(), found)
    });
    found.collect()
}

/// The module that `path` leads to from `module`; `None` for one of another crate.
fn resolved(
    module: &Module,
    path: &Module,
    names: &BTreeSet<Module>,
    sources: &BTreeMap<Module, Source>,
) -> Option<Module> {
    let mut at = module.clone();
    let mut rest = &path[..];
    match rest.first()?.as_str() {
        "crate" => (at, rest) = (Module::new(), &rest[1..]),
        "self" => rest = &rest[1..],
        "super" => {
            while rest.first().is_some_and(|segment| segment == "super") {
                at.pop();
                rest = &rest[1..];
            }
        }
        first => {
            if !names.contains(&[at.as_slice(), &[first.to_owned()]].concat()) {
                return None;
            }
        }
    }
    while let Some((first, further)) = rest.split_first() {
        let below = [at.as_slice(), std::slice::from_ref(first)].concat();
        if !names.contains(&below) {
            let export = sources[&at].exports.iter().find(|export| export.last() == Some(first));
            // A re-export of another crate's is nobody's here.
            return export.map_or(Some(at.clone()), |export| resolved(&at, export, names, sources));
        }
        (at, rest) = (below, further);
    }
    Some(at)
}

/// Reads the file `path` of the module `module`, and those of the modules below. The files are
/// formatted: what begins at the start of a line and spans several ends with a brace at the start of
/// one, or with a semicolon.
fn read(path: &Path, module: Module, sources: &mut BTreeMap<Module, Source>) {
    let text = fs::read_to_string(path).unwrap();
    let (mut source, mut below, mut rest) = (Source::default(), Vec::new(), String::new());
    let mut lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    while let Some(line) = lines.next() {
        if line == "#[cfg(test)]" {
            let item = lines.find(|line| !line.starts_with("#[")).unwrap();
            if !item.ends_with(';') {
                lines.find(|line| *line == "}").unwrap();
            }
            continue;
        }
        let item = without_visibility(line);
        if let Some(name) = item.strip_prefix("mod ").and_then(|name| name.strip_suffix(';')) {
            below.push(name.to_owned());
        } else if let Some(start) = item.strip_prefix("use ") {
            let mut tree = start.to_owned();
            while !tree.ends_with(';') {
                tree.push_str(lines.next().unwrap());
            }
            let is_export = line.starts_with("pub");
            let list = if is_export { &mut source.exports } else { &mut source.uses };
            paths(tree.trim_end_matches(';'), &[], list);
        } else {
            let code = line.split("// ").next().unwrap_or_default();
            rest.push_str(without_visibility(code.trim_start()));
            rest.push('\n');
        }
    }
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    for word in rest.split(|c| !is_path(c)) {
        let segments = word.split("::").filter(|segment| !segment.is_empty());
        let path: Module = segments.map(str::to_owned).collect();
        let leads_here = path.first().is_some_and(|first| {
            matches!(first.as_str(), "crate" | "super") || below.contains(first)
        });
        if path.len() > 1 && leads_here {
            source.inline.push(path);
        }
    }
    let folder = match path.file_stem().unwrap().to_str().unwrap() {
        "lib" | "main" | "mod" => path.parent().unwrap().to_owned(),
        name => path.with_file_name(name),
    };
    for name in below {
        let files = [folder.join(format!("{name}.rs")), folder.join(&name).join("mod.rs")];
        let file: Option<&PathBuf> = files.iter().find(|file| file.is_file());
        let file = file.unwrap_or_else(|| panic!("{} has no module {name}", path.display()));
        read(file, [module.as_slice(), &[name]].concat(), sources);
    }
    sources.insert(module, source);
}

/// An item without `pub` or `pub(...)`.
fn without_visibility(line: &str) -> &str {
    let Some(rest) = line.strip_prefix("pub") else { return line };
    let rest = match rest.strip_prefix('(').and_then(|rest| rest.split_once(')')) {
        Some((_, rest)) => rest,
        None => rest,
    };
    rest.trim_start()
}

/// The paths of a `use` tree.
fn paths(tree: &str, before: &[String], found: &mut Vec<Module>) {
    let tree = tree.trim();
    let (head, group) = match tree.split_once('{') {
        Some((head, group)) => (head, Some(group.trim_end().strip_suffix('}').unwrap())),
        None => (tree, None),
    };
    let head = head.split(" as ").next().unwrap_or_default();
    let segments = head.split("::").map(str::trim).filter(|segment| !segment.is_empty());
    let path: Module = before.iter().cloned().chain(segments.map(str::to_owned)).collect();
    let Some(group) = group else {
        // `a::{self}` is `a`, and `a::*` too.
        let is_whole =
            path.len() > 1 && path.last().is_some_and(|last| last == "self" || last == "*");
        found.push(if is_whole { path[..path.len() - 1].to_vec() } else { path });
        return;
    };
    let (mut start, mut depth) = (0, 0_usize);
    for (at, c) in group.char_indices().chain([(group.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if !group[start..at].trim().is_empty() {
                    paths(&group[start..at], &path, found);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}
