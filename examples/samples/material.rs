//! What an object is made of, from sixteen pictures: maps of base colour, roughness and metallic, under a
//! known environment and a known lamp. Shape and views are known, so fragments are made once for all steps.
//! Pictures are cut off at 1 and encoded, as a camera does: in linear light a few highlights of the lamp,
//! a hundred times brighter, would outweigh all else.
//!
//! What counts is how well the maps predict eight views that were held out and never learnt. The maps
//! themselves are less well known: a rough metal looks much like a dielectric of another colour, and no view
//! shows the texels that lie beside both parts of the object.

use std::ops::Range;

use bokashi::glam::DVec3;
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, planet, sky, substance};
use bokashi_examples::{Asked, Curve, Found, Goal, Sample, Silhouettes};

/// This sample.
pub const SAMPLE: Sample =
    Sample { name: "material", about: "learns what an object is made of, from 16 pictures", run };

const SIDE: usize = 256;
const STEPS: u64 = 300;
const TEXELS: usize = 128;
const LEARNT: usize = 16;
const HELD_OUT: usize = 8;

/// The surface that a camera sees, as numbers that don't change.
struct Seen {
    fragments: StillFragments<f32>,
    normals: Tensor<f32>,
    views: Tensor<f32>,
    places: Tensor<f32>,
    silhouettes: Silhouettes,
}

/// The light, as numbers that don't change.
struct Lights {
    harmonics: Tensor<f32>,
    reflections: Vec<Tensor<f32>>,
    direction: Tensor<f32>,
}

/// The object before a camera on a sphere around it.
fn seen(silhouettes: Silhouettes, random: &mut Random) -> Result<Seen, FitError> {
    let tape = Tape::new();
    let (shape, normals, places) = planet()?;
    let eye = 3.2 * random.direction();
    let up = eye.any_orthogonal_vector();
    let camera = perspective(0.7, 1.0, 0.1, 10.0) * look_at(eye, DVec3::ZERO, up);
    let vertices = tape.constant(&shape.vertices);
    let options = silhouettes.options(Size::square(SIDE)).cull(Cull::Back);
    let fragments = rasterize(project(vertices, &camera, None)?, &shape.mesh, options)?;
    let eye = tape.constant(&Tensor::from(eye.as_vec3().to_array()));
    Ok(Seen {
        normals: interpolate(tape.constant(&normals), &fragments)?.value(),
        views: (eye - interpolate(vertices, &fragments)?).value(),
        places: interpolate(tape.constant(&places), &fragments)?.value(),
        fragments: fragments.still(),
        silhouettes,
    })
}

fn lights(random: &mut Random) -> Result<Lights, FitError> {
    let tape = Tape::new();
    let texels = tape.constant(&sky(64, random));
    let Environment { harmonics, reflections } =
        Environment::of_texels(texels, &Prefilter::new(64, 4)?)?;
    let reflections = reflections.levels().iter().map(|level| level.value()).collect();
    let direction = Tensor::from(random.direction().as_vec3().to_array());
    Ok(Lights { harmonics: harmonics.value(), reflections, direction })
}

impl Seen {
    /// The picture, from 0 to 1, with `maps: [S, S, 5]`: base colour, roughness and metallic.
    fn image<'t>(&self, maps: Var<'t, f32>, lights: &Lights) -> Result<Var<'t, f32>, FitError> {
        let tape = maps.tape();
        let maps = Texture::new(maps)?;
        let places = tape.constant(&self.places);
        let numbers = sample_texture(&maps, places, Detail::Finest, Sampler::new())?;
        let count = numbers.shape()[0];
        let material = Material::MetallicRoughness {
            base_color: numbers.slice(1, 0..3)?,
            roughness: numbers.slice(1, 3..4)?.reshape([count])?,
            metallic: numbers.slice(1, 4..5)?.reshape([count])?,
            conserves_energy: false,
        };
        let [normals, views] = [&self.normals, &self.views].map(|numbers| tape.constant(numbers));
        let surface = Surface { normals, views, positions: None };
        let levels: Vec<_> = lights.reflections.iter().map(|level| tape.constant(level)).collect();
        let reflections = CubeMap::of_levels(&levels)?;
        let environment = Environment { harmonics: tape.constant(&lights.harmonics), reflections };
        let direction = tape.constant(&lights.direction);
        let lamp = Light::Directional { direction, irradiance: tape.constant_full([3], 1.0) };
        let light = environment.shade(&surface, &material)? + shade(&surface, &material, &[lamp])?;
        let fragments = self.fragments.on(tape);
        let image = self.silhouettes.picture(light, &fragments, Background::Zero)?.image()?;
        Ok(srgb_encode(image.clamp(0.0, 1.0)?)?)
    }

    fn still_image(&self, maps: &Tensor<f32>, lights: &Lights) -> Result<Tensor<f32>, FitError> {
        Ok(self.image(Tape::new().constant(maps), lights)?.value())
    }
}

