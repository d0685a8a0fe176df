//! The images of a new scene, with the cameras and masks that lie beside them.

use std::fs;
use std::path::{Path, PathBuf};

use bokashi_scene::{
    Camera, CameraFile, Folder, NamedView, Picture, Place, SceneError, find_colmap, read_colmap,
    read_transforms,
};
use rayon::prelude::*;

use super::copies::Copies;

/// Files of cameras, the first of which is taken.
const TRANSFORMS: [&str; 2] = ["transforms.json", "transforms_train.json"];
/// Folders of COLMAP's models, or of numbered folders with models, likewise.
const MODELS: [&str; 2] = ["sparse", "colmap/sparse"];
/// What is read of a model, as binary files or text.
const OF_MODELS: [&str; 3] = ["cameras", "images", "points3D"];
/// The endings of images' names.
const IMAGES: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// Where the cameras of images are.
#[derive(Debug)]
pub(super) enum Source {
    /// In a `transforms.json`.
    Transforms(PathBuf),
    /// In a folder of COLMAP's; the second is that of the images.
    Colmap(PathBuf, PathBuf),
    /// Nowhere.
    Nowhere,
}

/// Images, all paths in the scene's folder.
#[derive(Debug)]
pub(super) struct Photographs {
    pub(super) source: Source,
    pub(super) images: Vec<PathBuf>,
    /// Of each image its mask, where all have one.
    pub(super) masks: Option<Vec<PathBuf>>,
    /// The folder of masks, likewise.
    pub(super) mask_folder: PathBuf,
    /// Whether all images have opacity.
    pub(super) has_opacity: bool,
    /// In the order of the images; none where they are nowhere.
    pub(super) cameras: Vec<Camera>,
    /// Columns and rows of each image.
    pub(super) sizes: Vec<[usize; 2]>,
    /// What was left out.
    pub(super) notes: Vec<String>,
}

impl Photographs {
    /// The images in the folder `images`, with what lies beside them among the `copies`.
    ///
    /// # Errors
    /// What is wrong with the folder or its files; [`SceneError::Content`] for a folder without images.
    pub(super) fn of(images: &Path, copies: &mut Copies<'_>) -> Result<Self, SceneError> {
        let folder = Folder::new(images)?;
        let is_there = |path: &Path| folder.find(path).is_ok();
        let transforms = TRANSFORMS.into_iter().map(Path::new).find(|path| is_there(path));
        let is_model = |model: &Path| {
            ["bin", "txt"].iter().any(|end| is_there(&model.join("cameras").with_extension(end)))
        };
        let models = MODELS.into_iter().map(|path| find_colmap(&folder, path));
        let model = models.into_iter().find(|(path, _)| is_model(path));
        let (model, several) = model.map_or((None, None), |(path, note)| (Some(path), note));
        let model = model.as_deref();
        let of_model = match folder.find("images").is_ok_and(|found| found.is_dir()) {
            true => Path::new("images"),
            false => Path::new(""),
        };
        let CameraFile { views, notes } = match (transforms, model) {
            (Some(file), _) => read_transforms(&folder, file)?,
            (None, Some(model)) => read_colmap(&folder, model, of_model)?,
            (None, None) => CameraFile::default(),
        };
        let has_cameras = transforms.is_some() || model.is_some();
        let files: Vec<_> = match has_cameras {
            true => views.iter().map(|view| view.image.clone()).collect(),
            false => listed(&folder)?,
        };
        if files.is_empty() {
            let message = "a folder of images has some of .png .jpg .jpeg .exr, and this has none";
            let place = Place::of(images);
            return Err(SceneError::Content { place, message: message.to_owned() });
        }
        // Images in folders of their own keep them; others get one.
        let is_nested = files.iter().all(|file| file.components().count() > 1);
        let home = copies.home(&folder, if is_nested { "" } else { "images" });
        let mut photographs = Self {
            source: Source::Nowhere,
            sizes: sizes(&folder, &files, &views)?,
            images: Vec::new(),
            masks: None,
            mask_folder: home.join("masks"),
            has_opacity: have_opacity(&folder, &files)?,
            cameras: views.iter().map(|view| view.camera).collect(),
            notes: several.into_iter().filter(|_| transforms.is_none()).chain(notes).collect(),
        };
        for file in &files {
            photographs.images.push(copies.add(&folder, file, &home)?);
        }
        if let Some(file) = transforms {
            photographs.source = Source::Transforms(copies.add(&folder, file, &home)?);
        } else if let Some(model) = model {
            for name in OF_MODELS {
                let ends = ["bin", "txt"].map(|end| model.join(name).with_extension(end));
                for path in ends.iter().filter(|path| is_there(path)) {
                    copies.add(&folder, path, &home)?;
                }
            }
            photographs.source = Source::Colmap(home.join(model), home.join(of_model));
        }
        photographs.add_masks(&folder, &files, &home, copies)?;
        Ok(photographs)
    }

