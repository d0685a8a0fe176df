//! Images, factors and filters that downsampling can be given.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Border, Filter, downsample};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    150 "downsampling: wide windows", "each tap by the border", wide_windows;
    151 "downsampling: constants", "kept, finite", constants;
    152 "downsampling: 1, and one block", "the identity; the weighted mean", ends;
};

const BORDERS: [Border; 3] = [Border::Zero, Border::Mirror, Border::Clamp];

/// The result, and the gradient for motley upstream.
fn run<T: Scalar>(
    shape: [usize; 3],
    entry: impl Fn(usize) -> f64,
    k: usize,
    filter: &Filter,
    border: Border,
) -> Result<[Vec<f64>; 2], Failure> {
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::from_flat_fn(shape, |at| T::from_f64(entry(at))));
    let out = downsample(image, k, filter, border)?;
    let upstream = Tensor::from_flat_fn(out.shape(), |at| T::from_f64(motley(5 * at + 2)));
    let gradients = tape.vjp(&[(out, &upstream)])?;
    Ok([numbers(&out.value()), numbers(&gradients.get_or_zeros(image))])
}

/// A bell that is not symmetric, up to 40 output pixels wide.
fn bell(x: f64) -> f64 {
    (1.0 + 0.01 * x) * (-x * x / 150.0).exp()
}

fn wide_windows<T: Scalar>() -> Outcome {
    let single = |at: usize| T::from_f64(motley(at)).to_f64();
    let mut error = 0.0_f64;
    for (k, [height, width]) in [(1, [3, 5]), (2, [2, 8]), (3, [6, 3])] {
        let reach = 40 * k as isize;
        for border in BORDERS {
            // The share of pixel `from` of a line of n in output pixel j, tap by tap.
            let share = |j: usize, from: usize, n: usize| -> f64 {
                let n = n as isize;
                let x = |i: isize| (2 * i + 1 - k as isize) as f64 / (2 * k) as f64;
                let source = |at: isize| match border {
                    Border::Zero => at,
                    Border::Clamp => at.clamp(0, n - 1),
                    Border::Mirror => at.rem_euclid(2 * n).min(2 * n - 1 - at.rem_euclid(2 * n)),
                };
                let taps = (-reach..reach).filter(|&i| x(i).abs() < 37.3);
                let total: f64 = taps.clone().map(|i| bell(x(i))).sum();
                let seen = taps.filter(|&i| source((j * k) as isize + i) == from as isize);
                seen.map(|i| bell(x(i))).sum::<f64>() / total
            };
            let [found, bars] =
                run::<T>([height, width, 2], motley, k, &Filter::custom(37.3, bell), border)?;
            let (mut expected, mut expected_bars) = (Vec::new(), vec![0.0; bars.len()]);
            for at in 0..found.len() {
                let (row, column, c) = (at / 2 / (width / k), at / 2 % (width / k), at % 2);
                let bar = T::from_f64(motley(5 * at + 2)).to_f64();
                let mut sum = 0.0;
                for pixel in 0..height * width {
                    let by_row = share(row, pixel / width, height);
                    let weight = by_row * share(column, pixel % width, width);
                    sum += weight * single(2 * pixel + c);
                    expected_bars[2 * pixel + c] += weight * bar;
                }
                expected.push(sum);
            }
            error = error
                .maximum_or_nan(difference(&found, &expected))
                .maximum_or_nan(difference(&bars, &expected_bars));
        }
    }
    Ok(Verdict::within("each pixel the sum over all of its taps", error, 64.0 * rounding::<T>()))
}

fn constants<T: Scalar>() -> Outcome {
    let filters = [
        Filter::Box,
        Filter::Triangle,
        Filter::Mitchell,
        Filter::Lanczos(64),
        Filter::custom(9.0, bell),
    ];
    let (mut error, mut finite) = (0.0_f64, true);
    for filter in filters {
        for border in [Border::Mirror, Border::Clamp] {
            for (k, shape) in [(1, [3, 4, 1]), (7, [14, 7, 3]), (60, [120, 60, 2])] {
                for level in [0.7, 1e30, 1e-30, 0.0] {
                    let value = T::from_f64(level).to_f64();
                    let [found, bars] = run::<T>(shape, |_| level, k, &filter, border)?;
                    let off = largest(found.iter().map(|entry| entry - value));
                    error = error.maximum_or_nan(if level == 0.0 { off } else { off / value });
                    finite &= bars.iter().all(|bar| bar.is_finite());
                }
            }
        }
    }
    // Some weights are negative: errors go by the sum of their sizes.
    Ok(Verdict::within("kept", error, 64.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}

fn ends<T: Scalar>() -> Outcome {
    let single = |at: usize| T::from_f64(motley(at)).to_f64();
    let mut error = 0.0_f64;
    for border in BORDERS {
        for filter in [Filter::Box, Filter::Triangle, Filter::Lanczos(1), Filter::Lanczos(3)] {
            for shape in [[1, 1, 1], [1, 9, 2], [9, 1, 2], [4, 4, 3]] {
                let [found, bars] = run::<T>(shape, motley, 1, &filter, border)?;
                let expected: Vec<f64> = (0..found.len()).map(single).collect();
                let upstream: Vec<f64> = (0..found.len()).map(|at| single(5 * at + 2)).collect();
                // The identity, to the bit.
                let is_same = found == expected && bars == upstream;
                error = error.maximum_or_nan(if is_same { 0.0 } else { f64::INFINITY });
            }
        }
        // The whole image to a pixel: the box is its mean.
        let [found, bars] = run::<T>([64, 64, 1], motley, 64, &Filter::Box, border)?;
        let mean = (0..4096).map(single).sum::<f64>() / 4096.0;
        error = error.maximum_or_nan((found[0] - mean).abs());
        error = error.maximum_or_nan(largest(bars.iter().map(|bar| bar - single(2) / 4096.0)));
    }
    Ok(Verdict::within("the image; its mean", error, 8.0 * rounding::<T>()))
}
