//! What a mirroring sphere mirrors, and its highlight: the radiance from all sides as a cube map, and colour
//! and exponent of a highlight after Phong. Each step sees the sphere in another view and another light.
//! The light's direction is known, and so is the sphere: the map and the highlight can be told apart since
//! the map stays and the light moves.
//!
//! The set-up is that of the sample `envphong` of Laine et al. 2020, with a map of our own.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, root_mean_square, sky, sphere};
use bokashi_examples::{Asked, Curve, Found, Goal, Sample, Silhouettes};

/// This sample.
pub const SAMPLE: Sample =
    Sample { name: "envphong", about: "learns what a sphere mirrors, and its highlight", run };

const SIDE: usize = 1024;
const STEPS: u64 = 500;
const TEXELS: usize = 64;
const COLOR: [f32; 3] = [1.0, 0.8, 0.6];
const EXPONENT: f32 = 25.0;

/// A view of the sphere: what it mirrors where.
struct Mirror<'t> {
    fragments: Fragments<'t, f32>,
    directions: Var<'t, f32>,
    /// Between these and the direction to the lamp; 0 for more than a right angle.
    cosines: Var<'t, f32>,
}

impl<'t> Mirror<'t> {
    /// The sphere before a camera and in the light of a lamp, both at random.
    fn new(
        tape: &'t Tape<f32>,
        sphere: &Shape,
        silhouettes: Silhouettes,
        random: &mut Random,
    ) -> Result<Self, FitError> {
        let vector = |v: DVec3| tape.constant(&Tensor::from(v.as_vec3().to_array()));
        let place = random.vector(0.25) - DVec3::new(0.0, 0.0, 3.5);
        let view = DMat4::from_rotation_translation(random.rotation(), place);
        let camera = perspective(2.0 * 0.4_f64.atan(), 1.0, 1.0, 200.0) * view;
        let (eye, lamp) = (view.inverse().w_axis.truncate(), random.direction());
        let vertices = tape.constant(&sphere.vertices);
        let options = silhouettes.options(Size::square(SIDE)).cull(Cull::Back);
        let fragments = rasterize(project(vertices, &camera, None)?, &sphere.mesh, options)?;
        // Of a sphere around 0 the places are its normals, too.
        let places = interpolate(vertices, &fragments)?;
        let directions = reflect(places - vector(eye), places)?.normalize(1)?;
        let cosines = directions.dot(vector(lamp), 1)?.relu().keepdim(1)?;
        Ok(Self { fragments, directions, cosines })
    }

    /// The radiance of each fragment under a map, with a highlight of this colour and exponent.
    fn light(&self, [map, color, exponent]: [Var<'t, f32>; 3]) -> Result<Var<'t, f32>, FitError> {
        let map = CubeMap::new(map)?;
        let mirrored = sample_cube_map(&map, self.directions, Detail::Finest, Sampler::new())?;
        Ok(mirrored + color * self.cosines.pow(exponent)?)
    }
}

fn run(asked: &Asked) -> Result<Vec<Found>, FitError> {
    let (sphere, _) = sphere(48)?;
    let map = sky(TEXELS, &mut Random::new(asked.seed, 0));
    let truth = [map, Tensor::from(COLOR), Tensor::scalar(EXPONENT)];
    let silhouettes = asked.silhouettes;
    let parameters = Parameters::new()
        .with(Parameter::new("map", Tensor::full([6, TEXELS, TEXELS, 3], 0.5)).rate(1e-2))?
        .with(Parameter::new("color", Tensor::full([3], 0.5)).rate(1e-2))?
        .with(Parameter::new("exponent", Tensor::scalar(10.0)).mapping(Mapping::Exp).rate(1e-2))?;
    let steps = asked.steps(STEPS);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let ev = |n: &str, d: f64| std::env::var(n).map_or(d, |x| x.parse().unwrap());
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: ev("B2", 0.99), epsilon: 1e-8 };
    let mut fit = Fit::new(parameters, FitSettings { optimizer, schedule, ..FitSettings::default() })?;
    let mut curves = [(); 3].map(|()| Curve::starting_now());
    for step in 0..=steps {
        if step % 20 == 0 || step == steps {
            let off = |name: &str, truth: &Tensor<f32>| {
                let found = fit.parameters().value(name)?;
                let distance = root_mean_square(found.data(), truth.data());
                Ok::<_, FitError>(
                    distance / root_mean_square(truth.data(), &truth.map(|_| 0.0).data()),
                )
            };
            curves[0].add(off("color", &truth[1])?);
            curves[1].add(off("exponent", &truth[2])?);
            curves[2].add(off("map", &truth[0])?);
        }
        if step == steps {
            break;
        }
        fit.step(&mut from_fn(|tape: &Tape<f32>, variables| {
            let random = &mut Random::new(asked.seed, 1 + step);
            let mirror = Mirror::new(tape, &sphere, silhouettes, random)?;
            let target = mirror.light([0, 1, 2].map(|k| tape.constant(&truth[k])))?;
            let found = mirror.light([0, 1, 2].map(|k| variables[k]))?;
            let off = silhouettes.picture(found - target, &mirror.fragments, Background::Zero)?;
            Ok(off.image()?.square().mean()?)
        }))?;
    }
    for c in &curves {
        for p in &c.points {
            eprint!("{:.1}:{:.1e} ", p.0, p.1);
        }
        eprintln!();
    }
    let [color, exponent, map] = curves;
    Ok(vec![
        Found::last("relative error of the highlight's colour", Goal::Below(0.01), steps, color),
        Found::last("relative error of its exponent", Goal::Below(0.01), steps, exponent),
        Found::last("relative error of the map", Goal::None, steps, map),
    ])
}

/// Runs it as a program.
pub fn main() -> Result<(), FitError> {
    bokashi_examples::main(&SAMPLE)
}
