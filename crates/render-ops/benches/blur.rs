//! What does a blur cost, by size, sigma and the way it is done? Forward, and backward to the image
//! and sigma, three channels in `f32`, a mirror border.
//!
//! The window of the sampled kernel grows with sigma. The discrete kernel is a window too where
//! that is faster, and tridiagonal systems, at one cost for every sigma, where it is not.

use std::hint::black_box;

use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Blur, Kernel, Radius, gaussian_blur};
use divan::Bencher;
use divan::counter::ItemsCount;
use rayon::ThreadPoolBuilder;

/// Pixels along a side, sigma, threads.
type Case = (usize, f32, usize);

/// Of these the work is one piece, which stays on the thread that asks for it.
const SMALL: [Case; 2] = [(32, 1.0, 1), (32, 4.0, 1)];
const LARGE: [Case; 9] = [
    (256, 4.0, 1),
    (1024, 1.0, 1),
    (1024, 4.0, 1),
    (1024, 16.0, 1),
    (1024, 64.0, 1),
    (1024, 1.0, 2),
    (1024, 4.0, 2),
    (1024, 16.0, 2),
    (1024, 64.0, 2),
];

fn main() {
    divan::main();
}

fn steps(bencher: Bencher<'_, '_>, (side, sigma, threads): Case, kernel: Kernel, tolerance: f64) {
    let entry = |k: usize| ((k * 7919) % 1009) as f32 / 1009.0;
    let image = Tensor::from_flat_fn([side, side, 3], entry);
    let upstream = Tensor::from_flat_fn([side, side, 3], |k| entry(3 * k) - 0.5);
    let blur = Blur { kernel, radius: Radius::Tolerance(tolerance), ..Blur::default() };
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    let mut tape = Tape::new();
    let mut step = || {
        {
            let (image, sigma) = (tape.leaf(&image), tape.leaf_scalar(sigma));
            let out = gaussian_blur(image, sigma, &blur).expect("a finite sigma above 0");
            let gradients = tape.vjp(&[(out, &upstream)]).expect("an upstream of the same shape");
            black_box((gradients.get(image), gradients.get(sigma)));
        }
        tape.reset();
    };
    let bencher = bencher.counter(ItemsCount::new(side * side));
    match side {
        // Entering a pool from outside takes longer than a fifth of the step.
        ..=32 => bencher.bench_local(step),
        _ => bencher.bench_local(|| pool.install(&mut step)),
    }
}

#[divan::bench(args = SMALL, sample_count = 500)]
fn small_sampled(bencher: Bencher<'_, '_>, case: Case) {
    steps(bencher, case, Kernel::Sampled, 1e-4);
}

#[divan::bench(args = LARGE, sample_count = 20)]
fn large_sampled(bencher: Bencher<'_, '_>, case: Case) {
    steps(bencher, case, Kernel::Sampled, 1e-4);
}

#[divan::bench(args = LARGE, sample_count = 20)]
fn large_discrete(bencher: Bencher<'_, '_>, case: Case) {
    steps(bencher, case, Kernel::Discrete, 1e-4);
}

#[divan::bench(args = LARGE, sample_count = 20)]
fn large_discrete_to_1e_6(bencher: Bencher<'_, '_>, case: Case) {
    steps(bencher, case, Kernel::Discrete, 1e-6);
}
