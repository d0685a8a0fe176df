//! A folder with a scene to begin with.

mod copies;
mod made;
mod mesh;
mod photographs;
mod template;

use std::fs;
use std::path::Path;

use bokashi_scene::{Scene, SceneError, description};
use bokashi_write::{check_below, check_folder};

use self::copies::Copies;
use self::made::Made;
use self::mesh::Start;
use self::photographs::Photographs;
use self::template::Template;
use crate::arguments::NewArguments;
use crate::digits::count;
use crate::failure::Failure;
use crate::output::say;
use crate::plain::shell_word;

/// The scene's file.
const SCENE: &str = "scene.toml";
/// The file that lets editors complete the scene's, which names it in its first line.
const SCHEMA: &str = "scene.schema.json";
/// What every such file has, of an earlier build too.
const MARK: &str = "\"title\": \"A scene for bokashi\"";

/// Makes the folder that `arguments` name: files are copied first, then the schema is written, and the scene's
/// file last. Where that fails, what was made is removed again.
///
/// # Errors
/// [`Failure::Use`] for a folder that has a scene, can't be written, or has other files where copies would
/// go; [`Failure::Work`] for a mesh, an image or a file of cameras that can't be read or copied.
pub(crate) fn run(arguments: &NewArguments) -> Result<(), Failure> {
    let folder = arguments.folder.as_path();
    let file = folder.join(SCENE);
    if fs::symlink_metadata(&file).is_ok() {
        let rule = "new needs a folder without a scene.toml";
        return Err(Failure::Use(format!("{rule}, and {} is there", file.display())));
    }
    let failed = |error| Failure::Use(format!("new needs a folder to write to: {error}"));
    check_folder(folder).map_err(failed)?;
    let failed = |error: SceneError| Failure::Work(error.to_string());
    let mut copies = Copies::new(folder);
    let start = arguments.from.as_deref().map(|mesh| Start::read(mesh, &mut copies));
    let start = start.transpose().map_err(failed)?;
    let photographs = arguments.images.as_deref();
    let photographs = photographs.map(|images| Photographs::read(images, &mut copies));
    let photographs = photographs.transpose().map_err(failed)?;
    copies.check()?;
    check_schema(folder)?;
    let (start, photographs) = (start.as_ref(), photographs.as_ref());
    let has_rough_cameras = arguments.rough_cameras;
    let mut template = Template { start, photographs, has_rough_cameras, no_hull: None };
    let mut made = Made::new(folder);
    match make(&mut made, &copies, &mut template, &file) {
        Ok(scene) => say(&last_words(&file, &copies, &template, &scene)),
        Err(failure) => {
            // So that the same command can be given again.
            made.undo();
            Err(failure)
        }
    }
}

/// Writes all files; the scene of them is then loaded. Where masks make no hull, `template` says so afterwards.
fn make(
    made: &mut Made<'_>,
    copies: &Copies<'_>,
    template: &mut Template<'_>,
    file: &Path,
) -> Result<Scene, Failure> {
    copies.write(made)?;
    made.write(SCHEMA, description::schema().as_bytes())?;
    let write = |made: &mut Made<'_>, template: &Template<'_>| {
        made.write(SCENE, format!("#:schema ./{SCHEMA}\n{}", template.text()).as_bytes())
    };
    write(made, template)?;
    let mut loaded = Scene::load(file);
    if let (Err(error), true) = (&loaded, template.starts_from_hull()) {
        template.no_hull = Some(error.to_string());
        write(made, template)?;
        loaded = Scene::load(file);
    }
    loaded.map_err(|error| Failure::Work(error.to_string()))
}

/// Whether a schema can be written to the folder: there is none, or one that another build wrote.
///
/// # Errors
/// [`Failure::Use`] where something else has the name.
fn check_schema(folder: &Path) -> Result<(), Failure> {
    check_below(folder, SCHEMA).map_err(|error| {
        Failure::Use(format!("new needs a place for the scene's schema: {error}"))
    })?;
    let file = folder.join(SCHEMA);
    let is_ours =
        || file.is_file() && fs::read_to_string(&file).is_ok_and(|text| text.contains(MARK));
    if fs::symlink_metadata(&file).is_err() || is_ours() {
        return Ok(());
    }
    let rule = "new needs a folder without another file where the scene's schema goes";
    Err(Failure::Use(format!("{rule}, and {} is there", file.display())))
}

/// What was made, and what to do next.
fn last_words(file: &Path, copies: &Copies<'_>, template: &Template<'_>, scene: &Scene) -> String {
    let mut text = format!("Made {}:\n", file.display());
    if let Some(start) = template.start {
        text += &format!("  mesh     {}", start.file.display());
        if start.named > 0 {
            text += &format!(" and {} that it names", count(start.named, "file"));
        }
        text.push('\n');
    } else if template.starts_from_hull() {
        text += "  mesh     what the masks of all views allow\n";
    } else {
        text += "  mesh     a sphere to start from\n";
    }
    text += &format!("  views    {}\n", template.views());
    text += &format!("  masks    {}\n", template.masks());
    text += &format!("  learnt   {}\n", template.learnt());
    text += &format!("  copied   {}\n", count(copies.count(), "file"));
    // The scene may say again what was said of the files that were copied.
    let of_images = template.photographs.into_iter().flat_map(|p| &p.notes);
    let of_images = of_images.filter(|note| !scene.notes.contains(note));
    let no_hull = template.no_hull.as_ref();
    let no_hull = no_hull.map(|reason| format!("the fit starts from a sphere: {reason}"));
    for note in scene.notes.iter().chain(of_images).chain(&no_hull) {
        text += &format!("note: {note}\n");
    }
    let path = shell_word(file);
    text += match template.needs_cameras() {
        true => "\nFill in the camera of each view in it: all stand in one place so far. Then:\n",
        false => "\nNext:\n",
    };
    text += &format!("  bokashi inspect {path}\n");
    text += &match template.photographs {
        Some(_) => format!("  bokashi fit {path}\n"),
        None => format!("  bokashi render {path}\n"),
    };
    text
}
