//! Standard deviations and images that a blur can be given.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes, keep_error};
use crate::measures::{difference, largest, motley, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    40 "sigma = 0", "the identity; an error for the unnormalized kernel", sigma_zero;
    42 "sigma beyond the image", "the limit of the border", sigma_beyond_the_image;
    43 "variance 1e-12", "defined", tiny_variance;
    44 "constant image", "kept, dsigma 0", constant_image;
    45 "impulse in a corner", "mass 1 (mirror)", impulse_in_a_corner;
    51 "window wider than the image", "each tap by the border", wide_window_on_a_small_image;
    52 "unnormalized kernel at sigma 1e-30", "its gain, or an error", seed_kernel_overflow;
    64 "discrete kernel, any sigma", "mass and constants kept", discrete_at_any_sigma;
    65 "discrete kernel, wide", "windows and systems agree", discrete_both_ways;
    190 "disc, variance 1e-12", "a step of diffusion", disc_of_tiny_variance;
    191 "disc, any sigma", "mass and constants kept", disc_at_any_sigma;
    192 "disc wider than the image", "each pixel by the border", disc_wider_than_the_image;
};

const SHAPE: [usize; 3] = [5, 7, 2];

/// Those with any sigma above 0.
const KERNELS: [Kernel; 3] = [Kernel::Unnormalized, Kernel::Sampled, Kernel::Discrete];

/// Those with a sum of 1.
const NORMALIZED: [Kernel; 3] = [Kernel::Sampled, Kernel::Discrete, Kernel::Disc];

const BORDERS: [Border; 3] = [Border::Zero, Border::Mirror, Border::Clamp];

/// The blurred image, and the gradients of `sum u . image` with respect to the image and sigma.
struct Blurred {
    image: Vec<f64>,
    image_bar: Vec<f64>,
    sigma_bar: f64,
}

fn blurred<T: Scalar>(
    shape: [usize; 3],
    entry: impl Fn(usize) -> f64,
    sigma: f64,
    blur: &Blur,
) -> Result<Blurred, Failure> {
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(entry(k))));
    let sigma = tape.leaf_scalar(T::from_f64(sigma));
    let out = gaussian_blur(image, sigma, blur)?;
    let upstream = Tensor::from_flat_fn(shape, |k| T::from_f64(motley(5 * k + 2)));
    let gradients = tape.vjp(&[(out, &upstream)])?;
    Ok(Blurred {
        image: numbers(&out.value()),
        image_bar: numbers(&gradients.get_or_zeros(image)),
        sigma_bar: gradients.get_or_zeros(sigma).item().to_f64(),
    })
}

/// The motley image as `T` holds it.
fn motley_in<T: Scalar>(k: usize) -> f64 {
    T::from_f64(motley(k)).to_f64()
}

fn sigma_zero<T: Scalar>() -> Outcome {
    let expected: Vec<_> = (0..70).map(motley_in::<T>).collect();
    let upstream: Vec<_> = (0..70).map(|k| motley_in::<T>(5 * k + 2)).collect();
    let mut error = 0.0_f64;
    for (kernel, border) in NORMALIZED.into_iter().flat_map(|k| BORDERS.map(|b| (k, b))) {
        for zero in [0.0, -0.0] {
            let blur = Blur { kernel, border, ..Blur::default() };
            let found = blurred::<T>(SHAPE, motley, zero, &blur)?;
            error = error
                .maximum_or_nan(difference(&found.image, &expected))
                .maximum_or_nan(difference(&found.image_bar, &upstream))
                .maximum_or_nan(found.sigma_bar.abs());
        }
    }
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::zeros(SHAPE));
    let seed = Blur { kernel: Kernel::Unnormalized, ..Blur::default() };
    let refused = keep_error(gaussian_blur(image, tape.leaf_scalar(T::ZERO), &seed));
    let rule =
        "gaussian_blur needs a finite and positive sigma for the unnormalized kernel, got sigma 0";
    Ok(Verdict::within(
        format!(
            "the image, its gradient the upstream, dsigma 0; unnormalized kernel: error: {rule}"
        ),
        error,
        0.0,
    )
    .and(refused == Err(rule.to_owned()), "the unnormalized kernel says something else"))
}

