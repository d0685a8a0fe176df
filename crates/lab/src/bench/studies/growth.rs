//! Does the cost grow linearly in faces and in pixels?

use bokashi_fit::FitError;
use bokashi_render_ops::Cull;
use bokashi_report::{Curve, Figure, PALETTE, Panel, SIZES, Scale, Stroke};

use crate::bench::effort::USUAL;
use crate::bench::pipeline::{Compared, Learner, contestant};
use crate::bench::sampling::{Timing, interleaved};
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;
use crate::bench::study::{Figures, Study};
use crate::bench::table::{Cell, Table};

/// Of the spheres in images of [`PIXELS_OF_FACES`].
const FACES: [usize; 5] = [100, 1_000, 10_000, 100_000, 1_000_000];
const PIXELS_OF_FACES: usize = 512;
/// Of the images of a sphere of [`FACES_OF_PIXELS`].
const PIXELS: [usize; 8] = [32, 64, 128, 256, 512, 1024, 2048, 4096];
const FACES_OF_PIXELS: usize = 1_000;

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let threads = bench.widest().current_num_threads();
    let mut study = Study::new(
        "growth",
        "Cost against faces and pixels",
        format!(
            "A step as in the first table, on spheres, f32, back faces culled, {threads} threads. \
             Scenes are timed one after the other, not in turns, since the largest take gigabytes. \
             The exponent is that of the time between a row and the row before. Linear growth has \
             the exponent 1. It is less where a constant part of the time still counts, and more \
             where the caches end. Fitted exponents are slopes of logarithms by least squares, \
             over all rows and over the last three, where a constant part counts least. Dotted: \
             linear growth through the last point."
        ),
    );
    let mut table = Table::new(
        "growth",
        "Time of a step",
        &[
            ("grows", "grows"),
            ("faces", "faces"),
            ("pixels", "pixels"),
            ("time, ms", "minimum_milliseconds"),
            ("median, ms", "median_milliseconds"),
            ("exponent", "exponent"),
            ("ns per face or pixel", "nanoseconds_per_face_or_pixel"),
            ("samples", "samples"),
        ],
    );
    let faces = &FACES[..bench.effort.choose(2, FACES.len())];
    let pixels = &PIXELS[..bench.effort.choose(2, PIXELS.len())];
    let of_faces = faces.iter().map(|&faces| Scene::sphere_of(faces, PIXELS_OF_FACES));
    let of_pixels = pixels.iter().map(|&pixels| Scene::sphere_of(FACES_OF_PIXELS, pixels));
    let rows: [(&str, Vec<Scene>); 2] = [
        ("faces", of_faces.collect::<Result<_, _>>()?),
        ("pixels", of_pixels.collect::<Result<_, _>>()?),
    ];
    let mut fitted = Table::new(
        "growth_exponents",
        "Fitted exponents of the time",
        &[
            ("grows", "grows"),
            ("from", "from"),
            ("to", "to"),
            ("over all rows", "exponent"),
            ("over the last three", "exponent_of_last_three"),
        ],
    );
    let mut panels = Vec::new();
    for (grows, scenes) in rows {
        let mut points: Vec<[f64; 4]> = Vec::new();
        for scene in scenes {
            let (count, width) = (scene.mesh.faces().len(), scene.size.width);
            let area = scene.size.pixels() as f64;
            // One scene at a time: the largest take gigabytes.
            let learner = Learner::<f32>::new(&scene, Cull::Back, Compared::Picture)?;
            let timing =
                interleaved(&mut [contestant(learner, bench.widest())], bench.effort, USUAL);
            let what = format!("{count} faces, {width} px");
            let timing: Option<Timing> = study
                .noted(&what, timing.into_iter().collect::<Result<Vec<_>, _>>())
                .map(|mut all| all.remove(0));
            let Some(timing) = timing else { continue };
            let size = if grows == "faces" { count as f64 } else { area };
            points.push([size, timing.minimum, timing.minimum, timing.upper_quartile]);
            let last_two = points.len().checked_sub(2).map(|from| exponent(&points[from..]));
            table.push(vec![
                Cell::text(grows),
                Cell::Count(count),
                Cell::text(format!("{width} x {width}")),
                Cell::timed(&timing, 1e3 * timing.minimum),
                Cell::timed(&timing, 1e3 * timing.median),
                Cell::maybe(last_two),
                Cell::number(1e9 * timing.minimum / size),
                Cell::Count(timing.samples),
            ]);
        }
        if let [first, .., last] = &points[..] {
            fitted.push(vec![
                Cell::text(grows),
                Cell::number(first[0]),
                Cell::number(last[0]),
                Cell::number(exponent(&points)),
                Cell::number(exponent(&points[points.len().saturating_sub(3)..])),
            ]);
        }
        let linear = points.last().map_or(Vec::new(), |last| {
            let at =
                |x: f64| [x, last[1] * x / last[0], last[1] * x / last[0], last[1] * x / last[0]];
            points.iter().map(|point| at(point[0])).collect()
        });
        panels.push(Panel {
            title: format!("Time of a step against {grows}"),
            figure: Figure {
                x: Scale::Counts,
                y: Scale::Seconds,
                x_title: if grows == "faces" { "faces" } else { "pixels of the image" },
                size: SIZES[0],
                spoken: format!("time of a step against {grows}, with linear growth beside it"),
                curves: vec![
                    Curve { color: 5, stroke: Stroke::Dotted, dots: false, points: linear },
                    Curve { color: 0, stroke: Stroke::Solid, dots: true, points },
                ],
                marks: Vec::new(),
            },
        });
    }
    study.figures.push(Figures {
        heading: None,
        is_folded: false,
        legend: vec![
            ("a step".to_owned(), PALETTE[0], Stroke::Solid),
            ("linear".to_owned(), PALETTE[5], Stroke::Dotted),
        ],
        panels,
    });
    study.tables.extend([fitted, table]);
    Ok(study)
}

/// The exponent of the power of x that fits y best: the slope of logarithms by least squares.
fn exponent(points: &[[f64; 4]]) -> f64 {
    let logarithms: Vec<[f64; 2]> = points.iter().map(|&[x, y, ..]| [x.ln(), y.ln()]).collect();
    let mean =
        |at: usize| logarithms.iter().map(|point| point[at]).sum::<f64>() / logarithms.len() as f64;
    let (x_mean, y_mean) = (mean(0), mean(1));
    let product = |[x, y]: &[f64; 2]| (x - x_mean) * (y - y_mean);
    let square = |[x, _]: &[f64; 2]| (x - x_mean).powi(2);
    logarithms.iter().map(product).sum::<f64>() / logarithms.iter().map(square).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponent_of_a_power_is_found_and_that_of_a_cost_with_a_constant_is_less() {
        let points = |time: fn(f64) -> f64| [1e2, 1e3, 1e4].map(|x| [x, time(x), 0.0, 0.0]);
        assert!((exponent(&points(|x| 3e-9 * x.powf(1.25))) - 1.25).abs() < 1e-12);
        let constant = exponent(&points(|x| 1e3 + x));
        assert!((0.1..0.9).contains(&constant), "{constant}");
    }
}
