//! A sphere into the shape of a bunny, from twenty silhouettes: by large steps, against a plain Laplacian.
//!
//! Large steps are those of Nicolet, Jacob and Jakob 2021: vertices are learnt as `(I + lambda L) v`, so that
//! each step is smooth. The other way adds the energy of the Laplacian to the loss. Ten more views are held
//! out and never learnt.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, ball, bunny, surface_distance};
use bokashi_examples::{Asked, Curve, Found, Goal, Sample, Silhouettes};

/// This sample.
pub const SAMPLE: Sample =
    Sample { name: "silhouette", about: "makes a bunny of a sphere by twenty silhouettes", run };

const SIDE: usize = 128;
const STEPS: u64 = 1500;
const LEARNT: usize = 20;
const HELD_OUT: usize = 10;
/// The smoothing of large steps.
const LAMBDA: f64 = 10.0;
/// What the energy of the plain Laplacian weighs.
const WEIGHT: f32 = 3.0;

/// What hides the background.
fn mask<'t>(
    vertices: Var<'t, f32>,
    mesh: &Mesh,
    camera: &DMat4,
    silhouettes: Silhouettes,
) -> Result<Var<'t, f32>, RenderError> {
    let clip = project(vertices, camera, None)?;
    let fragments = rasterize(clip, mesh, silhouettes.options(Size::square(SIDE)))?;
    let white =
        vertices.tape().constant(&Tensor::full([fragments.barycentrics.shape()[0], 1], 1.0));
    silhouettes.picture(white, &fragments, Background::Zero)?.image()
}

/// The mask of a shape that is not learnt.
fn still(shape: &Shape, camera: &DMat4, silhouettes: Silhouettes) -> Result<Tensor<f32>, FitError> {
    let tape = Tape::new();
    Ok(mask(tape.constant(&shape.vertices), &shape.mesh, camera, silhouettes)?.value())
}

fn hard(mask: &Tensor<f32>) -> Mask {
    Mask::from_flat_fn(mask.shape().clone(), |k| mask.data()[k] > 0.5)
}

fn camera(random: &mut Random) -> DMat4 {
    let eye = 3.2 * random.direction();
    perspective(0.7, 1.0, 0.1, 10.0) * look_at(eye, DVec3::ZERO, eye.any_orthogonal_vector())
}

fn learn(asked: &Asked, has_large_steps: bool) -> Result<Vec<Found>, FitError> {
    let mut random = Random::new(asked.seed, 0);
    let cameras: Vec<_> = (0..LEARNT + HELD_OUT).map(|_| camera(&mut random)).collect();
    let (bunny, mut shape) = (bunny()?, ball(4)?);
    shape.vertices = shape.vertices.map(|x| 0.6 * x);
    let targets = cameras.iter().map(|camera| still(&bunny, camera, asked.silhouettes));
    let targets = targets.collect::<Result<Vec<_>, _>>()?;
    let topology = Topology::new(shape.mesh.faces(), shape.mesh.vertex_count())?;
    let laplacian = topology.uniform_laplacian();

    let vertices = Parameter::new("vertices", shape.vertices.clone());
    let vertices = match has_large_steps {
        true => vertices.preconditioned(&Preconditioner::new(&topology, LAMBDA)?).rate(6e-2),
        false => vertices.rate(1e-2),
    };
    let steps = asked.steps(STEPS);
    let schedule = Schedule::Cosine { steps, floor: 0.05 };
    let settings = FitSettings { schedule, ..FitSettings::default() };
    let mut fit = Fit::new(Parameters::new().with(vertices)?, settings)?;
    let mesh = shape.mesh.clone();
    let mut pipeline = views(LEARNT, |view, tape: &Tape<f32>, variables| {
        let seen = mask(variables[0], &mesh, &cameras[view.index], asked.silhouettes)?;
        let loss = mean_squared_error(seen, tape.constant(&targets[view.index]))?;
        if has_large_steps {
            return Ok(loss);
        }
        Ok(loss + laplacian_error(variables[0], &laplacian)? * WEIGHT)
    });
    let mut curve = Curve::starting_now();
    for step in 0..=steps {
        if step % 25 == 0 || step == steps {
            shape.vertices = fit.parameters().value("vertices")?;
            let mut sum = 0.0;
            for (camera, target) in cameras.iter().zip(&targets).skip(LEARNT) {
                let found = still(&shape, camera, asked.silhouettes)?;
                let [found, target] = [&found, target].map(hard);
                sum += iou(&found, &target)?;
            }
            curve.add(sum / HELD_OUT as f64);
        }
        if step < steps {
            fit.step(&mut pipeline)?;
        }
    }
    let word = if has_large_steps { "large steps" } else { "a plain Laplacian" };
    let goal = if has_large_steps { Goal::Above(0.97) } else { Goal::None };
    let white = |image: &Tensor<f32>| {
        Tensor::from_fn([SIDE, SIDE, 3], |[i, j, _]| image.data()[i * SIDE + j])
    };
    let found = still(&shape, &cameras[LEARNT], asked.silhouettes)?;
    let found = Found::last(format!("IoU of held-out views, {word}"), goal, steps, curve)
        .picture(&format!("held out, {word}"), &white(&found))
        .picture("held out, target", &white(&targets[LEARNT]));
    let metric = format!("mean surface distance, radius 1, {word}");
    let value = surface_distance(&shape.vertices, &bunny);
    let distance =
        Found { metric, value, goal: Goal::None, curve: Vec::new(), pictures: Vec::new(), ..found };
    Ok(vec![found, distance])
}

fn run(asked: &Asked) -> Result<Vec<Found>, FitError> {
    Ok([learn(asked, true)?, learn(asked, false)?].concat())
}

/// Runs it as a program.
pub fn main() -> Result<(), FitError> {
    bokashi_examples::main(&SAMPLE)
}
