//! Meshes that samples draw.

use std::f64::consts::{PI, TAU};

use bokashi::prelude::*;

/// A mesh with a place for each vertex.
#[derive(Debug, Clone)]
pub struct Shape {
    /// The faces.
    pub mesh: Mesh,
    /// `[V, 3]`.
    pub vertices: Tensor<f32>,
}

/// A cube of side 1 around 0: vertex k has the bits of k as coordinates, x first, less 1/2. The faces of
/// each side are neighbours, two per side.
///
/// # Errors
/// None: that of [`Mesh::new`].
pub fn cube() -> Result<Shape, RenderError> {
    let sides: [[u32; 4]; 6] =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let bit = |[vertex, axis]: [usize; 2]| (vertex >> (2 - axis) & 1) as f32 - 0.5;
    Ok(Shape { mesh: Mesh::new(faces, 8)?, vertices: Tensor::from_fn([8, 3], bit) })
}

/// A sphere of radius 1 around 0, its axis along y, with `rings` from pole to pole and twice as many
/// segments around; and texture coordinates `[V, 2]`, u around and v from the north pole down. Vertices on
/// the seam and at the poles stand there once for each segment, so u is never ambiguous.
///
/// # Errors
/// None: that of [`Mesh::new`].
pub fn sphere(rings: usize) -> Result<(Shape, Tensor<f32>), RenderError> {
    let (across, segments) = (2 * rings + 1, 2 * rings);
    let count = (rings + 1) * across;
    let place = |vertex: usize| {
        let (ring, segment) = (vertex / across, vertex % across);
        [segment as f64 / segments as f64, ring as f64 / rings as f64]
    };
    let vertices = Tensor::from_fn([count, 3], |[vertex, axis]| {
        let [u, v] = place(vertex);
        let (sin, cos) = (PI * v).sin_cos();
        [sin * (TAU * u).cos(), cos, -sin * (TAU * u).sin()][axis] as f32
    });
    let coordinates = Tensor::from_fn([count, 2], |[vertex, axis]| place(vertex)[axis] as f32);
    let mut faces = Vec::new();
    for ring in 0..rings {
        for segment in 0..segments {
            let a = (ring * across + segment) as u32;
            let [b, c, d] = [a + 1, a + across as u32, a + across as u32 + 1];
            if ring > 0 {
                faces.push([a, c, b]);
            }
            if ring + 1 < rings {
                faces.push([b, c, d]);
            }
        }
    }
    Ok((Shape { mesh: Mesh::new(faces, count)?, vertices }, coordinates))
}
