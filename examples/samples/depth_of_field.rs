//! A lens from one defocused picture: its focus and its aperture; then the vertices of what it sees, too.
//!
//! Where vertices are learnt, the nearest board is known: a scene twice as large, with twice the focus,
//! looks the same. How blurred the others are tells how far they are. Coverage is exact: the gradient of
//! antialias sees no distance change between pixel centres, and leaves an error of some 0.5 %.

use bokashi::glam::Vec3;
use bokashi::prelude::*;
use bokashi_examples::stage::{Boards, Random, learn, relative_error};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("depth-of-field", "learns a lens, then a scene, from one photo", Exact);

const SIZE: Size = Size { width: 128, height: 96 };
const APERTURE: f32 = 4.0;
const FOCUS: f32 = 3.5;

struct Scene {
    boards: Boards,
    silhouettes: Silhouettes,
}

impl Scene {
    /// `moves` are relative to the distance.
    fn photo<'t>(
        &self,
        aperture: Var<'t, f32>,
        focus: Var<'t, f32>,
        moves: Var<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let clip = self.boards.clip(moves)?;
        let options = RasterOptions::new(SIZE).silhouettes(self.silhouettes);
        let places = moves.tape().constant(&self.boards.places);
        let mesh = &self.boards.shape.mesh;
        let fragments = rasterize(clip, mesh, options.creases(&[places.into()]))?;
        let stripes = self.boards.stripes(&fragments)?;
        let sharp = fragments.picture(stripes, Background::Zero)?.image()?;
        let distances = eye_depth(&fragments)?.image(&fragments, 50.0)?;
        let lens = Lens { aperture, focus };
        Ok(depth_of_field(sharp, distances, lens, &LensOptions::default())?.image)
    }
}

fn run_case(request: &Request, learns_vertices: bool) -> Result<Vec<Outcome>, FitError> {
    let mut random = Random::new(request.seed, 0);
    let boards = Boards::new(&[2.2, 3.6, 7.0], &mut random)?;
    let zeros = boards.shape.vertices.map(|_| 0.0);
    let scene = Scene { boards, silhouettes: request.silhouettes };
    let tape = Tape::new();
    let [aperture, focus] = [APERTURE, FOCUS].map(|number| tape.constant_scalar(number));
    let target = scene.photo(aperture, focus, tape.constant(&zeros))?.value();

    let positive = |name, start: f32| {
        Parameter::new(name, Tensor::scalar(start)).mapping(Mapping::Softplus).rate(0.03)
    };
    let off = zeros.map(|_| if learns_vertices { random.between(-0.03, 0.03) as f32 } else { 0.0 });
    let moves = Parameter::new("moves", off).rate(1e-3);
    let parameters = Parameters::new()
        .with(positive("aperture", APERTURE * random.between(0.6, 1.4) as f32))?
        .with(positive("focus", FOCUS * random.between(0.8, 1.2) as f32))?
        .with(if learns_vertices { moves } else { moves.frozen() })?;
    let steps = request.steps(if learns_vertices { 2000 } else { 500 });
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let optimizer = Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 };
    let settings = FitSettings { steps, optimizer, schedule, ..FitSettings::default() };
    let mut pipeline = from_fn(|tape: &Tape<f32>, list| {
        Ok(squared_error(scene.photo(list[0], list[1], list[2])?, tape.constant(&target))?)
    });
    let errors = |learnt: &Parameters<f32>| {
        let off =
            |name, truth| Ok::<_, FitError>(relative_error(learnt.value(name)?.data(), &[truth]));
        let moves = learnt.value("moves")?;
        let far = moves.data().chunks(3).skip(4).map(|d| f64::from(Vec3::from_slice(d).length()));
        let mean = far.sum::<f64>() / (moves.shape()[0] - 4) as f64;
        Ok([off("aperture", APERTURE)?, off("focus", FOCUS)?, mean])
    };
    let (parameters, curves) = learn(parameters, settings, &mut pipeline, 10, errors)?;
    let list = parameters.record(&tape);
    let image = scene.photo(list[0], list[1], list[2])?.value();
    let (word, count) = if learns_vertices { ("with vertices", 3) } else { ("alone", 2) };
    let names = ["aperture", "focus", "vertices"].into_iter().zip(curves);
    let outcomes = names.take(count).map(|(name, curve)| {
        let metric = format!("relative error of the {name}, lens {word}");
        Outcome::last(metric, Goal::Below(0.01), steps, curve)
    });
    let mut outcomes: Vec<_> = outcomes.collect();
    outcomes[0] = outcomes[0].clone().picture("target", &target).picture(word, &image);
    Ok(outcomes)
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    Ok([run_case(request, false)?, run_case(request, true)?].concat())
}