fn run(asked: &Asked) -> Result<Vec<Found>, FitError> {
    let random = &mut Random::new(asked.seed, 0);
    let (truth, lights) = (substance(TEXELS, random), lights(random)?);
    let all = (0..LEARNT + HELD_OUT).map(|_| seen(asked.silhouettes, random));
    let all = all.collect::<Result<Vec<_>, _>>()?;
    let targets = all.iter().map(|seen| seen.still_image(&truth, &lights));
    let targets = targets.collect::<Result<Vec<_>, _>>()?;

    // Sigmoids of these: grey, half rough, half metal.
    let maps = Parameter::new("maps", Tensor::zeros([TEXELS, TEXELS, 5])).rate(0.1);
    let steps = asked.steps(STEPS);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let settings = FitSettings { schedule, ..FitSettings::default() };
    let mut fit = Fit::new(Parameters::new().with(maps)?, settings)?;
    let mut pipeline = views(LEARNT, |view, tape: &Tape<f32>, variables| {
        let image = all[view.index].image(variables[0].sigmoid(), &lights)?;
        Ok(mean_squared_error(image, tape.constant(&targets[view.index]))?)
    })
    .per_step(4)
    .seed(asked.seed);
    let part = |maps: &Tensor<f32>, channels: Range<usize>| -> Result<Tensor<f32>, FitError> {
        Ok(Tape::new().constant(maps).slice(2, channels)?.value())
    };
    let parts = [("base colour", 0..3), ("roughness", 3..4), ("metallic", 4..5)];
    let mut curves = [(); 4].map(|()| Curve::starting_now());
    let mut last = Vec::new();
    for step in 0..=steps {
        if step % 50 == 0 || step == steps {
            let maps = Tape::new().constant(&fit.parameters().value("maps")?).sigmoid().value();
            let held_out = all[LEARNT..].iter().map(|seen| seen.still_image(&maps, &lights));
            last = held_out.collect::<Result<Vec<_>, _>>()?;
            let pairs = last.iter().zip(&targets[LEARNT..]);
            let ratios = pairs.map(|(image, target)| psnr(image, target, 1.0));
            let sum = ratios.sum::<Result<f64, _>>()?;
            curves[0].add(sum / HELD_OUT as f64);
            // Of all texels, seen or not.
            for (curve, (_, own)) in curves[1..].iter_mut().zip(&parts) {
                curve.add(psnr(&part(&maps, own.clone())?, &part(&truth, own.clone())?, 1.0)?);
            }
        }
        if step < steps {
            fit.step(&mut pipeline)?;
        }
    }
    let names = ["held-out views"].into_iter().chain(parts.map(|(name, _)| name));
    let found = names.zip(curves).zip([Goal::Above(30.0), Goal::None, Goal::None, Goal::None]);
    let mut found: Vec<_> = found
        .map(|((name, curve), goal)| {
            Found::last(format!("PSNR of {name}, in dB"), goal, steps, curve)
        })
        .collect();
    let (views, target) = (found.remove(0), &targets[LEARNT]);
    found.insert(0, views.picture("held-out view", &last[0]).picture("its truth", target));
    Ok(found)
}

/// Runs it as a program.
pub fn main() -> Result<(), FitError> {
    bokashi_examples::main(&SAMPLE)
}
