//! Laws of the blur with a disc.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};

use crate::gaussian_blur::{dot, numbers};

const BORDERS: [Border; 3] = [Border::Zero, Border::Mirror, Border::Clamp];
/// A tolerance that allows half the size from a radius of 8 on.
const COARSE: Radius = Radius::Tolerance(0.15);
const EXACT: Radius = Radius::Fixed(2048);

fn disc(border: Border, radius: Radius) -> Blur {
    Blur { kernel: Kernel::Disc, border, radius }
}

fn blurred<T: Scalar>(image: &Tensor<T>, sigma: f64, blur: &Blur) -> Tensor<T> {
    let tape = Tape::new();
    let sigma = tape.constant_scalar(T::from_f64(sigma));
    gaussian_blur(tape.constant(image), sigma, blur).unwrap().value()
}

/// The gradients of `<out_bar, blurred image>` with respect to the image and sigma.
fn gradients(
    image: &Tensor<f64>,
    sigma: f64,
    blur: &Blur,
    out_bar: &Tensor<f64>,
) -> (Tensor<f64>, f64) {
    let tape = Tape::new();
    let (image, sigma) = (tape.leaf(image), tape.leaf_scalar(sigma));
    let out = gaussian_blur(image, sigma, blur).unwrap();
    let gradients = tape.vjp(&[(out, out_bar)]).unwrap();
    (gradients.get(image).unwrap().clone(), gradients.get(sigma).unwrap().item())
}

/// The area of a pixel under a disc of this radius around the origin, by thin slices.
fn area(pixel: [isize; 2], radius: f64) -> f64 {
    const SLICES: usize = 1000;
    let [x, y] = pixel.map(|at| at.unsigned_abs() as f64);
    let slice = |k: usize| {
        let x = x - 0.5 + (k as f64 + 0.5) / SLICES as f64;
        let chord = (radius * radius - x * x).max(0.0).sqrt();
        (chord.min(y + 0.5) - (y - 0.5).max(-chord)).max(0.0)
    };
    (0..SLICES).map(slice).sum::<f64>() / SLICES as f64
}

/// The weights of a disc up to `reach` pixels to either side, whose variance is found by halving intervals.
fn weights(sigma: f64, reach: isize) -> Vec<Vec<f64>> {
    let of_radius = |radius: f64| -> Vec<Vec<f64>> {
        let share = |i, j| area([i, j], radius) / (std::f64::consts::PI * radius * radius);
        (-reach..=reach).map(|i| (-reach..=reach).map(|j| share(i, j)).collect()).collect()
    };
    let variance = |weights: &[Vec<f64>]| -> f64 {
        let rows = weights.iter().zip(-reach..);
        rows.map(|(row, i)| (i * i) as f64 * row.iter().sum::<f64>()).sum()
    };
    let (mut low, mut high) = (0.5, 2.0 * sigma + 1.0);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if variance(&of_radius(middle)) < sigma * sigma { low = middle } else { high = middle }
    }
    of_radius(low)
}

/// The pixel of `extent` that stands at a position, as the borders say.
fn source(border: Border, at: isize, extent: usize) -> Option<usize> {
    let last = extent as isize - 1;
    match border {
        Border::Zero => (0..=last).contains(&at).then_some(at as usize),
        Border::Clamp => Some(at.clamp(0, last) as usize),
        Border::Mirror => {
            let mut at = at;
            while !(0..=last).contains(&at) {
                at = if at < 0 { -1 - at } else { 2 * last + 1 - at };
            }
            Some(at as usize)
        }
    }
}

