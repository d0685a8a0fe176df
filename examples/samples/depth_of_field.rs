//! A lens from one defocused picture: its focus and its aperture; then the vertices of what it sees, too.
//!
//! Where vertices are learnt, the nearest board is known: a picture of a scene twice as large, with twice
//! the focus, is the same. How blurred the other boards are then tells how far they are.

use bokashi::prelude::*;
use bokashi_examples::stage::Random;
use bokashi_examples::{Asked, Curve, Found, Goal, Sample, Silhouettes};

/// This sample.
pub const SAMPLE: Sample = Sample {
    name: "depth-of-field",
    about: "learns a lens, then a scene, from one blurred picture",
    run,
};

const SIZE: Size = Size { width: 128, height: 96 };
const STEPS: u64 = 500;
const APERTURE: f64 = 4.0;
const FOCUS: f64 = 3.5;
const BOARDS: usize = 3;

/// Striped boards: corners in space and on the board.
struct Scene {
    mesh: Mesh,
    corners: Tensor<f32>,
    places: Tensor<f32>,
    silhouettes: Silhouettes,
}

/// Boards side by side, from near to far, each slanted.
fn scene(asked: &Asked, random: &mut Random) -> Result<Scene, FitError> {
    let square = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4)?;
    let mesh = Assembly::new(&[(&square, BOARDS)])?.mesh().clone();
    let mut corners = Vec::new();
    for (k, distance) in [2.2, 3.6, 7.0].into_iter().enumerate() {
        let slant = random.between(0.2, 0.35);
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            // As wide in the picture as the others.
            let depth = distance * (1.0 + slant * x * [1.0, -1.0, 1.0][k]);
            let across = [-0.31, 0.0, 0.31][k] + 0.14 * x;
            corners.push([across * depth, 0.27 * y * depth, -depth].map(|x| x as f32));
        }
    }
    let places = Tensor::from_fn([4 * BOARDS, 2], |[corner, axis]| (corner >> axis & 1) as f32);
    Ok(Scene { mesh, corners: Tensor::from(corners), places, silhouettes: asked.silhouettes })
}

impl Scene {
    fn photo<'t>(
        &self,
        corners: Var<'t, f32>,
        lens: Lens<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let tape = corners.tape();
        let clip = project(corners, &perspective(0.7, 4.0 / 3.0, 0.1, 50.0), None)?;
        let fragments = rasterize(clip, &self.mesh, self.silhouettes.options(SIZE))?;
        let places = interpolate(tape.constant(&self.places), &fragments)?;
        // Stripes along and across, in other ways for each channel.
        let waves = tape.constant(&Tensor::from([[21.0, 3.0, 14.0], [4.0, 27.0, 17.0]]));
        let stripes = places.matmul(waves)?.sin() * 0.4 + 0.5;
        let sharp = self.silhouettes.picture(stripes, &fragments, Background::Zero)?.image()?;
        let distances = eye_depth(&fragments)?.image(&fragments, 50.0)?;
        Ok(depth_of_field(sharp, distances, lens, &LensOptions::default())?.image)
    }
}

fn learn(asked: &Asked, with_corners: bool) -> Result<Vec<Found>, FitError> {
    let mut random = Random::new(asked.seed, 0);
    let scene = scene(asked, &mut random)?;
    let tape = Tape::new();
    let [aperture, focus] = [APERTURE, FOCUS].map(|number| tape.constant_scalar(number as f32));
    let target = scene.photo(tape.constant(&scene.corners), Lens { aperture, focus })?.value();

    // What is off: 2 % of the distance, but not at the first board.
    let off = Tensor::from_fn([4 * BOARDS, 3], |[corner, axis]| {
        let distance = -scene.corners.data()[3 * corner + 2];
        let is_free = with_corners && corner >= 4;
        if is_free {
            distance * random.between(-0.02, 0.02) as f32 * [0.5, 0.5, 1.0][axis]
        } else {
            0.0
        }
    });
    let positive = |name, start: f64| {
        Parameter::new(name, Tensor::scalar(start as f32)).mapping(Mapping::Softplus).rate(0.03)
    };
    let moves = Parameter::new("moves", off).rate(2e-3);
    let parameters = Parameters::new()
        .with(positive("aperture", APERTURE * random.between(0.6, 1.4)))?
        .with(positive("focus", FOCUS * random.between(0.8, 1.2)))?
        .with(if with_corners { moves } else { moves.frozen() })?;
    let steps = asked.steps(if with_corners { 4 * STEPS } else { STEPS });
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let mut fit = Fit::new(parameters, FitSettings { schedule, ..FitSettings::default() })?;
    let free = Tensor::from_fn([4 * BOARDS, 3], |[corner, _]| if corner < 4 { 0.0 } else { 1.0 });
    let mut curves = [(); 3].map(|()| Curve::starting_now());
    let mut image = target.clone();
    for _ in 0..steps {
        fit.step(&mut from_fn(|tape: &Tape<f32>, variables| {
            let corners = tape.constant(&scene.corners) + variables[2] * tape.constant(&free);
            let lens = Lens { aperture: variables[0], focus: variables[1] };
            let photo = scene.photo(corners, lens)?;
            image = photo.value();
            Ok(squared_error(photo, tape.constant(&target))?)
        }))?;
        let value = |name| fit.parameters().value(name);
        let relative = |name, truth: f64| {
            Ok::<_, FitError>((f64::from(value(name)?.item()) / truth - 1.0).abs())
        };
        curves[0].add(relative("aperture", APERTURE)?);
        curves[1].add(relative("focus", FOCUS)?);
        let moves = value("moves")?;
        let pairs = moves.data().chunks(3).zip(scene.corners.data().chunks(3));
        let far = pairs.map(|(d, at)| d.iter().map(|x| x * x).sum::<f32>().sqrt() / -at[2]);
        curves[2].add(f64::from(far.sum::<f32>()) / (4 * BOARDS - 4) as f64);
    }
    let word = if with_corners { "with vertices" } else { "alone" };
    let names = ["aperture", "focus", "vertices"].into_iter().zip(curves);
    let found = names.take(if with_corners { 3 } else { 2 }).map(|(name, curve)| {
        let metric = format!("relative error of the {name}, lens {word}");
        Found::last(metric, Goal::Below(0.01), steps, curve)
    });
    let mut found: Vec<_> = found.collect();
    found[0].pictures =
        vec![("target".into(), target.cast()), (format!("lens {word}"), image.cast())];
    Ok(found)
}

fn run(asked: &Asked) -> Result<Vec<Found>, FitError> {
    Ok([learn(asked, false)?, learn(asked, true)?].concat())
}

/// Runs it as a program.
pub fn main() -> Result<(), FitError> {
    bokashi_examples::main(&SAMPLE)
}
