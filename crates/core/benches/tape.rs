//! What does the tape itself cost? A multiply, forward and backward, by length; operations on large
//! arrays, against the time to move their memory.
//!
//! Times are per step: divide those of a chain by [`CHAIN`] for one multiply with its share of
//! recording, walking back and ending the step.

use std::hint::black_box;

use bokashi_core::{Tape, Tensor, Var};
use divan::Bencher;
use divan::counter::ItemsCount;

/// Multiplies in a chain.
const CHAIN: usize = 100;

/// Entries of a large array: three channels of a megapixel.
const LARGE: usize = 3 << 20;

fn main() {
    divan::main();
}

/// `x c c ... c`, the sum of its entries, and its gradient.
fn multiplies(bencher: Bencher<'_, '_>, length: usize, both_need_gradients: bool) {
    let (x, c) = (Tensor::full([length], 0.5_f32), Tensor::full([length], 1.001));
    let mut tape = Tape::new();
    bencher.counter(ItemsCount::new(CHAIN)).bench_local(|| {
        {
            let x = tape.leaf(&x);
            let c = if both_need_gradients { tape.leaf(&c) } else { tape.constant(&c) };
            let y = (0..CHAIN).fold(x, |y, _| y * c);
            let gradients = y.sum().backward().expect("a scalar");
            black_box(gradients.get(x));
        }
        tape.reset();
    });
}

#[divan::bench(args = [1, 16, 256, 3072])]
fn multiply_by_a_constant(bencher: Bencher<'_, '_>, length: usize) {
    multiplies(bencher, length, false);
}

#[divan::bench(args = [1, 16, 256, 3072])]
fn multiply_with_both_gradients(bencher: Bencher<'_, '_>, length: usize) {
    multiplies(bencher, length, true);
}

#[divan::bench]
fn inference(bencher: Bencher<'_, '_>) {
    let x = Tensor::full([16], 0.5_f32);
    let mut tape = Tape::new();
    bencher.counter(ItemsCount::new(CHAIN)).bench_local(|| {
        let x = tape.constant(&x);
        black_box((0..CHAIN).fold(x, |y, _| y * x).item());
        tape.reset();
    });
}

/// What is done to a large array.
type Work = for<'t> fn(Var<'t, f32>, Var<'t, f32>) -> Var<'t, f32>;

const WORKS: [(&str, Work); 7] = [
    ("sum", |x, _| x.sum()),
    ("x + c", |x, c| (x + c).sum()),
    ("x * c", |x, c| (x * c).sum()),
    ("(x - c)^2", |x, c| (x - c).square().sum()),
    ("x * row", |x, c| (x.reshape([LARGE / 3, 3]).expect("it fits") * row(c)).sum()),
    ("x * column", |x, c| (x.reshape([LARGE / 3, 3]).expect("it fits") * column(c)).sum()),
    ("sum over rows", |x, _| {
        x.reshape([LARGE / 3, 3]).and_then(|x| x.sum_axis(0)).expect("it fits").sum()
    }),
];

fn row(c: Var<'_, f32>) -> Var<'_, f32> {
    c.slice(0, 0..3).expect("c is longer")
}

fn column(c: Var<'_, f32>) -> Var<'_, f32> {
    c.slice(0, 0..LARGE / 3).and_then(|c| c.reshape([LARGE / 3, 1])).expect("c is longer")
}

#[divan::bench(args = WORKS.map(|(name, _)| name), sample_count = 30)]
fn large_forward_and_backward(bencher: Bencher<'_, '_>, name: &str) {
    let (_, work) = WORKS.into_iter().find(|(other, _)| *other == name).expect("from the list");
    let (x, c) = (Tensor::full([LARGE], 0.5_f32), Tensor::full([LARGE], 1.001));
    let mut tape = Tape::new();
    bencher.counter(ItemsCount::new(LARGE)).bench_local(|| {
        {
            let x = tape.leaf(&x);
            let gradients = work(x, tape.constant(&c)).backward().expect("a scalar");
            black_box(gradients.get(x));
        }
        tape.reset();
    });
}
