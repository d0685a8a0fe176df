//! A scene in memory: objects, views and their cameras, as `scene.toml` names them.
//!
//! Images stay where they are until their turn comes: see `targets`.

mod environment;
mod objects;
mod source;
mod views;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use bokashi_core::Tensor;
use bokashi_fit::Given;
use bokashi_render_ops::Size;
use glam::DVec3;

use self::source::Source;
use crate::cameras::Camera;
use crate::description::{Description, SurfaceModel};
use crate::error::{Location, SceneError};
use crate::file_names::{is_file_name, notes_of_names};
use crate::folder::Folder;
use crate::memory::OF_DRAWN_PIXEL;
use crate::object::Object;
use crate::picture::MOST_SAMPLES;
use crate::scene_view::SceneView;

/// A scene: what its file says, with the meshes and cameras that the file names.
///
/// All of it can be changed before a fit.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Its file, for messages.
    pub path: PathBuf,
    /// Where its files are.
    pub folder: Folder,
    /// What its file says.
    pub description: Description,
    /// The meshes.
    pub objects: Vec<Object>,
    /// The views.
    pub views: Vec<SceneView>,
    /// The texels of its environment, a cube map `[6, S, S, 3]`.
    pub environment: Option<Tensor<f32>>,
    /// What files hold that was left out or mended, in words.
    pub notes: Vec<String>,
    /// The files that were read to load it but its own, with their lengths and checksums in words.
    pub(crate) files: Given,
}

impl Scene {
    /// The views that have an image, by their indices: those that are held out, or the others.
    pub fn views_with_image(&self, are_held_out: bool) -> impl Iterator<Item = usize> {
        let views = self.views.iter().enumerate();
        let views = views.filter(move |(_, view)| view.held_out == are_held_out);
        views.filter(|(_, view)| view.image.is_some()).map(|(index, _)| index)
    }

    /// The scene of the file at `path`; all its files lie in that file's folder.
    ///
    /// # Errors
    /// Whatever is wrong with the file, or with a mesh or a file of cameras that it names.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let folder = Folder::new(path.parent().unwrap_or(Path::new(".")))?;
        let name = path.file_name().map(PathBuf::from).unwrap_or_default();
        let source = Source { text: folder.read_text(&name)?, path: path.to_owned(), folder };
        let description = Description::parse(&source.text, path)?;
        let is_lit = match description.pipeline.surface {
            Some(model) => model != SurfaceModel::Unlit,
            None => !description.lights.is_empty() || description.environment.is_some(),
        };
        source.check_lens(&description)?;
        let mut notes = Vec::new();
        let views = source.views(&description, &mut notes)?;
        let mut objects = Vec::new();
        for entry in &description.meshes {
            objects.extend(source.objects(entry, &views, is_lit, &mut notes)?);
        }
        source.grow_fields(&description, &mut objects)?;
        for SceneView { camera: Camera { size, .. }, .. } in &views {
            let (what, found) = ("pixels of a view", size.width as u64 * size.height as u64);
            if found > MOST_SAMPLES {
                let location = Location::new(path);
                return Err(SceneError::TooLarge { location, what, most: MOST_SAMPLES, found });
            }
        }
        check_views(&source.folder, &views, &description, OF_DRAWN_PIXEL)?;
        notes.extend(one_lens(&description, &views));
        check_names("a mesh", objects.iter().map(|object| &object.name), path)?;
        check_names("a view", views.iter().map(|view| &view.name), path)?;
        notes.extend(notes_of_names("the meshes", objects.iter().map(|object| &object.name)));
        notes.extend(notes_of_names("the views", views.iter().map(|view| &view.name)));
        let environment = source.environment(&description)?;
        let Source { path, folder, .. } = source;
        let files = folder.files_read().into_iter().filter(|(file, _)| *file != name);
        let files = files.map(|(file, digest)| (file.display().to_string(), digest)).collect();
        let mut scene =
            Self { path, folder, description, objects, views, environment, notes, files };
        for object in &scene.objects {
            let has_map =
                object.materials.iter().any(|material| material.normal_map.texels.is_some());
            if has_map && object.tangents.is_some() && scene.learns_vertices(object) {
                let message = "its vertices are learnt, so tangents follow from its coordinates";
                let note = format!("{}: {message}, not from its file", object.name);
                scene.notes.push(note);
            }
        }
        Ok(scene)
    }

    /// The middle of the objects, and the radius of a ball around them; of nothing, the origin and 1.
    pub fn ball(&self) -> (DVec3, f64) {
        let extents = self.objects.iter().filter_map(Object::extent);
        match extents.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]) {
            Some([least, largest]) => {
                let radius = 0.5 * least.distance(largest);
                (0.5 * (least + largest), if radius > 0.0 { radius } else { 1.0 })
            }
            None => (DVec3::ZERO, 1.0),
        }
    }

    /// Whether the places of an object's vertices are learnt.
    pub(crate) fn learns_vertices(&self, object: &Object) -> bool {
        let names = |names: &Vec<String>| names.contains(&object.name);
        let learnt = self.description.learn.vertices.as_ref();
        learnt.is_some_and(|learnt| learnt.meshes.as_ref().is_none_or(names))
    }

    /// The view `name`.
    pub fn view(&self, name: &str) -> Option<usize> {
        self.views.iter().position(|view| view.name == name)
    }
}

