//! The texture of a sphere that is seen from near and far, with and without mipmaps.
//!
//! Far away a pixel sees many texels. Without mipmaps it takes four of them for all, and pulls these four
//! towards the mean. The target is drawn four times as large along each axis, and then averaged. The set-up
//! is that of the sample `earth` of Laine et al. 2020, with a texture of our own.

use bokashi::glam::{DMat4, DVec3};
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, globe, learn, sphere};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("earth", "learns the texture of a sphere seen from near and far");

const SIDE: usize = 512;
const STEPS: u64 = 3000;
const TEXELS: [usize; 2] = [128, 256];

struct Scene {
    sphere: Shape,
    coordinates: Tensor<f32>,
    silhouettes: Silhouettes,
}

impl Scene {
    fn image<'t>(
        &self,
        texture: &Texture<'t, f32>,
        camera: &DMat4,
        side: usize,
    ) -> Result<Var<'t, f32>, RenderError> {
        let tape = texture.levels()[0].tape();
        let clip = project(tape.constant(&self.sphere.vertices), camera, None)?;
        let options = RasterOptions::new(Size::square(side)).cull(Cull::Back);
        let options = options.silhouettes(self.silhouettes);
        let coordinates = tape.constant(&self.coordinates);
        let creases = [coordinates.into()];
        let fragments = rasterize(clip, &self.sphere.mesh, options.creases(&creases))?;
        let places = interpolate(coordinates, &fragments)?;
        let detail = if texture.levels().len() > 1 {
            let steps = differentials(&fragments)?;
            let differentials = interpolate_differentials(coordinates, &fragments, steps)?;
            Detail::Differentials { differentials, bias: None }
        } else {
            Detail::Finest
        };
        let surface = sample_texture(texture, places, detail, Sampler::new())?;
        fragments.picture(surface, Background::Zero)?.image()
    }
}

/// A sphere of radius 1/2, turned at random, 1.5 to 50 in front of the camera.
fn camera(random: &mut Random) -> DMat4 {
    let projection = perspective(2.0 * 0.4_f64.atan(), 1.0, 0.9, 200.0);
    let position = DVec3::new(0.0, 0.0, -random.between(1.5, 50.0));
    projection
        * DMat4::from_scale_rotation_translation(DVec3::splat(0.5), random.rotation(), position)
}

fn run_case(request: &Request, has_mipmaps: bool) -> Result<Outcome, FitError> {
    let (sphere, coordinates) = sphere(24)?;
    let scene = Scene { sphere, coordinates, silhouettes: request.silhouettes };
    let truth = globe(TEXELS, &mut Random::new(request.seed, 0));
    let texels = Tensor::full([TEXELS[0], TEXELS[1], 3], 0.3);
    let texels = Parameter::new("texels", texels).rate(1e-2);
    let steps = request.steps(STEPS);
    let schedule = Schedule::Exponential { steps, factor: 0.1, floor: 0.0 };
    // Gradients of near and far views differ a hundredfold: their squares are soon forgotten.
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 };
    let settings = FitSettings { steps, optimizer, schedule, ..FitSettings::default() };
    let mut pipeline = views(1, |view, tape: &Tape<f32>, variables| {
        let camera = camera(&mut Random::new(request.seed, 1 + view.step));
        let texture = Texture::with_mipmaps(tape.constant(&truth))?;
        let fine = scene.image(&texture, &camera, 4 * SIDE)?;
        let target = downsample(fine, 4, &Filter::Box, Border::Mirror)?;
        let texels = variables.get("texels")?;
        let texture =
            if has_mipmaps { Texture::with_mipmaps(texels)? } else { Texture::new(texels)? };
        Ok(mean_squared_error(scene.image(&texture, &camera, SIDE)?, target)?)
    });
    let ratio = |learnt: &Parameters<f32>| Ok([psnr(&learnt.value("texels")?, &truth, 1.0)?]);
    let texels = Parameters::new().with(texels)?;
    let (learnt, [curve]) = learn(texels, settings, &mut pipeline, 100, ratio)?;
    let word = if has_mipmaps { "with" } else { "without" };
    let metric = format!("texture PSNR in dB, {word} mipmaps");
    let pictures = Outcome::last(metric, Goal::None, steps, curve).picture("true texture", &truth);
    Ok(pictures.picture("learnt", &learnt.value("texels")?))
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let [with, without] = [run_case(request, true)?, run_case(request, false)?];
    let (ahead, seconds) = (with.value - without.value, with.seconds + without.seconds);
    let curve = vec![(seconds, ahead)];
    let (metric, goal) = ("mipmaps ahead by, in dB".to_owned(), Goal::Above(3.0));
    let steps = with.steps;
    let ahead = Outcome { metric, value: ahead, goal, steps, seconds, curve, pictures: Vec::new() };
    Ok(vec![with, without, ahead])
}