#[test]
fn every_pixel_is_the_double_sum_over_a_disc() {
    for (sigma, reach) in [(0.3, 1), (0.7, 2), (1.6, 4)] {
        let weights = weights(sigma, reach);
        for shape in [[1, 1, 1], [1, 9, 2], [8, 1, 3], [5, 7, 3], [40, 3, 1]] {
            let [height, width, channels] = shape;
            let image = numbers::<f64>(shape, 1);
            for border in BORDERS {
                let expected = |k: usize| {
                    let [y, x, c] = [k / (width * channels), k / channels % width, k % channels];
                    let mut sum = 0.0;
                    for (i, j) in
                        (-reach..=reach).flat_map(|i| (-reach..=reach).map(move |j| (i, j)))
                    {
                        let row = source(border, y as isize + i, height);
                        let column = source(border, x as isize + j, width);
                        if let (Some(y), Some(x)) = (row, column) {
                            let weight = weights[(i + reach) as usize][(j + reach) as usize];
                            sum += weight * image.data()[(y * width + x) * channels + c];
                        }
                    }
                    sum
                };
                let found = blurred(&image, sigma, &disc(border, EXACT));
                let narrow = blurred(&image.cast::<f32>(), sigma, &disc(border, COARSE));
                for k in 0..image.size() {
                    let expected = expected(k);
                    let (wide, narrow) = (found.data()[k], f64::from(narrow.data()[k]));
                    assert!((wide - expected).abs() < 1e-5, "{sigma} {shape:?} {border:?} {k}");
                    assert!((wide - narrow).abs() < 1e-6, "{sigma} {shape:?} {border:?} {k}");
                }
            }
        }
    }
}

#[test]
fn bands_and_strips_of_a_large_image_join_without_a_seam() {
    let (shape, sigma) = ([131, 257, 1], 1.6);
    let weights = weights(sigma, 4);
    let image = numbers::<f64>(shape, 9);
    let out = blurred(&image, sigma, &disc(Border::Mirror, COARSE));
    for k in (0..out.size()).step_by(97) {
        let mut expected = 0.0;
        for (i, j) in (-4..=4).flat_map(|i| (-4..=4).map(move |j| (i, j))) {
            let y = source(Border::Mirror, (k / 257) as isize + i, 131).unwrap();
            let x = source(Border::Mirror, (k % 257) as isize + j, 257).unwrap();
            expected += weights[(i + 4) as usize][(j + 4) as usize] * image.data()[y * 257 + x];
        }
        assert!((out.data()[k] - expected).abs() < 1e-5, "{k}");
    }
}

/// The weights that a pixel of the blurred image has, `[H, W]`.
fn weights_of_pixel(size: [usize; 2], pixel: [usize; 2], sigma: f64, radius: Radius) -> Vec<f64> {
    let shape = [size[0], size[1], 1];
    let mut upstream = Tensor::<f64>::zeros(shape);
    upstream.data_mut()[pixel[0] * size[1] + pixel[1]] = 1.0;
    let blur = disc(Border::Mirror, radius);
    gradients(&Tensor::zeros(shape), sigma, &blur, &upstream).0.data().to_vec()
}

#[test]
fn at_half_the_size_each_pixel_sees_the_variance_of_sigma_around_itself() {
    for (sigma, size) in [(4.0, 64), (7.0, 64), (8.5, 96), (17.0, 160), (33.0, 320)] {
        for pixel in [[0, 0], [1, 0], [2, 3], [3, 5], [6, 7]] {
            let pixel = pixel.map(|at| at + size / 2);
            let weights = weights_of_pixel([size; 2], pixel, sigma, COARSE);
            let moment = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                let offset = |at: usize, axis: usize| at as f64 - pixel[axis] as f64;
                let weights = weights.iter().enumerate();
                weights.map(|(k, w)| w * f(offset(k / size, 0), offset(k % size, 1))).sum()
            };
            approx::assert_relative_eq!(moment(&|_, _| 1.0), 1.0, epsilon = 1e-12);
            for mean in [moment(&|y, _| y), moment(&|_, x| x), moment(&|y, x| x * y)] {
                assert!(mean.abs() < 1e-10, "{sigma} {pixel:?}: {mean}");
            }
            for variance in [moment(&|y, _| y * y), moment(&|_, x| x * x)] {
                approx::assert_relative_eq!(variance, sigma * sigma, max_relative = 1e-10);
            }
        }
    }
}

#[test]
fn at_half_the_size_no_more_weight_is_misplaced_than_the_tolerance_says() {
    // Halved once, twice and three times.
    for (sigma, tolerance, size) in
        [(4.0, 0.15, 64), (8.0, 0.15, 96), (8.1, 0.15, 96), (16.2, 0.15, 160), (12.6, 0.05, 128)]
    {
        let mut most = 0.0_f64;
        for pixel in [[0, 0], [1, 0], [2, 1], [3, 3]] {
            let pixel = pixel.map(|at| at + size / 2);
            let [coarse, exact] = [Radius::Tolerance(tolerance), EXACT]
                .map(|radius| weights_of_pixel([size; 2], pixel, sigma, radius));
            let moved: f64 = coarse.iter().zip(&exact).map(|(a, b)| 0.5 * (a - b).abs()).sum();
            most = most.max(moved);
        }
        assert!(most > 0.01 && most <= tolerance, "{sigma}: {most} with {tolerance}");
    }
}

