//! Figures of merit.

use bokashi::glam::Vec3;
use bokashi::prelude::*;
use bokashi_paper::automorphisms;

use super::mesh::Shape;

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

/// How far numbers are off, relative to the truth: a quotient of roots of sums of squares.
///
/// # Panics
/// Where the lengths differ.
#[track_caller]
pub fn relative_error(values: &[f32], truth: &[f32]) -> f64 {
    root_mean_square(values, truth) / root_mean_square(truth, &vec![0.0; truth.len()])
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
    pub fn distance_to(&self, vertices: &Tensor<f32>) -> f64 {
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

/// The mean distance of the vertices `[V, 3]` from a surface: from the nearest point of the nearest face.
pub fn surface_distance(vertices: &Tensor<f32>, surface: &Shape) -> f64 {
    let corner = |vertex: u32| Vec3::from_slice(&surface.vertices.data()[3 * vertex as usize..]);
    let faces: Vec<_> = surface.mesh.faces().iter().map(|face| face.map(corner)).collect();
    let distance =
        |p: Vec3| faces.iter().map(|face| to_face(p, face)).fold(f32::INFINITY, f32::min);
    let vertices = vertices.data().chunks(3).map(Vec3::from_slice);
    let count = vertices.len() as f64;
    vertices.map(|p| f64::from(distance(p))).sum::<f64>() / count
}

/// The distance of a point from a face.
fn to_face(p: Vec3, &[a, b, c]: &[Vec3; 3]) -> f32 {
    let normal = (b - a).cross(c - a);
    let is_beside = |from: Vec3, to: Vec3| normal.cross(to - from).dot(p - from) >= 0.0;
    if is_beside(a, b) && is_beside(b, c) && is_beside(c, a) && normal != Vec3::ZERO {
        return (p - a).dot(normal.normalize()).abs();
    }
    let to_edge = |from: Vec3, to: Vec3| {
        let (way, off) = (to - from, p - from);
        let share = (off.dot(way) / way.length_squared()).clamp(0.0, 1.0);
        if share.is_nan() { off.length() } else { (off - share * way).length() }
    };
    to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a))
}
