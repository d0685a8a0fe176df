//! No operation is forgotten: each that is public has a subject in the catalogue, which does the operation itself,
//! and is compiled ahead by its crate.

use std::fs;
use std::path::{Path, PathBuf};

fn crates() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates")
}

/// The modules right inside a folder, by their names: Rust files, and of folders their `mod.rs`.
fn files(folder: &Path) -> Vec<(String, String)> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let file = |path: PathBuf| {
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let file = if path.is_dir() { path.join("mod.rs") } else { path };
        (name, fs::read_to_string(file).unwrap())
    };
    entries.map(file).filter(|(name, _)| name != "mod").collect()
}

/// The parts of a source file from a line that starts with `head` to the next one that is `}`.
fn blocks<'a>(source: &'a str, head: &str) -> Vec<&'a str> {
    let starts = source.match_indices(head).map(|(start, _)| start);
    let starts = starts.filter(|&start| start == 0 || source[..start].ends_with('\n'));
    starts.map(|start| source[start..].split("\n}\n").next().unwrap()).collect()
}

/// Whether `source` calls a function of that name, or a method where the name starts with a dot.
fn calls(source: &str, name: &str) -> bool {
    let is_other = |before: char| before.is_alphanumeric() || "_.".contains(before);
    let call = format!("{name}(");
    let mut before = source.match_indices(&call).map(|(start, _)| &source[..start]);
    before.any(|before| name.starts_with('.') || !before.ends_with(is_other))
}

/// The methods that the folders in an operation's folder give to pictures.
fn methods_of_pictures(folder: &Path) -> String {
    let entries = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    let files =
        entries.map(|path| path.join("mod.rs")).filter_map(|file| fs::read_to_string(file).ok());
    files.map(|file| blocks(&file, "impl<'t, T: Scalar> Picture<'t, T>").concat()).collect()
}

/// The functions that `bokashi-render-ops` exports, and the methods of what lies on a tape, each with a dot
/// before its name.
fn rendering() -> [Vec<String>; 2] {
    let source = crates().join("render-ops/src");
    let library = fs::read_to_string(source.join("lib.rs")).unwrap();
    // Lists of names go over several lines.
    let exports = library.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next());
    let functions = exports.flat_map(|path| {
        let names = path.split("::").last().unwrap_or_default().split(',');
        names.map(|name| name.trim_matches(|c: char| "{}".contains(c) || c.is_whitespace()))
    });
    // It records what the others do.
    let others = ["glam", "render"];
    let is_operation =
        |name: &&str| name.starts_with(|c: char| c.is_ascii_lowercase()) && !others.contains(name);
    let functions: Vec<_> = functions.filter(is_operation).map(str::to_owned).collect();
    let modules = library.lines().filter_map(|line| line.strip_prefix("mod "));
    let methods = modules.flat_map(|module| {
        let module = source.join(module.trim_end_matches(';'));
        let files = [module.with_extension("rs"), module.join("mod.rs")];
        let file = files.iter().find_map(|file| fs::read_to_string(file).ok());
        let mut blocks = blocks(&file.expect("the module is there"), "impl<'t, ").concat();
        blocks += &methods_of_pictures(&module);
        let methods = blocks.lines().filter_map(|line| line.strip_prefix("    pub fn "));
        let names = methods.map(|method| format!(".{}", method.split(['(', '<']).next().unwrap()));
        names.collect::<Vec<_>>()
    });
    [functions, methods.collect()]
}

/// The functions that `bokashi-fit` gives for losses, but those without a tape.
fn losses() -> Vec<String> {
    let folders = ["losses", "regularizers"].map(|folder| crates().join("fit/src").join(folder));
    let files = folders.iter().flat_map(|folder| files(folder));
    let names = files.flat_map(|(_, text)| {
        let code = text.split("#[cfg(test)]").next().unwrap();
        let public = code.lines().filter_map(|line| line.trim().strip_prefix("pub fn "));
        let names = public.filter_map(|line| {
            let name: String =
                line.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            let declared = code.split(&format!("pub fn {name}<")).nth(1).unwrap_or_default();
            let is_on_a_tape = declared.split('{').next().is_some_and(|d| d.contains("Var<"));
            is_on_a_tape.then_some(name)
        });
        names.collect::<Vec<_>>()
    });
    names.collect()
}

/// The functions of `bokashi-mesh` that record something, and those whose results do.
fn on_meshes() -> Vec<String> {
    let source = crates().join("mesh/src");
    let library = fs::read_to_string(source.join("lib.rs")).unwrap();
    let modules = library.lines().filter_map(|line| line.strip_prefix("mod "));
    let texts = modules.flat_map(|module| {
        let module = source.join(module.trim_end_matches(';'));
        let inner = if module.is_dir() { files(&module) } else { Vec::new() };
        let own = [module.with_extension("rs"), module.join("mod.rs")];
        let own = own.iter().find_map(|file| fs::read_to_string(file).ok());
        inner.into_iter().map(|(_, text)| text).chain(own)
    });
    let names = texts.flat_map(|text| {
        let code = text.split("#[cfg(test)]").next().unwrap().to_owned();
        let functions = code.split("\npub fn ").skip(1).filter_map(|function| {
            let (head, _) = function.split_once('{')?;
            let is_on_a_tape = head.contains("Var<") || function.starts_with("draw_points");
            is_on_a_tape.then(|| head.split(['<', '(']).next().unwrap_or_default().to_owned())
        });
        functions.collect::<Vec<_>>()
    });
    names.collect()
}

