//! The pose of a cube with flat sides, from one picture: a random search far away, gradients near the end.
//!
//! The first half of the steps tries rotations around the best one so far, by noise that falls from 1 to
//! 1e-4, and keeps what looks better. The second half is Adam. The set-up is that of the sample `pose` of
//! Laine et al. 2020.

use std::ops::ControlFlow;

use bokashi::fit::{Rules, StepState, before_update};
use bokashi::glam::{DQuat, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, cube};
use bokashi_examples::{Curve, Goal, Outcome, Request};

bokashi_examples::sample!("pose", "finds how a cube with flat sides is turned");

const SIDE: usize = 256;
const STEPS: u64 = 10_000;
const COLORS: [[f32; 3]; 6] = [
    [1.0, 0.2, 0.2],
    [0.2, 1.0, 0.2],
    [0.2, 0.2, 1.0],
    [1.0, 1.0, 0.2],
    [1.0, 0.2, 1.0],
    [0.2, 1.0, 1.0],
];

/// What does not change: the cube, and its faces' colours at corners of their own.
struct Scene {
    cube: Shape,
    colored: Mesh,
    silhouettes: Silhouettes,
}

impl Scene {
    fn image<'t>(&self, rotation: Var<'t, f32>) -> Result<Var<'t, f32>, RenderError> {
        let tape = rotation.tape();
        let translation = tape.constant(&Tensor::from([0.0, 0.0, -3.5]));
        let projection = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 50.0);
        let pose = Pose { rotation, translation };
        let clip = project(tape.constant(&self.cube.vertices), &projection, Some(pose))?;
        let options = RasterOptions::new(Size::square(SIDE)).silhouettes(self.silhouettes);
        let colors = (tape.constant(&Tensor::from(COLORS)), &self.colored);
        render(clip, &self.cube.mesh, colors, options, Background::Zero)?.image()
    }
}

fn tensor(q: DQuat) -> Tensor<f32> {
    Tensor::from(q.normalize().to_array().map(|x| x as f32))
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let cube = cube()?;
    let colored = Mesh::new((0..12).map(|face| [face / 2; 3]).collect(), 6)?;
    let scene = Scene { cube, colored, silhouettes: request.silhouettes };
    let mut random = Random::new(request.seed, 0);
    let (truth, mut best) = (random.rotation(), random.rotation());
    let mut tape = Tape::new();
    let target = scene.image(tape.constant(&tensor(truth)))?.value();
    let off = |q: DQuat| q.normalize().angle_between(truth).to_degrees();
    let mut curve = Curve::starting_now();
    let steps = request.steps(STEPS);

    let mut least = f32::INFINITY;
    for step in 0..steps / 2 {
        // From 1 to 1e-4, and long near 1: a cube looks much the same from 24 sides.
        let noise = 1e-4_f64.powf((2.0 * step as f64 / steps as f64).powi(4));
        let axis = DVec3::from_array([(); 3].map(|()| random.normal()));
        let tried = DQuat::from_vec4((noise * axis).extend(1.0)).normalize() * best;
        tape.reset();
        let image = scene.image(tape.constant(&tensor(tried)))?;
        let loss = squared_error(image, tape.constant(&target))?.item();
        if loss < least {
            (least, best) = (loss, tried);
            curve.add(off(best));
        }
    }

    let rotation = Parameter::new("rotation", tensor(best)).rate(1e-2);
    let schedule = Schedule::Cosine { steps: steps - steps / 2, floor: 0.0 };
    let settings = FitSettings { steps: steps - steps / 2, schedule, ..FitSettings::default() };
    let mut fit = Fit::new(Parameters::new().with(rotation)?, settings)?;
    let mut image = target.clone();
    let quaternion = |q: &Tensor<f32>| DQuat::from_array([0, 1, 2, 3].map(|k| q.data()[k].into()));
    let mut pipeline = from_fn(|tape: &Tape<f32>, variables| {
        let drawn = scene.image(variables.get("rotation")?)?;
        image = drawn.value();
        Ok(squared_error(drawn, tape.constant(&target))?)
    });
    let mut watch = before_update(|state: &StepState<'_, f32, ()>| {
        let rotation = state.parameters.get("rotation").expect("it is there");
        curve.add(off(quaternion(rotation.raw())));
        ControlFlow::Continue(())
    });
    fit.drive(&mut pipeline, &Rules::default(), &mut [&mut watch])?;
    let outcome = Outcome::last("angle to the truth, in degrees", Goal::Below(0.5), steps, curve);
    Ok(vec![outcome.picture("target", &target).picture("found", &image)])
}
