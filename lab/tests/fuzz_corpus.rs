//! The corpus that fuzzing keeps, replayed without libFuzzer: every input that once showed something
//! new, among them those that once showed a defect.

use std::fs;
use std::path::Path;
use std::sync::Once;

#[allow(unreachable_pub, reason = "public in the package of the fuzz targets")]
#[path = "../fuzz/src/lib.rs"]
mod fuzz;

/// Runs `target` on each kept input of the corpus `name`; returns what it returned.
fn replayed(name: &str, target: fn(&[u8]) -> usize) -> Vec<usize> {
    static QUIET: Once = Once::new();
    QUIET.call_once(fuzz::let_guarded_panics_pass);
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name);
    let entries = fs::read_dir(&corpus).unwrap().map(|entry| entry.unwrap().path());
    let mut inputs: Vec<_> = entries.collect();
    inputs.sort();
    let run = |input: &std::path::PathBuf| {
        let bytes = fs::read(input).unwrap();
        let reached = std::panic::catch_unwind(|| target(&bytes));
        reached.unwrap_or_else(|_| panic!("{} breaks a promise", input.display()))
    };
    inputs.iter().map(run).collect()
}

/// Inputs that reach something: others show that wrong input is refused.
fn reaching(all: &[usize]) -> usize {
    all.iter().filter(|&&reached| reached > 0).count()
}

#[test]
fn meshes_keep_their_promises() {
    let all = replayed("mesh", fuzz::mesh);
    assert!(reaching(&all) > 30, "{all:?}");
    assert!(all.iter().any(|&fragments| fragments > 100), "{all:?}");
}

#[test]
fn matrices_keep_their_promises() {
    let all = replayed("matrix", fuzz::matrix);
    assert!(reaching(&all) > 30, "{all:?}");
}

#[test]
fn images_keep_their_promises() {
    let all = replayed("image", fuzz::image);
    assert!(reaching(&all) > 30, "{all:?}");
}

#[test]
fn pictures_keep_their_promises() {
    let all = replayed("picture", fuzz::pictures);
    assert!(reaching(&all) > 30, "{all:?}");
    assert!(all.iter().any(|&pixels| pixels > 100), "{all:?}");
}

#[test]
fn blurs_by_the_discrete_kernel_keep_their_promises() {
    let all = replayed("discrete", fuzz::discrete);
    assert!(reaching(&all) > 30, "{all:?}");
}

#[test]
fn saved_fits_keep_their_promises() {
    let all = replayed("saved", fuzz::saved);
    assert!(reaching(&all) > 10, "{all:?}");
}

#[test]
fn meshes_of_files_keep_their_promises() {
    let all = replayed("mesh_file", fuzz::mesh_file);
    assert!(reaching(&all) > 10, "{all:?}");
}

#[test]
fn images_of_files_keep_their_promises() {
    let all = replayed("image_file", fuzz::image_file);
    assert!(reaching(&all) > 15, "{all:?}");
}

#[test]
fn cameras_of_files_keep_their_promises() {
    let all = replayed("camera_file", fuzz::camera_file);
    assert!(reaching(&all) > 5, "{all:?}");
}

#[test]
fn scenes_of_files_keep_their_promises() {
    let all = replayed("scene_file", fuzz::scene_file);
    assert!(reaching(&all) > 10, "{all:?}");
}

#[test]
fn arrays_of_files_keep_their_promises() {
    let all = replayed("array_file", fuzz::array_file);
    assert!(reaching(&all) > 8, "{all:?}");
}
