//! Scenes whose silhouettes differ in kind, each with vertices off those of a reference image.

use std::f64::consts::PI;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_paper::{FACES, View};
use bokashi_render_ops::{Cull, Mesh, Size};
use glam::{DMat3, DVec2, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::bench::effort::Effort;
use crate::bench::scenes::{Scene, uniform};

/// Vertices of cubes are up to this far off, in sides of the cube.
pub(super) const SHIFT: f64 = 0.1;

/// A scene whose vertices are off, and where they belong.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) scene: Scene,
    pub(super) target: Tensor<f64>,
}

/// Makes the case of a seed.
type Make = fn(u64) -> Result<Case, FitError>;

/// A kind of case, and how its truth is found.
pub(super) struct Kind {
    pub(super) name: &'static str,
    pub(super) make: Make,
    /// Of how many seeds.
    pub(super) seeds: u64,
    pub(super) cull: Cull,
    /// How high the truth's slabs are at most, in pixels.
    pub(super) height: f64,
    /// Half the step of the truth's differences, in world units.
    pub(super) step: f64,
    /// The size of its image, for the scenes of the step's table.
    pub(super) pixels: usize,
}

const OWN: Kind = Kind {
    name: "cube",
    make: cube,
    seeds: 20,
    cull: Cull::None,
    height: 1.0 / 256.0,
    step: 1e-6,
    pixels: 64,
};

/// The kinds that are looked at in several sizes. A quick run takes a small sphere: the truth of the
/// large sphere takes the longest of all.
pub(super) fn cases(effort: Effort) -> [Kind; 6] {
    let (name, make): (_, Make) = match effort {
        Effort::Quick => ("sphere1k", |seed| sphere(seed, 32, 17)),
        Effort::Full => ("sphere20k", |seed| sphere(seed, 144, 70)),
    };
    [
        OWN,
        // Of so many vertices some come to be seen within a larger step.
        Kind { name, make, seeds: 3, height: 1.0 / 64.0, step: 1e-8, ..OWN },
        Kind { name: "two cubes in each other", make: two_cubes, seeds: 3, ..OWN },
        Kind { name: "thin fan", make: fan, seeds: 3, ..OWN },
        Kind { name: "sheet with a hole", make: sheet, seeds: 3, ..OWN },
        // Many edges pass behind others between two vertices.
        Kind { name: "500 triangles", make: triangles, seeds: 3, height: 1.0 / 2048.0, ..OWN },
    ]
}

/// The scenes of the step's table, as they are learnt there.
pub(super) fn of_bench(effort: Effort) -> Vec<Kind> {
    let kind = |name, make, pixels| {
        let height = if pixels < 100 { OWN.height } else { 1.0 / 64.0 };
        Kind { name, make, pixels, seeds: 1, cull: Cull::Back, height, ..OWN }
    };
    let all = [
        kind("cube@32", |_| jittered(Scene::cube(32)?), 32),
        kind("cube@256", |_| jittered(Scene::cube(256)?), 256),
        kind("cube@1024", |_| jittered(Scene::cube(1024)?), 1024),
        kind("sphere1k@256", |_| jittered(Scene::sphere("", 32, 17, 256)?), 256),
        kind("sphere20k@512", |_| jittered(Scene::sphere("", 144, 70, 512)?), 512),
        kind("sphere80k@1024", |_| jittered(Scene::largest()?), 1024),
    ];
    all.into_iter().take(effort.choose(1, 6)).collect()
}

/// How the truth of a mesh from a file is found: of so many vertices some come to be seen within a larger
/// step.
pub(super) fn of_mesh(cull: Cull) -> Kind {
    Kind { name: "mesh", cull, height: 1.0 / 64.0, step: 1e-8, ..OWN }
}

/// A scene of the step's table, its vertices off as there.
fn jittered(scene: Scene) -> Result<Case, FitError> {
    let positions = scene.jittered(0.3 / 256.0 * scene.size.width as f64, 0);
    let target = scene.positions.clone();
    Ok(Case { scene: Scene { positions, ..scene }, target })
}

/// The paper's cube in a random pose, each coordinate of each vertex off.
fn cube(seed: u64) -> Result<Case, FitError> {
    let scene = Scene::cube(8)?;
    let (target, positions) = (scene.positions.clone(), scene.shifted(SHIFT, seed));
    let camera = View::random(seed, 0).camera();
    Ok(Case { scene: Scene { positions, camera, ..scene }, target })
}

/// A sphere of one colour, bent.
fn sphere(seed: u64, around: usize, along: usize) -> Result<Case, FitError> {
    let sphere = Scene::sphere("", around, along, 8)?;
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
        let corner = row * (QUADS + 1) + column;
        let [right, below, across] = [corner + 1, corner + QUADS + 1, corner + QUADS + 2];
        faces.extend([[corner, below, across], [corner, across, right]]);
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
        has_creases: false,
    };
    Ok(Case { scene, target })
}
