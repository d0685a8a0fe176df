//! Pictures, depth, normals and ids of a scene's views, without a fit.

use std::path::{Path, PathBuf};

use bokashi_scene::{Scene, SceneError, capped_note, lens_note, write_result};

use super::turntable;
use crate::arguments::{RenderArguments, USUAL_OUT};
use crate::failure::Failure;
use crate::output::say;
use crate::places::Places;
use crate::threads::start_threads;

/// Renders the views of a scene, or one of them.
///
/// # Errors
/// [`Failure::Use`] for a view that is not there, and places that can't be written to; [`Failure::Work`] for
/// what is wrong with the scene.
pub(crate) fn render(arguments: &RenderArguments) -> Result<(), Failure> {
    let RenderArguments { scene, view, turntable, threads, quiet, .. } = arguments;
    let out = arguments.out.as_deref().unwrap_or(Path::new(USUAL_OUT));
    let is_out_named = arguments.out.is_some();
    Places { out: Some(out), is_out_named, ..Places::default() }.check()?;
    start_threads(*threads)?;
    let failed = |error: SceneError| Failure::Work(error.to_string());
    let scene = Scene::load(scene).map_err(failed)?;
    let all = match view {
        None => (0..scene.views.len()).collect(),
        Some(name) => match scene.view(name) {
            Some(view) => vec![view],
            None => {
                let names: Vec<_> = scene.views.iter().map(|view| view.name.as_str()).collect();
                let rule = format!("--view needs one of {}", names.join(", "));
                return Err(Failure::Use(format!("{rule}, and this is {name}")));
            }
        },
    };
    if *turntable && scene.views.is_empty() {
        let rule = "--turntable needs a view: its camera is the one that goes around";
        return Err(Failure::Use(format!("{rule}, and the scene has none")));
    }
    let mut names = scene.rendered_names(&all);
    names.extend(turntable.then(|| PathBuf::from(turntable::FILE)));
    scene.check_results(out, &names).map_err(failed)?;
    std::fs::create_dir_all(out)
        .map_err(|error| Failure::Work(format!("{} could not be made: {error}", out.display())))?;
    if !quiet {
        let bent = lens_note(&scene).map_err(|error| failed(error.into()))?;
        let capped = capped_note(&scene).map_err(failed)?;
        for note in scene.notes.iter().chain(&bent).chain(&capped) {
            say(&format!("note: {note}\n"))?;
        }
    }
    for rendered in scene.rendered(&all).map_err(failed)? {
        let rendered = rendered.map_err(failed)?;
        for (name, bytes) in &rendered.files {
            write_result(out, name, bytes).map_err(failed)?;
        }
        if !quiet {
            say(&format!("{}: {} files\n", rendered.view, rendered.files.len()))?;
        }
    }
    if *turntable {
        turntable::write(&scene, out)?;
        if !quiet {
            say(&format!("{}\n", turntable::FILE))?;
        }
    }
    Ok(())
}
