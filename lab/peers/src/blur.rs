//! Gaussian blurs of three channels by image libraries, forward alone: they have no gradients.
//!
//! The error is against the same blur in f64, weights `exp(-k^2 / (2 sigma^2))` divided by their
//! sum, of all k whose weight is above 1e-17, with the border pixels repeated, as both libraries do.

use std::hint::black_box;

use image::{ImageBuffer, Rgb};
use imageproc::filter::gaussian_blur_f32;
use libblur::{
    BlurImage, BlurImageMut, EdgeMode, EdgeMode2D, FastBlurChannels, GaussianBlurParams,
    IeeeBinaryConvolutionMode, ThreadingPolicy, gaussian_blur_f32 as libblur_f32,
};

use crate::Figure;
use crate::sampling::interleaved;

/// Strengths of the blur, in pixels, as in `bokashi-lab bench`.
const SIGMAS: [f64; 6] = [0.1, 0.5, 1.0, 4.0, 16.0, 64.0];
const PIXELS: [usize; 3] = [32, 256, 1024];
const CHANNELS: usize = 3;

pub fn figures() -> Vec<Figure> {
    let mut figures = Vec::new();
    for pixels in PIXELS {
        for sigma in SIGMAS {
            let noise = noise(pixels * pixels * CHANNELS);
            let exact = exact(&noise, pixels, sigma);
            let side = pixels as u32;

            let picture: ImageBuffer<Rgb<f32>, Vec<f32>> =
                ImageBuffer::from_raw(side, side, noise.clone()).expect("of the right length");
            let run = || gaussian_blur_f32(&picture, sigma as f32);
            let imageproc_error = error(run().as_raw(), &exact);
            let mut imageproc = || drop(black_box(run()));

            let source = BlurImage::borrow(&noise, side, side, FastBlurChannels::Channels3);
            let mut blurred = BlurImageMut::alloc(side, side, FastBlurChannels::Channels3);
            libblur(&source, &mut blurred, sigma);
            let libblur_error = error(blurred.data.borrow(), &exact);
            let mut libblur = || {
                libblur(&source, &mut blurred, sigma);
                black_box(blurred.data.borrow().first());
            };

            let times = interleaved(&mut [&mut imageproc, &mut libblur]);
            let errors = [("imageproc", imageproc_error), ("libblur", libblur_error)];
            for ((name, error), [minimum, median]) in errors.into_iter().zip(times) {
                figures.push(Figure {
                    study: "blur",
                    name,
                    pixels: Some(pixels),
                    sigma: Some(sigma),
                    minimum_microseconds: minimum,
                    median_microseconds: median,
                    error: Some(error),
                    ..Figure::default()
                });
            }
        }
    }
    figures
}

fn libblur(source: &BlurImage<'_, f32>, blurred: &mut BlurImageMut<'_, f32>, sigma: f64) {
    libblur_f32(
        source,
        blurred,
        GaussianBlurParams::new_from_sigma(sigma),
        EdgeMode2D::new(EdgeMode::Clamp),
        ThreadingPolicy::Single,
        IeeeBinaryConvolutionMode::Normal,
    )
    .expect("images of one size");
}

/// Numbers in [0, 1) from a generator of our own: a multiplicative congruential one.
fn noise(count: usize) -> Vec<f32> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as f32 / (1_u32 << 24) as f32
    };
    (0..count).map(|_| next()).collect()
}

/// The exact blur: along the rows, then along the columns.
fn exact(image: &[f32], pixels: usize, sigma: f64) -> Vec<f64> {
    let weight = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    let half: Vec<f64> = (0..).map(weight).take_while(|&weight| weight > 1e-17).collect();
    let sum = 2.0 * half.iter().sum::<f64>() - half[0];
    let last = pixels as isize - 1;
    // Entry `at` of a line of which entry k is `line(k)`.
    let tap = |line: &dyn Fn(usize) -> f64, at: usize| {
        let side = |k: isize| line((at as isize + k).clamp(0, last) as usize);
        let pair = |k: usize| half[k] * (side(k as isize) + side(-(k as isize)));
        (half[0] * line(at) + (1..half.len()).map(pair).sum::<f64>()) / sum
    };
    let place =
        |row: usize, column: usize, channel: usize| (row * pixels + column) * CHANNELS + channel;
    let along = |image: &[f64], by_rows: bool| {
        let mut blurred = vec![0.0; image.len()];
        for row in 0..pixels {
            for column in 0..pixels {
                for channel in 0..CHANNELS {
                    let line = |k: usize| match by_rows {
                        true => image[place(row, k, channel)],
                        false => image[place(k, column, channel)],
                    };
                    let at = if by_rows { column } else { row };
                    blurred[place(row, column, channel)] = tap(&line, at);
                }
            }
        }
        blurred
    };
    let image: Vec<f64> = image.iter().map(|&entry| f64::from(entry)).collect();
    along(&along(&image, true), false)
}

/// The largest difference as a share of the largest entry.
fn error(found: &[f32], exact: &[f64]) -> f64 {
    let largest = exact.iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
    let differences = found.iter().zip(exact).map(|(a, b)| (f64::from(*a) - b).abs());
    differences.fold(0.0, f64::max) / largest
}
