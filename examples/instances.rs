//! Two meshes in one picture, one of them three times: which way has one of the three cubes gone?
//!
//! A floor and three cubes are drawn with one visibility. The cubes share their vertices and colours;
//! each has a model matrix. The third one's is learnt, a quaternion and a translation, although the
//! second cube hides a part of it.

use bokashi::glam::{DMat4, DQuat, DVec3};
use bokashi::prelude::*;
use bokashi::render_ops::camera::to_tensor;

/// The corners of the cube's six sides; vertex k has the bits of k as its coordinates.
const SIDES: [[u32; 4]; 6] =
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];

struct Scene {
    assembly: Assembly,
    floor: Tensor<f64>,
    cube: Tensor<f64>,
    /// The floor's colours, then the cube's.
    colors: Tensor<f64>,
    indices: Mesh,
    /// Of the cubes that stay where they are.
    known: [Tensor<f64>; 2],
    camera: DMat4,
}

impl Scene {
    fn new() -> Result<Self, FitError> {
        let floor = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4)?;
        let faces = SIDES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let cube = Mesh::new(faces.collect(), 8)?;
        let assembly = Assembly::new(&[(&floor, 1), (&cube, 3)])?;
        let bit = |vertex: usize, axis: usize| (vertex >> (2 - axis) & 1) as f64;
        let color = |[row, axis]: [usize; 2]| if row < 4 { 0.3 } else { bit(row - 4, axis) };
        let moved_to = |x: f64, z: f64| to_tensor(&DMat4::from_translation(DVec3::new(x, 0.0, z)));
        let eye = DVec3::new(1.5, 2.0, 6.0);
        Ok(Self {
            indices: assembly.attributes(&[&floor, &cube])?,
            assembly,
            floor: Tensor::from_fn([4, 3], |[k, axis]| {
                [8.0 * bit(k, 2) - 4.0, -0.5, 3.0 - 8.0 * bit(k, 1)][axis]
            }),
            cube: Tensor::from_fn([8, 3], |[vertex, axis]| bit(vertex, axis) - 0.5),
            colors: Tensor::from_fn([12, 3], color),
            known: [moved_to(-1.6, 0.3), moved_to(0.5, 1.0)],
            camera: perspective(0.7, 1.0, 1.0, 50.0) * look_at(eye, DVec3::ZERO, DVec3::Y),
        })
    }

    fn picture<'t>(
        &self,
        rotation: Var<'t, f64>,
        translation: Var<'t, f64>,
    ) -> Result<Picture<'t, f64>, FitError> {
        let tape = rotation.tape();
        let [first, second] = self.known.each_ref().map(|matrix| tape.constant(matrix));
        let models = [first, second, rigid(rotation, translation)?];
        let models = Var::concat(&models, 0)?.reshape([3, 4, 4])?;
        let floor = project(tape.constant(&self.floor), &self.camera, None)?;
        let cubes = project_instances(tape.constant(&self.cube), models, &self.camera)?;
        let clip = Var::concat(&[floor, cubes], 0)?;
        let colors = (tape.constant(&self.colors), &self.indices);
        let exact = RasterOptions::new(Size::square(96)).silhouettes(Silhouettes::Exact);
        Ok(render(clip, self.assembly.mesh(), colors, exact, Background::Zero)?)
    }
}

fn main() -> Result<(), FitError> {
    let scene = Scene::new()?;
    let turn = DQuat::from_rotation_y(0.6);
    let position = DVec3::new(0.9, 0.1, -0.9);
    let quaternion = |q: DQuat| Tensor::from(q.to_array());
    let tape = Tape::new();
    let truth =
        [quaternion(turn), Tensor::from(position.to_array())].map(|tensor| tape.constant(&tensor));
    let photo = scene.picture(truth[0], truth[1])?.image()?.value();
    let photo = PixelLoss::squared(&photo, &Tensor::zeros([3]))?;

    let start = Tensor::from((position + DVec3::new(0.25, -0.1, 0.2)).to_array());
    let parameters = Parameters::new()
        .with(Parameter::new("rotation", quaternion(DQuat::from_rotation_y(0.3))).rate(0.02))?
        .with(Parameter::new("translation", start).rate(0.01))?;
    let schedule = Schedule::Cosine { steps: 400, floor: 0.0 };
    let mut fit =
        Fit::new(parameters, FitSettings { steps: 400, schedule, ..FitSettings::default() })?;
    let history = fit.run(&mut from_fn(|_: &Tape<f64>, variables| {
        let picture = scene.picture(variables.get("rotation")?, variables.get("translation")?)?;
        Ok(picture.loss(&photo)?)
    }))?;
    let [q, translation] =
        [fit.parameters().value("rotation")?, fit.parameters().value("translation")?];
    let q = DQuat::from_slice(q.data()).normalize();
    println!("loss         {:.1e} -> {:.1e}", history.initial().loss, history.last().loss);
    println!("rotation     {:.1e} rad off", q.angle_between(turn));
    println!("translation  {:.1e} off", DVec3::from_slice(translation.data()).distance(position));
    Ok(())
}
