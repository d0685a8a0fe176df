//! What does a digit of a blur cost?
//!
//! Each algorithm is run at several tolerances; a point is its time per pixel and its largest error
//! against the same kernel in f64 with a window that misses nothing. Values, the gradient with
//! respect to the image and that with respect to sigma have their points apart: each is timed with
//! what it needs and no more. The upstream gradient is what the blur took away from the image, so
//! that the sigma-gradient is a sum without cancellation.

mod algorithm;
mod figure;
mod input;
mod targets;
#[cfg(test)]
mod tests;

use bokashi_fit::FitError;
use bokashi_render_ops::Kernel;
use bokashi_report::{Cell, Figures, PALETTE, Section, Stroke, Table};

use self::algorithm::{ALGORITHMS, EXACT, KERNELS};
use self::figure::{FRONT, Line, Point, panel};
use self::input::{Input, Quantity, Results};
use self::targets::targets;
use crate::bench::effort::USUAL;
use crate::bench::sampling::{Timing, interleaved};
use crate::bench::setting::Bench;

const TOLERANCES: [f64; 4] = [1e-2, 1e-4, 1e-6, 1e-8];
const SIGMAS: [f64; 6] = [0.1, 0.5, 1.0, 4.0, 16.0, 64.0];
const PIXELS: [usize; 3] = [32, 256, 1024];
/// Larger images are blurred in f32 alone and by some of the sigmas, or the study takes too long.
const SMALL: usize = 256;
const SIGMAS_OF_LARGE: [f64; 3] = [1.0, 4.0, 64.0];

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let mut study = Section::new(
        "blur",
        "A blur: time against error",
        format!(
            "Three channels of noise, a mirror border; one thread where nothing else is said. The \
             error is the largest difference from the same kernel, sampled or discrete, as a share \
             of the largest entry. That kernel is computed in f64, with a window that misses less \
             than {EXACT:e}. The discrete Gaussian takes a window or tridiagonal systems, \
             whichever takes less time: the systems from a sigma of some 10 on. A line of its own \
             shows its window at every sigma. Lines join the tolerances {}. Times are per pixel; \
             the time of a gradient includes that of the values. Where sigma is larger than the \
             image, only the image's mean is left, and what gradients there are is rounding. Grey \
             dots: no other point has both less time and less error (the Pareto front).",
            TOLERANCES.map(|tolerance| format!("{tolerance:e}")).join(", ")
        ),
    );
    let targets = targets(bench, &mut study)?;
    let peers = bench.peer_names("blur");
    let lines = lines(&peers);
    let mut table = Table::new(
        "blur",
        "Every algorithm at every tolerance",
        &[
            ("pixels", "pixels"),
            ("sigma", "sigma"),
            ("quantity", "quantity"),
            ("algorithm", "algorithm"),
            ("tolerance", "tolerance"),
            ("relative error", "relative_error"),
            ("ns per pixel", "minimum_nanoseconds_per_pixel"),
            ("median", "median_nanoseconds_per_pixel"),
            ("quartiles apart, %", "spread_percent"),
            ("samples", "samples"),
        ],
    )
    .not_printed();
    let mut beside = Table::new(
        "blur_libraries",
        "Values alone, beside image libraries at their own truncation: milliseconds, and the largest \
         relative error",
        &[
            ("pixels", "pixels"),
            ("sigma", "sigma"),
            ("ours, 1e-2", "milliseconds_at_1e-2"),
            ("error", "error_at_1e-2"),
            ("ours, 1e-4", "milliseconds_at_1e-4"),
            ("error", "error_at_1e-4"),
            ("imageproc", "imageproc_milliseconds"),
            ("error", "imageproc_error"),
            ("libblur", "libblur_milliseconds"),
            ("error", "libblur_error"),
        ],
    );
    let sizes = bench.effort.choose(&PIXELS[..1], &PIXELS[..]);
    for &pixels in sizes {
        let sigmas = if pixels <= SMALL { &SIGMAS[..] } else { &SIGMAS_OF_LARGE[..] };
        let sigmas = bench.effort.choose(&SIGMAS[2..4], sigmas);
        for &sigma in sigmas {
            let input = Input::new(pixels, sigma)?;
            let reference = |kernel| {
                Ok::<_, FitError>((kernel, bench.widest().install(|| input.exact(kernel))?))
            };
            let references = KERNELS.into_iter().map(reference).collect::<Result<Vec<_>, _>>()?;
            let mut panels = Vec::new();
            for quantity in Quantity::APART {
                let rivals = Rivals { quantity, input: &input, references: &references, pixels };
                let mut points = rivals.measure(bench, &mut study, &mut table)?;
                if quantity == Quantity::Values {
                    points.extend(peer_points(bench, &peers, pixels, sigma));
                    beside.push(beside_libraries(&points, &lines, pixels, sigma));
                }
                panels.push(panel(&lines, quantity, &points));
            }
            let legend =
                lines.iter().map(|line| (line.name.clone(), PALETTE[line.color], line.stroke));
            let front = ("Pareto front".to_owned(), PALETTE[FRONT], Stroke::Dotted);
            let figures = Figures::new(panels, legend.chain([front]));
            // One of each size is in plain sight.
            study.push_figures(Figures {
                is_folded: sigma != 4.0,
                ..figures.with_heading(format!("{pixels} px, sigma {sigma}"))
            });
        }
    }
    study.push_table(targets);
    if !peers.is_empty() {
        study.push_table(beside);
    }
    study.push_table(table);
    Ok(study)
}

