//! Error against time: views through the lens, and one view with its blurs.

use bokashi_catalogue::lens::{Frame, LensScene, Named, UNIT, named};
use bokashi_core::{Tape, Tensor, mean_squared_error};
use bokashi_fit::FitError;
use bokashi_render_ops::ThinLens;
use bokashi_report::{Cell, Column, Curve, Figure, Figures, PALETTE, Scale, Stroke, Table};

use super::measure::{Measured, Truth, Way, measure};
use crate::bench::effort::{Effort, USUAL};
use crate::bench::sampling::{Contestant, Timing, interleaved};
use crate::bench::setting::Bench;

/// Views that stand for the lens.
const VIEWS: [usize; 5] = [16, 32, 64, 128, 256];
/// Samples along each side of a pixel.
const SAMPLES: [usize; 4] = [1, 2, 4, 8];
/// The scenes that are timed: two planes, a floor, several things at once.
const SCENES: [&str; 3] = ["board in front", "slanted board on a floor", "five balls"];
/// Pixels along a side, and the most samples along each: at the first, scenes are as elsewhere. More samples of the
/// second would fill some gigabytes.
const PIXELS: [(usize, usize); 2] = [(UNIT, 8), (256, 4)];

fn ways(effort: Effort, most: usize) -> Vec<Way> {
    let views = VIEWS[..effort.choose(1, VIEWS.len())].iter().map(|&count| Way::Views(count));
    let samples = &SAMPLES[..effort.choose(2, SAMPLES.len())];
    let samples = samples.iter().filter(|&&samples| samples <= most);
    let samples = samples.map(|&samples| Way::Picture(samples));
    [Way::Pinhole, Way::Gather].into_iter().chain(samples).chain(views).collect()
}

impl Way {
    fn name(self) -> String {
        match self {
            Self::Pinhole => "no lens".to_owned(),
            Self::Picture(1) => "lens_picture".to_owned(),
            Self::Picture(samples) => format!("lens_picture, {samples} x {samples} samples"),
            Self::Gather => "depth_of_field".to_owned(),
            Self::Views(count) => format!("{count} views"),
        }
    }
}

/// A step of a fit on `tape`: the picture and its error against `target`, and gradients by aperture and focus where
/// it `learns` them and has some. Views take turns on the tape.
fn step(
    way: Way,
    scene: &LensScene,
    frame: Frame,
    numbers: [f64; 2],
    target: &Tensor<f32>,
    tape: &mut Tape<f32>,
    learns: bool,
) -> Result<(), FitError> {
    let views = if let Way::Views(count) = way { count } else { 1 };
    for view in 0..views {
        tape.reset();
        let tape = &*tape;
        let number = |value: f64| match learns {
            true => tape.leaf_scalar(value as f32),
            false => tape.constant_scalar(value as f32),
        };
        let [aperture, focus] = [numbers[0] * frame.scale(), numbers[1]].map(number);
        let image = way.drawn(scene, frame, ThinLens { aperture, focus }, view)?;
        let loss = mean_squared_error(image, tape.constant(target))?;
        if loss.needs_gradient() {
            loss.backward()?;
        }
    }
    Ok(())
}

/// How far off a way is, and its times without and with gradients.
struct Row {
    way: Way,
    measured: Measured,
    times: [Timing; 2],
}

/// All ways on a scene, with `most` samples along each side of a pixel.
fn rows(
    bench: &Bench,
    named: &Named,
    (pixels, most): (usize, usize),
) -> Result<Vec<Row>, FitError> {
    let Named { scene, numbers, .. } = named;
    let frame = Frame::new(pixels);
    let points = bench.effort.choose([8, 4], [512, 256]);
    let truth = Truth::new(scene, pixels, *numbers, points)?;
    let target = truth.image.cast();
    let all = ways(bench.effort, most);
    let mut contestants = Vec::new();
    for &way in &all {
        for learns in [false, true] {
            let (target, mut tape) = (&target, Tape::new());
            contestants.push(Contestant::new(bench.one(), move || {
                step(way, scene, frame, *numbers, target, &mut tape, learns)
            }));
        }
    }
    let mut times = interleaved(&mut contestants, bench.effort, USUAL).into_iter();
    let row = |way: Way| -> Result<Row, FitError> {
        let mut next = || times.next().expect("a time for each contestant");
        let times = [next()?, next()?];
        Ok(Row { way, measured: measure(way, scene, pixels, *numbers, &truth)?, times })
    };
    all.into_iter().map(row).collect()
}

