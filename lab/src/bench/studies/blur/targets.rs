//! The blurs that others were measured at, at the tolerance that each takes.

use bokashi_fit::FitError;
use bokashi_render_ops::{Blur, Kernel};
use bokashi_report::{Cell, Section, Table};
use rayon::ThreadPool;

use super::algorithm::{Algorithm, USED};
use super::input::{Input, Quantity};
use crate::bench::effort::USUAL;
use crate::bench::sampling::interleaved;
use crate::bench::setting::Bench;

/// Forward and backward to the image and sigma, f32, where others were measured: pixels, sigma,
/// threads, and torch's median milliseconds on a machine of this kind.
const TARGETS: [(usize, f64, usize, Option<f64>); 5] = [
    (32, 4.0, 1, Some(0.85)),
    (1024, 1.0, 2, Some(283.0)),
    (1024, 4.0, 2, Some(352.0)),
    (1024, 16.0, 2, Some(1012.0)),
    (1024, 64.0, 2, None),
];
/// The error that is allowed, of values and of either gradient.
const ERROR: f64 = 1e-4;
/// Tolerances to choose from.
const TOLERANCES: [f64; 5] = [1e-3, 1e-4, 1e-5, 1e-6, 1e-7];

/// A blur, and its errors: values, image gradient, sigma gradient.
struct Candidate {
    tolerance: f64,
    blur: Blur,
    errors: [f64; 3],
}

/// The first of the tolerances at which no error is above [`ERROR`], or the last of them.
fn candidate(input: &Input, algorithm: &Algorithm) -> Result<Candidate, FitError> {
    let exact = input.exact(algorithm.kernel)?;
    let mut last = None;
    for tolerance in TOLERANCES {
        let blur = algorithm.blur(tolerance, input.sigma)?;
        let errors = |quantity| input.errors(algorithm, &blur, quantity, &exact);
        let ([values, ..], [_, image, sigma]) =
            (errors(Quantity::Values)?, errors(Quantity::Both)?);
        let errors = [values, image, sigma].map(|error| error.unwrap_or(f64::INFINITY));
        let is_within = errors.iter().all(|&error| error <= ERROR);
        last = Some(Candidate { tolerance, blur, errors });
        if is_within {
            break;
        }
    }
    Ok(last.expect("there are tolerances"))
}

fn name(kernel: Kernel) -> &'static str {
    match kernel {
        Kernel::Unnormalized => "unnormalized",
        Kernel::Sampled => "sampled",
        Kernel::Discrete => "discrete",
        Kernel::Disc => "disc",
    }
}

/// The table; what ends in an error is noted in `study`.
pub(super) fn targets(bench: &Bench, study: &mut Section) -> Result<Table, FitError> {
    let mut table = Table::new(
        "blur_targets",
        "Forward and backward to the image and sigma, f32, at the largest tolerance (a power of ten) \
         whose three errors are at most 1e-4; torch 2.13 on 2 threads as measured on another machine \
         of this kind",
        &[
            ("pixels", "pixels"),
            ("sigma", "sigma"),
            ("threads", "threads"),
            ("kernel", "kernel"),
            ("tolerance", "tolerance"),
            ("time, ms", "minimum_milliseconds"),
            ("median, ms", "median_milliseconds"),
            ("torch, ms", "torch_milliseconds"),
            ("error of values", "error_of_values"),
            ("of image gradient", "error_of_image_gradient"),
            ("of sigma gradient", "error_of_sigma_gradient"),
            ("samples", "samples"),
        ],
    );
    for &(pixels, sigma, threads, torch) in &TARGETS[..bench.effort.choose(1, TARGETS.len())] {
        let input = Input::new(pixels, sigma)?;
        let pool: &ThreadPool = if threads == 1 { bench.one() } else { bench.widest() };
        let mut chosen = Vec::new();
        for algorithm in USED {
            let candidate = bench.widest().install(|| candidate(&input, algorithm))?;
            chosen.push((algorithm, candidate));
        }
        let contestant = |(_, chosen): &(_, Candidate)| {
            input.contestant::<f32>(chosen.blur, Quantity::Both, pool)
        };
        let mut contestants: Vec<_> = chosen.iter().map(contestant).collect();
        let timings = interleaved(&mut contestants, bench.effort, USUAL);
        for ((algorithm, candidate), timing) in chosen.iter().zip(timings) {
            let what = format!("{}, {pixels} px, sigma {sigma}", algorithm.name);
            let Some(timing) = study.noted(&what, timing) else { continue };
            let mut row = vec![
                Cell::Count(pixels),
                Cell::number(sigma),
                Cell::Count(pool.current_num_threads()),
                Cell::text(name(algorithm.kernel)),
                Cell::number(candidate.tolerance),
                timing.cell(1e3 * timing.minimum),
                timing.cell(1e3 * timing.median),
                Cell::maybe(torch),
            ];
            row.extend(candidate.errors.map(Cell::number));
            row.push(Cell::Count(timing.samples));
            table.push(row);
        }
    }
    Ok(table)
}
