//! A cube from pictures of a few pixels: 8 positions, with 8 colours or with 24, one per corner of a
//! side. Each step sees the cube in another pose.
//!
//! Poses, rates and metric are those of Laine et al. 2020, *Modular primitives for high-performance
//! differentiable rendering*, section 4; beta2 and exact coverage are our own.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, cube, learn, vertex_distance};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("cube", "learns a cube's vertices and colours from tiny pictures", Exact);

/// What does not change: the cube, the corners that colours belong to, and how it is drawn.
struct Scene {
    cube: Shape,
    colored: Mesh,
    side: usize,
    silhouettes: Silhouettes,
}

impl Scene {
    fn image<'t>(
        &self,
        camera: &DMat4,
        vertices: Var<'t, f32>,
        colors: Var<'t, f32>,
    ) -> Result<Var<'t, f32>, RenderError> {
        let clip = project(vertices, camera, None)?;
        let options = RasterOptions::new(Size::square(self.side)).silhouettes(self.silhouettes);
        let colors = (colors, &self.colored);
        render(clip, &self.cube.mesh, colors, options, Background::Zero)?.image()
    }
}

/// The cube turned and moved at random, 3.5 in front of a camera with near plane 1, far plane 50 and
/// half-width 0.4 of the near plane.
fn camera(random: &mut Random) -> DMat4 {
    let projection = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 50.0);
    let position = random.vector(0.25) - DVec3::new(0.0, 0.0, 3.5);
    projection * DMat4::from_rotation_translation(random.rotation(), position)
}

fn run_case(request: &Request, side: usize, color_count: usize) -> Result<Outcome, FitError> {
    let cube = cube()?;
    let faces = cube.mesh.faces().to_vec();
    // Colours at vertices, or four of their own for each side.
    let of_sides =
        (0..6).flat_map(|k| [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]);
    let colored = if color_count == 8 { faces.clone() } else { of_sides.collect() };
    let colored = Mesh::new(colored, color_count)?;
    let silhouettes = request.silhouettes;
    let mut random = Random::new(request.seed, 0);
    let vertices = cube.vertices.map(|x| x + random.between(-0.5, 0.5) as f32);
    let colors = Tensor::from_flat_fn([color_count, 3], |_| random.unit() as f32);
    // Those of the corners of the cube of colours; with 24, at random.
    let true_colors = Tensor::from_fn([color_count, 3], |[color, channel]| match color_count {
        8 => (color >> (2 - channel) & 1) as f32,
        _ => random.unit() as f32,
    });
    let (truth, measure) = (cube.vertices.clone(), vertex_distance(&faces, &cube.vertices));
    let scene = Scene { cube, colored, side, silhouettes };

    let parameters = Parameters::new()
        .with(Parameter::new("vertices", vertices).rate(1e-2))?
        .with(Parameter::new("colors", colors).rate(1e-2))?;
    // At 16 pixels 1500 steps are enough.
    let steps = request.steps(if side == 16 { 1500 } else { 5000 });
    let schedule = Schedule::Exponential { steps: 2000, factor: 0.1, floor: 0.01 };
    // Gradients shrink as fast as the rate. With 0.999 the second moment lags behind and steps become too
    // small: at 4 pixels, with 8 colours, a median of 2e-4 is left. With 0.99 steps are too noisy.
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.998, epsilon: 1e-8 };
    let settings = FitSettings { steps, schedule, optimizer, ..FitSettings::default() };
    let mut pipeline = views(1, |view, tape: &Tape<f32>, variables| {
        let camera = camera(&mut Random::new(request.seed, 1 + view.step));
        let target = scene.image(&camera, tape.constant(&truth), tape.constant(&true_colors))?;
        Ok(mean_squared_error(scene.image(&camera, variables[0], variables[1])?, target)?)
    });
    let distance = |learnt: &Parameters<f32>| Ok([measure.distance_to(&learnt.value("vertices")?)]);
    let (_, [curve]) = learn(parameters, settings, &mut pipeline, 50, distance)?;
    // Antialias blends silhouettes alone, and of 24 colours some jump across edges in between. Where pixels
    // are large, only coverage tells.
    let is_due = silhouettes == Silhouettes::Exact || (side, color_count) == (16, 8);
    let goal = if is_due { Goal::Below(1e-4) } else { Goal::None };
    let metric = format!("mean vertex distance, {side} px, {color_count} colours");
    Ok(Outcome::last(metric, goal, steps, curve))
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let cases = [16, 8, 4].into_iter().flat_map(|side| [(side, 8), (side, 24)]);
    cases.map(|(side, colors)| run_case(request, side, colors)).collect()
}
