//! A chain of multiplications by a constant, forward and backward, on other tapes.

use std::hint::black_box;

use crate::Figure;
use crate::sampling::interleaved;

/// Lengths of the chains and of the vectors, as in `bokashi-lab bench`.
const CHAINS: [usize; 2] = [20, 220];
const LENGTHS: [usize; 4] = [1, 16, 256, 3072];

pub fn figures() -> Vec<Figure> {
    let engines: [(&'static str, fn(usize, usize)); 3] =
        [("candle", candle), ("burn", burn), ("dfdx", dfdx)];
    let mut figures = Vec::new();
    for length in LENGTHS {
        for (name, engine) in engines {
            let (mut short, mut long) =
                (|| engine(length, CHAINS[0]), || engine(length, CHAINS[1]));
            let [short, long] = interleaved(&mut [&mut short, &mut long])
                .try_into()
                .expect("one for each contestant");
            let slope = |at: usize| (long[at] - short[at]) / (CHAINS[1] - CHAINS[0]) as f64;
            figures.push(Figure {
                study: "multiply",
                name,
                length: Some(length),
                minimum_microseconds: slope(0),
                median_microseconds: slope(1),
                ..Figure::default()
            });
        }
    }
    figures
}

fn candle(length: usize, count: usize) {
    use candle_core::{Device, Tensor, Var};
    let x = Var::from_vec(vec![0.5_f32; length], length, &Device::Cpu).expect("a vector");
    let factor = Tensor::from_vec(vec![1.001_f32; length], length, &Device::Cpu).expect("a vector");
    let mut product = x.as_tensor().clone();
    for _ in 0..count {
        product = (&product * &factor).expect("of one length");
    }
    let gradients = product.sum_all().and_then(|sum| sum.backward()).expect("a scalar");
    black_box(gradients.get(&x));
}

fn burn(length: usize, count: usize) {
    use burn::tensor::{Device, Tensor};
    let device = Device::default().autodiff();
    let full = |value: f32| Tensor::<1>::from_floats(vec![value; length].as_slice(), &device);
    let (x, factor) = (full(0.5).require_grad(), full(1.001));
    let mut product = x.clone();
    for _ in 0..count {
        product = product * factor.clone();
    }
    let gradients = product.sum().backward();
    black_box(x.grad(&gradients));
}

fn dfdx(length: usize, count: usize) {
    use dfdx::prelude::*;
    let device = Cpu::default();
    let full = |value: f32| device.tensor((vec![value; length], (length,)));
    let (x, factor) = (full(0.5), full(1.001));
    let mut product = x.leaky_trace();
    for _ in 0..count {
        product = product * factor.clone();
    }
    let gradients = product.sum::<Rank0, _>().backward();
    black_box(gradients.get(&x));
}