/// The sources of the catalogue's entries in a folder, one after the other.
fn entries(folder: &str) -> String {
    let files = files(&crates().join("catalogue/src").join(folder)).into_iter();
    files.map(|(_, text)| text).collect()
}

#[test]
fn every_operation_on_tensors_has_an_entry() {
    let catalogue = fs::read_to_string(crates().join("catalogue/src/tensors/mod.rs")).unwrap();
    let operations = files(&crates().join("core/src/ops"));
    assert!(operations.len() > 20);
    for (name, _) in operations {
        let row = format!("\noperation!({name}\n");
        assert!(catalogue.contains(&row), "{name} has no entry");
    }
}

#[test]
fn every_rendering_operation_has_an_entry() {
    let [functions, methods] = rendering();
    assert!(functions.len() > 30, "{functions:?}");
    assert!(methods.len() >= 3, "{methods:?}");
    // What a subject does itself, under the name that it has: another function could do anything.
    let catalogue = entries("rendering");
    let subjects = blocks(&catalogue, "impl Subject for ").concat();
    for name in functions.iter().chain(&methods) {
        // An associated function stands behind the name of its type.
        let is_called =
            calls(&subjects, name) || subjects.contains(&format!(":{}(", name.replace('.', ":")));
        assert!(is_called, "{name} has no entry");
        let others = ["(", "<"].map(|end| format!("fn {}{end}", name.trim_start_matches('.')));
        assert!(!others.iter().any(|other| catalogue.contains(other)), "{name} is something else");
    }
    assert!(!calls("deep_blur(x).blur(x)", "blur") && !calls("blur(x)", ".blur"));
}

#[test]
fn every_loss_has_an_entry() {
    let (losses, catalogue) = (losses(), entries("losses"));
    assert!(losses.len() >= 13, "only {losses:?} were found");
    for name in losses {
        assert!(catalogue.contains(&format!("{name}(")), "{name} has no entry");
    }
}

#[test]
fn every_operation_on_meshes_has_an_entry_with_a_benchmark_and_is_compiled_ahead() {
    let (operations, catalogue) = (on_meshes(), entries("meshes"));
    assert!(operations.len() >= 3, "only {operations:?} were found");
    let ahead = fs::read_to_string(crates().join("mesh/src/precompiled.rs")).unwrap();
    for name in operations {
        let subjects = blocks(&catalogue, "impl Subject for ").concat();
        assert!(calls(&subjects, &name), "{name} has no entry");
        assert!(
            catalogue.contains(&format!("benchmark!(entry, \"{name}\"")),
            "{name} has no benchmark"
        );
        assert!(calls(&ahead, &name), "{name} is not compiled ahead");
    }
}

/// What none of them records has neither a time, nor a proof that it takes no memory and has the same bits on
/// any number of threads.
#[test]
fn every_operation_has_a_benchmark() {
    let tensors = fs::read_to_string(crates().join("catalogue/src/tensors/mod.rs")).unwrap();
    let catalogue: String =
        (tensors + &entries("rendering")).split_whitespace().collect::<Vec<_>>().concat();
    let [functions, _] = rendering();
    // These record what others do; a composite at pixel centres has nothing to do, but for its image.
    let others = [
        "interpolate_indexed",
        "interpolate_differentials_indexed",
        "rasterize_behind",
        "depth_layers",
        "eye_depth_slope",
        "composite",
        "exposure",
    ];
    let functions = functions.into_iter().filter(|name| !others.contains(&name.as_str()));
    let of_tensors = files(&crates().join("core/src/ops")).into_iter().map(|(name, _)| name);
    for name in functions.chain(of_tensors) {
        let starts = [format!("entry,\"{name}\""), format!("entry,\"{name},")];
        let is_there = starts.iter().any(|start| catalogue.contains(start));
        assert!(
            is_there || catalogue.contains(&format!("\"{name}\":|s|")),
            "{name} has no benchmark"
        );
    }
}

/// With `precompiled-f64`, which tests and Python have. What is not named there is compiled where it is used: it costs
/// time, silently.
#[test]
fn every_operation_is_compiled_ahead() {
    let source = |path: &str| fs::read_to_string(crates().join(path)).unwrap();
    let tensors = source("core/src/precompiled.rs");
    // They are operators there.
    let operators = ["add", "sub", "mul", "div", "affine"];
    let operations = files(&crates().join("core/src/ops")).into_iter().map(|(name, _)| name);
    for name in operations.filter(|name| !operators.contains(&name.as_str())) {
        // The product of a sparse matrix is a method of it.
        let name = name.replace("sparse_product", "product");
        assert!(tensors.contains(&format!("{name}(")), "{name} is not compiled ahead");
    }
    let [functions, _] = rendering();
    let ahead = source("render-ops/src/precompiled.rs");
    // These record what others do.
    let others = [
        "interpolate_indexed",
        "interpolate_differentials_indexed",
        "rasterize_behind",
        "depth_layers",
        "eye_depth_slope",
        "irradiance",
    ];
    for name in functions.iter().filter(|name| !others.contains(&name.as_str())) {
        assert!(calls(&ahead, name), "{name} is not compiled ahead");
    }
    let ahead = source("fit/src/precompiled.rs");
    // These are the mean error's, one of similarity at several scales, and an operation of the caller's.
    let others = ["weighted_error", "masked_error", "halved", "pyramid_error"];
    for name in losses().iter().filter(|name| !others.contains(&name.as_str())) {
        assert!(ahead.contains(&format!("{name}(")), "{name} is not compiled ahead");
    }
}
