//! How good is the gradient of an antialiased silhouette, and what does it cost?
//!
//! The truth is the gradient of `<g, a(p)>`, where `a` is the picture of a cube with vertices `p`
//! averaged over the area of each pixel, by central differences of a picture with many samples per
//! pixel; `g` is one fixed upstream gradient per image, that of the squared error against the true
//! cube. A method gives the gradient of `<g, image(p)>` for an image of its own. The samples are
//! taken on two grids, a quarter of a sample to either side; half of the distance between the two
//! differences is their noise.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_fit::report::{Curve, Figure, PALETTE, Panel, SIZES, Scale, Stroke};
use bokashi_render_ops::{
    Background, Cull, Mesh, RasterOptions, Sampling, interpolate, project, rasterize, resolve,
};
use glam::{DMat4, DVec3};

use crate::bench::Bench;
use crate::effort::USUAL;
use crate::pipeline::render;
use crate::sampling::{Contestant, Timing, interleaved};
use crate::scenes::{CUBE_VERTICES, Scene};
use crate::study::{Figures, Study};
use crate::table::{Cell, Table};

/// Vertices are up to this far off, in sides of the cube.
const SHIFT: f64 = 0.1;
/// Half the step of the differences, in sides of the cube: some samples' widths, so that thousands
/// of samples change sides, and a small part of a pixel.
const STEP: f64 = 4e-3;
/// The sizes of the images, in pixels; each divides the number of samples.
const PIXELS: [usize; 4] = [8, 16, 32, 64];

/// A way to make an image of `pixels` x `pixels` from the cube's vertices.
struct Method {
    name: &'static str,
    image: Image,
}

/// The image of a scene with other positions and colours.
type Image = for<'t> fn(&Scene, Var<'t, f32>, Var<'t, f32>) -> Result<Var<'t, f32>, FitError>;

/// All methods; another one is another row.
const METHODS: [Method; 6] = [
    Method { name: "no antialias", image: |scene, p, c| Ok(picture(scene, p, c)?.jagged) },
    Method { name: "antialias", image: |scene, p, c| Ok(picture(scene, p, c)?.image) },
    Method { name: "antialias, 2x2", image: |scene, p, c| supersampled(2, scene, p, c) },
    Method { name: "antialias, 4x4", image: |scene, p, c| supersampled(4, scene, p, c) },
    Method { name: "exact coverage", image: |scene, p, c| exact(&scene.mesh, scene, p, c) },
    Method {
        name: "exact coverage, all edges",
        image: |scene, p, c| exact(&scene.mesh.with_seams(|_, _| true), scene, p, c),
    },
];

fn picture<'t, T: Scalar>(
    scene: &Scene,
    positions: Var<'t, T>,
    colors: Var<'t, T>,
) -> Result<crate::pipeline::Rendered<'t, T>, FitError> {
    // Perturbed cubes may show their inside.
    render(scene, Cull::None, positions, colors)
}

/// The picture with exact coverage, and pieces at the seams of `mesh`.
fn exact<'t, T: Scalar>(
    mesh: &Mesh,
    scene: &Scene,
    positions: Var<'t, T>,
    colors: Var<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let clip = project(positions, &scene.camera, None)?;
    let options = RasterOptions { sampling: Sampling::Exact, ..scene.size.into() };
    let fragments = rasterize(clip, mesh, options)?;
    Ok(resolve(interpolate(colors, &fragments)?, &fragments, Background::Zero)?)
}

/// `times` x `times` antialiased pixels make one.
fn supersampled<'t>(
    times: usize,
    scene: &Scene,
    positions: Var<'t, f32>,
    colors: Var<'t, f32>,
) -> Result<Var<'t, f32>, FitError> {
    let pixels = scene.size.width;
    let large = picture(&scene.at(times * pixels), positions, colors)?.image;
    let split = large.reshape([pixels, times, pixels, times, 3])?;
    Ok(split.mean_axis(3)?.mean_axis(1)?)
}

