//! What a mirroring sphere mirrors, and its highlight: the radiance from all sides as a cube map, and colour
//! and exponent of a highlight after Phong. Each step sees the sphere in another view and another light.
//! The light's direction is known, and so is the sphere: the map and the highlight can be told apart since
//! the map stays and the light moves.
//!
//! The set-up is that of the sample `envphong` of Laine et al. 2020, with a map of our own and larger rates:
//! the highlight finds its way once the map has found its own.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, root_mean_square, sky, sphere};
use bokashi_examples::{Asked, Curve, Found, Goal, Sample, Silhouettes};

/// This sample.
pub const SAMPLE: Sample =
    Sample { name: "envphong", about: "learns what a sphere mirrors, and its highlight", run };

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
        found: [Var<'t, f32>; 3],
        random: &mut Random,
    ) -> Result<Var<'t, f32>, FitError> {
        let tape = found[0].tape();
        let vector = |v: DVec3| tape.constant(&Tensor::from(v.as_vec3().to_array()));
        let place = random.vector(0.25) - DVec3::new(0.0, 0.0, 3.5);
        let view = DMat4::from_rotation_translation(random.rotation(), place);
        let camera = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 200.0) * view;
        let (eye, lamp) = (view.inverse().w_axis.truncate(), random.direction());
        let vertices = tape.constant(&self.sphere.vertices);
        let options = self.silhouettes.options(Size::square(SIDE)).cull(Cull::Back);
        let clip = project(vertices, &camera, None)?;
        let fragments = rasterize(clip, &self.sphere.mesh, options)?;
        // Of a sphere around 0 the places are its normals, too.
        let places = interpolate(vertices, &fragments)?;
        let mirrored = reflect(places - vector(eye), places)?.normalize(1)?;
        let cosines = mirrored.dot(vector(lamp), 1)?.relu().keepdim(1)?;
        let light = |[map, color, exponent]: [Var<'t, f32>; 3]| -> Result<_, FitError> {
            let map = CubeMap::new(map)?;
            let seen = sample_cube_map(&map, mirrored, Detail::Finest, Sampler::new())?;
            Ok(seen + color * cosines.pow(exponent)?)
        };
        // Pictures with the same silhouettes: their difference is the picture of the difference.
        let truth = [0, 1, 2].map(|k| tape.constant(&self.truth[k]));
        let off = light(found)? - light(truth)?;
        let picture = self.silhouettes.picture(off, &fragments, Background::Zero)?;
        Ok(picture.image()?.square().mean()?)
    }
}

fn length(numbers: &[f32]) -> f64 {
    root_mean_square(numbers, &vec![0.0; numbers.len()])
}

fn run(asked: &Asked) -> Result<Vec<Found>, FitError> {
    let map = sky(TEXELS, &mut Random::new(asked.seed, 0));
    let truth = [map, Tensor::from(COLOR), Tensor::scalar(EXPONENT)];
    let scene = Scene { sphere: sphere(48)?.0, truth, silhouettes: asked.silhouettes };
    let parameters = Parameters::new()
        .with(Parameter::new("map", Tensor::full([6, TEXELS, TEXELS, 3], 0.5)).rate(0.05))?
        .with(Parameter::new("color", Tensor::full([3], 0.5)).rate(0.05))?
        .with(Parameter::new("exponent", Tensor::scalar(10.0)).mapping(Mapping::Exp).rate(0.05))?;
    let steps = asked.steps(STEPS);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    // Gradients of the highlight fall a hundredfold as the map is found: their squares are soon forgotten.
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 };
    let mut fit =
        Fit::new(parameters, FitSettings { optimizer, schedule, ..FitSettings::default() })?;
    let mut curves = [(); 3].map(|()| Curve::starting_now());
    for step in 0..=steps {
        if step % 20 == 0 || step == steps {
            for (k, name) in ["color", "exponent"].into_iter().enumerate() {
                let (found, truth) = (fit.parameters().value(name)?, &scene.truth[k + 1]);
                curves[k].add(root_mean_square(found.data(), truth.data()) / length(truth.data()));
            }
            // A view and a light that no step has.
            let tape = Tape::new();
            let list = fit.parameters().record(&tape);
            let random = &mut Random::new(asked.seed, u64::MAX);
            let error = scene.error([0, 1, 2].map(|k| list[k]), random)?.item();
            curves[2].add(f64::from(error).sqrt());
        }
        if step < steps {
            fit.step(&mut from_fn(|_: &Tape<f32>, variables| {
                let random = &mut Random::new(asked.seed, 1 + step);
                scene.error([0, 1, 2].map(|k| variables[k]), random)
            }))?;
        }
    }
    // The faces, one below the other.
    let strip = |map: &Tensor<f32>| {
        Tensor::from_flat_fn([6 * TEXELS, TEXELS, 3], |entry| map.data()[entry])
    };
    let [color, exponent, image] = curves;
    let goal = Goal::Below(0.01);
    let image = Found::last("image RMSE, in a view not learnt", Goal::None, steps, image)
        .picture("true map", &strip(&scene.truth[0]))
        .picture("learnt map", &strip(&fit.parameters().value("map")?));
    Ok(vec![
        Found::last("relative error of the highlight's colour", goal, steps, color),
        Found::last("relative error of the highlight's exponent", goal, steps, exponent),
        image,
    ])
}

/// Runs it as a program.
pub fn main() -> Result<(), FitError> {
    bokashi_examples::main(&SAMPLE)
}
