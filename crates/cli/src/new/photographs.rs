//! The images of a new scene, with the cameras and masks that lie beside them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use bokashi_scene::{
    Camera, CameraFile, Folder, Location, Mask, NamedView, Picture, SceneError, find_colmap,
    find_mask, read_colmap, read_transforms,
};
use rayon::prelude::*;

use super::copies::Copies;
use crate::digits::count;
use crate::plain::shell_word;

/// Files of cameras, the first of which is taken.
const TRANSFORMS: [&str; 2] = ["transforms.json", "transforms_train.json"];
/// Folders of COLMAP's models, or of numbered folders with models, likewise.
const MODELS: [&str; 2] = ["sparse", "colmap/sparse"];
/// What is read of a model, as binary files or text.
const OF_MODELS: [&str; 3] = ["cameras", "images", "points3D"];
/// The endings of images' names.
const IMAGES: [&str; 5] = ["png", "jpg", "jpeg", "exr", "hdr"];
/// Those of images that are not read, without those of cameras' raw files, and of these.
const OTHERS: [&str; 14] = [
    "heic", "heif", "avif", "webp", "bmp", "tif", "tiff", "gif", "jp2", "jxl", "tga", "psd", "ppm",
    "pnm",
];
const RAW: [&str; 9] = ["dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "pef"];
/// Folders beside photographs that have none. Others are nerfstudio's `images_2` and so on, the same photographs
/// made smaller.
const ELSEWHERE: [&str; 4] = ["masks", "sparse", "colmap", "stereo"];
/// With fewer images none is held out.
const HELD_OUT: usize = 8;
/// Names that a note has; others are counted.
const NAMED: usize = 3;

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
    /// Whether the file of cameras names a mask for each.
    pub(super) has_named_masks: bool,
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
    pub(super) fn read(images: &Path, copies: &mut Copies<'_>) -> Result<Self, SceneError> {
        let folder = Folder::new(images)?;
        let Cameras { transforms, model, images: of_model, views, notes: of_cameras } =
            Cameras::read(&folder)?;
        let has_cameras = transforms.is_some() || model.is_some();
        let listed = Listed::read(&folder)?;
        let mut notes: Vec<_> = listed.left_out().into_iter().collect();
        let files: Vec<_> = match has_cameras {
            true => views.iter().map(|view| view.image.clone()).collect(),
            false => listed.images.clone(),
        };
        if files.is_empty() {
            let rule =
                "a folder of images has some of .png .jpg .jpeg .exr .hdr, and this has none";
            let message = [&[rule.to_owned()][..], &notes].concat().join("; ");
            return Err(SceneError::Content { location: Location::new(images), message });
        }
        if has_cameras {
            notes.extend(without_camera(&folder, &files, &listed.images));
        }
        // Cameras of other programs are those of the pixels as they are stored.
        let turned = match has_cameras {
            true => vec![false; files.len()],
            false => find_turned(&folder, &files, &mut notes)?,
        };
        // Images in folders of their own keep them; others get one.
        let is_nested = files.iter().all(|file| file.components().count() > 1);
        let home = copies.home(&folder, if is_nested { "" } else { "images" });
        let mut photographs = Self {
            source: Source::Nowhere,
            sizes: sizes(&folder, &files, &views, &turned)?,
            images: Vec::new(),
            masks: None,
            has_named_masks: false,
            mask_folder: home.join("masks"),
            has_opacity: false,
            cameras: views.iter().map(|view| view.camera).collect(),
            notes: of_cameras.into_iter().chain(notes).collect(),
        };
        for (file, turned) in files.iter().zip(turned) {
            photographs.images.push(match turned {
                true => copies.add_upright(&folder, file, &home)?,
                false => copies.add(&folder, file, &home)?,
            });
        }
        photographs.source = match (transforms, model) {
            (Some(file), _) => Source::Transforms(copies.add(&folder, file, &home)?),
            (None, Some(model)) => {
                add_model(&folder, &model, &home, copies)?;
                Source::Colmap(home.join(model), home.join(of_model))
            }
            (None, None) => Source::Nowhere,
        };
        let named: Option<Vec<_>> = views.iter().map(|view| view.mask.clone()).collect();
        photographs.add_masks(&folder, (&files, named), &home, copies)?;
        photographs.find_opacity(&folder, &files)?;
        Ok(photographs)
    }

    /// Finds out whether all images have opacity that shows objects in one of them. The first image that has none
    /// ends the search.
    fn find_opacity(&mut self, folder: &Folder, files: &[PathBuf]) -> Result<(), SceneError> {
        let mut shows = false;
        for file in files {
            let Some(mask) = Mask::from_opacity(&Picture::read(folder, file)?) else {
                return Ok(());
            };
            shows |= mask.fault().is_none();
        }
        self.has_opacity = shows;
        if !shows && self.masks.is_none() {
            let note = "the opacity of the images is the same everywhere, so it was left out";
            self.notes.push(note.to_owned());
        }
        Ok(())
    }

    /// Adds the masks, if each image has one: those in the folder of masks, or else those that the file of
    /// cameras names.
    fn add_masks(
        &mut self,
        folder: &Folder,
        (files, named): (&[PathBuf], Option<Vec<PathBuf>>),
        home: &Path,
        copies: &mut Copies<'_>,
    ) -> Result<(), SceneError> {
        let masks = Path::new("masks");
        if !folder.find(masks).is_ok_and(|path| path.is_dir()) {
            for mask in named.iter().flatten() {
                copies.add(folder, mask, home)?;
            }
            self.has_named_masks = named.is_some_and(|masks| !masks.is_empty());
            return Ok(());
        }
        let masks_found: Vec<_> = files.iter().map(|file| find_mask(folder, masks, file)).collect();
        let missing = masks_found.iter().filter(|mask| mask.is_none()).count();
        if missing > 0 {
            let rule = "masks count where each image has one";
            let all = files.len();
            let note = format!("{rule}, and {missing} of {all} have none: they were left out");
            self.notes.push(note);
            return Ok(());
        }
        let mut added = Vec::with_capacity(masks_found.len());
        for mask in masks_found.iter().flatten() {
            added.push(match is_turned(folder, mask)? {
                true if matches!(self.source, Source::Nowhere) => {
                    copies.add_upright(folder, mask, home)?
                }
                _ => copies.add(folder, mask, home)?,
            });
        }
        self.masks = Some(added);
        Ok(())
    }

    /// Whether silhouettes can be compared.
    pub(super) fn has_masks(&self) -> bool {
        self.masks.is_some() || self.has_named_masks || self.has_opacity
    }

    /// Whether there are enough images to hold some out.
    pub(super) fn has_held_out(&self) -> bool {
        self.images.len() >= HELD_OUT
    }
}

