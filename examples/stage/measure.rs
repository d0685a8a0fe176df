//! Figures of merit.

use bokashi::prelude::*;
use bokashi_paper::automorphisms;

/// The peak signal-to-noise ratio, in decibels, of an image whose values reach 1.
///
/// # Panics
/// Where the shapes differ.
#[track_caller]
pub fn psnr<T: Scalar>(image: &Tensor<T>, truth: &Tensor<T>) -> f64 {
    assert_eq!(image.shape(), truth.shape());
    let pairs = image.data().iter().zip(truth.data());
    let sum: f64 = pairs.map(|(a, b)| (a.to_f64() - b.to_f64()).powi(2)).sum();
    -10.0 * (sum / image.size() as f64).log10()
}

/// The root of the mean square of differences.
///
/// # Panics
/// Where the lengths differ.
#[track_caller]
pub fn root_mean_square(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// The mean distance of vertices `[V, 3]` from their true places. A mesh that looks the same with its
/// vertices permuted may be learnt in any of these ways: the least distance counts.
#[derive(Debug, Clone)]
pub struct VertexDistance {
    ways: Vec<Vec<usize>>,
    truth: Tensor<f32>,
}

/// Measures distances from `truth`, the vertices of a mesh with `faces`.
pub fn vertex_distance(faces: &[[u32; 3]], truth: &Tensor<f32>) -> VertexDistance {
    VertexDistance { ways: automorphisms(faces, truth.shape()[0]), truth: truth.clone() }
}

impl VertexDistance {
    /// The mean distance of `vertices`.
    pub fn of(&self, vertices: &Tensor<f32>) -> f64 {
        let distance = |a: &[f32], b: &[f32]| -> f64 {
            a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
        };
        let truth: Vec<_> = self.truth.data().chunks(3).collect();
        let mean = |way: &Vec<usize>| {
            let pairs = vertices.data().chunks(3).zip(way);
            pairs.map(|(vertex, &to)| distance(vertex, truth[to])).sum::<f64>() / way.len() as f64
        };
        self.ways.iter().map(mean).fold(f64::INFINITY, f64::min)
    }
}