fn seed_kernel_overflow<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::zeros(SHAPE));
    let sigma = T::from_f64(1e-30);
    let blur = Blur { kernel: Kernel::Unnormalized, ..Blur::default() };
    let said = keep_error(gaussian_blur(image, tape.leaf_scalar(sigma), &blur));
    if rounding::<T>() < 1e-10 {
        // The centre's weight is 4e29 and its slope -4e59: numbers, in f64.
        let found = blurred::<T>([1, 1, 1], |_| 1.0, 1e-30, &blur)?;
        let weight = 1e30 / f64::sqrt(std::f64::consts::TAU);
        // One pixel, under a mirror, both axes.
        let error = (found.image[0] / (weight * weight) - 1.0).abs();
        return Ok(Verdict::within("the gain of 1.6e59 as printed", error, 1e-14));
    }
    let rule = "gaussian_blur needs a sigma at which the unnormalized kernel does not overflow";
    Ok(Verdict::refused(vec![(said, format!("{rule}, got sigma {}", sigma.to_f64()))]))
}

fn sigma_beyond_the_image<T: Scalar>() -> Outcome {
    let mean = |pixels: &[usize], channel: usize| -> f64 {
        let sum: f64 = pixels.iter().map(|pixel| motley_in::<T>(2 * pixel + channel)).sum();
        sum / pixels.len() as f64
    };
    let all: Vec<usize> = (0..35).collect();
    let corners = [0, 6, 28, 34];
    let mut error = 0.0_f64;
    let mut finite = true;
    for kernel in KERNELS {
        for border in BORDERS {
            let most = if rounding::<T>() < 1e-10 { f64::MAX } else { f64::from(f32::MAX) };
            for sigma in [1e5, 1e9, 1e20, 1e30, 1e38, most] {
                let blur = Blur { kernel, border, ..Blur::default() };
                let found = blurred::<T>(SHAPE, motley, sigma, &blur)?;
                let limit = |k: usize| match border {
                    Border::Zero => 0.0,
                    Border::Mirror => mean(&all, k % 2),
                    Border::Clamp => mean(&corners, k % 2),
                };
                let expected: Vec<_> = (0..70).map(limit).collect();
                // A window over 1e9 px has 1e-8 of its weight over the image.
                let tail = if border == Border::Mirror { 0.0 } else { 10.0 / sigma };
                let beyond = difference(&found.image, &expected) - tail;
                error = error.maximum_or_nan(beyond).maximum_or_nan(found.sigma_bar.abs() - tail);
                finite &= found.image_bar.iter().all(|bar| bar.is_finite());
            }
        }
    }
    let outcome = "the mean (mirror), the mean of the corners (clamp), zero; no slope";
    Ok(Verdict::within(outcome, error.maximum_or_nan(0.0), 16.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}

/// The pixel, of `extent` in a line, that a window sees at a place.
fn source(border: Border, at: isize, extent: isize) -> Option<isize> {
    match border {
        Border::Zero => (0..extent).contains(&at).then_some(at),
        Border::Clamp => Some(at.clamp(0, extent - 1)),
        Border::Mirror => {
            let phase = at.rem_euclid(2 * extent);
            Some(phase.min(2 * extent - 1 - phase))
        }
    }
}

fn wide_window_on_a_small_image<T: Scalar>() -> Outcome {
    // The window as a double sum, tap by tap.
    let sigma = 40.0;
    let radius = 200_isize;
    let weight = |k: isize| f64::exp(-0.5 * (k as f64 / sigma).powi(2));
    let total: f64 = (-radius..=radius).map(weight).sum();
    // The share of the pixel at `from` in the window around `at`.
    let share = |border: Border, at: isize, from: isize, extent: isize| -> f64 {
        let taps = (-radius..=radius).filter(|k| source(border, at + k, extent) == Some(from));
        taps.map(weight).sum::<f64>() / total
    };
    let mut error = 0.0_f64;
    for border in BORDERS {
        let blur = Blur { border, radius: Radius::Fixed(200), ..Blur::default() };
        let found = blurred::<T>(SHAPE, motley, sigma, &blur)?;
        for (k, found) in found.image.iter().enumerate() {
            let (row, column) = ((k / 14) as isize, (k / 2 % 7) as isize);
            let mut expected = 0.0;
            for from in 0..35 {
                let by_row = share(border, row, from / 7, 5);
                let by_column = share(border, column, from % 7, 7);
                expected += by_row * by_column * motley_in::<T>(2 * from as usize + k % 2);
            }
            error = error.maximum_or_nan((found - expected).abs());
        }
    }
    Ok(Verdict::within("each pixel the sum over all 401 x 401 taps", error, 16.0 * rounding::<T>()))
}

fn tiny_variance<T: Scalar>() -> Outcome {
    // Learnt as a variance: sigma = sqrt(t).
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::from_flat_fn(SHAPE, |k| T::from_f64(motley(k))));
    let variance = tape.leaf_scalar(T::from_f64(1e-12));
    let out = gaussian_blur(image, variance.sqrt(), &Blur::default())?;
    let gradients = out.square().sum().backward()?;
    let expected: Vec<_> = (0..70).map(motley_in::<T>).collect();
    let slope = gradients.get_or_zeros(variance).item().to_f64();
    let doubled = numbers(&gradients.get_or_zeros(image));
    let twice: Vec<_> = expected.iter().map(|entry| 2.0 * entry).collect();
    let error =
        difference(&numbers(&out.value()), &expected).maximum_or_nan(difference(&doubled, &twice));
    Ok(Verdict::within("the image itself; d/dt = 0", error.maximum_or_nan(slope.abs()), 0.0))
}

fn constant_image<T: Scalar>() -> Outcome {
    let value = T::from_f64(0.7).to_f64();
    let (mut error, mut slope) = (0.0_f64, 0.0_f64);
    let borders = [Border::Mirror, Border::Clamp];
    for (kernel, border) in NORMALIZED.into_iter().flat_map(|k| borders.map(|b| (k, b))) {
        for sigma in [1e-6, 0.3, 2.0, 50.0, 1e5] {
            let sigma = if kernel == Kernel::Disc { f64::min(sigma, 1024.0) } else { sigma };
            let blur = Blur { kernel, border, ..Blur::default() };
            let found = blurred::<T>(SHAPE, |_| 0.7, sigma, &blur)?;
            error = error.maximum_or_nan(largest(found.image.iter().map(|entry| entry - value)));
            slope = slope.maximum_or_nan(found.sigma_bar.abs());
        }
    }
    Ok(Verdict::within("kept; d/dsigma exactly 0", error, 64.0 * rounding::<T>())
        .and(slope == 0.0, format!("d/dsigma is {slope:.1e}")))
}

fn impulse_in_a_corner<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for shape in [[5, 7, 1], [1, 9, 1], [16, 16, 1]] {
        for sigma in [0.5, 3.0, 80.0, 1e5] {
            let impulse = |k: usize| if k == 0 { 1.0 } else { 0.0 };
            let found = blurred::<T>(shape, impulse, sigma, &Blur::default())?;
            let mass: f64 = found.image.iter().sum();
            let least = found.image.iter().fold(0.0_f64, |least, &entry| least.min(entry));
            error = error.maximum_or_nan((mass - 1.0).abs()).maximum_or_nan(-least);
        }
    }
    // Some 300 weights and pixels are rounded, each by a part of it.
    Ok(Verdict::within("mass 1", error, 128.0 * rounding::<T>()))
}