/// A row: the sampled kernel in f32 at the first two tolerances, then the libraries.
fn beside_libraries(points: &[Point], lines: &[Line], pixels: usize, sigma: f64) -> Vec<Cell> {
    let named = |name: &str, index: usize| {
        let line = lines.iter().position(|line| line.name.starts_with(name));
        points.iter().filter(|point| Some(point.line) == line).nth(index)
    };
    let all = [named(ALGORITHMS[0].name, 0), named(ALGORITHMS[0].name, 1)];
    let all = all.into_iter().chain(["imageproc", "libblur"].map(|name| named(name, 0)));
    let area = (pixels * pixels) as f64;
    let cells = all.flat_map(|point| {
        let milliseconds = point.map(|point| 1e3 * area * point.seconds_per_pixel);
        [Cell::maybe(milliseconds), Cell::maybe(point.map(|point| point.error))]
    });
    [Cell::Count(pixels), Cell::number(sigma)].into_iter().chain(cells).collect()
}

/// The curves of a figure: those of the algorithms, then those of the peers.
fn lines(peers: &[String]) -> Vec<Line> {
    let ours = ALGORITHMS.iter().map(|one| Line {
        name: one.name.to_owned(),
        color: one.color,
        stroke: one.stroke(),
    });
    let free = 1 + ALGORITHMS.iter().map(|one| one.color).max().unwrap_or(0);
    let theirs = peers.iter().enumerate().map(|(index, peer)| Line {
        name: format!("{peer}, forward alone"),
        color: free + index % (FRONT - free),
        stroke: Stroke::Solid,
    });
    ours.chain(theirs).collect()
}

/// What is measured in turns: one quantity of one input.
struct Rivals<'a> {
    quantity: Quantity,
    input: &'a Input,
    /// The exact results, by kernel.
    references: &'a [(Kernel, Results<f64>)],
    /// Width and height of the image.
    pixels: usize,
}

impl Rivals<'_> {
    /// Every algorithm at every tolerance.
    fn measure(
        &self,
        bench: &Bench,
        study: &mut Section,
        table: &mut Table,
    ) -> Result<Vec<Point>, FitError> {
        let &Self { quantity, input, references, pixels } = self;
        let sigma = input.sigma;
        let mut contests = Vec::new();
        let mut contestants = Vec::new();
        let double = pixels <= SMALL;
        let taking_part = ALGORITHMS.iter().enumerate();
        for (line, algorithm) in taking_part.filter(|(_, one)| double || !one.is_double) {
            let reference = references.iter().find(|(kernel, _)| *kernel == algorithm.kernel);
            let (_, exact) = reference.expect("each kernel has a reference");
            for tolerance in TOLERANCES {
                let blur = algorithm.blur(tolerance, sigma)?;
                let error = || input.error(algorithm, &blur, quantity, exact);
                contests.push((line, algorithm, tolerance, bench.widest().install(error)));
                contestants.push(match algorithm.is_double {
                    true => input.contestant::<f64>(blur, quantity, bench.one()),
                    false => input.contestant::<f32>(blur, quantity, bench.one()),
                });
            }
        }
        let timings = interleaved(&mut contestants, bench.effort, USUAL);
        let mut points = Vec::new();
        let area = (pixels * pixels) as f64;
        for ((line, algorithm, tolerance, error), timing) in contests.into_iter().zip(timings) {
            let what = format!(
                "{} of {}, {pixels} px, sigma {sigma}, tolerance {tolerance:e}",
                quantity.name(),
                algorithm.name
            );
            let measured: Option<(f64, Timing)> =
                study.noted(&what, error.and_then(|error| Ok((error, timing?))));
            let Some((error, timing)) = measured else { continue };
            points.push(Point { line, seconds_per_pixel: timing.minimum / area, error });
            table.push(vec![
                Cell::Count(pixels),
                Cell::number(sigma),
                Cell::text(quantity.name()),
                Cell::text(algorithm.name),
                Cell::number(tolerance),
                Cell::number(error),
                timing.cell(1e9 * timing.minimum / area),
                timing.cell(1e9 * timing.median / area),
                timing.cell(100.0 * timing.spread()),
                Cell::Count(timing.samples),
            ]);
        }
        Ok(points)
    }
}

/// What others measured of the same size and sigma.
fn peer_points(bench: &Bench, names: &[String], pixels: usize, sigma: f64) -> Vec<Point> {
    let same = bench.peers_of("blur");
    let same = same.filter(|peer| peer.pixels == Some(pixels) && peer.sigma == Some(sigma));
    let point = |peer: &crate::bench::setting::Peer| {
        let line = ALGORITHMS.len() + names.iter().position(|name| *name == peer.name)?;
        let seconds_per_pixel = 1e-6 * peer.minimum_microseconds / (pixels * pixels) as f64;
        Some(Point { line, seconds_per_pixel, error: peer.error? })
    };
    same.filter_map(point).collect()
}
