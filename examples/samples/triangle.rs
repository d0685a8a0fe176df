//! A triangle with a colour at each corner. Nothing is learnt: this is the shortest way to a picture.

use bokashi::prelude::*;
use bokashi_examples::{Curve, Goal, Outcome, Request};

bokashi_examples::sample!("triangle", "draws a triangle with a colour at each corner");

const SIDE: usize = 256;

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let mut curve = Curve::starting_now();
    let tape = Tape::<f64>::new();
    let corners = [[-0.8, -0.8, 0.0, 1.0], [0.8, -0.8, 0.0, 1.0], [-0.8, 0.8, 0.0, 1.0]];
    let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let clip = tape.constant(&Tensor::from(corners.to_vec()));
    let mesh = Mesh::new(vec![[0, 1, 2]], 3)?;
    let colors = tape.constant(&Tensor::from(colors.to_vec()));
    let options = RasterOptions::new(Size::square(SIDE)).silhouettes(request.silhouettes);
    let image = render(clip, &mesh, colors, options, Background::Zero)?.image()?.value();

    // The same from the formula: the barycentrics of each pixel's centre.
    let truth = Tensor::from_fn([SIDE, SIDE, 3], |[row, column, channel]| {
        let [right, up] = [column, SIDE - 1 - row].map(|k| (2 * k + 1) as f64 / SIDE as f64 - 1.0);
        let [green, blue] = [right, up].map(|x| (x + 0.8) / 1.6);
        let weights = [1.0 - green - blue, green, blue];
        if weights.iter().all(|&weight| weight >= 0.0) { weights[channel] } else { 0.0 }
    });
    curve.add(psnr(&image, &truth, 1.0)?);
    let metric = "PSNR against the formula at pixel centres, in dB";
    Ok(vec![Outcome::last(metric, Goal::Above(25.0), 0, curve).picture("picture", &image)])
}