/// The first of [`MODELS`] that has cameras, with what to know of it.
fn find_model(folder: &Folder) -> Option<(PathBuf, Option<String>)> {
    let is_model = |model: &Path| {
        let files = ["bin", "txt"].map(|end| model.join("cameras").with_extension(end));
        files.iter().any(|file| folder.find(file).is_ok())
    };
    let mut models = MODELS.into_iter().map(|path| find_colmap(folder, path));
    models.find(|(path, _)| is_model(path))
}

/// That some of the `images` are not among the `files` that have cameras, in words.
fn without_camera(folder: &Folder, files: &[PathBuf], images: &[PathBuf]) -> Option<String> {
    let known: BTreeSet<_> = files.iter().map(|file| folder.find(file).ok()).collect();
    let is_unknown = |file: &&PathBuf| !known.contains(&folder.find(file).ok());
    let names = named(&images.iter().filter(is_unknown).collect::<Vec<_>>())?;
    Some(format!("images without a camera were left out: {names}"))
}

/// What a folder and those in it hold.
#[derive(Debug, Default)]
struct Listed {
    /// Images, by their names.
    images: Vec<PathBuf>,
    /// How many images there are that are not read, by their endings and folders.
    others: BTreeMap<(String, PathBuf), usize>,
}

impl Listed {
    fn read(folder: &Folder) -> Result<Self, SceneError> {
        let mut listed = Self::default();
        listed.add(folder, Path::new(""))?;
        listed.images.sort();
        Ok(listed)
    }

    /// Adds what is in the folder `inside`. Links to folders are not followed.
    fn add(&mut self, folder: &Folder, inside: &Path) -> Result<(), SceneError> {
        let listed = folder.join(inside);
        let listed = if listed.as_os_str().is_empty() { folder.path().to_owned() } else { listed };
        let failed = |error| SceneError::Read { path: listed.clone(), error };
        for entry in fs::read_dir(&listed).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let (name, kind) = (entry.file_name(), entry.file_type().map_err(failed)?);
            let (path, name) = (inside.join(&name), name.to_string_lossy().to_lowercase());
            let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            if name.starts_with('.') {
                continue;
            }
            if kind.is_dir() {
                let smaller = name.strip_prefix("images_").map(str::parse::<u32>);
                let is_elsewhere = ELSEWHERE.contains(&&*name) || matches!(smaller, Some(Ok(_)));
                if !(is_elsewhere && inside.as_os_str().is_empty()) {
                    self.add(folder, &path)?;
                }
            } else if IMAGES.contains(&&*ending) && folder.join(&path).is_file() {
                self.images.push(path);
            } else if OTHERS.contains(&&*ending) || RAW.contains(&&*ending) {
                // As it is written: a shell minds capitals.
                let ending = path.extension().unwrap_or_default().to_string_lossy();
                *self.others.entry((ending.into_owned(), listed.clone())).or_default() += 1;
            }
        }
        Ok(())
    }

    /// What is said of images that are not read.
    fn left_out(&self) -> Option<String> {
        let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
        for ((ending, _), count) in &self.others {
            *kinds.entry(ending.to_lowercase()).or_default() += count;
        }
        let all: usize = kinds.values().sum();
        let (raw, others): (Vec<_>, Vec<_>) =
            self.others.keys().partition(|(ending, _)| RAW.contains(&&*ending.to_lowercase()));
        let kinds = kinds.iter().map(|(ending, count)| format!("{count} .{ending}"));
        let rule = "images are PNG, JPEG, EXR or HDR";
        let mut message = format!(
            "{} left out, {}: {rule}",
            count(all, "image"),
            kinds.collect::<Vec<_>>().join(", ")
        );
        if !others.is_empty() {
            let files = others.iter().map(|(ending, path)| {
                let path = shell_word(path);
                format!("{}/*.{ending}", path.trim_end_matches('/'))
            });
            let files = files.collect::<Vec<_>>().join(" ");
            message += &format!("; ImageMagick makes PNGs: magick mogrify -format png {files}");
        }
        if !raw.is_empty() {
            message += "; a camera's raw files are developed first";
        }
        (all > 0).then_some(message)
    }
}

