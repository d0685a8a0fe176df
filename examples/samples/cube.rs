//! A cube from pictures of a few pixels: 8 positions, with 8 colours or with 24, one per corner of a
//! side. Each step sees the cube in another pose.
//!
//! Set-up and metric are those of Laine et al. 2020, *Modular primitives for high-performance
//! differentiable rendering*, section 4.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, cube, vertex_distance};
use bokashi_examples::{Asked, Curve, Found, Goal, Sample, Silhouettes};

/// This sample.
pub const SAMPLE: Sample =
    Sample { name: "cube", about: "learns a cube's vertices and colours from tiny pictures", run };

const STEPS: u64 = 5000;

/// What does not change: the cube, the corners that colours belong to, and how it is drawn.
struct Scene {
    cube: Shape,
    colored: Mesh,
    options: RasterOptions,
    silhouettes: Silhouettes,
}

impl Scene {
    fn picture<'t>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, f32>,
        colors: Var<'t, f32>,
    ) -> Result<Picture<'t, f32>, RenderError> {
        let clip = project(vertices, camera, None)?;
        let fragments = rasterize(clip, &self.cube.mesh, self.options)?;
        let surface = interpolate_indexed(colors, &self.colored, &fragments)?;
        self.silhouettes.picture(surface, &fragments, Background::Zero)
    }
}

/// The cube turned and moved at random, 3.5 in front of a camera with near plane 1, far plane 50 and
/// half-width 0.4 of the near plane.
fn camera(random: &mut Random) -> DMat4 {
    let projection = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 50.0);
    let place = random.vector(0.25) - DVec3::new(0.0, 0.0, 3.5);
    projection * DMat4::from_rotation_translation(random.rotation(), place)
}

fn learn(asked: &Asked, side: usize, color_count: usize) -> Result<Found, FitError> {
    let cube = cube()?;
    let faces = cube.mesh.faces().to_vec();
    // Colours at vertices, or four of their own for each side.
    let of_sides =
        (0..6).flat_map(|k| [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]);
    let colored = if color_count == 8 { faces.clone() } else { of_sides.collect() };
    let colored = Mesh::new(colored, color_count)?;
    let silhouettes = asked.silhouettes;
    let options = silhouettes.options(Size::square(side));
    let mut random = Random::new(asked.seed, 0);
    let vertices = cube.vertices.map(|x| x + random.between(-0.5, 0.5) as f32);
    let colors = Tensor::from_flat_fn([color_count, 3], |_| random.unit() as f32);
    // Those of the corners of the cube of colours; with 24, at random.
    let true_colors = Tensor::from_fn([color_count, 3], |[color, channel]| match color_count {
        8 => (color >> (2 - channel) & 1) as f32,
        _ => random.unit() as f32,
    });
    let (truth, measure) = (cube.vertices.clone(), vertex_distance(&faces, &cube.vertices));
    let scene = Scene { cube, colored, options, silhouettes };

    let parameters = Parameters::new()
        .with(Parameter::new("vertices", vertices).rate(1e-2))?
        .with(Parameter::new("colors", colors).rate(1e-2))?;
    let schedule = Schedule::Exponential { steps: 2000, factor: 0.1, floor: 0.01 };
    let mut fit = Fit::new(parameters, FitSettings { schedule, ..FitSettings::default() })?;
    let mut curve = Curve::starting_now();
    curve.add(measure.of(&fit.parameters().value("vertices")?));
    // At 16 pixels 1500 steps are enough.
    let steps = asked.steps(if side == 16 { 1500 } else { STEPS });
    for step in 0..steps {
        let camera = camera(&mut Random::new(asked.seed, 1 + step));
        fit.step(&mut from_fn(|tape: &Tape<f32>, variables| {
            let seen =
                scene.picture(&camera, tape.constant(&truth), tape.constant(&true_colors))?;
            let picture = scene.picture(&camera, variables[0], variables[1])?;
            Ok(squared_error(picture.image()?, seen.image()?)? * (1.0 / (side * side * 3) as f32))
        }))?;
        if (step + 1) % 50 == 0 || step + 1 == steps {
            curve.add(measure.of(&fit.parameters().value("vertices")?));
        }
    }
    let metric = format!("mean vertex distance, {side} px, {color_count} colours");
    // Antialias blends silhouettes alone, and of 24 colours some jump across edges in between. Where pixels
    // are larger, only what lies in them tells.
    let is_due = color_count == 8 && (side == 16 || silhouettes == Silhouettes::Exact);
    let goal = if is_due { Goal::Below(1e-4) } else { Goal::None };
    Ok(Found::last(metric, goal, steps, curve))
}

fn run(asked: &Asked) -> Result<Vec<Found>, FitError> {
    let cases = [16, 8, 4].into_iter().flat_map(|side| [(side, 8), (side, 24)]);
    cases.map(|(side, colors)| learn(asked, side, colors)).collect()
}

/// Runs it as a program.
pub fn main() -> Result<(), FitError> {
    bokashi_examples::main(&SAMPLE)
}