/// The image with as many more pixels as `more` at each side, as its border says.
fn extended(image: &Tensor<f64>, border: Border, more: usize) -> Tensor<f64> {
    let &[height, width, channels] = &**image.shape() else { panic!("an image has three axes") };
    let shape = [height + 2 * more, width + 2 * more, channels];
    Tensor::from_flat_fn(shape, |k| {
        let [y, x] = [k / (shape[1] * channels), k / channels % shape[1]];
        let y = source(border, y as isize - more as isize, height);
        let x = source(border, x as isize - more as isize, width);
        match (y, x) {
            (Some(y), Some(x)) => image.data()[(y * width + x) * channels + k % channels],
            _ => 0.0,
        }
    })
}

#[test]
fn half_the_size_sees_the_border_as_the_whole_size_does() {
    for sigma in [4.0, 6.0, 9.0, 14.0] {
        for shape in [[64, 61, 1], [63, 62, 2], [65, 80, 1], [31, 96, 1]] {
            let image = numbers::<f64>(shape, 3);
            for border in BORDERS {
                let blur = disc(border, COARSE);
                let found = blurred(&image, sigma, &blur);
                const MORE: usize = 64;
                let whole = blurred(&extended(&image, border, MORE), sigma, &blur);
                let [_, width, channels] = shape;
                for k in 0..image.size() {
                    let [y, x] = [k / (width * channels), k / channels % width];
                    let at = (y + MORE) * (width + 2 * MORE) + x + MORE;
                    let expected = whole.data()[at * channels + k % channels];
                    let error = (found.data()[k] - expected).abs();
                    assert!(error < 1e-12, "{sigma} {shape:?} {border:?} {y} {x}: {error}");
                }
            }
        }
    }
}

#[test]
fn backward_is_the_adjoint_of_forward_at_every_size_and_border() {
    for sigma in [0.3, 1.2, 5.0, 9.0, 40.0] {
        for shape in [[1, 1, 1], [1, 40, 2], [33, 1, 1], [17, 23, 3], [40, 30, 1]] {
            for border in BORDERS {
                for radius in [EXACT, COARSE] {
                    let blur = disc(border, radius);
                    let (image, out_bar) = (numbers::<f64>(shape, 5), numbers::<f64>(shape, 6));
                    let (image_bar, sigma_bar) = gradients(&image, sigma, &blur, &out_bar);
                    let out = blurred(&image, sigma, &blur);
                    let size = dot(&image, &image).sqrt() * dot(&out_bar, &out_bar).sqrt();
                    let difference = dot(&out, &out_bar) - dot(&image, &image_bar);
                    assert!(
                        difference.abs() <= 1e-12 * size,
                        "{difference} {sigma} {blur:?} {shape:?}"
                    );
                    let at = |sigma: f64| dot(&blurred(&image, sigma, &blur), &out_bar);
                    let h = 1e-4 * sigma;
                    let quotient = |h: f64| (at(sigma + h) - at(sigma - h)) / (2.0 * h);
                    let richardson = (4.0 * quotient(0.5 * h) - quotient(h)) / 3.0;
                    let error = (sigma_bar - richardson).abs();
                    assert!(
                        error <= 1e-8 * size / sigma,
                        "{sigma} {blur:?} {shape:?}: {sigma_bar} {richardson}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_mirror_keeps_the_sum_of_all_pixels_where_the_image_can_be_halved() {
    for (shape, sigma, radius) in
        [([5, 7, 1], 2.0, EXACT), ([24, 32, 1], 5.0, COARSE), ([24, 32, 1], 15.0, COARSE)]
    {
        let image = Tensor::from_flat_fn(shape, |k| if k == 0 { 1.0 } else { 0.0 });
        let out = blurred::<f64>(&image, sigma, &disc(Border::Mirror, radius));
        approx::assert_relative_eq!(out.data().iter().sum::<f64>(), 1.0, epsilon = 1e-13);
    }
}
