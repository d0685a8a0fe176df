//! Cameras of any focal length and centre.

use bokashi_core::{Scalar, Tape};
use bokashi_render_ops::{Size, orthographic, pinhole, project};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{largest, numbers, rounding, rows, vector};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    122 "pinholes of any focal length", "points at their pixels", known_pixels;
};

const SIZE: Size = Size { width: 40, height: 30 };

fn known_pixels<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for focal in [1e-3, 1.0, 700.0, -30.0, 1e6] {
        for center in [[19.5, 14.5], [0.0, 0.0], [-1e4, 3e5]] {
            for (z, is_pinhole) in [(0.5, true), (4.0, true), (4.0, false)] {
                let tape = Tape::<T>::new();
                let intrinsics = vector(&tape, [focal, 2.0 * focal, center[0], center[1]]);
                let camera = match is_pinhole {
                    true => pinhole(intrinsics, SIZE, 0.25, f64::INFINITY)?,
                    false => orthographic(intrinsics, SIZE, 0.25, 8.0)?,
                };
                let point = [0.25, -0.125, z];
                let clip = numbers(&project(rows(&tape, &[point]), camera, None)?.value());
                // OpenCV's pixels, half a pixel before ours.
                let w = if is_pinhole { z } else { 1.0 };
                let place = |k: usize, scale: f64| scale * focal * point[k] / w + center[k];
                let [u, v] = [place(0, 1.0), place(1, 2.0)];
                let [width, height] = [SIZE.width, SIZE.height].map(|extent| extent as f64);
                let x = 0.5 * (clip[0] / clip[3] + 1.0) * width - 0.5;
                let y = 0.5 * (1.0 - clip[1] / clip[3]) * height - 0.5;
                let size = (focal.abs() + largest(center)).max(100.0);
                error = error.maximum_or_nan(largest([x - u, y - v, clip[3] - w]) / size);
            }
        }
    }
    let outcome = "each point at its pixel, by OpenCV's formula";
    Ok(Verdict::within(outcome, error, 8.0 * rounding::<T>()))
}
