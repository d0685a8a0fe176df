//! Meshes that samples draw.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use bokashi::glam::Vec3;
use bokashi::prelude::*;

use super::random::Random;

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
    let grid_point = |vertex: usize| {
        let (ring, segment) = (vertex / across, vertex % across);
        [segment as f64 / segments as f64, ring as f64 / rings as f64]
    };
    let vertices = Tensor::from_fn([count, 3], |[vertex, axis]| {
        let [u, v] = grid_point(vertex);
        let (sin, cos) = (PI * v).sin_cos();
        [sin * (TAU * u).cos(), cos, -sin * (TAU * u).sin()][axis] as f32
    });
    let coordinates = Tensor::from_fn([count, 2], |[vertex, axis]| grid_point(vertex)[axis] as f32);
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

fn rows(vertices: &[Vec3]) -> Tensor<f32> {
    Tensor::from(vertices.iter().map(|v| v.to_array()).collect::<Vec<_>>())
}

/// Balls of radius 1/4 in a cube of half-side 1, as one mesh.
///
/// # Errors
/// None: that of [`Mesh::new`].
pub fn cluster(count: usize, random: &mut Random) -> Result<Shape, RenderError> {
    let (ball, _) = sphere(8)?;
    let (mut faces, mut vertices) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let first = vertices.len() as u32;
        let center = random.vector(1.0).as_vec3();
        faces.extend(ball.mesh.faces().iter().map(|face| face.map(|vertex| vertex + first)));
        let of_ball = ball.vertices.data().chunks(3).map(|v| center + 0.25 * Vec3::from_slice(v));
        vertices.extend(of_ball.map(|v| v.to_array()));
    }
    let mesh = Mesh::new(faces, vertices.len())?;
    Ok(Shape { mesh, vertices: Tensor::from(vertices) })
}

/// Squares side by side before a camera at 0 that looks along -z, each slanted and as wide in the picture
/// as the others.
#[derive(Debug, Clone)]
pub struct Boards {
    /// Corners and faces.
    pub shape: Shape,
    /// The place of each corner on its square, `[V, 2]`.
    pub places: Tensor<f32>,
    /// How far away a corner is, `[V, 1]`; 0 for the first board, which shall not move.
    pub depths: Tensor<f32>,
}

impl Boards {
    /// Boards at these distances.
    ///
    /// # Errors
    /// None: that of [`Mesh::new`].
    pub fn new(distances: &[f64; 3], random: &mut Random) -> Result<Self, RenderError> {
        let square = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4)?;
        let mesh = Assembly::new(&[(&square, distances.len())])?.mesh().clone();
        let mut vertices = Vec::new();
        for (k, distance) in distances.iter().enumerate() {
            let slant = random.between(0.2, 0.35) * [1.0, -1.0, 1.0][k];
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let depth = distance * (1.0 + slant * x);
                let across = [-0.31, 0.0, 0.31][k] + 0.14 * x;
                vertices.push([across * depth, 0.27 * y * depth, -depth].map(|x| x as f32));
            }
        }
        let count = vertices.len();
        let places = Tensor::from_fn([count, 2], |[corner, axis]| (corner >> axis & 1) as f32);
        let depth = |[corner, _]: [usize; 2]| if corner < 4 { 0.0 } else { -vertices[corner][2] };
        let depths = Tensor::from_fn([count, 1], depth);
        Ok(Self { shape: Shape { mesh, vertices: Tensor::from(vertices) }, places, depths })
    }

    /// Clip positions of boards whose corners moved; `moves: [V, 3]` are relative to the distance.
    ///
    /// # Errors
    /// Those of moves of another shape.
    pub fn clip<'t>(&self, moves: Var<'t, f32>) -> Result<Var<'t, f32>, FitError> {
        let tape = moves.tape();
        let [vertices, depths] = [&self.shape.vertices, &self.depths].map(|x| tape.constant(x));
        let camera = perspective(0.7, 4.0 / 3.0, 0.1, 50.0);
        Ok(project(vertices + moves * depths, &camera, None)?)
    }

    /// What fragments show, `[N, 3]`: stripes along and across, in other ways for each channel.
    ///
    /// # Errors
    /// Those of fragments of another mesh.
    pub fn stripes<'t>(&self, fragments: &Fragments<'t, f32>) -> Result<Var<'t, f32>, FitError> {
        let tape = fragments.clip.tape();
        let waves = tape.constant(&Tensor::from([[21.0, 3.0, 14.0], [4.0, 27.0, 17.0]]));
        Ok(interpolate(tape.constant(&self.places), fragments)?.matmul(waves)?.sin() * 0.4 + 0.5)
    }
}

