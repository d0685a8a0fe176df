//! Textures of our own.

use bokashi::glam::DVec3;
use bokashi::prelude::*;

use super::random::Random;

/// Waves of which land and sea are made.
const WAVES: usize = 60;

/// A globe with coasts, mountains, ice and a grid of meridians: texels `[H, W, 3]` from 0 to 1, the north
/// pole in the first row.
pub fn globe([height, width]: [usize; 2], random: &mut Random) -> Tensor<f32> {
    // Sums of waves through space have no seam. The finer, the lower.
    let waves: Vec<_> = (0..WAVES)
        .map(|k| {
            let frequency = 2.0 * 1.05_f64.powi(k as i32);
            (frequency * random.direction(), random.between(0.0, std::f64::consts::TAU), frequency)
        })
        .collect();
    let heights = |place: DVec3| -> f64 {
        waves.iter().map(|(wave, phase, f)| (wave.dot(place) + phase).sin() / f.powf(0.7)).sum()
    };
    Tensor::from_fn([height, width, 3], |[row, column, channel]| {
        let latitude = std::f64::consts::PI * ((row as f64 + 0.5) / height as f64);
        let longitude = std::f64::consts::TAU * ((column as f64 + 0.5) / width as f64);
        let (sin, cos) = latitude.sin_cos();
        let above = heights(DVec3::new(sin * longitude.cos(), cos, sin * longitude.sin()));
        let is_ice = cos.abs() + 0.05 * above > 0.9;
        let is_line = (column * 24 / width != (column + 1) * 24 / width) && sin > 0.3;
        let color = match above {
            _ if is_line => [0.9, 0.8, 0.2],
            _ if is_ice => [0.95, 0.97, 1.0],
            deep if deep < 0.0 => {
                [0.05, 0.15 + 0.1 * (1.0 + deep.tanh()), 0.55 + 0.2 * deep.tanh()]
            }
            low if low < 0.8 => [0.15 + 0.3 * low, 0.55 - 0.1 * low, 0.15],
            high => [0.45 + 0.1 * high.tanh(), 0.4, 0.3],
        };
        color[channel] as f32
    })
}

/// The texels `[H, W, 3]` that are nearest to the texture coordinates `[V, 2]` of vertices: `[V, 3]`.
pub fn at_vertices(texels: &Tensor<f32>, coordinates: &Tensor<f32>) -> Tensor<f32> {
    let (height, width) = (texels.shape()[0], texels.shape()[1]);
    Tensor::from_fn([coordinates.shape()[0], 3], |[vertex, channel]| {
        let [u, v] = [0, 1].map(|k| coordinates.data()[2 * vertex + k]);
        let column = (u * width as f32) as usize % width;
        let row = ((v * height as f32) as usize).min(height - 1);
        texels.data()[(row * width + column) * 3 + channel]
    })
}
