//! What an object is made of, from sixteen pictures: maps of base colour, roughness and metallic, under a
//! known environment and a known lamp. Shape and views are known, so fragments are made once for all steps.
//! Pictures are cut off at 1 and encoded, as a camera does: the lamp's highlights are a hundred times brighter.
//!
//! What counts is how well the maps predict eight views that were held out. The maps themselves are less
//! well known: a rough metal looks much like a dielectric of another colour.

use bokashi::prelude::*;
use bokashi_examples::stage::{
    ConstantLights, ConstantSurface, Random, learn, planet, sky, substance,
};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("material", "learns what an object is made of, from 16 pictures");

const TEXELS: usize = 128;
const LEARNT: usize = 16;
const HELD_OUT: usize = 8;
const MAPS: [&str; 3] = ["base colour", "roughness", "metallic"];

/// What does not change.
struct Scene {
    views: Vec<ConstantSurface>,
    lights: ConstantLights,
}

impl Scene {
    /// The picture of a view, from 0 to 1.
    fn image<'t>(&self, k: usize, maps: &Variables<'t, f32>) -> Result<Var<'t, f32>, FitError> {
        let (view, tape) = (&self.views[k], maps[0].tape());
        let maps = Texture::new(Var::concat(&[maps[0], maps[1], maps[2]], 2)?)?;
        let places = tape.constant(&view.places);
        let numbers = sample_texture(&maps, places, Detail::Finest, Sampler::new())?;
        let count = numbers.shape()[0];
        let material = Material::MetallicRoughness {
            base_color: numbers.slice(1, 0..3)?,
            roughness: numbers.slice(1, 3..4)?.reshape([count])?,
            metallic: numbers.slice(1, 4..5)?.reshape([count])?,
            conserves_energy: false,
        };
        let [normals, views] = [&view.normals, &view.views].map(|rows| tape.constant(rows));
        let surface = Surface { normals, views, positions: None };
        let (environment, lamp) = self.lights.on(tape)?;
        let light = environment.shade(&surface, &material)? + shade(&surface, &material, &[lamp])?;
        let fragments = view.fragments.on(tape);
        let image = fragments.picture(light, Background::Zero)?.image()?;
        Ok(srgb_encode(image.clamp(0.0, 1.0)?)?)
    }
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let random = &mut Random::new(request.seed, 0);
    let parameters = |maps: [Tensor<f32>; 3], mapping: Mapping| {
        MAPS.into_iter().zip(maps).try_fold(Parameters::new(), |list, (name, map)| {
            list.with(Parameter::new(name, map).mapping(mapping).rate(0.1))
        })
    };
    let truth = parameters(substance(TEXELS, random), Mapping::Identity)?;
    let lights = ConstantLights::new(&sky(64, random), random.direction())?;
    let options = RasterOptions::new(Size::square(256)).cull(Cull::Back);
    let (object, options) = (planet()?, options.silhouettes(request.silhouettes));
    let all = 0..LEARNT + HELD_OUT;
    let surfaces =
        all.clone().map(|_| ConstantSurface::new(&object, 3.2 * random.direction(), options));
    let scene = Scene { views: surfaces.collect::<Result<_, _>>()?, lights };
    let draw = |k: usize, maps: &Parameters<f32>| -> Result<_, FitError> {
        Ok(scene.image(k, &maps.record(&Tape::new()))?.value())
    };
    let targets = all.map(|k| draw(k, &truth)).collect::<Result<Vec<_>, _>>()?;
    let grey = [3, 1, 1].map(|channels| Tensor::full([TEXELS, TEXELS, channels], 0.5));

    let steps = request.steps(300);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let settings = FitSettings { steps, schedule, ..FitSettings::default() };
    let mut pipeline = views(LEARNT, |view, tape: &Tape<f32>, maps| {
        Ok(mean_squared_error(scene.image(view.index, maps)?, tape.constant(&targets[view.index]))?)
    })
    .per_step(4)
    .seed(request.seed);
    let ratios = |learnt: &Parameters<f32>| {
        let mut held_out = 0.0;
        for k in LEARNT..LEARNT + HELD_OUT {
            held_out += psnr(&draw(k, learnt)?, &targets[k], 1.0)? / HELD_OUT as f64;
        }
        // Of all texels, seen or not.
        let mut all = [held_out; 4];
        for (ratio, name) in all[1..].iter_mut().zip(MAPS) {
            *ratio = psnr(&learnt.value(name)?, &truth.value(name)?, 1.0)?;
        }
        Ok(all)
    };
    let grey = parameters(grey, Mapping::Sigmoid)?;
    let (learnt, curves) = learn(grey, settings, &mut pipeline, 50, ratios)?;
    let [views, maps @ ..] = curves;
    let views = Outcome::last("PSNR of held-out views, in dB", Goal::Above(30.0), steps, views)
        .picture("held-out view", &draw(LEARNT, &learnt)?)
        .picture("its truth", &targets[LEARNT]);
    let maps = MAPS.into_iter().zip(maps).map(|(name, curve)| {
        Outcome::last(format!("PSNR of {name}, in dB"), Goal::None, steps, curve)
    });
    Ok([views].into_iter().chain(maps).collect())
}
