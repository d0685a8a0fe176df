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
    let heights = |point: DVec3| -> f64 {
        waves.iter().map(|(wave, phase, f)| (wave.dot(point) + phase).sin() / f.powf(0.7)).sum()
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

/// Smooth colours `[V, 3]` of our own for vertices `[V, 3]` around 0.
pub fn motley(vertices: &Tensor<f32>, random: &mut Random) -> Tensor<f32> {
    let mut wave = || (random.between(4.0, 9.0) * random.direction(), random.between(0.0, 6.3));
    let waves: [[_; 4]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| wave()));
    Tensor::from_fn([vertices.shape()[0], 3], |[vertex, channel]| {
        let point = DVec3::from_array([0, 1, 2].map(|k| vertices.data()[3 * vertex + k].into()));
        let sum: f64 =
            waves[channel].iter().map(|(wave, phase)| (wave.dot(point) + phase).sin()).sum();
        (0.5 + 0.12 * sum) as f32
    })
}

/// Maps of a material, `[side, side, C]`: base colours of a globe, roughness from 0.15 to 0.85 in waves, and
/// metallic, nearly 0 or 1, in patches.
pub fn substance(side: usize, random: &mut Random) -> [Tensor<f32>; 3] {
    let colors = globe([side, side], random);
    let mut waves = || {
        let [across, down, phase] = [(); 3].map(|()| random.between(1.0, 6.0).floor());
        Tensor::from_fn([side, side, 1], |[row, column, _]| {
            let [u, v] = [column, row].map(|k| std::f64::consts::TAU * k as f64 / side as f64);
            ((across * u + phase).sin() * (down * v + phase).cos()) as f32
        })
    };
    let [roughness, metallic] = [waves(), waves()];
    [colors, roughness.map(|x| 0.5 + 0.35 * x), metallic.map(|x| 0.5 + 0.5 * (4.0 * x).tanh())]
}