fn discrete_at_any_sigma<T: Scalar>() -> Outcome {
    let (mut error, mut slope, mut finite) = (0.0_f64, 0.0_f64, true);
    for shape in [[1, 1, 1], [1, 200, 1], [60, 70, 2]] {
        let size: usize = shape.iter().product();
        for sigma in [0.0, 1e-30, 1e-6, 0.3, 7.0, 30.0, 2000.0, 1e5, 1e30] {
            for tolerance in [1e-2, 1e-5, 1e-8] {
                let radius = Radius::Tolerance(tolerance);
                let blur = Blur { kernel: Kernel::Discrete, border: Border::Mirror, radius };
                let flat = blurred::<T>(shape, |_| 0.5, sigma, &blur)?;
                error = error.maximum_or_nan(largest(flat.image.iter().map(|entry| entry - 0.5)));
                slope = slope.maximum_or_nan(flat.sigma_bar.abs());
                let impulse = |k: usize| f64::from(u8::from(k == size / 3));
                let found = blurred::<T>(shape, impulse, sigma, &blur)?;
                error = error.maximum_or_nan((found.image.iter().sum::<f64>() - 1.0).abs());
                finite &= found.sigma_bar.is_finite();
                finite &= found.image_bar.iter().all(|bar| bar.is_finite());
            }
        }
    }
    // Each of the 4200 pixels takes its share of what elimination along two lines passes on: a few
    // roundings for each of their 130 pixels.
    Ok(Verdict::within("mass 1, a constant kept, its slope 0", error, 1024.0 * rounding::<T>())
        .and(finite, "a gradient is not finite")
        .and(slope <= 1e3 * rounding::<T>(), format!("the slope of a constant is {slope:.1e}")))
}

