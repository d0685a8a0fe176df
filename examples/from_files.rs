//! A mesh and a photograph from files, and a pipeline of your own between them.
//!
//! `load_mesh` and `load_image` give tensors; no scene is described. The hand of `examples/scenes/hand` is drawn
//! as the camera saw it. Learnt are a colour at each vertex and where the hand stands. The argument is how many
//! steps there are.

use std::error::Error;
use std::path::Path;

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_scene::{load_image, load_mesh};

/// Of the camera, in pixels.
const FOCAL: f64 = 400.0;
/// Of the cloth behind the hand.
const CLOTH: [f32; 3] = [0.0056; 3];

struct Scene {
    mesh: Mesh,
    /// `[V, 3]`.
    positions: Tensor<f32>,
    /// `[H, W, 3]`, linear.
    photo: Tensor<f32>,
    camera: DMat4,
}

impl Scene {
    fn load(folder: &Path) -> Result<Self, Box<dyn Error>> {
        let hand = load_mesh(folder.join("hand.obj"))?;
        hand.notes.iter().for_each(|note| println!("note: {note}"));
        let photo = load_image(folder.join("images/IMG-1843.jpg"))?;
        let [height, width] = [photo.shape()[0] as f64, photo.shape()[1] as f64];
        let eye = DVec3::new(0.0, 0.2, 3.057);
        let view = look_at(eye, eye - DVec3::Z, DVec3::Y);
        let angle = 2.0 * (0.5 * height / FOCAL).atan();
        let camera = perspective(angle, width / height, 0.1, 50.0) * view;
        Ok(Self { mesh: hand.mesh, positions: hand.positions, photo, camera })
    }

    fn picture<'t>(&self, variables: &Variables<'t, f32>) -> Result<Picture<'t, f32>, FitError> {
        let (colors, position) = (variables.get("colors")?, variables.get("place")?);
        let cloth = colors.tape().constant(&Tensor::from(CLOTH));
        let vertices = colors.tape().constant(&self.positions) + position;
        let clip = project(vertices, &self.camera, None)?;
        let size = Size { width: self.photo.shape()[1], height: self.photo.shape()[0] };
        let exact = RasterOptions::new(size).silhouettes(Silhouettes::Exact);
        Ok(render(clip, &self.mesh, colors, exact, Background::Color(cloth))?)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let steps = std::env::args().nth(1).map(|word| word.parse()).transpose()?.unwrap_or(200);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/hand");
    let scene = Scene::load(&folder)?;
    let vertices = scene.mesh.vertex_count();
    println!("{vertices} vertices, {} faces", scene.mesh.faces().len());

    let skin = [0.34, 0.17, 0.12];
    let colors = Tensor::from_fn([vertices, 3], |[_, channel]| skin[channel]);
    // The mean of the vertices at the origin.
    let position = Tensor::from([0.060, -0.343, 0.120]);
    let parameters = Parameters::new()
        .with(Parameter::new("colors", colors).mapping(Mapping::Sigmoid).rate(0.05))?
        .with(Parameter::new("place", position).rate(0.002))?;
    let mut fit = Fit::new(parameters, FitSettings { steps, ..FitSettings::default() })?;
    let photo = PixelLoss::squared(&scene.photo, &Tensor::from(CLOTH))?;
    let history = fit.run(&mut from_fn(|_: &Tape<f32>, variables| {
        Ok(scene.picture(variables)?.loss(&photo)?)
    }))?;

    let [first, last] = [history.initial().loss, history.last().loss];
    println!("loss   {first:.4} -> {last:.4}");
    println!("place  {:.4?}", fit.parameters().value("place")?.data());
    Ok(())
}
