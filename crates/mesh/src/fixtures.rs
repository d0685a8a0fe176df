//! Meshes that tests are run on.

use std::f64::consts::TAU;

use bokashi_core::Tensor;
use bokashi_render_ops::Mesh;
use bokashi_render_ops::glam::DVec3;

/// Positions and faces.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    pub(crate) points: Vec<DVec3>,
    pub(crate) faces: Vec<[u32; 3]>,
}

impl Model {
    pub(crate) fn positions(&self) -> Tensor<f64> {
        let entry = |k: usize| self.points[k / 3][k % 3];
        Tensor::from_flat_fn([self.points.len(), 3], entry)
    }

    pub(crate) fn mesh(&self) -> Mesh {
        Mesh::new(self.faces.clone(), self.points.len()).unwrap()
    }

    /// The model with each point moved.
    pub(crate) fn moved(mut self, by: impl Fn(DVec3) -> DVec3) -> Self {
        self.points.iter_mut().for_each(|point| *point = by(*point));
        self
    }

    /// Both, as parts of one.
    pub(crate) fn and(mut self, other: Self) -> Self {
        let first = self.points.len() as u32;
        self.points.extend(other.points);
        self.faces.extend(other.faces.iter().map(|face| face.map(|vertex| vertex + first)));
        self
    }

    /// Each point moved by up to `size` along each axis, in a way that `seed` draws.
    pub(crate) fn shaken(mut self, size: f64, seed: u64) -> Self {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut draw = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for point in &mut self.points {
            *point += size * DVec3::new(draw(), draw(), draw());
        }
        self
    }
}

pub(crate) fn tetrahedron() -> Model {
    let points = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    let points = points.map(DVec3::from_array).to_vec();
    Model { points, faces: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] }
}

/// From -1 to 1.
pub(crate) fn cube() -> Model {
    let sign = |bits: u32, axis: u32| f64::from(bits >> axis & 1) * 2.0 - 1.0;
    let points = (0..8).map(|bits| DVec3::new(sign(bits, 0), sign(bits, 1), sign(bits, 2)));
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Model { points: points.collect(), faces }
}

/// Of radius 1, with a tube of radius `tube`, `around` by `across` squares.
pub(crate) fn torus(around: usize, across: usize, tube: f64) -> Model {
    let index = |i: usize, j: usize| ((i % around) * across + j % across) as u32;
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for i in 0..around {
        for j in 0..across {
            let (u, v) = (TAU * i as f64 / around as f64, TAU * j as f64 / across as f64);
            let radius = 1.0 + tube * v.cos();
            points.push(DVec3::new(radius * u.cos(), radius * u.sin(), tube * v.sin()));
            let corners = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
            faces.extend([
                [corners[0], corners[1], corners[2]],
                [corners[0], corners[2], corners[3]],
            ]);
        }
    }
    Model { points, faces }
}

/// The square from 0 to 1, `count` by `count` squares.
pub(crate) fn sheet(count: usize) -> Model {
    let index = |i: usize, j: usize| (i * (count + 1) + j) as u32;
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for i in 0..=count {
        for j in 0..=count {
            points.push(DVec3::new(i as f64, j as f64, 0.0) / count as f64);
            if i < count && j < count {
                let [a, b, c, d] =
                    [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    Model { points, faces }
}

/// Of radius 1: each face of an octahedron is `count` squared faces.
pub(crate) fn sphere(count: usize) -> Model {
    let corners = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
    let eighths =
        [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
    let (mut points, mut faces): (Vec<DVec3>, _) = (Vec::new(), Vec::new());
    let mut names = std::collections::HashMap::new();
    for [a, b, c] in eighths.map(|eighth: [usize; 3]| eighth.map(|corner| corners[corner])) {
        let mut name = |i: usize, j: usize| {
            let k = count - i - j;
            let point = i as f64 * a + j as f64 * b + k as f64 * c;
            let key = point.to_array().map(|x| x.round() as i64);
            *names.entry(key).or_insert_with(|| {
                points.push(point.normalize());
                points.len() as u32 - 1
            })
        };
        for (i, j) in (0..count).flat_map(|i| (0..count - i).map(move |j| (i, j))) {
            faces.push([name(i + 1, j), name(i, j + 1), name(i, j)]);
            if i + j + 2 <= count {
                faces.push([name(i + 1, j + 1), name(i, j + 1), name(i + 1, j)]);
            }
        }
    }
    Model { points, faces }
}