fn discrete_both_ways<T: Scalar>() -> Outcome {
    // A fixed radius is a window; a tolerance, at these sigmas, tridiagonal systems.
    let shape = [60, 70, 2];
    let mut error = 0.0_f64;
    for border in [Border::Zero, Border::Mirror] {
        for sigma in [12.0, 40.0, 90.0] {
            let of = |radius| Blur { kernel: Kernel::Discrete, border, radius };
            let systems = blurred::<T>(shape, motley, sigma, &of(Radius::Tolerance(1e-6)))?;
            let window = blurred::<T>(shape, motley, sigma, &of(Radius::Fixed(600)))?;
            error = error
                .maximum_or_nan(difference(&systems.image, &window.image))
                .maximum_or_nan(difference(&systems.image_bar, &window.image_bar));
        }
    }
    Ok(Verdict::within("the same image and gradient", error, 1e-6 + 64.0 * rounding::<T>()))
}

fn disc_of_tiny_variance<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::from_flat_fn(SHAPE, |k| T::from_f64(motley(k))));
    let variance = tape.leaf_scalar(T::from_f64(1e-12));
    let blur = Blur { kernel: Kernel::Disc, ..Blur::default() };
    let out = gaussian_blur(image, variance.sqrt(), &blur)?;
    let gradients = out.square().sum().backward()?;
    let expected: Vec<_> = (0..70).map(motley_in::<T>).collect();
    // d/dt is half the difference between the four neighbours and the pixel, four times.
    let mut slope = 0.0;
    for (k, entry) in expected.iter().enumerate() {
        let [row, column, channel] = [k / 14, k / 2 % 7, k % 2];
        let neighbours = [
            [row.saturating_sub(1), column],
            [(row + 1).min(4), column],
            [row, column.saturating_sub(1)],
            [row, (column + 1).min(6)],
        ];
        let beside = neighbours.map(|[row, column]| expected[14 * row + 2 * column + channel]);
        slope += entry * (beside.iter().sum::<f64>() - 4.0 * entry);
    }
    let found = gradients.get_or_zeros(variance).item().to_f64();
    let error = difference(&numbers(&out.value()), &expected)
        .maximum_or_nan((found - slope).abs() / slope.abs());
    Ok(Verdict::within(
        "the image; d/dt by the four neighbours",
        error,
        16.0 * rounding::<T>() + 1e-11,
    ))
}

