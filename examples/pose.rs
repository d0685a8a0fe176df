//! A pipeline of your own: where is this cube, and how blurred is its picture?
//!
//! Takes one blurred picture of a cube whose shape and colours are known. Learns the cube's pose (a
//! quaternion and a translation) and the blur's sigma together. The start is off by half a radian, a
//! quarter of the cube's side, and a factor of two in sigma.

use bokashi::glam::{DMat4, DQuat, DVec3};
use bokashi::prelude::*;

/// The corners of the cube's six sides; vertex k has the bits of k as its coordinates.
const SIDES: [[u32; 4]; 6] =
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];

/// The known cube and the camera that looks at it.
struct Scene {
    mesh: Mesh,
    vertices: Tensor<f64>,
    colors: Tensor<f64>,
    camera: DMat4,
}

impl Scene {
    fn new() -> Result<Self, FitError> {
        let faces = SIDES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let bit = |[vertex, axis]: [usize; 2]| (vertex >> (2 - axis) & 1) as f64;
        Ok(Self {
            mesh: Mesh::new(faces.collect(), 8)?,
            vertices: Tensor::from_fn([8, 3], |entry| bit(entry) - 0.5),
            colors: Tensor::from_fn([8, 3], bit),
            camera: perspective(0.7, 1.0, 1.0, 50.0),
        })
    }

    /// The picture of the cube in `pose`, in either precision.
    fn picture<'t, T: Scalar>(
        &self,
        pose: Pose<'t, T>,
        sigma: Var<'t, T>,
    ) -> Result<Blurred<'t, T>, FitError> {
        let tape: &Tape<T> = sigma.tape();
        let clip = project(tape.constant(&self.vertices.cast()), &self.camera, Some(pose))?;
        let colors = tape.constant(&self.colors.cast());
        let exact = RasterOptions::new(Size::square(64)).silhouettes(Silhouettes::Exact);
        let picture = render(clip, &self.mesh, colors, exact, Background::Zero)?;
        Ok(picture.blurred(sigma, &Blur::default()))
    }
}

fn main() -> Result<(), FitError> {
    let scene = Scene::new()?;
    let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.9);
    let translation = DVec3::new(0.2, -0.1, -4.0);

    let quaternion = |q: DQuat| Tensor::from(q.to_array());
    let vector = |v: DVec3| Tensor::from(v.to_array());
    let tape = Tape::<f64>::new();
    let truth = Pose {
        rotation: tape.constant(&quaternion(rotation)),
        translation: tape.constant(&vector(translation)),
    };
    let photo = scene.picture(truth, tape.constant_scalar(1.5))?.image()?.value();
    let photo = PixelLoss::squared(&photo, &Tensor::zeros([3]))?;

    let turned = quaternion(DQuat::from_axis_angle(DVec3::Y, 0.5) * rotation);
    let moved = vector(translation + DVec3::new(-0.15, 0.15, 0.15));
    let parameters = Parameters::new()
        .with(Parameter::new("rotation", turned).rate(0.02))?
        .with(Parameter::new("translation", moved).rate(0.01))?
        .with(Parameter::new("sigma", Tensor::scalar(3.0)).rate(0.02).mapping(Mapping::Softplus))?;
    let schedule = Schedule::Cosine { steps: 500, floor: 0.0 };
    let settings = FitSettings { steps: 500, schedule, ..FitSettings::default() };
    let mut fit = Fit::new(parameters, settings)?;
    let history = fit.run(&mut from_fn(|_: &Tape<f64>, variables| {
        let (rotation, translation) = (variables.get("rotation")?, variables.get("translation")?);
        let picture = scene.picture(Pose { rotation, translation }, variables.get("sigma")?)?;
        Ok(picture.loss(&photo)?)
    }))?;

    let learnt = |name| fit.parameters().value(name);
    let q = DQuat::from_slice(learnt("rotation")?.data()).normalize();
    let away = DVec3::from_slice(learnt("translation")?.data()).distance(translation);
    println!("loss         {:.1e} -> {:.1e}", history.initial().loss, history.last().loss);
    println!("rotation     {:.1e} rad off", q.angle_between(rotation));
    println!("translation  {away:.1e} off");
    println!("sigma        {:.6}, the truth is 1.5", learnt("sigma")?.item());
    Ok(())
}
