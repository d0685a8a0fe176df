//! The true gradient of a scene's area-averaged picture, and how well it is known.

use bokashi_core::Tensor;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::cases::{Case, Kind};
use super::scanlines::{Order, Scanlines};

/// Where there are more coordinates than this, slopes are taken along eight random directions.
const MOST_COORDINATES: usize = 24;
const DIRECTIONS: usize = 8;

/// What is true of a scene at one size.
#[derive(Debug, Clone)]
pub(super) struct Truth {
    pub(super) pixels: usize,
    /// `[pixels, pixels, 3]`.
    pub(super) picture: Vec<f64>,
    /// The gradient of the squared error against the reference image, `[pixels, pixels, 3]`.
    pub(super) upstream: Tensor<f64>,
    /// Directions in which all vertices move, and how `<upstream, picture>` changes along each.
    directions: Vec<Vec<f64>>,
    slopes: Vec<f64>,
    /// How far the slopes of half as many scanlines are off these, as a share of them.
    pub(super) noise: f64,
    /// How far pixels of half as many scanlines are off, at most.
    pub(super) pixel_noise: f64,
}

impl Truth {
    /// The length of a gradient's error over that of the gradient. Along random signs the mean square
    /// of a vector's slopes is that of its length.
    pub(super) fn error(&self, gradient: &[f64]) -> f64 {
        let slopes: Vec<f64> =
            self.directions.iter().map(|direction| product(direction, gradient)).collect();
        distance(&slopes, &self.slopes) / length(&self.slopes)
    }

    /// The largest difference of a picture's pixels.
    pub(super) fn pixel_error(&self, picture: &[f64]) -> f64 {
        apart(picture, &self.picture)
    }
}

/// The truth at each of some sizes, of which the last is the largest, and a multiple of all others.
pub(super) fn truths(case: &Case, kind: &Kind, sizes: &[usize]) -> Vec<Truth> {
    let &Kind { cull, height, step, .. } = kind;
    let largest = sizes[sizes.len() - 1];
    let scene = &case.scene.with_pixels(largest);
    let sets = [Order::One, Order::Two].map(|order| Scanlines { scene, cull, height, order });
    let [picture, target] = [&scene.positions, &case.target]
        .map(|positions| sets.each_ref().map(|lines| lines.picture(positions)));
    let upstream: Vec<f64> =
        picture[1].iter().zip(&target[1]).map(|(drawn, wanted)| drawn - wanted).collect();
    let directions = directions(scene.positions.data().len());
    let upstreams: Vec<_> = sizes.iter().map(|&size| averaged(&upstream, largest, size)).collect();
    // Per direction, set of lines, and size.
    let slopes: Vec<[Vec<f64>; 2]> = directions
        .par_iter()
        .map(|direction| {
            sets.each_ref().map(|lines| {
                let moved = |by: f64| {
                    let mut positions = scene.positions.clone();
                    let entries = positions.data_mut().iter_mut().zip(direction);
                    entries.for_each(|(entry, along)| *entry += by * along);
                    lines.picture(&positions)
                };
                let (above, below) = (moved(step), moved(-step));
                let change: Vec<f64> =
                    above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * step)).collect();
                let both = sizes.iter().zip(&upstreams);
                both.map(|(&size, g)| product(&averaged(&change, largest, size), g)).collect()
            })
        })
        .collect();
    let all = sizes.iter().zip(upstreams).enumerate();
    all.map(|(index, (&pixels, upstream))| {
        let slopes_of =
            |set: usize| -> Vec<f64> { slopes.iter().map(|sets| sets[set][index]).collect() };
        let (slopes, coarse) = (slopes_of(1), slopes_of(0));
        let [coarse_picture, picture] =
            picture.each_ref().map(|picture| averaged(picture, largest, pixels));
        Truth {
            pixels,
            upstream: Tensor::new([pixels, pixels, 3], upstream).expect("three channels"),
            directions: directions.clone(),
            noise: distance(&coarse, &slopes) / length(&slopes),
            slopes,
            pixel_noise: apart(&coarse_picture, &picture),
            picture,
        }
    })
    .collect()
}

/// One coordinate after the other where there are few, else random signs.
fn directions(coordinates: usize) -> Vec<Vec<f64>> {
    if coordinates <= MOST_COORDINATES {
        let unit =
            |k: usize| (0..coordinates).map(|index| f64::from(u8::from(index == k))).collect();
        return (0..coordinates).map(unit).collect();
    }
    let mut generator = ChaCha8Rng::seed_from_u64(0);
    let mut sign = || if generator.next_u32() & 1 == 0 { 1.0 } else { -1.0 };
    (0..DIRECTIONS).map(|_| (0..coordinates).map(|_| sign()).collect()).collect()
}

/// The picture `[to, to, 3]` of one `[from, from, 3]`, a multiple as large.
fn averaged(samples: &[f64], from: usize, to: usize) -> Vec<f64> {
    let times = from / to;
    let mut sums = vec![0.0; to * to * 3];
    for (row, line) in samples.chunks_exact(from * 3).enumerate() {
        for (entry_index, entry) in line.iter().enumerate() {
            let (column, channel) = (entry_index / 3, entry_index % 3);
            sums[(row / times * to + column / times) * 3 + channel] += entry;
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= (times * times) as f64);
    sums
}

fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn length(vector: &[f64]) -> f64 {
    product(vector, vector).sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