/// The picture `[pixels, pixels, 3]` of samples `[n, n, 3]`, n a multiple of `pixels`.
fn averaged(samples: &[f64], from: usize, to: usize) -> Vec<f64> {
    let times = from / to;
    let mut sums = vec![0.0; to * to * 3];
    for (row, line) in samples.chunks_exact(from * 3).enumerate() {
        for (at, entry) in line.iter().enumerate() {
            let (column, channel) = (at / 3, at % 3);
            sums[(row / times * to + column / times) * 3 + channel] += entry;
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= (times * times) as f64);
    sums
}

/// Point samples of cubes on two grids, averaged to the largest of [`PIXELS`].
struct Sampler {
    grids: [Scene; 2],
    tape: Tape<f64>,
}

impl Sampler {
    fn new(samples: usize) -> Result<Self, FitError> {
        let scene = Scene::cube(samples)?;
        // Half a sample's width is 1 / samples in normalized device coordinates.
        let grid = |quarter: f64| {
            let offset = DVec3::new(quarter, -quarter, 0.0) * 2.0 / samples as f64;
            let camera = DMat4::from_translation(offset) * scene.camera;
            Scene { camera, ..scene.clone() }
        };
        Ok(Self { grids: [grid(0.25), grid(-0.25)], tape: Tape::new() })
    }

    fn picture(&mut self, grid: usize, positions: &Tensor<f64>) -> Result<Vec<f64>, FitError> {
        let scene = &self.grids[grid];
        let jagged = {
            let positions = self.tape.constant(positions);
            let colors = self.tape.constant(&scene.colors);
            picture(scene, positions, colors)?.jagged.value()
        };
        self.tape.reset();
        Ok(averaged(jagged.data(), scene.size.width, largest()))
    }
}

fn largest() -> usize {
    PIXELS[PIXELS.len() - 1]
}

/// What a seed's cube has at one size: the upstream gradient, the true gradient, its noise.
struct Truth {
    upstream: Tensor<f32>,
    gradient: Vec<f64>,
    /// Relative to the gradient's length.
    noise: f64,
}

/// The truth at each size.
fn truths(sampler: &mut Sampler, positions: &Tensor<f64>) -> Result<Vec<Truth>, FitError> {
    let target = sampler.grids[0].positions.clone();
    let mut upstream = vec![0.0; largest() * largest() * 3];
    for grid in 0..2 {
        let (seen, wanted) = (sampler.picture(grid, positions)?, sampler.picture(grid, &target)?);
        let both = upstream.iter_mut().zip(seen.iter().zip(&wanted));
        both.for_each(|(sum, (seen, wanted))| *sum += seen - wanted);
    }
    let upstreams: Vec<Vec<f64>> =
        PIXELS.iter().map(|&pixels| averaged(&upstream, largest(), pixels)).collect();
    // Per size and grid, one entry per coordinate.
    let mut gradients = vec![[const { Vec::new() }; 2]; PIXELS.len()];
    for coordinate in 0..3 * CUBE_VERTICES {
        for grid in 0..2 {
            let mut moved = |step: f64| {
                let mut moved = positions.clone();
                moved.data_mut()[coordinate] += step;
                sampler.picture(grid, &moved)
            };
            let (above, below) = (moved(STEP)?, moved(-STEP)?);
            let difference: Vec<f64> = above.iter().zip(&below).map(|(a, b)| a - b).collect();
            for (at, &pixels) in PIXELS.iter().enumerate() {
                let difference = averaged(&difference, largest(), pixels);
                let product: f64 = difference.iter().zip(&upstreams[at]).map(|(d, g)| d * g).sum();
                gradients[at][grid].push(product / (2.0 * STEP));
            }
        }
    }
    let all = PIXELS.iter().zip(upstreams).zip(gradients);
    all.map(|((&pixels, upstream), [a, b])| {
        let gradient: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
        let upstream = Tensor::new([pixels, pixels, 3], upstream)?.cast();
        Ok(Truth { upstream, noise: 0.5 * distance(&a, &b) / length(&gradient), gradient })
    })
    .collect()
}

fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|entry| entry * entry).sum::<f64>().sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The relative errors of the gradients of single vertices, but for those that have none.
fn errors_by_vertex(found: &[f64], truth: &[f64]) -> Vec<f64> {
    let pairs = found.chunks_exact(3).zip(truth.chunks_exact(3));
    let seen = pairs.filter(|(_, truth)| length(truth) > 0.0);
    seen.map(|(found, truth)| distance(found, truth) / length(truth)).collect()
}

