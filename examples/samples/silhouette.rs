//! A sphere into the shape of a bunny, from twenty silhouettes: by large steps, against a plain Laplacian.
//!
//! Large steps are those of Nicolet, Jacob and Jakob 2021: vertices are learnt as `(I + lambda L) v`, so that
//! each step is smooth. The other way adds the energy of the Laplacian to the loss. Ten more views are held
//! out and never learnt.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, ball, bunny, learn, surface_distance};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("silhouette", "makes a bunny of a sphere by twenty silhouettes");

const SIDE: usize = 128;
const STEPS: u64 = 1500;
const LEARNT: usize = 20;
const HELD_OUT: usize = 10;
/// The smoothing of large steps.
const LAMBDA: f64 = 5.0;
/// What the energy of the plain Laplacian weighs.
const WEIGHT: f32 = 1.0;

/// What hides the background.
fn mask<'t>(
    vertices: Var<'t, f32>,
    mesh: &Mesh,
    camera: &DMat4,
    silhouettes: Silhouettes,
) -> Result<Var<'t, f32>, RenderError> {
    let clip = project(vertices, camera, None)?;
    let options = RasterOptions::new(Size::square(SIDE)).silhouettes(silhouettes);
    let fragments = rasterize(clip, mesh, options.creases(&[]))?;
    let white = vertices.tape().constant_full([fragments.coverage.count(), 1], 1.0);
    fragments.picture(white, Background::Zero)?.image()
}

fn camera(random: &mut Random) -> DMat4 {
    let eye = 3.2 * random.direction();
    perspective(0.7, 1.0, 0.1, 10.0) * look_at(eye, DVec3::ZERO, eye.any_orthogonal_vector())
}

fn run_case(request: &Request, has_large_steps: bool) -> Result<Vec<Outcome>, FitError> {
    let mut random = Random::new(request.seed, 0);
    let cameras: Vec<_> = (0..LEARNT + HELD_OUT).map(|_| camera(&mut random)).collect();
    let (bunny, Shape { mesh, vertices: start }) = (bunny()?, ball(4)?);
    let draw = |vertices: &Tensor<f32>, mesh: &Mesh, camera: &DMat4| -> Result<_, FitError> {
        Ok(mask(Tape::new().constant(vertices), mesh, camera, request.silhouettes)?.value())
    };
    let targets = cameras.iter().map(|camera| draw(&bunny.vertices, &bunny.mesh, camera));
    let targets = targets.collect::<Result<Vec<_>, _>>()?;
    let topology = Topology::new(mesh.faces(), mesh.vertex_count())?;
    let laplacian = topology.uniform_laplacian();

    let vertices = Parameter::new("vertices", start.map(|x| 0.6 * x));
    let vertices = match has_large_steps {
        true => vertices.preconditioned(&Preconditioner::new(&topology, LAMBDA)?).rate(6e-2),
        false => vertices.rate(1e-2),
    };
    let steps = request.steps(STEPS);
    let schedule = Schedule::Cosine { steps, floor: 0.05 };
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 };
    let settings = FitSettings { steps, optimizer, schedule, ..FitSettings::default() };
    let mut pipeline = views(LEARNT, |view, tape: &Tape<f32>, variables| {
        let drawn = mask(variables[0], &mesh, &cameras[view.index], request.silhouettes)?;
        let loss = mean_squared_error(drawn, tape.constant(&targets[view.index]))?;
        if has_large_steps {
            return Ok(loss);
        }
        Ok(loss + laplacian_error(variables[0], &laplacian)? * WEIGHT)
    });
    let hard =
        |mask: &Tensor<f32>| Mask::from_flat_fn(mask.shape().clone(), |k| mask.data()[k] > 0.5);
    let overlap = |learnt: &Parameters<f32>| {
        let vertices = learnt.value("vertices")?;
        let held_out = cameras.iter().zip(&targets).skip(LEARNT);
        let overlaps = held_out.map(|(camera, target)| {
            Ok::<_, FitError>(iou(&hard(&draw(&vertices, &mesh, camera)?), &hard(target))?)
        });
        Ok([overlaps.sum::<Result<f64, _>>()? / HELD_OUT as f64])
    };
    let vertices = Parameters::new().with(vertices)?;
    let (learnt, [curve]) = learn(vertices, settings, &mut pipeline, 25, overlap)?;
    let vertices = learnt.value("vertices")?;
    let word = if has_large_steps { "large steps" } else { "a plain Laplacian" };
    let goal = if has_large_steps { Goal::Above(0.97) } else { Goal::None };
    let iou = Outcome::last(format!("IoU of held-out views, {word}"), goal, steps, curve)
        .picture(&format!("held out, {word}"), &draw(&vertices, &mesh, &cameras[LEARNT])?)
        .picture("held out, target", &targets[LEARNT]);
    let metric = format!("mean surface distance, radius 1, {word}");
    let value = surface_distance(&vertices, &bunny);
    let distance =
        Outcome { metric, value, goal: Goal::None, curve: Vec::new(), pictures: Vec::new(), ..iou };
    Ok(vec![iou, distance])
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    Ok([run_case(request, true)?, run_case(request, false)?].concat())
}
