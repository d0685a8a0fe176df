//! What does a digit of a blur cost?
//!
//! Each algorithm is run at several tolerances; a point is its time per pixel and its largest error
//! against the same kernel in f64 with a window that misses nothing. Values, the gradient with
//! respect to the image and that with respect to sigma have their points apart: each is timed with
//! what it needs and no more. The upstream gradient is what the blur took away from the image, so
//! that the sigma-gradient is a sum without cancellation.

use std::hint::black_box;

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_fit::report::{Curve, Figure, PALETTE, Panel, SIZES, Scale, Stroke};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::ThreadPool;

use crate::bench::Bench;
use crate::difference::relative_error;
use crate::effort::USUAL;
use crate::sampling::{Contestant, Timing, interleaved};
use crate::study::{Figures, Study};
use crate::table::{Cell, Table};

/// A way to blur, at a tolerance.
struct Algorithm {
    name: &'static str,
    /// Whether it computes in f64.
    is_double: bool,
    blur: fn(f64) -> Blur,
}

fn sampled(tolerance: f64) -> Blur {
    let (kernel, border) = (Kernel::Sampled, Border::Mirror);
    Blur { kernel, border, radius: Radius::Tolerance(tolerance) }
}

/// All algorithms; another one is another row. Its reference is its own kernel.
const ALGORITHMS: [Algorithm; 2] = [
    Algorithm { name: "sampled, f32", is_double: false, blur: sampled },
    Algorithm { name: "sampled, f64", is_double: true, blur: sampled },
];

const TOLERANCES: [f64; 4] = [1e-2, 1e-4, 1e-6, 1e-8];
const SIGMAS: [f64; 6] = [0.1, 0.5, 1.0, 4.0, 16.0, 64.0];
const PIXELS: [usize; 3] = [32, 256, 1024];
/// Larger images are blurred in f32 alone and by some of the sigmas, or the study takes too long.
const SMALL: usize = 256;
const SIGMAS_OF_LARGE: [f64; 3] = [1.0, 4.0, 64.0];
/// The reference's window misses this share.
const EXACT: f64 = 1e-15;
const CHANNELS: usize = 3;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Values,
    ImageGradient,
    SigmaGradient,
    /// Both gradients: what a fit asks for.
    Both,
}

impl Quantity {
    const APART: [Self; 3] = [Self::Values, Self::ImageGradient, Self::SigmaGradient];

    fn name(self) -> &'static str {
        match self {
            Self::Values => "values",
            Self::ImageGradient => "image gradient",
            Self::SigmaGradient => "sigma gradient",
            Self::Both => "both gradients",
        }
    }
}

/// An image to blur, and the upstream gradient of the blurred one; both exact in f32.
struct Input {
    image: Tensor<f64>,
    upstream: Tensor<f64>,
    sigma: f64,
}

/// Values, image gradient, sigma gradient, as far as they were asked for.
type Results<T> = [Option<Tensor<T>>; 3];

/// One blur of `image` and what is asked for.
fn run<T: Scalar>(
    tape: &mut Tape<T>,
    [image, upstream]: [&Tensor<T>; 2],
    sigma: f64,
    blur: &Blur,
    quantity: Quantity,
) -> Result<Results<T>, FitError> {
    let results = {
        let sigma = Tensor::scalar(T::from_f64(sigma));
        let leaf = |wanted: bool, tensor| match wanted {
            true => tape.leaf(tensor),
            false => tape.constant(tensor),
        };
        let wants = |one: Quantity| quantity == one || quantity == Quantity::Both;
        let x = leaf(wants(Quantity::ImageGradient), image);
        let sigma = leaf(wants(Quantity::SigmaGradient), &sigma);
        let blurred = gaussian_blur(x, sigma, blur)?;
        match quantity {
            Quantity::Values => [Some(blurred.value()), None, None],
            _ => {
                let gradients = tape.vjp(&[(blurred, upstream)])?;
                [None, gradients.get(x).cloned(), gradients.get(sigma).cloned()]
            }
        }
    };
    tape.reset();
    Ok(results)
}

impl Input {
    fn new(pixels: usize, sigma: f64) -> Result<Self, FitError> {
        let mut generator = ChaCha8Rng::seed_from_u64(pixels as u64);
        let shape = [pixels, pixels, CHANNELS];
        let image = Tensor::from_fn(shape, |_| f64::from(generator.next_u32() >> 8) / 16_777_216.0);
        let mut input = Self { image, upstream: Tensor::zeros(shape), sigma };
        // What is a good upstream gradient does not take an exact blur.
        let [blurred, ..] = input.results::<f32>(&sampled(1e-3), Quantity::Values)?;
        let blurred: Tensor<f32> = blurred.unwrap_or(Tensor::zeros(shape));
        let taken = |k: usize| input.image.data()[k] as f32 - blurred.data()[k];
        input.upstream = Tensor::from_fn(shape, |k| f64::from(taken(k)));
        Ok(input)
    }