/// A shape with normals and texture coordinates.
#[derive(Debug, Clone)]
pub struct Object {
    /// Vertices and faces.
    pub shape: Shape,
    /// `[V, 3]`.
    pub normals: Tensor<f32>,
    /// `[V, 2]`.
    pub places: Tensor<f32>,
}

/// A ball of radius 0.6 within a ring: the ball has the upper half of the texture, and the ring the lower.
///
/// # Errors
/// None: that of [`Mesh::new`].
pub fn planet() -> Result<Object, RenderError> {
    const AROUND: usize = 96;
    const ACROSS: usize = 24;
    let (ball, of_ball) = sphere(24)?;
    let mut normals: Vec<_> = ball.vertices.data().chunks(3).map(Vec3::from_slice).collect();
    let mut vertices: Vec<_> = normals.iter().map(|&normal| 0.6 * normal).collect();
    // Off the border of a half, over which samples would mix.
    let within = |half: f32, v: f32| 0.5 * (half + 0.04 + 0.92 * v);
    let mut places: Vec<_> =
        of_ball.data().chunks(2).map(|uv| [uv[0], within(0.0, uv[1])]).collect();
    let mut faces = ball.mesh.faces().to_vec();
    let first = vertices.len();
    for vertex in 0..(AROUND + 1) * (ACROSS + 1) {
        let (segment, slice) = (vertex / (ACROSS + 1), vertex % (ACROSS + 1));
        let [u, v] = [segment as f32 / AROUND as f32, slice as f32 / ACROSS as f32];
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        let (up, out) = (std::f32::consts::TAU * v).sin_cos();
        let outward = Vec3::new(cos, 0.0, -sin);
        normals.push(out * outward + up * Vec3::Y);
        vertices.push(0.9 * outward + 0.15 * normals[first + vertex]);
        places.push([u, within(1.0, v)]);
        if segment < AROUND && slice < ACROSS {
            let a = (first + vertex) as u32;
            let [b, c, d] = [a + 1, a + ACROSS as u32 + 1, a + ACROSS as u32 + 2];
            faces.extend([[a, c, b], [b, c, d]]);
        }
    }
    let mesh = Mesh::new(faces, vertices.len())?;
    let shape = Shape { mesh, vertices: rows(&vertices) };
    Ok(Object { shape, normals: rows(&normals), places: Tensor::from(places) })
}

/// A sphere of radius 1 around 0 whose faces are nearly alike: an octahedron, each face cut into four
/// `cuts` times.
///
/// # Errors
/// None: that of [`Mesh::new`].
pub fn ball(cuts: usize) -> Result<Shape, RenderError> {
    let mut vertices = vec![Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];
    for _ in 0..cuts {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                vertices.push((vertices[a as usize] + vertices[b as usize]).normalize());
                vertices.len() as u32 - 1
            })
        };
        let cut = |[a, b, c]: [u32; 3]| {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(cut).collect();
    }
    let mesh = Mesh::new(faces, vertices.len())?;
    Ok(Shape { mesh, vertices: rows(&vertices) })
}

/// The Stanford bunny, 3,674 faces, moved and scaled into the sphere of radius 1 around 0.
///
/// # Errors
/// None: that of [`Mesh::new`].
pub fn bunny() -> Result<Shape, RenderError> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for line in include_str!("../data/bunny.obj").lines() {
        let (kind, rest) = line.split_once(' ').unwrap_or_default();
        let numbers = rest.split(' ').map_while(|word| word.parse::<f32>().ok());
        match (kind, &numbers.collect::<Vec<_>>()[..]) {
            ("v", &[x, y, z]) => vertices.push(Vec3::new(x, y, z)),
            ("f", &[a, b, c]) => faces.push([a, b, c].map(|vertex| vertex as u32 - 1)),
            _ => {}
        }
    }
    let low = vertices.iter().fold(Vec3::INFINITY, |low, &v| low.min(v));
    let high = vertices.iter().fold(Vec3::NEG_INFINITY, |high, &v| high.max(v));
    let middle = 0.5 * (low + high);
    let radius = vertices.iter().map(|v| v.distance(middle)).fold(0.0, f32::max);
    vertices.iter_mut().for_each(|v| *v = (*v - middle) / radius);
    let mesh = Mesh::new(faces, vertices.len())?;
    Ok(Shape { mesh, vertices: rows(&vertices) })
}