/// The gradient that `method` gives, by coordinate.
fn gradient(
    method: &Method,
    scene: &Scene,
    positions: &Tensor<f32>,
    upstream: &Tensor<f32>,
    tape: &mut Tape<f32>,
) -> Result<Vec<f64>, FitError> {
    let found = {
        let positions = tape.leaf(positions);
        let image = (method.image)(scene, positions, tape.constant(&scene.colors.cast()))?;
        tape.vjp(&[(image, upstream)])?.get_or_zeros(positions)
    };
    tape.reset();
    Ok(found.data().iter().map(|&entry| f64::from(entry)).collect())
}

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let samples = bench.effort.choose(256, 1024);
    let seeds = bench.effort.choose(2, 7);
    let mut study =
        Study::new("silhouettes", "The gradient of a silhouette, against the true one", "");
    let mut sampler = Sampler::new(samples)?;
    let scene = Scene::cube(PIXELS[0])?;
    let mut cubes = Vec::new();
    for seed in 0..seeds {
        let positions = scene.shifted(SHIFT, seed);
        let truths = bench.widest().install(|| truths(&mut sampler, &positions))?;
        cubes.push((positions.cast::<f32>(), truths));
    }
    let mut table = Table::new(
        "silhouettes",
        "Relative error of the vertex gradient over the cubes, and the time of an image and its \
         gradient (f32, one thread)",
        &[
            ("pixels", "pixels"),
            ("method", "method"),
            ("median error, %", "median_error_percent"),
            ("least", "least_error_percent"),
            ("largest", "largest_error_percent"),
            ("by vertex", "median_error_by_vertex_percent"),
            ("time, µs", "minimum_microseconds"),
            ("median time, µs", "median_microseconds"),
            ("samples", "samples"),
        ],
    );
    let mut noise = 0.0_f64;
    let mut curves = Vec::new();
    for (at, &pixels) in PIXELS.iter().enumerate() {
        let scene = scene.at(pixels);
        let mut contestants = Vec::new();
        for method in &METHODS {
            let (positions, truths) = &cubes[0];
            let (scene, upstream, mut tape) = (&scene, &truths[at].upstream, Tape::new());
            contestants.push(Contestant::new(bench.one(), move || {
                gradient(method, scene, positions, upstream, &mut tape).map(drop)
            }));
        }
        let timings = interleaved(&mut contestants, bench.effort, USUAL);
        drop(contestants);
        let mut points = Vec::new();
        for (method, timing) in METHODS.iter().zip(timings) {
            let what = format!("{} at {pixels} px", method.name);
            let Some(timing): Option<Timing> = study.noted(&what, timing) else { continue };
            let (mut errors, mut by_vertex) = (Vec::new(), Vec::new());
            for (positions, truths) in &cubes {
                let Truth { upstream, gradient: truth, noise: seen } = &truths[at];
                noise = noise.max(*seen);
                let found = gradient(method, &scene, positions, upstream, &mut Tape::new())?;
                errors.push(distance(&found, truth) / length(truth));
                by_vertex.extend(errors_by_vertex(&found, truth));
            }
            errors.sort_by(f64::total_cmp);
            by_vertex.sort_by(f64::total_cmp);
            let (least, largest) = (errors[0], errors[errors.len() - 1]);
            let median = errors[errors.len() / 2];
            points.push([timing.minimum, least, median, largest]);
            table.push(vec![
                Cell::Count(pixels),
                Cell::text(method.name),
                Cell::number(100.0 * median),
                Cell::number(100.0 * least),
                Cell::number(100.0 * largest),
                Cell::maybe(by_vertex.get(by_vertex.len() / 2).map(|median| 100.0 * median)),
                Cell::timed(&timing, 1e6 * timing.minimum),
                Cell::timed(&timing, 1e6 * timing.median),
                Cell::Count(timing.samples),
            ]);
        }
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        curves.push(Curve { color: at, stroke: Stroke::Solid, dots: true, points });
    }
    study.note = format!(
        "The gradient of <g, image> with respect to the vertices of {seeds} cubes, each vertex up to \
         {SHIFT} off, against that of <g, area-averaged image>; g is one fixed upstream gradient \
         per cube and size. The truth: central differences of pictures of {samples} x {samples} \
         point samples; its own noise is at most {:.1} % of its length. The error is the length of \
         the difference over the length of the truth, for the gradient as a whole, all coordinates of \
         all vertices; median over the cubes. By vertex: the same for each vertex's three \
         coordinates, median over all visible vertices of all cubes. 2x2 and 4x4: rendered so much \
         larger, then averaged down.",
        100.0 * noise
    );
    let legend = PIXELS.iter().enumerate();
    let legend = legend.map(|(at, pixels)| (format!("{pixels} px"), PALETTE[at], Stroke::Solid));
    study.figures.push(Figures {
        heading: None,
        is_folded: false,
        legend: legend.collect(),
        panels: vec![Panel {
            title: "Relative error of the gradient; bands: least and largest".to_owned(),
            figure: Figure {
                x: Scale::Seconds,
                y: Scale::Logarithmic,
                x_title: "time of an image and its gradient",
                size: SIZES[0],
                spoken: "error of the vertex gradient against time, per size".to_owned(),
                curves,
                marks: Vec::new(),
            },
        }],
    });
    study.tables.push(table);
    Ok(study)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averaging_keeps_constants_and_means() {
        let samples: Vec<f64> = (0..4 * 4 * 3).map(f64::from).collect();
        let picture = averaged(&samples, 4, 2);
        // The mean of pixels (0, 0), (0, 1), (1, 0), (1, 1), first channel.
        assert_eq!(picture[0], (0.0 + 3.0 + 12.0 + 15.0) / 4.0);
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        assert_eq!(mean(&picture), mean(&samples));
    }

    #[test]
    fn a_vertex_counts_by_its_own_gradient_and_a_hidden_one_not_at_all() {
        let truth = [3.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 100.0];
        let found = [3.0, 5.0, 4.0, 1.0, 1.0, 1.0, 0.0, 0.0, 101.0];
        assert_eq!(errors_by_vertex(&found, &truth), [1.0, 0.01]);
    }

    #[test]
    fn the_true_gradient_is_the_one_that_makes_the_error_fall() {
        let mut sampler = Sampler::new(256).unwrap();
        let target = sampler.grids[0].positions.clone();
        let positions = sampler.grids[0].shifted(SHIFT, 3);
        let truths = truths(&mut sampler, &positions).unwrap();
        let mut error = |positions: &Tensor<f64>, target: &Tensor<f64>| {
            let seen = averaged(&sampler.picture(0, positions).unwrap(), largest(), 16);
            let wanted = averaged(&sampler.picture(0, target).unwrap(), largest(), 16);
            distance(&seen, &wanted).powi(2)
        };
        let Truth { gradient, noise, .. } = &truths[1];
        assert!(*noise < 0.1, "{noise}");
        // The upstream gradient is that of the squared error: along the gradient it grows by the
        // gradient's squared length.
        let step = 0.01 / length(gradient);
        let mut moved = |sign: f64| {
            let mut moved = positions.clone();
            let entries = moved.data_mut().iter_mut().zip(gradient);
            entries.for_each(|(entry, slope)| *entry += sign * step * slope);
            error(&moved, &target)
        };
        let slope = (moved(1.0) - moved(-1.0)) / (2.0 * step);
        let expected = length(gradient).powi(2);
        assert!((slope / expected - 1.0).abs() < 0.1, "{slope} {expected}");
    }
}
