//! An object that starts further away than its own size: no pixel of its picture touches the target's, so
//! no gradient leads there. A wide blur of both pictures makes them touch, and gets narrower as the fit
//! goes on. Without the blur the fit must fail, and that is shown.

use bokashi::glam::DVec3;
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, cube, learn};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("far-start", "finds an object that starts far from its picture");

const SIDE: usize = 64;
const STEPS: u64 = 800;
/// The standard deviation of the blur at the start, in pixels.
const WIDEST: f64 = 16.0;

struct Scene {
    cube: Shape,
    silhouettes: Silhouettes,
}

impl Scene {
    fn image<'t>(&self, translation: Var<'t, f32>) -> Result<Var<'t, f32>, RenderError> {
        let tape = translation.tape();
        let turn = [0.2, 0.3, 0.1, 0.9];
        let pose = Pose { rotation: tape.constant(&Tensor::from(turn)), translation };
        let camera = perspective(0.7, 1.0, 0.1, 50.0);
        let clip = project(tape.constant(&self.cube.vertices), &camera, Some(pose))?;
        let options = RasterOptions::new(Size::square(SIDE)).silhouettes(self.silhouettes);
        let colors = tape.constant(&self.cube.vertices.map(|x| x + 0.5));
        render(clip, &self.cube.mesh, colors, options, Background::Zero)?.image()
    }
}

fn tensor(v: DVec3) -> Tensor<f32> {
    Tensor::from(v.to_array().map(|x| x as f32))
}

fn run_case(
    scene: &Scene,
    request: &Request,
    truth: DVec3,
    start: DVec3,
    blurs: bool,
) -> Result<Outcome, FitError> {
    let tape = Tape::new();
    let target = scene.image(tape.constant(&tensor(truth)))?.value();
    let steps = request.steps(STEPS);
    let position = Parameter::new("place", tensor(start)).rate(0.03);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let settings = FitSettings { steps, schedule, ..FitSettings::default() };
    let mut pipeline = views(1, |view, tape: &Tape<f32>, variables| {
        // From wide to none in the first two thirds.
        let left = 1.0 - 1.5 * view.step as f64 / steps as f64;
        let sigma = if blurs { (WIDEST * left).max(0.0) } else { 0.0 };
        let sigma = tape.constant_scalar(sigma as f32);
        let blur = |image| gaussian_blur(image, sigma, &Blur::default());
        let drawn = scene.image(variables.get("place")?)?;
        Ok(squared_error(blur(drawn)?, blur(tape.constant(&target))?)?)
    });
    let off = |learnt: &Parameters<f32>| {
        let position = learnt.value("place")?;
        Ok([DVec3::from_array([0, 1, 2].map(|k| position.data()[k].into())).distance(truth)])
    };
    let (learnt, [curve]) =
        learn(Parameters::new().with(position)?, settings, &mut pipeline, 1, off)?;
    let image = scene.image(tape.constant(&learnt.value("place")?))?.value();
    // The cube's side is 1, and the way was longer.
    let (word, goal) =
        if blurs { ("with", Goal::Below(0.01)) } else { ("without", Goal::Above(0.5)) };
    let outcome = Outcome::last(format!("distance {word} blur, in sides"), goal, steps, curve);
    Ok(outcome.picture(&format!("{word} blur"), &image).picture("target", &target))
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let scene = Scene { cube: cube()?, silhouettes: request.silhouettes };
    let mut random = Random::new(request.seed, 0);
    let truth = DVec3::new(random.between(0.8, 1.2), random.between(-0.8, 0.8), -6.0);
    // Across the picture: 2.2 to 2.4 sides away, and more or less as far from the eye.
    let away = DVec3::new(-random.between(2.2, 2.4), 0.0, random.between(-0.3, 0.3));
    [true, false]
        .into_iter()
        .map(|blurs| run_case(&scene, request, truth, truth + away, blurs))
        .collect()
}