    fn results<T: Scalar>(&self, blur: &Blur, quantity: Quantity) -> Result<Results<T>, FitError> {
        let (image, upstream) = (self.image.cast(), self.upstream.cast());
        run(&mut Tape::<T>::new(), [&image, &upstream], self.sigma, blur, quantity)
    }

    /// The same blur on the threads of `pool`, over and over.
    fn contestant<'a, T: Scalar>(
        &self,
        blur: Blur,
        quantity: Quantity,
        pool: &'a ThreadPool,
    ) -> Contestant<'a> {
        let (image, upstream, sigma) = (self.image.cast(), self.upstream.cast(), self.sigma);
        let mut tape = Tape::<T>::new();
        Contestant::new(move |steps| {
            pool.install(|| {
                (0..steps).try_for_each(|_| {
                    black_box(run(&mut tape, [&image, &upstream], sigma, &blur, quantity)?);
                    Ok(())
                })
            })
        })
    }

    /// The largest relative error of what `quantity` asks for.
    fn error(
        &self,
        algorithm: &Algorithm,
        blur: &Blur,
        quantity: Quantity,
        exact: &Results<f64>,
    ) -> Result<f64, FitError> {
        fn worst<T: Scalar>(found: Results<T>, exact: &Results<f64>) -> f64 {
            let pairs = found.iter().zip(exact).filter_map(|(a, b)| a.as_ref().zip(b.as_ref()));
            pairs.map(|(found, exact)| relative_error(found, exact)).fold(0.0, f64::max)
        }
        Ok(match algorithm.is_double {
            true => worst(self.results::<f64>(blur, quantity)?, exact),
            false => worst(self.results::<f32>(blur, quantity)?, exact),
        })
    }

    /// The exact results of an algorithm's kernel.
    fn exact(&self, blur: fn(f64) -> Blur) -> Result<Results<f64>, FitError> {
        let exact = blur(EXACT);
        let [values, ..] = self.results(&exact, Quantity::Values)?;
        let [_, image, sigma] = self.results(&exact, Quantity::Both)?;
        Ok([values, image, sigma])
    }
}

/// A measured point.
struct Point {
    /// Index of the algorithm, or that of a peer after all of them.
    line: usize,
    seconds_per_pixel: f64,
    error: f64,
}

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let mut study = Study::new(
        "blur",
        "A blur: time against error",
        format!(
            "Three channels of noise, a mirror border; one thread where nothing else is said. The error is the largest \
             difference from the same kernel in f64 with a window that misses less than {EXACT:e}, \
             as a share of the largest entry. Lines join the tolerances {}. Times are per pixel; \
             the time of a gradient includes that of the values. Grey dots: what nothing else \
             beats in both (the Pareto front).",
            TOLERANCES.map(|tolerance| format!("{tolerance:e}")).join(", ")
        ),
    );
    study.tables.push(targets(bench, &mut study.failures)?);
    let peers = bench.peer_names("blur");
    let mut names: Vec<String> = ALGORITHMS.iter().map(|one| one.name.to_owned()).collect();
    names.extend(peers.iter().map(|peer| format!("{peer}, forward alone")));
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
    let sizes = bench.effort.choose(&PIXELS[..1], &PIXELS[..]);
    for &pixels in sizes {
        let sigmas = if pixels <= SMALL { &SIGMAS[..] } else { &SIGMAS_OF_LARGE[..] };
        let sigmas = bench.effort.choose(&SIGMAS[2..4], sigmas);
        for &sigma in sigmas {
            let input = Input::new(pixels, sigma)?;
            let found = measure(bench, &mut study, &mut table, &input, pixels)?;
            let mut panels = Vec::new();
            for (quantity, mut points) in found {
                if quantity == Quantity::Values {
                    points.extend(peer_points(bench, &peers, pixels, sigma));
                }
                panels.push(panel(&names, quantity, pixels, sigma, &points));
            }
            let legend = (0..names.len())
                .map(|line| (names[line].clone(), PALETTE[line % 5], Stroke::Solid));
            let front = ("Pareto front".to_owned(), PALETTE[FRONT], Stroke::Dotted);
            study.figures.push(Figures {
                // One of each size is in plain sight.
                is_folded: sigma != 4.0,
                heading: Some(format!("{pixels} px, sigma {sigma}")),
                legend: legend.chain([front]).collect(),
                panels,
            });
        }
    }
    study.tables.push(table);
    Ok(study)
}

