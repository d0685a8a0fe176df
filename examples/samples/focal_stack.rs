//! A focal stack: three photos of one camera, each with an aperture and a focus of its own. Learnt are both of each
//! photo, from up to a quarter off, and the places of two boards: how blurred they are tells how far.
//! The third board is known: a scene twice as large with twice the focus looks the same. The lens that learns has not
//! drawn the photos: each is the mean of what 256 points of a lens see.

use bokashi::glam::Vec3;
use bokashi::prelude::*;
use bokashi_examples::stage::{Boards, Random, learn, mean_through_lens, relative_error};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!(
    "focal-stack",
    "learns three lenses and a scene from a focal stack",
    Exact
);

const SIZE: Size = Size { width: 80, height: 60 };
const MARGIN: usize = 12;
const APERTURES: [f32; 3] = [5.0, 4.5, 4.0];
const FOCI: [f32; 3] = [2.4, 3.6, 5.5];

/// What a lens sees.
fn photo(boards: &Boards, lens: [f32; 2]) -> Result<Tensor<f32>, FitError> {
    let tape = Tape::new();
    let clip = boards.clip(tape.constant(&boards.shape.vertices.map(|_| 0.0)))?.value();
    mean_through_lens(&clip, SIZE, lens, 256, |clip| {
        let options = RasterOptions::new(SIZE).silhouettes(Silhouettes::Exact);
        let places = clip.tape().constant(&boards.places);
        let fragments = rasterize(clip, &boards.shape.mesh, options.creases(&[places.into()]))?;
        Ok(fragments.picture(boards.stripes(&fragments)?, Background::Zero)?.image()?)
    })
}

/// What the lens that learns sees, from what is visible and what that hides.
fn drawn<'t>(
    boards: &Boards,
    moves: Var<'t, f32>,
    lens: ThinLens<'t, f32>,
    look: Silhouettes,
) -> Result<Var<'t, f32>, FitError> {
    let tape = moves.tape();
    let [width, height] = [SIZE.width, SIZE.height].map(|pixels| pixels + 2 * MARGIN);
    let share = [SIZE.width as f32 / width as f32, SIZE.height as f32 / height as f32, 1.0, 1.0];
    let clip = boards.clip(moves)? * tape.constant(&Tensor::from([share]));
    let (mesh, options) = (&boards.shape.mesh, RasterOptions::new(Size { width, height }));
    let places = [tape.constant(&boards.places).into()];
    let mut layers = vec![rasterize(clip, mesh, options.silhouettes(look).creases(&places))?];
    layers.extend(depth_layers(clip, mesh, options.silhouettes(Silhouettes::Aliased), Some(2))?);
    let seen = |fragments| -> Result<_, FitError> {
        let premultiplied = boards.stripes(fragments)?;
        let alpha = tape.constant_full([fragments.coverage.count()], 1.0);
        Ok(LensLayer::from_fragments(fragments, premultiplied, alpha)?)
    };
    let layers = layers.iter().map(seen).collect::<Result<Vec<_>, _>>()?;
    let far = f64::INFINITY;
    let options = ThinLensOptions { margin: MARGIN, ..ThinLensOptions::default() };
    Ok(lens_picture(layers[0], &layers[1..], Background::Zero, far, lens, &options)?.image)
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let mut random = Random::new(request.seed, 0);
    let boards = Boards::new(&[2.2, 3.6, 7.0], &mut random)?;
    let photos = (0..3).map(|k| photo(&boards, [APERTURES[k], FOCI[k]]));
    let photos = photos.collect::<Result<Vec<_>, _>>()?;
    let moves = boards.shape.vertices.map(|_| random.between(-0.03, 0.03) as f32);
    let mut positive = |name, truth: [f32; 3]| {
        let start = truth.map(|number| number * random.between(0.75, 1.25) as f32);
        Parameter::new(name, Tensor::from(start)).mapping(Mapping::Exp).rate(0.02)
    };
    let parameters = Parameters::new()
        .with(positive("apertures", APERTURES))?
        .with(positive("foci", FOCI))?
        .with(Parameter::new("moves", moves).rate(2e-3))?;
    let steps = request.steps(300);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let settings = FitSettings { steps, schedule, ..FitSettings::default() };
    let mut pipeline = from_fn(|tape: &Tape<f32>, list| {
        let losses = photos.iter().enumerate().map(|(k, photo)| {
            let [aperture, focus] = [list[0].slice(0, k..k + 1)?, list[1].slice(0, k..k + 1)?];
            let lens = ThinLens { aperture, focus };
            let image = drawn(&boards, list[2], lens, request.silhouettes)?;
            Ok::<_, FitError>(squared_error(image, tape.constant(photo))?)
        });
        losses.reduce(|a, b| Ok(a? + b?)).expect("three photos")
    });
    let errors = |learnt: &Parameters<f32>| {
        let off =
            |name, truth| Ok::<_, FitError>(relative_error(learnt.value(name)?.data(), truth));
        let moves = learnt.value("moves")?;
        let far = moves.data().chunks(3).skip(4).map(|d| f64::from(Vec3::from_slice(d).length()));
        Ok([off("apertures", &APERTURES)?, off("foci", &FOCI)?, far.sum::<f64>() / 8.0])
    };
    let (_, curves) = learn(parameters, settings, &mut pipeline, 10, errors)?;
    let goals = [("apertures", 0.03), ("foci", 0.03), ("vertices", 0.01)].into_iter().zip(curves);
    let outcome = |((what, goal), curve)| {
        Outcome::last(format!("relative error of the {what}"), Goal::Below(goal), steps, curve)
    };
    Ok(goals.map(outcome).collect())
}
