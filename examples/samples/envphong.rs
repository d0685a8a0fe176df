//! What a mirroring sphere mirrors, and its highlight: the radiance from all sides as a cube map, and colour
//! and exponent of a highlight after Phong. Each step sees the sphere in another view and another light.
//! The light's direction is known, and so is the sphere: the map and the highlight can be told apart since
//! the map stays and the light moves.
//!
//! The set-up is that of the sample `envphong` of Laine et al. 2020, with a map of our own and larger rates:
//! the highlight finds its way once the map has found its own.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, column, learn, relative_error, sky, sphere};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("envphong", "learns what a sphere mirrors, and its highlight");

const SIDE: usize = 1024;
const STEPS: u64 = 600;
const TEXELS: usize = 64;
const COLOR: [f32; 3] = [1.0, 0.8, 0.6];
const EXPONENT: f32 = 25.0;

/// What is known, and what is to be found: map, colour and exponent.
struct Scene {
    sphere: Shape,
    truth: [Tensor<f32>; 3],
    silhouettes: Silhouettes,
}

impl Scene {
    /// The mean squared difference from the true picture, before a camera and in the light of a lamp, both at
    /// random.
    fn error<'t>(
        &self,
        learnt: &Variables<'t, f32>,
        random: &mut Random,
    ) -> Result<Var<'t, f32>, FitError> {
        let (tape, learnt) = (learnt[0].tape(), [learnt[0], learnt[1], learnt[2]]);
        let vector = |v: DVec3| tape.constant(&Tensor::from(v.as_vec3().to_array()));
        let position = random.vector(0.25) - DVec3::new(0.0, 0.0, 3.5);
        let view = DMat4::from_rotation_translation(random.rotation(), position);
        let camera = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 200.0) * view;
        let (eye, lamp) = (view.inverse().w_axis.truncate(), random.direction());
        let vertices = tape.constant(&self.sphere.vertices);
        let shown = [vertices.into()];
        let options = RasterOptions::new(Size::square(SIDE)).cull(Cull::Back);
        let options = options.silhouettes(self.silhouettes).creases(&shown);
        let clip = project(vertices, &camera, None)?;
        let fragments = rasterize(clip, &self.sphere.mesh, options)?;
        // Of a sphere around 0 the places are its normals, too.
        let places = interpolate(vertices, &fragments)?;
        let mirrored = reflect(places - vector(eye), places)?.normalize()?;
        let cosines = mirrored.dot(vector(lamp))?.relu().keepdim(1)?;
        let light = |[map, color, exponent]: [Var<'t, f32>; 3]| -> Result<_, FitError> {
            let map = CubeMap::new(map)?;
            let reflected = sample_cube_map(&map, mirrored, Detail::Finest, Sampler::new())?;
            Ok(reflected + color * cosines.pow(exponent)?)
        };
        // Pictures with the same silhouettes: their difference is the picture of the difference.
        let truth = [0, 1, 2].map(|k| tape.constant(&self.truth[k]));
        let off = light(learnt)? - light(truth)?;
        Ok(fragments.picture(off, Background::Zero)?.image()?.square().mean()?)
    }
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let map = sky(TEXELS, &mut Random::new(request.seed, 0));
    let truth = [map, Tensor::from(COLOR), Tensor::scalar(EXPONENT)];
    let scene = Scene { sphere: sphere(48)?.0, truth, silhouettes: request.silhouettes };
    let start = Parameters::new()
        .with(Parameter::new("map", Tensor::full([6, TEXELS, TEXELS, 3], 0.5)).rate(0.05))?
        .with(Parameter::new("color", Tensor::full([3], 0.5)).rate(0.05))?
        .with(Parameter::new("exponent", Tensor::scalar(10.0)).mapping(Mapping::Exp).rate(0.05))?;
    let steps = request.steps(STEPS);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    // Gradients of the highlight fall a hundredfold as the map is found: their squares are soon forgotten.
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 };
    let settings = FitSettings { steps, optimizer, schedule, ..FitSettings::default() };
    let mut pipeline = views(1, |view, _: &Tape<f32>, variables| {
        scene.error(variables, &mut Random::new(request.seed, 1 + view.step))
    });
    let errors = |learnt: &Parameters<f32>| {
        let off =
            |name, truth| Ok::<_, FitError>(relative_error(learnt.value(name)?.data(), truth));
        // A view and a light that no step has.
        let random = &mut Random::new(request.seed, u64::MAX);
        let error = scene.error(&learnt.record(&Tape::new()), random)?.item();
        Ok([off("color", &COLOR)?, off("exponent", &[EXPONENT])?, f64::from(error).sqrt()])
    };
    let (learnt, [color, exponent, image]) = learn(start, settings, &mut pipeline, 20, errors)?;
    let goal = Goal::Below(0.01);
    let image = Outcome::last("image RMSE, in a view not learnt", Goal::None, steps, image)
        .picture("true map", &column(&scene.truth[0]))
        .picture("learnt map", &column(&learnt.value("map")?));
    Ok(vec![
        Outcome::last("relative error of the highlight's colour", goal, steps, color),
        Outcome::last("relative error of the highlight's exponent", goal, steps, exponent),
        image,
    ])
}
