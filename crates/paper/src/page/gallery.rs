//! Pictures of the learnt cube along a fit, beside its target: the paper's Figures 3 and 5.
//!
//! Two rows per fit. *Seen*: the image that the fit compares with its target, in its own
//! resolution, each pixel a square. *Cube*: the same cube large and sharp, with the wireframes
//! of the learnt cube (white) and of the true one (yellow) over it. All from one fixed view.

use std::fmt::Write as _;

use bokashi_report::{
    ReportError, RgbImage, data_uri, enlarged, escaped, grouped, picture_of, png, sheet,
};

use super::digest::{Fit, Group};
use crate::{self as scenes, Experiment, Preset, Silhouettes, Snapshot, View};

/// Side of the large pictures, in pixels.
const SIDE: usize = 192;
/// The wireframe of the true cube.
const TRUE: &str = "#FFC53D";
/// The wireframe of the learnt cube.
const LEARNT: &str = "#FFFFFF";
/// The steps that the paper shows.
const SHOWN: [u64; 5] = [0, 10, 100, 1_000, 10_000];

/// The view of all pictures: the pose of experiment 5.2.
pub(crate) fn view() -> View {
    View::fixed()
}

/// The image that the fit of `fit` makes of `snapshot`, in its own resolution.
pub(crate) fn draw(fit: &Fit, snapshot: &Snapshot) -> Result<RgbImage, ReportError> {
    let settings = &fit.settings;
    let sigma = snapshot.sigma.filter(|_| settings.blurs());
    let blur = sigma.map(|sigma| (settings.kernel, sigma));
    let (side, silhouettes) = (settings.resolution, settings.silhouettes);
    let image = scenes::picture(snapshot, side, silhouettes, blur, &view())
        .map_err(ReportError::content)?;
    picture_of(&image)
}

/// The cube of `snapshot`, `side` pixels high, sharp.
fn cube(snapshot: &Snapshot, side: usize) -> Result<RgbImage, ReportError> {
    let picture = scenes::picture(snapshot, side, Silhouettes::Antialias, None, &view());
    picture_of(&picture.map_err(ReportError::content)?)
}

/// What the fit should find.
pub(crate) fn target(fit: &Fit) -> Snapshot {
    scenes::truth(fit.settings.blurs().then_some(fit.settings.sigma_target))
}

/// The snapshots of the paper's steps, and the last.
fn shown(fit: &Fit) -> Vec<&Snapshot> {
    let last = fit.snapshots.last().map(|snapshot| snapshot.step);
    let shown = |step: u64| SHOWN.contains(&step) || Some(step) == last;
    fit.snapshots.iter().filter(|snapshot| shown(snapshot.step)).collect()
}

/// A group's pictures as a PNG file: rows *seen* and *cube*, columns the steps and the target.
pub(crate) fn file(group: &Group) -> Result<Option<Vec<u8>>, ReportError> {
    let fit = group.typical();
    let shown = shown(fit);
    if shown.is_empty() {
        return Ok(None);
    }
    let (mut top, mut bottom) = (Vec::new(), Vec::new());
    for snapshot in shown.into_iter().chain([&target(fit)]) {
        top.push(enlarged(&draw(fit, snapshot)?, SIDE as u32));
        bottom.push(cube(snapshot, SIDE)?);
    }
    let rows =
        if group.settings.experiment == Experiment::Sigma { vec![top] } else { vec![top, bottom] };
    png(&sheet(&rows, 6, [96; 3])).map(Some)
}

/// The galleries of an experiment, one per group, as HTML; those with tuned rates folded, where
/// there are others to see.
pub(crate) fn html(groups: &[&Group]) -> Result<String, ReportError> {
    let (tuned, paper): (Vec<&Group>, Vec<&Group>) =
        groups.iter().partition(|group| group.settings.preset == Preset::Tuned);
    let (tuned, mut html) = (galleries(&tuned)?, galleries(&paper)?);
    if html.is_empty() || tuned.is_empty() {
        html.push_str(&tuned);
    } else {
        let _ = write!(html, "<details><summary>With tuned rates</summary>{tuned}</details>");
    }
    Ok(html)
}

