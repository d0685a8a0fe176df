//! Error against time: views through the lens, and one view with its blurs.

use bokashi_catalogue::lens::{
    Frame, LensScene, Named, UNIT, draw, gather, mean_through, named, point, through,
};
use bokashi_core::{Tape, Tensor, mean_squared_error};
use bokashi_fit::FitError;
use bokashi_render_ops::ThinLens;
use bokashi_report::{Cell, Curve, Figure, Figures, PALETTE, Scale, Stroke, Table};

use super::measure::{Way, percent_off};
use crate::bench::effort::{Effort, USUAL};
use crate::bench::sampling::{Contestant, Timing, interleaved};
use crate::bench::setting::Bench;

/// Views that stand for the lens.
const VIEWS: [usize; 4] = [16, 32, 64, 128];
/// The scenes that are timed: two planes, a floor, several things at once.
const SCENES: [&str; 3] = ["board in front", "slanted board on a floor", "five balls"];
/// Pixels along a side: at the first, scenes are as elsewhere.
const PIXELS: [usize; 2] = [UNIT, 256];

fn ways(effort: Effort) -> Vec<Way> {
    let views = &VIEWS[..effort.choose(1, VIEWS.len())];
    let views = views.iter().map(|&count| Way::Views(count));
    views.chain([Way::Picture, Way::Gather]).collect()
}

impl Way {
    fn name(self) -> String {
        match self {
            Self::Picture => "lens_picture".to_owned(),
            Self::Gather => "depth_of_field".to_owned(),
            Self::Views(count) => format!("{count} views"),
        }
    }
}

/// A step of a fit on `tape`: the picture and its error against `target`, and gradients by aperture and focus where
/// it `learns` them. Views take turns on the tape.
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
    for k in 0..views {
        tape.reset();
        let tape = &*tape;
        let number = |value: f64| match learns {
            true => tape.leaf_scalar(value as f32),
            false => tape.constant_scalar(value as f32),
        };
        let [aperture, focus] = [numbers[0] * frame.scale(), numbers[1]].map(number);
        let lens = ThinLens { aperture, focus };
        let clip = |frame: Frame| tape.constant(&scene.clip(frame));
        let image = match way {
            Way::Picture => draw(scene, frame, clip(frame), lens)?.image,
            Way::Gather => gather(scene, frame, clip(frame), lens)?,
            Way::Views(count) => {
                let frame = frame.without_margin();
                through(scene, frame, clip(frame), lens, point(k, count, 0.0))?
            }
        };
        let loss = mean_squared_error(image, tape.constant(target))?;
        if learns {
            loss.backward()?;
        }
    }
    Ok(())
}

/// A way's error in percent, and its times without and with gradients.
struct Row {
    way: Way,
    off: f64,
    times: [Timing; 2],
}

/// All ways on a scene.
fn rows(bench: &Bench, named: &Named, pixels: usize) -> Result<Vec<Row>, FitError> {
    let Named { scene, numbers, .. } = named;
    let frame = Frame::new(pixels);
    let own = [numbers[0] * frame.scale(), numbers[1]];
    let points = bench.effort.choose(8, 512);
    let truth: Tensor<f32> = mean_through(scene, frame.without_margin(), own, points, 1.0)?;
    let all = ways(bench.effort);
    let mut contestants = Vec::new();
    for &way in &all {
        for learns in [false, true] {
            let (truth, mut tape) = (&truth, Tape::new());
            contestants.push(Contestant::new(bench.one(), move || {
                step(way, scene, frame, *numbers, truth, &mut tape, learns)
            }));
        }
    }
    let mut times = interleaved(&mut contestants, bench.effort, USUAL).into_iter();
    let truth = truth.cast();
    let row = |way: Way| -> Result<Row, FitError> {
        let mut next = || times.next().expect("a time for each contestant");
        let times = [next()?, next()?];
        let off = percent_off(&way.image(scene, pixels, *numbers)?, &truth);
        Ok(Row { way, off, times })
    };
    all.into_iter().map(row).collect()
}

/// The curves of a panel: error against the time of a step.
fn panel(title: String, rows: &[Row]) -> Figure {
    let points = |of: fn(Way) -> bool| {
        let own = rows.iter().filter(move |row| of(row.way));
        own.map(|row| (row.times[1].minimum, row.off))
    };
    let kinds: [fn(Way) -> bool; 3] =
        [|way| matches!(way, Way::Views(_)), |way| way == Way::Picture, |way| way == Way::Gather];
    let curves = kinds
        .into_iter()
        .enumerate()
        .map(|(color, kind)| Curve::line(color, Stroke::Solid, points(kind)).with_dots());
    let x = (Scale::Seconds, "time of a step with gradients");
    Figure::new(title, x, Scale::Logarithmic, curves)
}

/// Times and errors of all ways, and a figure of them.
pub(super) fn study(bench: &Bench) -> Result<(Table, Figures), FitError> {
    let columns = [
        ("scene", "scene"),
        ("pixels", "pixels"),
        ("way", "way"),
        ("RMS, %", "rms_percent"),
        ("forward, ms", "forward_minimum_milliseconds"),
        ("with gradients, ms", "step_minimum_milliseconds"),
        ("median, ms", "step_median_milliseconds"),
    ];
    let title = "Error against time: f32, one thread";
    let (mut table, mut panels) = (Table::new("lens_times", title, &columns), Vec::new());
    let scenes = named().into_iter().filter(|scene| SCENES.contains(&&*scene.name));
    for scene in scenes.take(bench.effort.choose(1, SCENES.len())) {
        for pixels in &PIXELS[..bench.effort.choose(1, PIXELS.len())] {
            let rows = rows(bench, &scene, *pixels)?;
            for Row { way, off, times: [forward, step] } in &rows {
                table.push(vec![
                    Cell::text(&scene.name),
                    Cell::Count(*pixels),
                    Cell::text(way.name()),
                    Cell::number(*off),
                    forward.cell(1e3 * forward.minimum),
                    step.cell(1e3 * step.minimum),
                    step.cell(1e3 * step.median),
                ]);
            }
            if *pixels == UNIT {
                panels.push(panel(format!("RMS, %: {}", scene.name), &rows));
            }
        }
    }
    let names = ["views through the lens", "lens_picture", "depth_of_field"];
    let legend = names.into_iter().zip(PALETTE);
    let legend = legend.map(|(name, color)| (name.to_owned(), color, Stroke::Solid));
    Ok((table, Figures::new(panels, legend)))
}
