//! Laws of the blur by tridiagonal systems, against transforms and sums that it knows nothing of.

use bokashi_core::{Tape, Tensor};

use super::*;
use crate::border::Border;
use crate::taps::{Blur, Kernel, Radius};

const BORDERS: [Border; 2] = [Border::Zero, Border::Mirror];
/// Lines of one pixel and of several strips; channels that fill the lanes, that don't, and more.
const SHAPES: [[usize; 3]; 6] =
    [[1, 1, 1], [2, 40, 3], [35, 5, 1], [3, 4, 33], [7, 33, 5], [12, 2, 70]];

fn numbers<T: Scalar>(shape: [usize; 3], seed: usize) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| {
        T::from_f64(((k * 7919 + seed * 104_729) % 1009) as f64 / 1009.0 - 0.4)
    })
}

fn dot<T: Scalar>(x: &Tensor<T>, y: &Tensor<T>) -> f64 {
    x.data().iter().zip(y.data()).map(|(x, y)| x.to_f64() * y.to_f64()).sum()
}

/// `exp(-t) I_k(t)` by its power series, for small t.
fn bessel(k: usize, t: f64) -> f64 {
    let mut term = (1..=k).fold((-t).exp(), |term, m| term * 0.5 * t / m as f64);
    let mut sum = 0.0;
    for m in 1..200 {
        sum += term;
        term *= 0.25 * t * t / (m * (m + k)) as f64;
    }
    sum
}

struct Blurred<T> {
    image: Tensor<T>,
    slope: Tensor<T>,
}

fn lines<T: Scalar>(order: &Order, sigma: T, border: Border, shape: [usize; 3]) -> [Line<T>; 2] {
    let mut lines = [Line::default(), Line::default()];
    for (line, extent) in lines.iter_mut().zip([shape[1], shape[0]]) {
        line.fill(order, sigma, border, extent);
    }
    lines
}

fn order(tolerance: f64) -> &'static Order {
    Order::within(tolerance).unwrap()
}

fn blurred<T: Scalar>(image: &Tensor<T>, order: &Order, sigma: f64, border: Border) -> Blurred<T> {
    let &[height, width, channels] = &**image.shape() else { panic!("an image has three axes") };
    let lines = lines(order, T::from_f64(sigma), border, [height, width, channels]);
    let [mut out, mut slope] = [Tensor::zeros(image.shape()), Tensor::zeros(image.shape())];
    let (mut columns, bench) = ([Vec::new(), Vec::new()], Workbench::default());
    let blur = Rational::new(image.shape(), &lines);
    blur.apply(image.data(), &mut columns, &bench, out.data_mut(), slope.data_mut());
    Blurred { image: out, slope }
}

fn largest_difference<T: Scalar, U: Scalar>(a: &Tensor<T>, b: &Tensor<U>) -> f64 {
    assert_eq!(a.shape(), b.shape());
    let pairs = a.data().iter().zip(b.data());
    pairs.map(|(a, b)| (a.to_f64() - b.to_f64()).abs()).fold(0.0, f64::max)
}

/// Along one axis, entries `apart` from each other, `out_i = sum_j matrix(i, j) x_j`.
fn multiplied(
    image: &Tensor<f64>,
    axis: usize,
    matrix: impl Fn(usize, usize) -> f64,
) -> Tensor<f64> {
    let shape = image.shape();
    let apart: usize = shape[axis + 1..].iter().product();
    let n = shape[axis];
    Tensor::from_flat_fn(shape.clone(), |k| {
        let (i, first) = (k / apart % n, k - k / apart % n * apart);
        (0..n).map(|j| matrix(i, j) * image.data()[first + j * apart]).sum()
    })
}

/// `[blur, its derivative with respect to sigma]` of a mirrored line of n pixels, as a matrix, by the
/// cosine transform.
fn mirrored(sigma: f64, n: usize) -> impl Fn(usize, usize) -> [f64; 2] {
    move |i, j| {
        let mut sums = [0.0; 2];
        for m in 0..n {
            let step = std::f64::consts::PI * m as f64 / n as f64;
            let bend = 1.0 - step.cos();
            let e = (-sigma * sigma * bend).exp() * if m == 0 { 1.0 } else { 2.0 } / n as f64;
            let wave = |i: usize| (step * (i as f64 + 0.5)).cos();
            sums[0] += e * wave(i) * wave(j);
            sums[1] -= 2.0 * sigma * bend * e * wave(i) * wave(j);
        }
        sums
    }
}

/// The weight of pixel j in pixel i of a line of n pixels, tap by tap.
fn weight(border: Border, variance: f64, n: usize) -> impl Fn(usize, usize) -> f64 {
    move |i, j| {
        let far = 60 + n as isize;
        let seen = |at: isize| border.source(at, n) == Some(j);
        let taps = (-far..=far).filter(|k| seen(i as isize + k));
        taps.map(|k| bessel(k.unsigned_abs(), variance)).sum()
    }
}

