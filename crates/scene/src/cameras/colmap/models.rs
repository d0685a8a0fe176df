//! Where the models of a reconstruction are, and which images they lack.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::files::shots;
use crate::cameras::camera::NamedView;
use crate::folder::Folder;

/// The endings of images' names.
const IMAGES: [&str; 5] = ["png", "jpg", "jpeg", "exr", "hdr"];
/// The most folders in folders that are searched for images.
const DEEPEST: usize = 8;
/// Images that a note names.
const MOST_NAMES: usize = 5;

/// The folder of the model of a reconstruction: `path` in `folder`, or of its folders `0`, `1` and so on the one
/// whose model has the most images; `path` itself where there is no model. With it a note that names all, where
/// there are several.
pub fn find_colmap(folder: &Folder, path: impl AsRef<Path>) -> (PathBuf, Option<String>) {
    let path = path.as_ref();
    let is_model = |path: &Path| {
        ["bin", "txt"].iter().any(|end| folder.find(path.join(format!("cameras.{end}"))).is_ok())
    };
    let numbers = match is_model(path) {
        true => Vec::new(),
        false => numbered(folder, path),
    };
    let models = numbers.into_iter().map(|number| path.join(number.to_string()));
    let models: Vec<_> = models.filter(|model| is_model(model)).collect();
    // Whoever reads it says what is wrong with a model that is broken.
    let count = |model: &PathBuf| shots(folder, model).map_or(0, |(shots, _)| shots.len());
    let counts: Vec<_> = match models.len() {
        1 => vec![0],
        _ => models.iter().map(count).collect(),
    };
    let Some(most) = (0..models.len()).rev().max_by_key(|&k| counts[k]) else {
        return (path.to_owned(), None);
    };
    let name = |k: usize| format!("{} with {}", models[k].display(), images(counts[k]));
    let others: Vec<_> = (0..models.len()).filter(|&k| k != most).map(name).collect();
    let note = format!(
        "{} has several models: {} is taken, and {} left out",
        path.display(),
        name(most),
        others.join(", ")
    );
    (models[most].clone(), (!others.is_empty()).then_some(note))
}

fn images(count: usize) -> String {
    if count == 1 { "1 image".to_owned() } else { format!("{count} images") }
}

/// The numbers that are names of folders in a folder, in ascending order.
fn numbered(folder: &Folder, path: &Path) -> Vec<u32> {
    let Ok(folder_path) = folder.find(path) else { return Vec::new() };
    let Ok(entries) = fs::read_dir(&folder_path) else { return Vec::new() };
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    // As COLMAP writes them: without zeros before.
    let number =
        |name: &String| name.parse::<u32>().ok().filter(|number| number.to_string() == *name);
    let mut numbers: Vec<_> = names.filter_map(|name| number(&name)).collect();
    numbers.sort_unstable();
    numbers
}

/// A note of the images in the folder `path` that no view has.
pub(super) fn without_camera(folder: &Folder, path: &Path, views: &[NamedView]) -> Option<String> {
    // The scene's own folder has other images, too.
    if path.components().all(|part| matches!(part, std::path::Component::CurDir)) {
        return None;
    }
    let known: HashSet<_> = views.iter().filter_map(|view| folder.find(&view.image).ok()).collect();
    let mut images = Vec::new();
    list(&folder.find(path).ok()?, DEEPEST, &mut images);
    images.retain(|file| !known.contains(file));
    images.sort_unstable();
    let root = folder.find(path).ok()?;
    let mut names: Vec<_> = images
        .iter()
        .take(MOST_NAMES)
        .map(|file| file.strip_prefix(&root).unwrap_or(file).display().to_string())
        .collect();
    if let more @ 1.. = images.len().saturating_sub(MOST_NAMES) {
        names.push(format!("{more} more"));
    }
    let message = match images.len() {
        0 => return None,
        1 => "1 image has no camera, and is left out".to_owned(),
        count => format!("{count} images have no camera, and are left out"),
    };
    Some(format!("{}: {message}: {}", path.display(), names.join(", ")))
}

/// Adds the images in a folder and in those inside it. Links to folders are not followed.
fn list(path: &Path, depth: usize, images: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(path) else { return };
    for entry in entries.flatten() {
        let (path, kind) = (entry.path(), entry.file_type());
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match kind {
            Ok(kind) if kind.is_dir() && depth > 0 => list(&path, depth - 1, images),
            Ok(kind) if kind.is_file() && IMAGES.contains(&&*ending) => images.push(path),
            _ => (),
        }
    }
}
