//! What was the lens focused at? A photo shows three boards at different distances, and one of them is
//! sharp. The focus is learnt from the scene's own distances, together with the aperture.
//!
//! Nothing moves, so the boards are rasterized once, and their fragments outlive every step.

use bokashi::prelude::*;

const SIZE: Size = Size { width: 72, height: 48 };

/// Three striped boards side by side, at these distances from the eye.
const DISTANCES: [f64; 3] = [2.0, 3.5, 7.0];

/// The fragments of the boards.
fn boards() -> Result<ConstantFragments<f64>, FitError> {
    let mut corners = Vec::new();
    for (k, distance) in DISTANCES.into_iter().enumerate() {
        // As large in the picture as the others.
        let across = [-0.52, -0.16, 0.2].map(|left| left * distance)[k];
        for (x, y) in [(0.0, -0.26), (0.32, -0.26), (0.0, 0.26), (0.32, 0.26)] {
            corners.push([across + x * distance, y * distance, -distance]);
        }
    }
    let square = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4)?;
    let boards = Assembly::new(&[(&square, DISTANCES.len())])?;
    let tape = Tape::new();
    let positions = tape.constant(&Tensor::from(corners));
    let clip = project(positions, &perspective(0.7, 1.5, 0.1, 50.0), None)?;
    Ok(rasterize(clip, boards.mesh(), SIZE)?.constant())
}

/// What a lens makes of the boards: their picture, out of focus where they are.
fn photo<'t>(
    boards: &ConstantFragments<f64>,
    lens: Lens<'t, f64>,
) -> Result<Var<'t, f64>, FitError> {
    let tape = lens.focus.tape();
    let fragments = boards.on(tape);
    // Stripes of three pixels.
    let stripe = |pixel: usize| 0.2 + 0.6 * (pixel % SIZE.width / 3 % 2) as f64;
    let stripes: Vec<_> = fragments.coverage.pixels().map(|pixel| [stripe(pixel)]).collect();
    let stripes = tape.constant(&Tensor::from(stripes));
    let sharp = fragments.picture(stripes, Background::Zero)?.image()?;
    let distances = eye_depth(&fragments)?.image(&fragments, 50.0)?;
    Ok(depth_of_field(sharp, distances, lens, &LensOptions::default())?.image)
}

fn main() -> Result<(), FitError> {
    let boards = boards()?;
    let tape = Tape::new();
    let truth = Lens { aperture: tape.constant_scalar(3.0), focus: tape.constant_scalar(3.5) };
    let taken = photo(&boards, truth)?.value();

    let positive = |name, start: f64| Parameter::new(name, start.into()).mapping(Mapping::Softplus);
    let parameters = Parameters::new()
        .with(positive("aperture", 2.0).rate(0.06))?
        .with(positive("focus", 2.2).rate(0.06))?;
    let schedule = Schedule::Cosine { steps: 300, floor: 0.0 };
    let mut fit =
        Fit::new(parameters, FitSettings { steps: 300, schedule, ..FitSettings::default() })?;
    let history = fit.run(&mut from_fn(|tape: &Tape<f64>, variables| {
        let lens = Lens { aperture: variables.get("aperture")?, focus: variables.get("focus")? };
        Ok(squared_error(photo(&boards, lens)?, tape.constant(&taken))?)
    }))?;
    println!("loss      {:.1e} -> {:.1e}", history.initial().loss, history.last().loss);
    for (name, truth) in [("aperture", "3 pixels at infinity"), ("focus", "3.5 units")] {
        println!("{name:8}  {:.5}, the truth is {truth}", fit.parameters().value(name)?.item());
    }
    Ok(())
}