/// Every algorithm at every tolerance on one input.
fn measure(
    bench: &Bench,
    study: &mut Study,
    table: &mut Table,
    input: &Input,
    pixels: usize,
) -> Result<Vec<(Quantity, Vec<Point>)>, FitError> {
    let sigma = input.sigma;
    let mut contests = Vec::new();
    let mut contestants = Vec::new();
    let double = pixels <= SMALL;
    let taking_part = ALGORITHMS.iter().enumerate().filter(|(_, one)| double || !one.is_double);
    for (line, algorithm) in taking_part {
        let exact = bench.widest().install(|| input.exact(algorithm.blur))?;
        for tolerance in TOLERANCES {
            let blur = (algorithm.blur)(tolerance);
            for quantity in Quantity::APART {
                let error = || input.error(algorithm, &blur, quantity, &exact);
                let error = bench.widest().install(error);
                contests.push((line, algorithm, tolerance, quantity, error));
                contestants.push(match algorithm.is_double {
                    true => input.contestant::<f64>(blur, quantity, bench.one()),
                    false => input.contestant::<f32>(blur, quantity, bench.one()),
                });
            }
        }
    }
    let timings = interleaved(&mut contestants, bench.effort, USUAL);
    let mut found = Vec::from(Quantity::APART.map(|quantity| (quantity, Vec::new())));
    let area = (pixels * pixels) as f64;
    for ((line, algorithm, tolerance, quantity, error), timing) in contests.into_iter().zip(timings)
    {
        let what = format!(
            "{} of {}, {pixels} px, sigma {sigma}, tolerance {tolerance:e}",
            quantity.name(),
            algorithm.name
        );
        let measured: Option<(f64, Timing)> =
            study.noted(&what, error.and_then(|error| Ok((error, timing?))));
        let Some((error, timing)) = measured else { continue };
        let points = found.iter_mut().find(|(one, _)| *one == quantity);
        let point = Point { line, seconds_per_pixel: timing.minimum / area, error };
        points.expect("each has its list").1.push(point);
        table.push(vec![
            Cell::Count(pixels),
            Cell::number(sigma),
            Cell::text(quantity.name()),
            Cell::text(algorithm.name),
            Cell::number(tolerance),
            Cell::number(error),
            Cell::timed(&timing, 1e9 * timing.minimum / area),
            Cell::timed(&timing, 1e9 * timing.median / area),
            Cell::timed(&timing, 100.0 * timing.spread()),
            Cell::Count(timing.samples),
        ]);
    }
    Ok(found)
}

/// What others measured of the same size and sigma.
fn peer_points(bench: &Bench, names: &[String], pixels: usize, sigma: f64) -> Vec<Point> {
    let same = bench.peers_of("blur");
    let same = same.filter(|peer| peer.pixels == Some(pixels) && peer.sigma == Some(sigma));
    let point = |peer: &crate::bench::Peer| {
        let line = ALGORITHMS.len() + names.iter().position(|name| *name == peer.name)?;
        let seconds_per_pixel = 1e-6 * peer.minimum_microseconds / (pixels * pixels) as f64;
        Some(Point { line, seconds_per_pixel, error: peer.error? })
    };
    same.filter_map(point).collect()
}

/// The colour of the front: the palette's grey.
const FRONT: usize = PALETTE.len() - 1;

