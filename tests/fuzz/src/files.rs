//! Folders with a few files, and what refusals have to be.

use std::fs;
use std::panic;

use bokashi_scene::{Folder, Picture, Place, Samples, SceneError};

/// What `read` answers of a new folder with these files, which is gone afterwards.
pub fn beside<'f>(
    files: impl IntoIterator<Item = (&'f str, &'f [u8])>,
    read: impl FnOnce(&Folder) -> usize,
) -> usize {
    let place = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        let path = place.path().join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).expect("a folder");
        }
        fs::write(path, bytes).expect("a small file");
    }
    read(&Folder::new(place.path()).expect("a folder"))
}

/// A PNG of 3 x 2 pixels, gray and opacity.
pub fn small_image() -> Vec<u8> {
    let samples = Samples::U8(vec![0, 255, 127, 255, 255, 0, 10, 255, 20, 255, 30, 128]);
    let image = Picture { width: 3, height: 2, channels: 2, samples };
    image.encode_png(&Place::of("a.png")).expect("an image")
}

/// 0, for an input that was refused with a message that people can read.
pub fn in_short(error: &SceneError) -> usize {
    let said = error.to_string();
    let begin: String = said.chars().take(500).collect();
    assert!(said.len() < 4096, "{} letters: {begin}", said.len());
    0
}

/// Lets panics pass that become errors: libFuzzer's hook ends the process at any panic.
pub fn let_guarded_panics_pass() {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if !bokashi_scene::is_guarded() {
            hook(info);
        }
    }));
}
