//! Mesh files of other people: which load, and why the others don't.
//!
//! [`walk`] loads each mesh file below a folder. A file is loaded where its model comes back the same from the
//! files that are written of it, refused where the reader says why, and broken where anything else happens.

use std::fs;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use bokashi_report::{Cell, Table};
use bokashi_scene::{
    Folder, Geometry, MeshKind, MeshOptions, Model, SceneError, glb, ply, read_model_bytes,
    read_model_with,
};
use glam::{DMat4, DVec3};
use serde::Serialize;

/// The endings of names of mesh files.
const FORMATS: [&str; 4] = ["obj", "ply", "gltf", "glb"];

/// What came of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It was loaded.
    Loaded {
        /// The faces of its meshes, each once.
        faces: usize,
        /// What was left out or mended.
        notes: Vec<String>,
    },
    /// The reader refused it, and said why.
    Refused(String),
    /// A panic, or a model that is another one after it was written and read.
    Broken(String),
}

/// A file, and what came of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct WalkedFile {
    /// Its path below the folder.
    pub path: PathBuf,
    /// The ending of its name, one of four.
    pub format: &'static str,
    /// What came of it.
    pub outcome: Outcome,
}

/// How many files of a format there are, and how many of them load: `obj=18/25`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Expected {
    /// The ending of their names.
    pub format: &'static str,
    /// Those that load.
    pub loaded: usize,
    /// All.
    pub files: usize,
}

impl FromStr for Expected {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = || {
            let (format, counts) = text.split_once('=')?;
            let (loaded, files) = counts.split_once('/')?;
            let format = FORMATS.into_iter().find(|known| *known == format)?;
            Some(Self { format, loaded: loaded.parse().ok()?, files: files.parse().ok()? })
        };
        parts().ok_or_else(|| {
            let formats = FORMATS.join(", ");
            format!("needs a format and two counts, as obj=18/25; the formats are {formats}")
        })
    }
}

/// Loads every mesh file below `folder`, in the order of their paths; `on_file` is told each before its turn.
/// Links to folders are not followed.
///
/// # Errors
/// Where a folder can't be read.
pub fn walk(folder: &Path, on_file: &mut dyn FnMut(&Path)) -> Result<Vec<WalkedFile>, SceneError> {
    let inside = Folder::new(folder)?;
    let mut files = Vec::new();
    let mut open = vec![PathBuf::new()];
    while let Some(next) = open.pop() {
        let path = folder.join(&next);
        let failed = |error: io::Error| SceneError::Read { path: path.clone(), error };
        for entry in fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let below = next.join(entry.file_name());
            match entry.file_type().map_err(failed)?.is_dir() {
                true => open.push(below),
                false => files.extend(format_of(&below).map(|format| (below, format))),
            }
        }
    }
    files.sort();
    let walked = files.into_iter().map(|(path, format)| {
        on_file(&path);
        let outcome = catch_unwind(AssertUnwindSafe(|| outcome(&inside, &path)));
        let outcome = outcome.unwrap_or_else(|_| Outcome::Broken("the reader panics".to_owned()));
        WalkedFile { path, format, outcome }
    });
    Ok(walked.collect())
}

fn format_of(path: &Path) -> Option<&'static str> {
    let ending = path.extension()?.to_str()?.to_lowercase();
    FORMATS.into_iter().find(|format| *format == ending)
}

fn outcome(folder: &Folder, path: &Path) -> Outcome {
    // What is written doubles vertices at seams: only welded ones come back.
    let options = MeshOptions { weld: Some(true), ..MeshOptions::default() };
    let model = match read_model_with(folder, path, options) {
        Ok(model) => model,
        Err(error) => {
            let message = error.to_string();
            // Without the folder, the same words stand in every report.
            let prefix = format!("{}{}", folder.path().display(), std::path::MAIN_SEPARATOR);
            return Outcome::Refused(message.replace(&prefix, ""));
        }
    };
    match comes_back(&model, folder) {
        Ok(true) => {
            let faces = model.geometries.iter().map(|geometry| geometry.faces.len()).sum();
            Outcome::Loaded { faces, notes: model.notes }
        }
        Ok(false) => Outcome::Broken("written and read, it is another model".to_owned()),
        Err(error) => Outcome::Broken(format!("it can't be written and read: {error}")),
    }
}