fn disc_at_any_sigma<T: Scalar>() -> Outcome {
    // The disc's rim touches sides of pixels at a radius of 3/2, where the variance is this.
    let cap = (1.0_f64 / 3.0).acos() - 8.0_f64.sqrt() / 9.0;
    let touching = (std::f64::consts::FRAC_2_PI * cap).sqrt();
    let (mut error, mut slope, mut finite) = (0.0_f64, 0.0_f64, true);
    for shape in [[1, 1, 1], [1, 200, 1], [60, 70, 2]] {
        let size: usize = shape.iter().product();
        for sigma in [0.0, 1e-30, 1e-6, 0.3, touching, 4.0, 8.0, 30.0, 1024.0] {
            for tolerance in [0.15, 1e-6] {
                let radius = Radius::Tolerance(tolerance);
                let blur = Blur { kernel: Kernel::Disc, border: Border::Mirror, radius };
                let flat = blurred::<T>(shape, |_| 0.7, sigma, &blur)?;
                let value = T::from_f64(0.7).to_f64();
                error = error.maximum_or_nan(largest(flat.image.iter().map(|entry| entry - value)));
                slope = slope.maximum_or_nan(flat.sigma_bar.abs());
                let impulse = |k: usize| f64::from(u8::from(k == size / 3));
                let found = blurred::<T>(shape, impulse, sigma, &blur)?;
                let mass = found.image.iter().sum::<f64>();
                // A disc that is blurred at half the size keeps it where both extents can be halved.
                if tolerance < 0.1 && sigma < 100.0 {
                    error = error.maximum_or_nan((mass - 1.0).abs());
                }
                finite &= mass.is_finite() && found.sigma_bar.is_finite();
                finite &= found.image_bar.iter().all(|bar| bar.is_finite());
            }
        }
    }
    // Some thousand pixels have the same weight, which is rounded the same way.
    Ok(Verdict::within("mass 1, a constant kept, its slope 0", error, 256.0 * rounding::<T>())
        .and(finite, "a gradient is not finite")
        .and(slope == 0.0, format!("the slope of a constant is {slope:.1e}")))
}

/// How far a disc in [`disc_wider_than_the_image`] may reach.
const REACH: isize = 20;

/// The share of a disc in each pixel around its centre, by thin slices, row by row.
fn disc_weights(sigma: f64) -> Vec<Vec<f64>> {
    const SLICES: usize = 400;
    let slices = |column: isize| {
        let place = move |k: usize| column as f64 - 0.5 + (k as f64 + 0.5) / SLICES as f64;
        (0..SLICES).map(place)
    };
    let chord = |x: f64, radius: f64| (radius * radius - x * x).max(0.0).sqrt();
    let area = |radius: f64| std::f64::consts::PI * radius * radius * SLICES as f64;
    let variance = |radius: f64| -> f64 {
        let column =
            |k: isize| -> f64 { slices(k).map(|x| (k * k) as f64 * 2.0 * chord(x, radius)).sum() };
        (-REACH..=REACH).map(column).sum::<f64>() / area(radius)
    };
    let (mut low, mut radius) = (0.5, 2.0 * sigma + 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + radius);
        if variance(middle) < sigma * sigma { low = middle } else { radius = middle }
    }
    let share = |row: isize, column: isize| -> f64 {
        let [above, below] = [row as f64 - 0.5, row as f64 + 0.5];
        let length = |x: f64| {
            let chord = chord(x, radius);
            (chord.min(below) - above.max(-chord)).max(0.0)
        };
        slices(column).map(length).sum::<f64>() / area(radius)
    };
    let row = |row: isize| (-REACH..=REACH).map(|column| share(row, column)).collect();
    (-REACH..=REACH).map(row).collect()
}

fn disc_wider_than_the_image<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for sigma in [4.0, 8.0] {
        let weights = disc_weights(sigma);
        for [height, width] in [[1, 1], [1, 9], [5, 7]] {
            for border in BORDERS {
                let blur = Blur { kernel: Kernel::Disc, border, radius: Radius::Fixed(20) };
                let shape = [height as usize, width as usize, 1];
                let found = blurred::<T>(shape, motley, sigma, &blur)?;
                for (k, found) in found.image.iter().enumerate() {
                    let (y, x) = (k as isize / width, k as isize % width);
                    let mut expected = 0.0;
                    for (row, weights) in (-REACH..=REACH).zip(&weights) {
                        for (column, weight) in (-REACH..=REACH).zip(weights) {
                            let row = source(border, y + row, height);
                            let column = source(border, x + column, width);
                            let (Some(row), Some(column)) = (row, column) else { continue };
                            expected += weight * motley_in::<T>((row * width + column) as usize);
                        }
                    }
                    error = error.maximum_or_nan((found - expected).abs());
                }
            }
        }
    }
    Ok(Verdict::within("each pixel the sum over all pixels of the disc", error, 1e-5))
}
