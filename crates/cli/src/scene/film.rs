//! The film of a fit: a few of its views above what they are to be, over the steps.

use std::cell::{OnceCell, RefCell};
use std::path::Path;

use bokashi_fit::{Listener, every};
use bokashi_report::{RgbImage, animation, png, sheet};
use bokashi_scene::{
    Location, Picture, Samples, SceneError, SceneFit, SceneView, Tensor, write_result,
};

use crate::failure::Failure;

/// The files in the folder of results: the film, and its last frame for readers who asked for less motion.
pub(super) const FILES: [&str; 2] = ["views/film.png", "views/film-end.png"];

/// The most parts into which frames divide a fit.
const PARTS: u64 = 14;
/// How many views are shown.
const VIEWS: usize = 3;
/// The width and the height of a view, in pixels, below twice this.
const SIDE: usize = 128;
/// The width up to which small views are enlarged, in pixels.
const WIDTH: u32 = 640;
/// Frames per second.
const RATE: u16 = 6;
/// How long the last frame stays, as a multiple of the others.
const REST: u16 = 15;
/// Between the views, and behind them.
const GAP: u32 = 4;
const GROUND: [u8; 3] = [38, 40, 48];

/// The frames of a fit.
#[derive(Debug, Default)]
pub(super) struct Film {
    frames: RefCell<Vec<RgbImage>>,
    /// The steps that were done at the first one.
    start: OnceCell<u64>,
    targets: OnceCell<Vec<RgbImage>>,
}

impl Film {
    /// A listener that adds a frame now and then over a fit of `steps`. Ranks share it, and the first draws.
    pub(super) fn listener(&self, steps: u64) -> impl Listener<SceneFit> + '_ {
        every(steps.div_ceil(PARTS).max(1), |fit: &SceneFit| fit.on_first(|| self.add(fit)))
    }

    /// Adds a frame: the first views that have an image, as they are seen now.
    fn add(&self, fit: &SceneFit) -> Result<(), SceneError> {
        let tiles = |image: &dyn Fn(usize, usize) -> Result<Tensor<f32>, SceneError>| {
            let views = fit.scene().views.iter().enumerate();
            let shown = views.filter(|(_, view)| view.image.is_some()).take(VIEWS);
            let tile = |(k, view): (usize, &SceneView)| {
                let size = view.camera.size;
                let reduce = (size.width.max(size.height) / SIDE).max(1);
                tile(&fit.scene().png_of(&image(k, reduce)?)?)
            };
            shown.map(tile).collect::<Result<Vec<_>, _>>()
        };
        // Of an image that can't be read, the fit speaks when its turn comes.
        let target = |view, reduce| fit.target(view, reduce);
        let targets = self.targets.get_or_init(|| tiles(&target).unwrap_or_default());
        if !targets.is_empty() {
            self.start.get_or_init(|| fit.steps_done());
            let seen = tiles(&|view, reduce| fit.picture(view, reduce))?;
            self.frames.borrow_mut().push(sheet(&[seen, targets.clone()], GAP, GROUND));
        }
        Ok(())
    }

    /// Writes the film to the folder `out`, and returns it as a block of a page; an empty one where no view has an
    /// image.
    pub(super) fn save(&self, out: &Path) -> Result<String, Failure> {
        let frames = self.frames.borrow();
        let (Some(last), Some(start)) = (frames.last(), self.start.get()) else {
            return Ok(String::new());
        };
        let [film, end] = FILES;
        for (name, bytes) in [(film, animation(&frames, RATE, REST)), (end, png(last))] {
            let bytes = bytes.map_err(|error| Failure::Work(error.to_string()))?;
            write_result(out, name, &bytes)?;
        }
        // Small views are shown enlarged.
        let width = (WIDTH / last.width()).max(1) * last.width();
        Ok(format!(
            "<div class=\"film\"><picture><source media=\"(prefers-reduced-motion:reduce)\" \
             srcset=\"{end}\"><img width=\"{width}\" alt=\"views turn into their targets\" \
             src=\"{film}\"></picture><div><p>Above what is seen, below the targets, from step {start} \
             on.</p></div></div>"
        ))
    }
}

/// A picture of red, green and blue bytes.
pub(super) fn tile(png: &[u8]) -> Result<RgbImage, SceneError> {
    let picture = Picture::decode(png, &Location::new(FILES[0]))?;
    let Samples::U8(bytes) = &picture.samples else { unreachable!("a PNG of a result has bytes") };
    let (pixels, _) = bytes.as_chunks::<3>();
    // Six bits per channel: half the size of the film, and no step that an eye would see in motion.
    let pixel = |x: u32, y: u32| pixels[y as usize * picture.width + x as usize].map(|x| x & 0xFC);
    Ok(RgbImage::from_fn(picture.width as u32, picture.height as u32, pixel))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_view_that_has_an_image_there_is_no_film() {
        let out = tempfile::tempdir().unwrap();
        assert!(Film::default().save(out.path()).unwrap().is_empty());
        assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0);
    }
}
