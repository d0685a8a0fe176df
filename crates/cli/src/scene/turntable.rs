//! A camera that goes once around what a scene's cameras look at, as an animated picture.

use std::path::{Path, PathBuf};

use bokashi_report::{RgbImage, animation, png};
use bokashi_scene::{Scene, SceneError, write_result};

use super::film::tile;
use super::pictures::VIEWS;
use crate::failure::Failure;

/// The animation.
pub(super) const FILE: &str = "turntable.png";
/// Its first frame for readers who asked for less motion.
const STILL: &str = "turntable-still.png";

/// Frames of the whole circle.
const FRAMES: usize = 36;
/// The longer side of a frame, in pixels, below twice this; of smaller views theirs.
const SIDE: usize = 256;
/// Frames per second.
const RATE: u16 = 12;

/// Where the files of a fit lie in the folder of results.
pub(super) fn files() -> [PathBuf; 2] {
    [FILE, STILL].map(|name| Path::new(VIEWS).join(name))
}

/// The frames; none of a scene without views.
fn frames(scene: &Scene) -> Result<Vec<RgbImage>, SceneError> {
    let Some(turned) = scene.turntable(FRAMES) else { return Ok(Vec::new()) };
    let size = turned.views[0].camera.size;
    let reduce = (size.width.max(size.height) / SIDE).max(1);
    turned.pictures(reduce)?.map(|picture| tile(&turned.png_of(&picture?)?)).collect()
}

/// Writes the animation to `out`, of a scene with a view.
///
/// # Errors
/// [`Failure::Work`] for what can't be drawn or written.
pub(super) fn write(scene: &Scene, out: &Path) -> Result<(), Failure> {
    write_result(out, FILE, &animated(&frames(scene)?)?)?;
    Ok(())
}

/// Writes the animation and its first frame below the folder of results `out`, and returns a block of the page.
///
/// # Errors
/// As [`write`].
pub(super) fn write_for_page(scene: &Scene, out: &Path) -> Result<String, Failure> {
    let frames = frames(scene)?;
    let Some(first) = frames.first() else { return Ok(String::new()) };
    let still = png(first).map_err(|error| Failure::Work(error.to_string()))?;
    let [moving, end] = files();
    write_result(out, &moving, &animated(&frames)?)?;
    write_result(out, &end, &still)?;
    Ok(format!(
        "<div class=\"film\"><picture><source media=\"(prefers-reduced-motion:reduce)\" \
         srcset=\"{VIEWS}/{STILL}\"><img width=\"{}\" alt=\"a camera goes around what was learnt\" \
         src=\"{VIEWS}/{FILE}\"></picture><div><p>As it was learnt, from all around.</p></div></div>",
        first.width()
    ))
}

/// An endless animation whose last frame leads to the first.
fn animated(frames: &[RgbImage]) -> Result<Vec<u8>, Failure> {
    animation(frames, RATE, 1).map_err(|error| Failure::Work(error.to_string()))
}