/// Whether a model's meshes are the same after they were written as GLB and read, and so are their faces as
/// PLY, which has colours of 8 bits.
fn comes_back(model: &Model, folder: &Folder) -> Result<bool, SceneError> {
    let options = MeshOptions::default();
    let back = read_model_bytes(&glb(model)?, MeshKind::Gltf, folder, "written.glb", options)?;
    // Nodes have what was taken off positions.
    let bare = |geometry: &Geometry| Geometry { offset: DVec3::ZERO, ..geometry.clone() };
    let mut same = back.geometries == model.geometries.iter().map(bare).collect::<Vec<_>>();
    for geometry in &model.geometries {
        let written =
            ply(geometry, &[DMat4::from_translation(geometry.offset)], &model.materials, |_| None)?;
        let back = read_model_bytes(&written, MeshKind::Ply, folder, "written.ply", options)?;
        same &= back.geometries.len() == 1 && back.geometries[0].faces == geometry.faces;
    }
    Ok(same)
}

/// How many files of each format there are and what came of them, then each that was not loaded and why.
pub fn markdown(walked: &[WalkedFile]) -> String {
    let mut counts = Table::new(
        "models",
        "Files",
        &[
            ("format", "format"),
            ("files", "files"),
            ("loaded", "loaded"),
            ("refused", "refused"),
            ("broken", "broken"),
        ],
    );
    for format in FORMATS {
        let [loaded, refused, broken] = count(walked, format);
        let cells = [loaded + refused + broken, loaded, refused, broken].map(Cell::Count);
        counts.push([vec![Cell::text(format)], cells.to_vec()].concat());
    }
    let mut text = counts.markdown();
    for WalkedFile { path, outcome, .. } in walked {
        let path = path.display();
        text.push_str(&match outcome {
            Outcome::Loaded { .. } => continue,
            Outcome::Refused(why) => format!("\n- refused: {why}"),
            Outcome::Broken(why) => format!("\n- BROKEN: {path}: {why}"),
        });
    }
    text.push('\n');
    text
}

/// What is wrong: broken files, and counts other than `expected`.
pub fn wrong(walked: &[WalkedFile], expected: &[Expected]) -> Vec<String> {
    let broken = walked.iter().filter_map(|WalkedFile { path, outcome, .. }| match outcome {
        Outcome::Broken(why) => Some(format!("{}: {why}", path.display())),
        _ => None,
    });
    let counts = expected.iter().filter_map(|Expected { format, loaded, files }| {
        let [loaded_now, refused, broken] = count(walked, format);
        let all = loaded_now + refused + broken;
        let rule = format!("{loaded} of {files} files of the format {format} load");
        ((loaded_now, all) != (*loaded, *files))
            .then(|| format!("{rule}, and these are {loaded_now} of {all}"))
    });
    broken.chain(counts).collect()
}

/// How many files of a format were loaded, refused and broken.
fn count(walked: &[WalkedFile], format: &str) -> [usize; 3] {
    let mut counts = [0; 3];
    for file in walked.iter().filter(|file| file.format == format) {
        counts[match file.outcome {
            Outcome::Loaded { .. } => 0,
            Outcome::Refused(_) => 1,
            Outcome::Broken(_) => 2,
        }] += 1;
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_files_and_other_counts_are_wrong() {
        let of = |path: &str, outcome| WalkedFile { path: path.into(), format: "ply", outcome };
        let loaded = || of("a.ply", Outcome::Loaded { faces: 1, notes: Vec::new() });
        let refused = || of("b.ply", Outcome::Refused("b.ply: no".to_owned()));
        let expected = [Expected { format: "ply", loaded: 1, files: 2 }];
        assert!(wrong(&[loaded(), refused()], &expected).is_empty());
        let rule = "1 of 2 files of the format ply load, and these are";
        assert_eq!(wrong(&[loaded(), loaded()], &expected), [format!("{rule} 2 of 2")]);
        assert_eq!(wrong(&[], &expected), [format!("{rule} 0 of 0")]);
        let found = [loaded(), of("c.ply", Outcome::Broken("it hums".to_owned()))];
        assert_eq!(wrong(&found, &expected), ["c.ply: it hums"]);
        assert!(markdown(&found).contains("- BROKEN: c.ply: it hums"));
    }

    #[test]
    fn a_model_comes_back_or_is_told_to_differ() {
        let place = tempfile::tempdir().unwrap();
        let folder = Folder::new(place.path()).unwrap();
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .25 0\nf 1/1 2/1 3/1\n";
        let mut model =
            read_model_bytes(text, MeshKind::Obj, &folder, "a.obj", MeshOptions::default())
                .unwrap();
        assert!(comes_back(&model, &folder).unwrap());
        // A vertex that no face names is not kept.
        model.geometries[0].positions.push([1.0; 3]);
        assert!(!comes_back(&model, &folder).unwrap());
        model.geometries[0].faces.clear();
        assert!(comes_back(&model, &folder).is_err());
    }
}