#[test]
fn a_mirrored_blur_is_that_of_the_cosine_transform() {
    for shape in SHAPES {
        let image = numbers::<f64>(shape, 1);
        for sigma in [0.3, 1.0, 3.0, 10.0, 100.0] {
            let (by_rows, by_columns) = (mirrored(sigma, shape[1]), mirrored(sigma, shape[0]));
            let both = |rows: usize, columns: usize| {
                let image = multiplied(&image, 1, |i, j| by_rows(i, j)[rows]);
                multiplied(&image, 0, |i, j| by_columns(i, j)[columns])
            };
            let expected = both(0, 0);
            let slopes = [both(0, 1), both(1, 0)];
            let slope = Tensor::from_flat_fn(shape, |k| slopes[0].data()[k] + slopes[1].data()[k]);
            for tolerance in [1e-3, 1e-5, 2e-7, 2e-9, 2e-11] {
                let order = order(tolerance);
                let found = blurred(&image, order, sigma, Border::Mirror);
                let rounding = 1e-13;
                let error = largest_difference(&found.image, &expected);
                assert!(error <= 2.0 * order.error + rounding, "{error} {shape:?} {sigma}");
                // The derivative's error is some times that of the blur.
                let error = sigma * largest_difference(&found.slope, &slope);
                assert!(error <= 20.0 * order.error + rounding, "{error} {shape:?} {sigma}");
            }
        }
    }
}

#[test]
fn every_border_is_that_of_the_sum_over_all_taps() {
    for shape in [[2, 40, 3], [35, 5, 1], [7, 33, 5]] {
        for border in BORDERS {
            for sigma in [0.5, 1.5, 4.0] {
                let image = numbers::<f64>(shape, 2);
                let variance = sigma * sigma;
                let expected = multiplied(&image, 1, weight(border, variance, shape[1]));
                let expected = multiplied(&expected, 0, weight(border, variance, shape[0]));
                let found = blurred(&image, order(2e-11), sigma, border);
                let error = largest_difference(&found.image, &expected);
                assert!(error <= 4e-11, "{error} {border:?} {shape:?} {sigma}");
            }
        }
    }
}

#[test]
fn the_blur_is_its_own_adjoint() {
    for shape in SHAPES {
        for (border, sigma) in BORDERS.into_iter().flat_map(|b| [0.4, 3.0, 50.0].map(|s| (b, s))) {
            let (image, g) = (numbers::<f64>(shape, 3), numbers::<f64>(shape, 4));
            let order = order(1e-4);
            let forward = blurred(&image, order, sigma, border).image;
            let difference =
                dot(&forward, &g) - dot(&image, &blurred(&g, order, sigma, border).image);
            let size = dot(&image, &image).sqrt() * dot(&g, &g).sqrt();
            assert!(difference.abs() <= 1e-13 * size, "{difference} {border:?} {shape:?} {sigma}");
        }
    }
}

#[test]
fn a_constant_image_is_kept_exactly_and_does_not_move() {
    for shape in SHAPES {
        for sigma in [0.3, 20.0, 3000.0] {
            let image = Tensor::<f32>::full(shape, 0.7);
            let found = blurred(&image, order(1e-6), sigma, Border::Mirror);
            assert_eq!(found.image, image);
            assert_eq!(found.slope, Tensor::zeros(shape));
        }
    }
}

#[test]
fn a_mirrored_blur_keeps_the_sum_of_all_pixels() {
    let image = numbers::<f64>([60, 70, 2], 6);
    let sum = |image: &Tensor<f64>| image.data().iter().sum::<f64>();
    for sigma in [1.0, 30.0, 2000.0] {
        let found = blurred(&image, order(1e-4), sigma, Border::Mirror);
        approx::assert_relative_eq!(sum(&found.image), sum(&image), max_relative = 1e-12);
        assert!(sum(&found.slope).abs() <= 1e-10 * sum(&image) / sigma);
    }
}

#[test]
fn f32_is_f64_to_rounding() {
    for border in BORDERS {
        for sigma in [1.0, 16.0, 64.0, 400.0, 3000.0] {
            let image = numbers::<f32>([500, 700, 1], 7);
            let narrow = blurred(&image, order(1e-6), sigma, border);
            let wide = blurred(&image.cast::<f64>(), order(1e-6), sigma, border);
            let error = largest_difference(&narrow.image, &wide.image);
            let slope = sigma * largest_difference(&narrow.slope, &wide.slope);
            assert!(error <= 2e-6, "{error} {border:?} {sigma}");
            assert!(slope <= 2e-6, "{slope} {border:?} {sigma}");
        }
    }
}

#[test]
fn a_tolerance_bounds_the_error_whichever_way_it_is_reached() {
    let shape = [40, 150, 2];
    let image = numbers::<f64>(shape, 8);
    let blurred = |sigma: f64, border, radius| {
        let tape = Tape::new();
        let blur = Blur { kernel: Kernel::Discrete, border, radius };
        let sigma = tape.leaf_scalar(sigma);
        super::super::gaussian_blur(tape.leaf(&image), sigma, &blur).unwrap().value()
    };
    for border in [Border::Zero, Border::Mirror, Border::Clamp] {
        for sigma in [0.2, 1.0, 3.0, 8.0, 25.0, 90.0] {
            let exact = blurred(sigma, border, Radius::Fixed(10_000));
            for tolerance in [1e-2, 1e-4, 1e-6, 1e-9, 1e-13] {
                let found = blurred(sigma, border, Radius::Tolerance(tolerance));
                let error = largest_difference(&found, &exact);
                // Along each axis the share is missing, and the rest grows by it.
                let bound = 4.0 * tolerance + 1e-13;
                assert!(error <= bound, "{error} {tolerance} {border:?} {sigma}");
            }
        }
    }
}