/// The first of some files, and how many others there are; nothing of none.
fn named(files: &[&PathBuf]) -> Option<String> {
    let first = files.iter().take(NAMED).map(|file| file.display().to_string());
    let first = first.collect::<Vec<_>>().join(", ");
    match files.len() {
        0 => None,
        all if all > NAMED => Some(format!("{first} and {} more", all - NAMED)),
        _ => Some(first),
    }
}

/// Whether viewers turn an image before they show it.
fn is_turned(folder: &Folder, file: &Path) -> Result<bool, SceneError> {
    let location = Location::new(folder.join(file));
    Ok(Picture::decode_turn(&folder.read(file)?, &location)?.is_some())
}

/// Columns and rows of each image: those of its camera, or of its file, turned or not.
fn sizes(
    folder: &Folder,
    files: &[PathBuf],
    views: &[NamedView],
    turned: &[bool],
) -> Result<Vec<[usize; 2]>, SceneError> {
    if !views.is_empty() {
        let sizes = views.iter().map(|view| view.camera.size);
        return Ok(sizes.map(|size| [size.width, size.height]).collect());
    }
    let size = |(file, turned): (&PathBuf, &bool)| {
        let size = Picture::read_size(folder, file)?;
        let location = Location::new(folder.join(file));
        let turn = match turned {
            true => Picture::decode_turn(&folder.read(file)?, &location)?,
            false => None,
        };
        Ok(turn.map_or(size, |turn| turn.size(size)))
    };
    files.par_iter().zip(turned).map(size).collect()
}

/// What other programs know of the cameras of a folder of images.
struct Cameras {
    transforms: Option<&'static Path>,
    /// A model of COLMAP's, where there is one.
    model: Option<PathBuf>,
    /// The folder of its images.
    images: &'static Path,
    views: Vec<NamedView>,
    notes: Vec<String>,
}

impl Cameras {
    /// Those of `transforms.json`, else of a model; none where there is neither.
    fn read(folder: &Folder) -> Result<Self, SceneError> {
        let is_there = |path: &&Path| folder.find(path).is_ok();
        let transforms = TRANSFORMS.into_iter().map(Path::new).find(is_there);
        let (model, several) =
            find_model(folder).map_or((None, None), |(path, note)| (Some(path), note));
        let images = match folder.find("images").is_ok_and(|path| path.is_dir()) {
            true => Path::new("images"),
            false => Path::new(""),
        };
        let CameraFile { views, notes } = match (transforms, &model) {
            (Some(file), _) => read_transforms(folder, file)?,
            (None, Some(model)) => read_colmap(folder, model, images)?,
            (None, None) => CameraFile::default(),
        };
        let several = several.filter(|_| transforms.is_none());
        let notes = several.into_iter().chain(notes).collect();
        Ok(Self { transforms, model, images, views, notes })
    }
}

/// Which images are stored turned, and a note that names them.
fn find_turned(
    folder: &Folder,
    files: &[PathBuf],
    notes: &mut Vec<String>,
) -> Result<Vec<bool>, SceneError> {
    let turns = files.par_iter().map(|file| is_turned(folder, file));
    let turned: Vec<bool> = turns.collect::<Result<_, _>>()?;
    let turned_files = files.iter().zip(&turned).filter(|(_, turned)| **turned);
    if let Some(names) = named(&turned_files.map(|(file, _)| file).collect::<Vec<_>>()) {
        notes.push(format!(
            "images were turned as viewers show them, which their Exif data say, and copied as PNG: \
             {names}"
        ));
    }
    Ok(turned)
}

/// Copies the files of a COLMAP model.
fn add_model(
    folder: &Folder,
    model: &Path,
    home: &Path,
    copies: &mut Copies<'_>,
) -> Result<(), SceneError> {
    let ends = ["bin", "txt"];
    let files =
        OF_MODELS.into_iter().flat_map(|name| ends.map(|end| model.join(name).with_extension(end)));
    for path in files.filter(|path| folder.find(path).is_ok()) {
        copies.add(folder, &path, home)?;
    }
    Ok(())
}
