//! The film of a report: learnt cubes above their targets, from the first step to the last.
//!
//! The view turns a little from frame to frame, so that one sees the shape and not one
//! silhouette. Blur is shown as the fit sees it, at the size of the film. The bar at the foot
//! runs over the steps, evenly in their logarithm, with a mark at each power of ten.

use bokashi_report::{ReportError, RgbImage, animation, picture_of, png, sheet};

use super::digest::{Fit, Group};
use super::gallery::target;
use crate::{self as scenes, Experiment, Preset, Silhouettes, Snapshot, View};

/// Frames per second.
const RATE: u16 = 12;
/// How long the last frame stays, as a multiple of the others.
const REST: u16 = 15;
/// Width of the whole film, in pixels, at most; a tile is no larger than [`TILE`].
const WIDTH: usize = 560;
/// Side of the largest tile, in pixels.
const TILE: usize = 176;
/// Between the tiles.
const GAP: u32 = 4;
/// Behind the tiles.
const GROUND: [u8; 3] = [38, 40, 48];
/// The bar, and its marks.
const BAR: [[u8; 3]; 2] = [[79, 179, 240], [150, 154, 164]];
/// Height of the bar's strip.
const STRIP: u32 = 10;

/// The groups that a film shows: those with the paper's rates and antialias (or, where there
/// are none, whatever there is) of the last experiment that has any.
pub(crate) fn cast<'a>(groups: &[&'a Group]) -> Vec<&'a Group> {
    for experiment in [Experiment::Joint, Experiment::Vertices, Experiment::Sigma] {
        let chosen = groups.iter().filter(|group| group.settings.experiment == experiment);
        let (first, rest): (Vec<&Group>, Vec<&Group>) = chosen.partition(|group| {
            let settings = &group.settings;
            settings.silhouettes == Silhouettes::Antialias && settings.preset == Preset::Paper
        });
        let cast = if first.is_empty() { rest } else { first };
        if !cast.is_empty() {
            return cast.into_iter().take(4).collect();
        }
    }
    Vec::new()
}

/// A film, and a picture of it for readers who asked for less motion.
#[derive(Debug)]
pub(crate) struct Film {
    /// The animated PNG.
    pub(crate) moving: Vec<u8>,
    /// Its last frame, a PNG.
    pub(crate) still: Vec<u8>,
}

/// The film of `groups` (see [`cast`]); `None` where no fit kept its snapshots.
pub(crate) fn film(groups: &[&Group]) -> Result<Option<Film>, ReportError> {
    let fits: Vec<&Fit> = groups.iter().map(|group| group.typical()).collect();
    let fits: Vec<&Fit> = fits.into_iter().filter(|fit| !fit.snapshots.is_empty()).collect();
    let Some(longest) = fits.iter().map(|fit| fit.snapshots.len()).max() else { return Ok(None) };
    let side = (WIDTH / fits.len()).min(TILE);
    let mut frames = Vec::with_capacity(longest);
    let moves = fits[0].settings.experiment != Experiment::Sigma;
    for index in 0..longest {
        let part = index as f64 / longest.max(2) as f64;
        let turned = View::angles([0.6, 0.5 + std::f64::consts::FRAC_PI_2 * part]);
        let view = if moves { turned } else { View::fixed() };
        let (mut learnt, mut truth) = (Vec::new(), Vec::new());
        for fit in &fits {
            let snapshot = &fit.snapshots[index.min(fit.snapshots.len() - 1)];
            learnt.push(tile(fit, snapshot, side, &view)?);
            truth.push(tile(fit, &target(fit), side, &view)?);
        }
        let last = fits[0].snapshots.len() - 1;
        let reached = fits[0].snapshots[index.min(last)].step;
        frames.push(with_bar(
            &sheet(&[learnt, truth], GAP, GROUND),
            reached,
            fits[0].settings.steps,
        ));
    }
    let still = png(&frames[frames.len() - 1])?;
    Ok(Some(Film { moving: animation(&frames, RATE, REST)?, still }))
}

/// One cube as its fit sees it, at the size of the film.
fn tile(fit: &Fit, snapshot: &Snapshot, side: usize, view: &View) -> Result<RgbImage, ReportError> {
    let scale = side as f64 / fit.settings.resolution as f64;
    let sigma = snapshot.sigma.filter(|_| fit.settings.blurs());
    let blur = sigma.map(|sigma| (fit.settings.kernel, sigma * scale));
    let picture = scenes::picture(snapshot, side, Silhouettes::Antialias, blur, view)
        .map_err(ReportError::content)?;
    let mut picture = picture_of(&picture)?;
    // Six bits per channel: half the bytes, and no step that an eye would see in motion.
    picture.pixels_mut().for_each(|pixel| *pixel = pixel.map(|value| value & 0xFC));
    Ok(picture)
}

/// A frame with the bar of steps under it.
fn with_bar(frame: &RgbImage, step: u64, steps: u64) -> RgbImage {
    let (width, height) = (frame.width(), frame.height());
    let mut barred = RgbImage::from_pixel(width, height + STRIP, GROUND);
    barred.replace(frame, [0, 0]);
    let (left, length) = (GAP, width.saturating_sub(2 * GAP));
    let position = |step: u64| {
        let part = (step as f64 + 1.0).ln() / (steps.max(1) as f64 + 1.0).ln();
        left + (part.clamp(0.0, 1.0) * f64::from(length)) as u32
    };
    let mut fill = |from: u32, to: u32, color: [u8; 3], [top, low]: [u32; 2]| {
        for (x, y) in (from..to.min(width)).flat_map(|x| (top..low).map(move |y| (x, height + y))) {
            barred.set_pixel(x, y, color);
        }
    };
    fill(left, position(step), BAR[0], [2, STRIP - 4]);
    let powers = (0..=19).map(|power| 10_u64.pow(power)).take_while(|&power| power <= steps);
    for mark in powers.map(position) {
        fill(mark, mark + 1, BAR[1], [0, STRIP - 2]);
    }
    barred
}
