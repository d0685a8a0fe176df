//! What is in a file, and what is wrong with it, as text and JSON.

mod cameras;
mod findings;
mod folder;
mod image;
mod mesh;
mod saved;
mod scene;
mod views;

use std::path::Path;

use bokashi_scene::SceneError;

use self::findings::Findings;
use crate::arguments::InspectArguments;
use crate::failure::Failure;
use crate::output::{is_standard_output, say, say_json};
use crate::places::Places;

/// A kind of file, by the endings of names.
type Kind = (&'static [&'static str], fn(&Path) -> Result<Findings, SceneError>);

/// What is read.
const KINDS: [Kind; 5] = [
    (&["obj", "ply", "gltf", "glb"], mesh::inspect),
    (&["png", "jpg", "jpeg", "exr", "hdr"], image::inspect),
    (&["toml"], scene::inspect),
    (&["json"], cameras::inspect),
    (&["safetensors"], saved::inspect),
];

/// Says what is in the file that `arguments` name.
///
/// # Errors
/// [`Failure::Use`] for a file of no kind that is read; [`Failure::Work`] for a file that can't be read, and
/// where something is wrong with it.
pub(crate) fn run(arguments: &InspectArguments) -> Result<(), Failure> {
    let file = arguments.file.as_path();
    let json = arguments.json.as_deref();
    Places {
        files: json.map(|json| ("--json", json)).into_iter().collect(),
        read: vec![("FILE", file)],
        ..Places::default()
    }
    .check()?;
    let ending = file.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let kind = KINDS.iter().find(|(endings, _)| endings.contains(&&*ending));
    let Some((_, inspect)) = kind else {
        let all = KINDS.iter().flat_map(|(endings, _)| endings.iter());
        let all = all.map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(" ");
        let rule = format!("inspect needs a file whose name ends with one of {all}");
        return Err(Failure::Use(format!("{rule}: got {}", file.display())));
    };
    let findings = inspect(file).map_err(|error| Failure::Work(error.to_string()))?;
    if !json.is_some_and(is_standard_output) {
        say(&findings.text(file))?;
    }
    if let Some(json) = json {
        say_json(json, &findings.json(file))?;
    }
    match findings.problems() {
        0 => Ok(()),
        1 => Err(Failure::Work(format!("{}: 1 problem", file.display()))),
        count => Err(Failure::Work(format!("{}: {count} problems", file.display()))),
    }
}
