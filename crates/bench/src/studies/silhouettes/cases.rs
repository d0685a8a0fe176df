//! Scenes whose silhouettes differ in kind, each with vertices off those of a target.

use std::f64::consts::PI;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_fit::scenes::{FACES, View};
use bokashi_render_ops::{Mesh, Size};
use glam::{DMat3, DVec2, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::scenes::{Scene, uniform};

/// Vertices of cubes are up to this far off, in sides of the cube.
const SHIFT: f64 = 0.1;

/// A scene whose vertices are off, and where they belong.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) scene: Scene,
    pub(super) target: Tensor<f64>,
}

/// Makes one of a seed.
type Make = fn(u64) -> Result<Case, FitError>;

/// All kinds with their names, and of how many seeds each is looked at.
pub(super) const CASES: [(&str, u64, Make); 6] = [
    ("cube", 20, cube),
    ("sphere20k", 5, sphere),
    ("two cubes in each other", 5, two_cubes),
    ("thin fan", 5, fan),
    ("sheet with a hole", 5, sheet),
    ("500 triangles", 5, triangles),
];

/// The paper's cube in a random pose, each coordinate of each vertex off.
fn cube(seed: u64) -> Result<Case, FitError> {
    let scene = Scene::cube(8)?;
    let (target, positions) = (scene.positions.clone(), scene.shifted(SHIFT, seed));
    let camera = View::random(seed, 0).camera();
    Ok(Case { scene: Scene { positions, camera, ..scene }, target })
}

/// A sphere of one colour, bent.
fn sphere(seed: u64) -> Result<Case, FitError> {
    let sphere = Scene::sphere("", 144, 70, 8)?;
    let colors = vec![0.8; sphere.colors.data().len()];
    bent(seed, sphere.mesh.faces().to_vec(), sphere.positions.data().to_vec(), colors)
}

/// Two cubes, each of one colour, one turned and a little to the side.
fn two_cubes(seed: u64) -> Result<Case, FitError> {
    let cube = Scene::cube(8)?;
    let points = cube.positions.data().as_chunks::<3>().0.iter().map(|&p| DVec3::from_array(p));
    let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(0.5);
    let other = points.clone().map(|point| turn * point + DVec3::new(0.3, 0.2, 0.1));
    let positions = points.clone().chain(other).flat_map(|point| point.to_array()).collect();
    let faces = FACES.into_iter().chain(FACES.map(|face| face.map(|vertex| vertex + 8)));
    let colors = [[0.9, 0.3, 0.2], [0.1, 0.4, 0.8]].into_iter().flat_map(|color| [color; 8]);
    bent(seed, faces.collect(), positions, colors.flatten().collect())
}

/// Thin triangles around a point, as wide as the gaps between them, each of one colour.
fn fan(seed: u64) -> Result<Case, FitError> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    for blade in 0..40 {
        let end = |k: usize| {
            let angle = PI * (2 * blade + k) as f64 / 40.0;
            DVec2::from_angle(angle).extend(0.2 * (3.0 * angle).sin()).to_array()
        };
        positions.extend([[0.0, 0.0, 0.3], end(0), end(1)].as_flattened());
        let color = [(); 3].map(|()| uniform(&mut generator));
        colors.extend([color; 3].as_flattened());
    }
    bent(seed, (0..40).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), positions, colors)
}

/// A wavy sheet of 24 x 24 quads with a hole, coloured by place.
fn sheet(seed: u64) -> Result<Case, FitError> {
    const QUADS: u32 = 24;
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for row in 0..=QUADS {
        for column in 0..=QUADS {
            let [x, y] = [column, row].map(|k| 1.6 * f64::from(k) / f64::from(QUADS) - 0.8);
            positions.extend([x, y, 0.25 * (4.0 * x + 1.0).sin() * (3.0 * y).cos()]);
        }
    }
    for (row, column) in (0..QUADS).flat_map(|row| (0..QUADS).map(move |column| (row, column))) {
        if (8..15).contains(&row) && (6..12).contains(&column) {
            continue;
        }
        let at = row * (QUADS + 1) + column;
        let [right, below, across] = [at + 1, at + QUADS + 1, at + QUADS + 2];
        faces.extend([[at, below, across], [at, across, right]]);
    }
    let colors = positions.iter().map(|x| 0.5 + 0.5 * x).collect();
    bent(seed, faces, positions, colors)
}

/// Triangles anywhere, each vertex of its own colour.
fn triangles(seed: u64) -> Result<Case, FitError> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut number = |size: f64| size * (2.0 * uniform(&mut generator) - 1.0);
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    for _ in 0..500 {
        let middle = [(); 3].map(|()| number(0.8));
        for _ in 0..3 {
            positions.extend(middle.map(|x| x + number(0.25)));
            colors.extend([(); 3].map(|()| 0.5 + number(0.5)));
        }
    }
    bent(seed, (0..500).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), positions, colors)
}

/// A mesh in a random pose; the target is the mesh, bent by waves of twentieths.
fn bent(
    seed: u64,
    faces: Vec<[u32; 3]>,
    positions: Vec<f64>,
    colors: Vec<f64>,
) -> Result<Case, FitError> {
    let bent = positions.as_chunks::<3>().0.iter().flat_map(|&point| {
        let point = DVec3::from_array(point);
        let phase = 2.5 * DVec3::new(point.y, point.z, point.x) + seed as f64;
        (point + 0.05 * DVec3::new(phase.x.sin(), phase.y.sin(), phase.z.sin())).to_array()
    });
    let shape = [positions.len() / 3, 3];
    let (target, colors) = (Tensor::new(shape, bent.collect())?, Tensor::new(shape, colors)?);
    let scene = Scene {
        name: String::new(),
        mesh: Mesh::new(faces, shape[0])?,
        positions: Tensor::new(shape, positions)?,
        colors,
        camera: View::random(seed, 0).camera(),
        size: Size::square(8),
    };
    Ok(Case { scene, target })
}
