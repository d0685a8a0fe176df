//! The views of a scene, those of files of cameras among them.

use std::collections::HashSet;
use std::path::{Component, Path};

use toml::Spanned;

use super::source::{Source, color_space};
use crate::cameras::{read_colmap, read_transforms};
use crate::description::{Description, Opening, SilhouettesName, ViewEntry, ViewLens};
use crate::error::{Location, SceneError};
use crate::file_names::stem;
use crate::mask_files::{find_mask, usual_mask};
use crate::picture::Picture;
use crate::scene_view::SceneView;
use crate::viewpoint::camera;

impl Source {
    /// All views: those of the scene's file, then those of files of cameras.
    pub(super) fn views(
        &self,
        description: &Description,
        notes: &mut Vec<String>,
    ) -> Result<Vec<SceneView>, SceneError> {
        let entries = || description.views.iter().map(Spanned::get_ref);
        let given = entries().filter_map(|entry| entry.name.clone()).collect();
        let is_unnamed = |entry: &&ViewEntry| entry.name.is_none();
        let unnamed = entries().filter(is_unnamed).filter_map(|view| view.image.as_deref());
        let mut unnamed = names(unnamed, &given).into_iter();
        let mut views = Vec::with_capacity(description.views.len());
        for entry in &description.views {
            let view = entry.get_ref();
            let of_image = || view.image.as_ref().and_then(|_| unnamed.next());
            let Some(name) = view.name.clone().or_else(of_image) else {
                return Err(self.wrong(entry, "a view without an image has a `name`"));
            };
            views.push(self.view(entry, name)?);
        }
        let Some(entry) = &description.cameras else { return Ok(views) };
        let cameras = entry.get_ref();
        let file = match (&cameras.transforms, &cameras.colmap) {
            (Some(file), None) => read_transforms(&self.folder, file)?,
            (None, Some(model)) => {
                let images = cameras.images.as_deref().unwrap_or(Path::new("images"));
                read_colmap(&self.folder, model, images)?
            }
            _ => {
                let rule = "cameras are in either `transforms` or `colmap`";
                return Err(self.wrong(entry, rule));
            }
        };
        notes.extend(file.notes);
        let every = cameras.held_out_every.map(|every| every.0);
        let taken: HashSet<_> = views.iter().map(|view| view.name.clone()).collect();
        let unnamed = names(file.views.iter().map(|view| view.image.as_path()), &taken);
        for (index, (view, name)) in file.views.into_iter().zip(unnamed).enumerate() {
            let mask = match &cameras.masks {
                None => view.mask,
                // One that is missing is missed when its turn comes.
                Some(masks) => find_mask(&self.folder, masks, &view.image)
                    .or(view.mask)
                    .or_else(|| Some(usual_mask(masks, &view.image))),
            };
            views.push(SceneView {
                name,
                image: Some(view.image),
                mask,
                color_space: cameras.color_space.map(color_space),
                held_out: every.is_some_and(|every| index.is_multiple_of(every)),
                exposure: 0.0,
                camera: view.camera,
                lens: ViewLens::default(),
            });
        }
        Ok(views)
    }

    fn view(&self, entry: &Spanned<ViewEntry>, name: String) -> Result<SceneView, SceneError> {
        let view = entry.get_ref();
        let size = match (view.camera.size, &view.image) {
            (Some(size), _) => size.map(|extent| extent.0),
            (None, Some(file)) => Picture::read_size(&self.folder, file)?,
            (None, None) => {
                let rule = "the camera of a view without an image has a `size`";
                return Err(self.wrong(entry, rule));
            }
        };
        Ok(SceneView {
            camera: camera(&view.camera, size).map_err(|rule| self.wrong(entry, rule))?,
            name,
            image: view.image.clone(),
            mask: view.mask.clone(),
            color_space: view.color_space.map(color_space),
            held_out: view.held_out,
            exposure: view.exposure.map_or(0.0, |stops| stops.0),
            lens: view.lens,
        })
    }

    /// # Errors
    /// [`SceneError::Content`] for a lens that can't be drawn as the scene says.
    pub(super) fn check_lens(&self, description: &Description) -> Result<(), SceneError> {
        let lens = description.pipeline.lens;
        if lens.is_some() && description.pipeline.silhouettes == SilhouettesName::Antialias {
            let rule = "the `silhouettes` of a picture through a lens are \"exact\" or \"aliased\"";
            let message = format!("{rule}, and these are \"antialias\"");
            return Err(SceneError::content(Location::new(&self.path), message));
        }
        for entry in &description.views {
            let given = entry.get_ref().lens;
            match (lens, given.opening) {
                (None, _) if given != ViewLens::default() => {
                    let rule = "a view has a `lens` of its own where `pipeline.lens` is there";
                    return Err(self.wrong(entry, rule));
                }
                (Some(lens), Some(own)) if own.key() != lens.opening.key() => {
                    let rule = "the lens of a view has the key that `pipeline.lens` has";
                    let [expected, found] = [lens.opening, own].map(Opening::key);
                    let message = format!("{rule}, `{expected}`, and this has `{found}`");
                    return Err(self.wrong(entry, message));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// A name for each image: its file's without the ending, with the folders above it where that is another's
/// name, and then with the ending.
fn names<'a>(images: impl Iterator<Item = &'a Path>, taken: &HashSet<String>) -> Vec<String> {
    let images: Vec<_> = images.collect();
    let whole = |image: &Path| {
        let parts = image.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        });
        parts.collect::<Vec<_>>().join("-")
    };
    let ways: [&dyn Fn(&Path) -> String; 3] =
        [&stem, &|image| whole(&image.with_extension("")), &|image| match image.extension() {
            Some(ending) => {
                format!("{}-{}", whole(&image.with_extension("")), ending.to_string_lossy())
            }
            None => whole(image),
        }];
    let mut names = Vec::new();
    for way in ways {
        names = images.iter().map(|image| way(image)).collect();
        let mut seen = taken.clone();
        if names.iter().all(|name| seen.insert(name.clone())) {
            break;
        }
    }
    names
}
