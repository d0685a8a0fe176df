mod camera;
mod transforms;

use std::fs;
use std::path::Path;

use glam::{DVec2, DVec3};
use tempfile::TempDir;

use super::Camera;
use crate::error::Location;
use crate::folder::Folder;
use crate::picture::{Picture, Samples};

/// A folder with files of text and gray images of 4 x 2 pixels.
pub(super) fn scene(texts: &[(&str, &str)], images: &[&str]) -> (TempDir, Folder) {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in texts {
        write(folder.path(), path, text.as_bytes());
    }
    let image = Picture { width: 4, height: 2, channels: 1, samples: Samples::U8(vec![7; 8]) };
    let image = image.encode_png(&Location::new("image")).unwrap();
    for path in images {
        write(folder.path(), path, &image);
    }
    let opened = Folder::new(folder.path()).unwrap();
    (folder, opened)
}

pub(super) fn write(folder: &Path, path: &str, bytes: &[u8]) {
    let path = folder.join(path);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

#[track_caller]
pub(super) fn assert_seen(camera: &Camera, point: [f64; 3], pixel: [f64; 2]) {
    let found = camera.pixel(DVec3::from(point)).unwrap();
    assert!(found.abs_diff_eq(DVec2::from(pixel), 1e-10), "{found} instead of {pixel:?}");
}