/// Checks that there is memory for the largest of these views, of whose pixels each takes so many bytes. Behind a lens
/// each hidden surface takes as many, and all blurs together: measured, four times as many for two surfaces. All that is
/// of each sample.
///
/// # Errors
/// [`SceneError::Memory`] at the view's image, or the folder where it has none.
pub(crate) fn check_views(
    folder: &Folder,
    views: &[SceneView],
    description: &Description,
    of_pixel: u64,
) -> Result<(), SceneError> {
    let lens = description.pipeline.lens;
    let of_pixel = of_pixel
        * lens.map_or(1, |lens| {
            (2 + lens.surface_count() as u64) * lens.sample_count().pow(2) as u64
        });
    let pixels = |view: &SceneView| view.camera.size.width as u64 * view.camera.size.height as u64;
    let Some(largest) = views.iter().max_by_key(|view| pixels(view)) else { return Ok(()) };
    let path = largest.image.as_ref().map_or(folder.path().to_owned(), |file| folder.join(file));
    let Size { width, height } = largest.camera.size;
    let what = || format!("the view {:?} of {width} x {height}", largest.name);
    folder.memory().check(pixels(largest).saturating_mul(of_pixel), &Location::new(path), what)
}

/// A note where one lens is learnt for views that have several.
fn one_lens(description: &Description, views: &[SceneView]) -> Option<String> {
    description.learn.distortion.as_ref()?;
    let (first, rest) = views.split_first()?;
    let others = rest.iter().filter(|view| view.camera.distortion != first.camera.distortion);
    let others = others.count();
    (others > 0).then(|| {
        let rule = "`learn.distortion` learns one lens for all views";
        let name = &first.name;
        format!("{rule}: it starts from that of {name:?}, and {others} others are left out")
    })
}

/// Names are those of parameters and files: there is each of them once.
fn check_names<'a>(
    what: &str,
    names: impl Iterator<Item = &'a String>,
    path: &Path,
) -> Result<(), SceneError> {
    let mut seen = HashSet::new();
    for name in names {
        let wrong = |rule: &str| {
            let message = format!("the name of {what} {rule}, and there is {name:?}");
            Err(SceneError::content(Location::new(path), message))
        };
        if !is_file_name(name) {
            return wrong("is that of a file");
        }
        if !seen.insert(name) {
            return wrong("is its own");
        }
    }
    Ok(())
}