fn galleries(groups: &[&Group]) -> Result<String, ReportError> {
    let mut html = String::new();
    for group in groups {
        let fit = group.typical();
        let shown = shown(fit);
        if shown.is_empty() {
            continue;
        }
        let name = escaped(&group.name());
        let seed = fit.settings.seed;
        let median = if group.fits.len() > 1 { ", the one of median error" } else { "" };
        let stuck = if fit.is_stuck() { "; it did not find the cube" } else { "" };
        let _ = write!(html, "<h4>{name} <small>seed {seed}{median}{stuck}</small></h4>");
        html.push_str(&strip(fit, &shown)?);
    }
    Ok(html)
}

/// One fit: a heading, the row *seen*, the row *cube*.
fn strip(fit: &Fit, shown: &[&Snapshot]) -> Result<String, ReportError> {
    let target = target(fit);
    let columns = shown.len() + 1;
    let mut heads = String::new();
    let (mut top, mut bottom) = (String::new(), String::new());
    for snapshot in shown.iter().copied().chain([&target]) {
        let is_target = std::ptr::eq(snapshot, &target);
        let head = if is_target {
            "target".to_owned()
        } else {
            format!("step {}", grouped(snapshot.step as f64))
        };
        let sigma = match snapshot.sigma.filter(|_| fit.settings.blurs()) {
            Some(sigma) => format!(" <small>σ {sigma:.3}</small>"),
            None => String::new(),
        };
        let _ = write!(heads, "<span>{head}{sigma}</span>");
        let uri = data_uri(&png(&draw(fit, snapshot)?)?);
        let _ = write!(top, "<img class=\"seen\" alt=\"seen at {head}\" src=\"{uri}\">");
        let frame = [(&target, TRUE), (snapshot, LEARNT)];
        bottom.push_str(&wired(snapshot, &frame[usize::from(is_target)..], &head)?);
    }
    let cube = match fit.settings.experiment {
        Experiment::Sigma => String::new(),
        _ => format!("<b>cube</b>{bottom}"),
    };
    Ok(format!(
        "<div class=\"scroll\"><div class=\"strip\" style=\"--columns:{columns}\">\
         <b></b>{heads}<b>seen</b>{top}{cube}</div></div>"
    ))
}

/// The final cube of one fit beside nothing else: for a list of fits that are stuck.
pub(crate) fn last_of(fit: &Fit) -> Result<Option<String>, ReportError> {
    let Some(last) = fit.snapshots.last() else { return Ok(None) };
    let target = target(fit);
    let frame = [(&target, TRUE), (last, LEARNT)];
    wired(last, &frame, &format!("the end of seed {}", fit.settings.seed)).map(Some)
}

/// A sharp picture of `snapshot` under wireframes, as SVG.
fn wired(
    snapshot: &Snapshot,
    frames: &[(&Snapshot, &str)],
    name: &str,
) -> Result<String, ReportError> {
    let uri = data_uri(&png(&cube(snapshot, SIDE)?)?);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {SIDE} {SIDE}\" role=\"img\" aria-label=\"cube at {name}\">\
         <image width=\"{SIDE}\" height=\"{SIDE}\" href=\"{uri}\"/>"
    );
    for (cube, color) in frames {
        let places = scenes::outline(cube, SIDE, &view());
        let mut path = String::new();
        for [from, to] in scenes::edges() {
            let ([x1, y1], [x2, y2]) = (places[from], places[to]);
            if [x1, y1, x2, y2].iter().all(|coordinate| coordinate.is_finite()) {
                let _ = write!(path, "M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}");
            }
        }
        let _ = write!(
            svg,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.2\"/>"
        );
    }
    svg.push_str("</svg>");
    Ok(svg)
}
