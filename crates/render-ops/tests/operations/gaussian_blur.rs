//! Laws of the blur.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};

const KERNELS: [Kernel; 3] = [Kernel::Unnormalized, Kernel::Sampled, Kernel::Discrete];
const BORDERS: [Border; 3] = [Border::Zero, Border::Mirror, Border::Clamp];
/// Smaller than the window and larger, along one axis and both; more entries than a block.
const SHAPES: [[usize; 3]; 6] =
    [[1, 1, 1], [1, 9, 2], [8, 1, 3], [5, 7, 3], [40, 3, 1], [2, 37, 1]];
const RADII: [Radius; 5] = [
    Radius::Fixed(0),
    Radius::Fixed(1),
    Radius::Fixed(4),
    Radius::Fixed(30),
    Radius::Tolerance(1e-6),
];

/// Every kernel, border and radius on every shape.
fn for_each_case(mut check: impl FnMut(Blur, [usize; 3])) {
    for shape in SHAPES {
        for (kernel, border) in KERNELS.into_iter().flat_map(|k| BORDERS.map(|b| (k, b))) {
            RADII.into_iter().for_each(|radius| check(Blur { kernel, border, radius }, shape));
        }
    }
}

pub(super) fn numbers<T: Scalar>(shape: [usize; 3], seed: usize) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| {
        T::from_f64(((k * 7919 + seed * 104_729) % 1009) as f64 / 1009.0 - 0.4)
    })
}

fn blurred<T: Scalar>(image: &Tensor<T>, sigma: f64, blur: &Blur) -> Tensor<T> {
    let tape = Tape::new();
    let sigma = tape.leaf_scalar(T::from_f64(sigma));
    gaussian_blur(tape.leaf(image), sigma, blur).unwrap().value()
}

/// The gradients of `<out_bar, blurred image>` with respect to the image and sigma.
fn gradients<T: Scalar>(
    image: &Tensor<T>,
    sigma: f64,
    blur: &Blur,
    out_bar: &Tensor<T>,
) -> (Tensor<T>, f64) {
    let tape = Tape::new();
    let (image, sigma) = (tape.leaf(image), tape.leaf_scalar(T::from_f64(sigma)));
    let out = gaussian_blur(image, sigma, blur).unwrap();
    let gradients = tape.vjp(&[(out, out_bar)]).unwrap();
    (gradients.get(image).unwrap().clone(), gradients.get(sigma).unwrap().item().to_f64())
}

pub(super) fn dot<T: Scalar>(x: &Tensor<T>, y: &Tensor<T>) -> f64 {
    x.data().iter().zip(y.data()).map(|(x, y)| x.to_f64() * y.to_f64()).sum()
}

fn assert_close<T: Scalar>(found: &Tensor<T>, expected: &Tensor<f64>, tolerance: f64) {
    assert_eq!(found.shape(), expected.shape());
    for (k, (found, expected)) in found.data().iter().zip(expected.data()).enumerate() {
        let error = (found.to_f64() - expected).abs();
        assert!(error <= tolerance, "entry {k}: {found} instead of {expected}");
    }
}

/// `exp(-t) I_k(t)` by its power series, for small t.
pub(super) fn bessel(k: usize, t: f64) -> f64 {
    let mut term = (1..=k).fold((-t).exp(), |term, m| term * 0.5 * t / m as f64);
    let mut sum = 0.0;
    for m in 1..200 {
        sum += term;
        term *= 0.25 * t * t / (m * (m + k)) as f64;
    }
    sum
}

/// The blurred entry at `[row, column, channel]`, by the definition as a double sum.
fn double_sum(image: &Tensor<f64>, at: [usize; 3], sigma: f64, radius: isize, blur: &Blur) -> f64 {
    let &[height, width, channels] = &**image.shape() else { panic!("an image has three axes") };
    let shape = |k: isize| match blur.kernel {
        Kernel::Discrete => bessel(k.unsigned_abs(), sigma * sigma),
        _ => (-0.5 * (k as f64 / sigma).powi(2)).exp(),
    };
    let total = match blur.kernel {
        Kernel::Unnormalized => sigma * std::f64::consts::TAU.sqrt(),
        _ => (-radius..=radius).map(shape).sum(),
    };
    let source = |at: isize, extent: usize| -> Option<usize> {
        let last = extent as isize - 1;
        let inside = (0..=last).contains(&at);
        match blur.border {
            Border::Zero => inside.then_some(at as usize),
            Border::Clamp => Some(at.clamp(0, last) as usize),
            Border::Mirror => {
                // Reflected at one end, then at the other, until it is inside.
                let mut at = at;
                while !(0..=last).contains(&at) {
                    at = if at < 0 { -1 - at } else { 2 * last + 1 - at };
                }
                Some(at as usize)
            }
        }
    };
    let [row, column, channel] = at;
    let mut sum = 0.0;
    for (i, j) in (-radius..=radius).flat_map(|i| (-radius..=radius).map(move |j| (i, j))) {
        let (y, x) = (source(row as isize + i, height), source(column as isize + j, width));
        if let (Some(y), Some(x)) = (y, x) {
            let weight = shape(i) * shape(j) / (total * total);
            sum += weight * image.data()[(y * width + x) * channels + channel];
        }
    }
    sum
}

