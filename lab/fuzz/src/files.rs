//! Folders with a few files, and what refusals have to be.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::{fs, panic};

use bokashi_scene::{Folder, Location, Picture, Samples, SceneError};
use tempfile::TempDir;

/// A folder, and what its files hold.
struct Written {
    place: TempDir,
    files: BTreeMap<String, Vec<u8>>,
}

thread_local! {
    /// Folders that nobody uses: to make one takes longer than to read a small file.
    static WRITTEN: RefCell<Vec<Written>> = const { RefCell::new(Vec::new()) };
}

/// What `read` answers of a folder with these files and no others.
pub fn beside<'f>(
    files: impl IntoIterator<Item = (&'f str, &'f [u8])>,
    read: impl FnOnce(&Folder) -> usize,
) -> usize {
    let files: BTreeMap<&str, &[u8]> = files.into_iter().collect();
    let mut written = WRITTEN.with_borrow_mut(Vec::pop).unwrap_or_else(|| Written {
        place: tempfile::tempdir().expect("a temporary folder"),
        files: BTreeMap::new(),
    });
    let root = written.place.path();
    written.files.retain(|name, _| {
        let is_kept = files.contains_key(name.as_str());
        if !is_kept {
            fs::remove_file(root.join(name)).expect("a file of ours");
        }
        is_kept
    });
    for (name, bytes) in files {
        if written.files.get(name).is_none_or(|kept| kept != bytes) {
            let path = root.join(name);
            fs::create_dir_all(path.parent().unwrap_or(root)).expect("a folder");
            fs::write(path, bytes).expect("a small file");
            written.files.insert(name.to_owned(), bytes.to_vec());
        }
    }
    let reached = read(&Folder::new(root).expect("a folder"));
    WRITTEN.with_borrow_mut(|all| all.push(written));
    reached
}

/// A PNG of 3 x 2 pixels, gray and opacity.
pub fn small_image() -> Vec<u8> {
    let samples = Samples::U8(vec![0, 255, 127, 255, 255, 0, 10, 255, 20, 255, 30, 128]);
    let image = Picture { width: 3, height: 2, channels: 2, samples };
    image.encode_png(&Location::new("a.png")).expect("an image")
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