fn panel(
    names: &[String],
    quantity: Quantity,
    pixels: usize,
    sigma: f64,
    points: &[Point],
) -> Panel {
    let place = |point: &Point| {
        let error = point.error;
        [point.seconds_per_pixel, error, error, error]
    };
    let mut curves = Vec::new();
    for line in 0..names.len() {
        let mut points: Vec<_> =
            points.iter().filter(|point| point.line == line).map(place).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        curves.push(Curve { color: line % FRONT, stroke: Stroke::Solid, dots: true, points });
    }
    let front = front(points).into_iter().map(|(x, y)| [x, y, y, y]).collect();
    curves.push(Curve { color: FRONT, stroke: Stroke::Dotted, dots: false, points: front });
    Panel {
        title: format!("{}: relative error", capital(quantity.name())),
        figure: Figure {
            x: Scale::Seconds,
            y: Scale::Logarithmic,
            x_title: "time per pixel",
            size: SIZES[1],
            spoken: format!("{}, {pixels} px, sigma {sigma}: error against time", quantity.name()),
            curves,
            marks: Vec::new(),
        },
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// The points that no other beats in both time and error, as a staircase.
fn front(points: &[Point]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<&Point> = points.iter().filter(|point| point.error.is_finite()).collect();
    sorted.sort_by(|a, b| {
        (a.seconds_per_pixel, a.error)
            .partial_cmp(&(b.seconds_per_pixel, b.error))
            .expect("times and errors are numbers")
    });
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for point in sorted {
        match steps.last() {
            Some(&(_, least)) if point.error >= least => continue,
            Some(&(_, least)) => steps.push((point.seconds_per_pixel, least)),
            None => {}
        }
        steps.push((point.seconds_per_pixel, point.error));
    }
    steps
}

/// Forward and backward to the image and sigma, f32, where others were measured: pixels, sigma,
/// threads, and torch's median milliseconds on a machine of this kind.
const TARGETS: [(usize, f64, usize, Option<f64>); 5] = [
    (32, 4.0, 1, Some(0.85)),
    (1024, 1.0, 2, Some(283.0)),
    (1024, 4.0, 2, Some(352.0)),
    (1024, 16.0, 2, Some(1012.0)),
    (1024, 64.0, 2, None),
];
/// Tolerance of these: it keeps the error of all three under 1e-4.
const TARGET_TOLERANCE: f64 = 1e-5;

fn targets(bench: &Bench, failures: &mut Vec<String>) -> Result<Table, FitError> {
    let mut table = Table::new(
        "blur_targets",
        "Forward and backward to the image and sigma, f32; torch 2.13 on 2 threads as measured on \
         another machine of this kind",
        &[
            ("pixels", "pixels"),
            ("sigma", "sigma"),
            ("threads", "threads"),
            ("time, ms", "minimum_milliseconds"),
            ("median, ms", "median_milliseconds"),
            ("torch, ms", "torch_milliseconds"),
            ("error of values", "error_of_values"),
            ("of image gradient", "error_of_image_gradient"),
            ("of sigma gradient", "error_of_sigma_gradient"),
            ("samples", "samples"),
        ],
    );
    let algorithm = &ALGORITHMS[0];
    for (pixels, sigma, threads, torch) in &TARGETS[..bench.effort.choose(1, TARGETS.len())] {
        let input = Input::new(*pixels, *sigma)?;
        let pool = if *threads == 1 { bench.one() } else { bench.widest() };
        let blur = (algorithm.blur)(TARGET_TOLERANCE);
        let mut contestant = [input.contestant::<f32>(blur, Quantity::Both, pool)];
        let timing = interleaved(&mut contestant, bench.effort, USUAL).remove(0);
        let exact = bench.widest().install(|| input.exact(algorithm.blur))?;
        let error = |quantity| {
            let error = || input.error(algorithm, &blur, quantity, &exact);
            Ok::<_, FitError>(Cell::number(bench.widest().install(error)?))
        };
        let [values, image, sigma_gradient] = Quantity::APART.map(error);
        match timing {
            Err(error) => failures.push(format!("{pixels} px, sigma {sigma}: {error}")),
            Ok(timing) => table.push(vec![
                Cell::Count(*pixels),
                Cell::number(*sigma),
                Cell::Count(pool.current_num_threads()),
                Cell::timed(&timing, 1e3 * timing.minimum),
                Cell::timed(&timing, 1e3 * timing.median),
                Cell::maybe(*torch),
                values?,
                image?,
                sigma_gradient?,
                Cell::Count(timing.samples),
            ]),
        }
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_on_the_front_where_none_is_both_faster_and_closer() {
        let point = |(seconds_per_pixel, error)| Point { line: 0, seconds_per_pixel, error };
        let points = [(3.0, 1e-3), (1.0, 1e-1), (2.0, 1e-3), (2.5, 1e-2), (4.0, 1e-5)];
        let found = front(&points.map(point));
        let expected = [(1.0, 1e-1), (2.0, 1e-1), (2.0, 1e-3), (4.0, 1e-3), (4.0, 1e-5)];
        assert_eq!(found, expected);
        assert!(front(&[point((1.0, f64::INFINITY))]).is_empty());
    }

    #[test]
    fn the_error_follows_the_tolerance() {
        let input = Input::new(24, 2.0).unwrap();
        let algorithm = &ALGORITHMS[1];
        let exact = input.exact(algorithm.blur).unwrap();
        let error = |tolerance, quantity| {
            input.error(algorithm, &sampled(tolerance), quantity, &exact).unwrap()
        };
        for quantity in Quantity::APART {
            let errors = TOLERANCES.map(|tolerance| error(tolerance, quantity));
            assert!(errors.is_sorted_by(|a, b| a > b), "{} {errors:?}", quantity.name());
            assert!(errors[0] > 1e-3 && errors[3] < 1e-6, "{} {errors:?}", quantity.name());
        }
    }
}