/// The error of both gradients, in percent: the root of the mean of their squares.
fn gradients_off(measured: &Measured) -> f64 {
    let squares = measured.slopes.map(|slope| slope.off * slope.off);
    100.0 * (0.5 * (squares[0] + squares[1])).sqrt()
}

/// The curves of a panel: an error against the time of a step.
fn panel(title: String, rows: &[Row], error: fn(&Measured) -> f64) -> Figure {
    let points = |of: fn(Way) -> bool| {
        let own = rows.iter().filter(move |row| of(row.way));
        own.map(move |row| (row.times[1].minimum, error(&row.measured)))
    };
    let kinds: [fn(Way) -> bool; 4] = [
        |way| matches!(way, Way::Views(_)),
        |way| matches!(way, Way::Picture(_)),
        |way| way == Way::Gather,
        |way| way == Way::Pinhole,
    ];
    let curves = kinds
        .into_iter()
        .enumerate()
        .map(|(color, kind)| Curve::line(color, Stroke::Solid, points(kind)).with_dots());
    let x = (Scale::Seconds, "time of a step with gradients");
    Figure::new(title, x, Scale::Logarithmic, curves)
}

const COLUMNS: [Column; 11] = [
    ("scene", "scene"),
    ("pixels", "pixels"),
    ("way", "way"),
    ("RMS, %", "rms_percent"),
    ("by K, %", "size_by_aperture_percent"),
    ("off, %", "off_by_aperture_percent"),
    ("by f, %", "size_by_focus_percent"),
    ("off, %", "off_by_focus_percent"),
    ("forward, ms", "forward_minimum_milliseconds"),
    ("with gradients, ms", "step_minimum_milliseconds"),
    ("median, ms", "step_median_milliseconds"),
];

/// Times and errors of all ways, and a figure of them: pictures above, gradients below.
pub(super) fn study(bench: &Bench) -> Result<(Table, Figures), FitError> {
    let title = "Error against time: f32, one thread";
    let mut table = Table::new("lens_times", title, &COLUMNS);
    let mut panels = [Vec::new(), Vec::new()];
    let scenes = named().into_iter().filter(|scene| SCENES.contains(&&*scene.name));
    for scene in scenes.take(bench.effort.choose(1, SCENES.len())) {
        for size in &PIXELS[..bench.effort.choose(1, PIXELS.len())] {
            let rows = rows(bench, &scene, *size)?;
            for Row { way, measured, times: [forward, step] } in &rows {
                let mut row = vec![Cell::text(&scene.name), Cell::Count(size.0)];
                row.extend([Cell::text(way.name()), Cell::number(measured.rms)]);
                for slope in measured.slopes {
                    row.extend([slope.size, slope.off].map(|share| Cell::number(100.0 * share)));
                }
                let times = [(forward, forward.minimum), (step, step.minimum), (step, step.median)];
                row.extend(times.map(|(timing, seconds)| timing.cell(1e3 * seconds)));
                table.push(row);
            }
            if size.0 == UNIT {
                let name = &scene.name;
                panels[0].push(panel(format!("RMS, %: {name}"), &rows, |measured| measured.rms));
                panels[1].push(panel(format!("gradients off, %: {name}"), &rows, gradients_off));
            }
        }
    }
    let names = ["views through the lens", "lens_picture", "depth_of_field", "no lens"];
    let legend = names.into_iter().zip(PALETTE);
    let legend = legend.map(|(name, color)| (name.to_owned(), color, Stroke::Solid));
    Ok((table, Figures::new(panels.concat(), legend)))
}