    /// Adds the masks, if each image has one.
    fn add_masks(
        &mut self,
        folder: &Folder,
        files: &[PathBuf],
        home: &Path,
        copies: &mut Copies<'_>,
    ) -> Result<(), SceneError> {
        let masks = Path::new("masks");
        if !folder.find(masks).is_ok_and(|found| found.is_dir()) {
            return Ok(());
        }
        let mask = |file: &PathBuf| {
            let own = masks.join(file.file_name()?);
            let png = own.with_extension("png");
            [own, png].into_iter().find(|path| folder.find(path).is_ok_and(|found| found.is_file()))
        };
        let found: Vec<_> = files.iter().map(mask).collect();
        let missing = found.iter().filter(|mask| mask.is_none()).count();
        if missing > 0 {
            let rule = "masks count where each image has one";
            let all = files.len();
            let note = format!("{rule}, and {missing} of {all} have none: they were left out");
            self.notes.push(note);
            return Ok(());
        }
        let added = found.iter().flatten().map(|mask| copies.add(folder, mask, home));
        self.masks = Some(added.collect::<Result<_, _>>()?);
        Ok(())
    }

    /// Whether silhouettes can be compared.
    pub(super) fn has_masks(&self) -> bool {
        self.masks.is_some() || self.has_opacity
    }
}

/// The images right inside the folder, or where there are none, inside its folder `images`; by their names.
fn listed(folder: &Folder) -> Result<Vec<PathBuf>, SceneError> {
    for inside in ["", "images"] {
        let place = folder.join(inside);
        if !inside.is_empty() && !place.is_dir() {
            continue;
        }
        let failed = |error| SceneError::Read { path: place.clone(), error };
        let mut files = Vec::new();
        for entry in fs::read_dir(&place).map_err(failed)? {
            let path = Path::new(inside).join(entry.map_err(failed)?.file_name());
            let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            if IMAGES.contains(&&*ending) && folder.join(&path).is_file() {
                files.push(path);
            }
        }
        if !files.is_empty() {
            files.sort();
            return Ok(files);
        }
    }
    Ok(Vec::new())
}

/// Columns and rows of each image: those of its camera, or of its file.
fn sizes(
    folder: &Folder,
    files: &[PathBuf],
    views: &[NamedView],
) -> Result<Vec<[usize; 2]>, SceneError> {
    if !views.is_empty() {
        let sizes = views.iter().map(|view| view.camera.size);
        return Ok(sizes.map(|size| [size.width, size.height]).collect());
    }
    files.par_iter().map(|file| Picture::size_in(folder, file)).collect()
}

/// Whether all images have opacity. The first that has none ends the search.
fn have_opacity(folder: &Folder, files: &[PathBuf]) -> Result<bool, SceneError> {
    for file in files {
        let picture = Picture::decode(&folder.read(file)?, &Place::of(folder.join(file)))?;
        if picture.opacity().is_none() {
            return Ok(false);
        }
    }
    Ok(true)
}