#[test]
fn every_pixel_is_the_double_sum_over_its_window() {
    for_each_case(|blur, shape| {
        let Radius::Fixed(radius) = blur.radius else { return };
        let image = numbers::<f64>(shape, 1);
        for sigma in [0.4, 1.3] {
            // The implementation cuts off taps below 1e-18 of the largest.
            let [_, width, channels] = shape;
            let expected = Tensor::from_flat_fn(shape, |k| {
                let at = [k / (width * channels), k / channels % width, k % channels];
                double_sum(&image, at, sigma, radius.min(20) as isize, &blur)
            });
            assert_close(&blurred(&image, sigma, &blur), &expected, 1e-14);
            assert_close(&blurred(&image.cast::<f32>(), sigma, &blur), &expected, 1e-5);
        }
    });
}

/// Backward is the adjoint of forward, and the slope in sigma the difference quotient. (The catalogue draws small
/// images; on a long line sums cancel, beyond what the law of curvature allows.)
#[test]
fn a_window_that_sees_a_whole_long_line_has_the_laws_of_any_other() {
    for border in [Border::Mirror, Border::Clamp, Border::Zero] {
        let blur = Blur { border, ..Blur::default() };
        for (shape, sigma) in [([1, 900, 1], 3.6e3), ([9000, 1, 1], 5e3)] {
            let (image, out_bar) = (numbers::<f64>(shape, 23), numbers::<f64>(shape, 24));
            let (image_bar, sigma_bar) = gradients(&image, sigma, &blur, &out_bar);
            let out = blurred(&image, sigma, &blur);
            let size = dot(&image, &image).sqrt() * dot(&out_bar, &out_bar).sqrt();
            let difference = dot(&out, &out_bar) - dot(&image, &image_bar);
            assert!(difference.abs() <= 1e-12 * size, "{difference} {border:?} {shape:?}");
            let at = |sigma: f64| dot(&blurred(&image, sigma, &blur), &out_bar);
            let h = 0.01 * sigma;
            let quotient = |h: f64| (at(sigma + h) - at(sigma - h)) / (2.0 * h);
            let richardson = (4.0 * quotient(0.5 * h) - quotient(h)) / 3.0;
            approx::assert_relative_eq!(sigma_bar, richardson, epsilon = 1e-8 * size / sigma);
        }
    }
}

#[test]
fn pieces_of_a_large_image_join_without_a_seam() {
    // Several pieces, whose borders lie within rows.
    let (shape, blur) = ([131, 257, 1], Blur { radius: Radius::Fixed(3), ..Blur::default() });
    let (image, out_bar) = (numbers::<f64>(shape, 9), numbers::<f64>(shape, 10));
    let out = blurred(&image, 1.1, &blur);
    for k in (0..out.size()).step_by(97).chain(16_380..16_390) {
        let expected = double_sum(&image, [k / 257, k % 257, 0], 1.1, 3, &blur);
        approx::assert_relative_eq!(out.data()[k], expected, epsilon = 1e-14);
    }
    let (image_bar, sigma_bar) = gradients(&image, 1.1, &blur, &out_bar);
    approx::assert_relative_eq!(dot(&out, &out_bar), dot(&image, &image_bar), max_relative = 1e-12);
    let at = |sigma: f64| dot(&blurred(&image, sigma, &blur), &out_bar);
    let quotient = (at(1.1 + 1e-5) - at(1.1 - 1e-5)) / 2e-5;
    approx::assert_relative_eq!(sigma_bar, quotient, max_relative = 1e-6);
}

#[test]
fn sampled_weights_with_sigma_zero_are_the_identity_and_leave_no_trace() {
    let tape = Tape::<f32>::new();
    let image = tape.leaf(&numbers([3, 4, 2], 13));
    for zero in [0.0, -0.0] {
        let sigma = tape.leaf_scalar(zero);
        let before = tape.len();
        let out = gaussian_blur(image, sigma, &Blur::default()).unwrap();
        assert_eq!(tape.len(), before);
        assert_eq!(out.value().data().as_ptr(), image.value().data().as_ptr());
        let report = format!("{:?}", tape.take_report());
        assert!(report.contains("sigma is 0"), "{report}");
    }
}

#[test]
fn a_small_sigma_is_nearly_the_identity() {
    for sigma in [1e-300, 1e-12, 1e-6, 0.05] {
        let image = numbers::<f64>([4, 3, 2], 14);
        assert_close(&blurred(&image, sigma, &Blur::default()), &image, 1e-15);
        let (image_bar, sigma_bar) = gradients(&image, sigma, &Blur::default(), &image);
        assert_close(&image_bar, &image, 1e-15);
        assert_eq!(sigma_bar, 0.0);
    }
}
