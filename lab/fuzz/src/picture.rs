//! Pictures before a colour, and before an image of that colour: the same picture and squared error.

use std::cell::Cell;

use arbitrary::Unstructured;
use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::{
    Background, Mesh, PixelLoss, RasterOptions, RenderError, interpolate, rasterize,
};

use super::mesh::{check_pieces, faces, sampling, size};
use super::number::{Range, bits, in_either_precision};
use super::step::check;

/// Runs the picture that `bytes` stand for; returns the number of its pixels, blended ones included.
pub fn pictures(bytes: &[u8]) -> usize {
    in_either_precision(bytes, run::<f32>, run::<f64>)
}

fn run<T: Scalar>(bytes: &mut Unstructured<'_>) -> arbitrary::Result<usize> {
    let range = Range::choose::<T>(bytes)?;
    let size = size(bytes)?;
    let vertex_count = bytes.int_in_range(0..=12)?;
    let channels = bytes.int_in_range(1..=4)?;
    let faces = faces(bytes, vertex_count)?;
    let Ok(mesh) = Mesh::new(faces, vertex_count) else { return Ok(0) };
    let background: u8 = bytes.int_in_range(0..=3)?;
    let clip: Tensor<T> = range.tensor(bytes, &[vertex_count, 4])?;
    let attributes = range.tensor(bytes, &[vertex_count, channels])?;
    let color = range.tensor(bytes, &[channels])?;
    let image: Tensor<T> = range.tensor(bytes, &[size.height, size.width, channels])?;
    // Of the same background, so that pixels beside the picture are left out, or of another one.
    let behind = if background > 1 { color.clone() } else { Tensor::zeros([channels]) };
    let sampling = sampling(bytes)?;
    let options = RasterOptions::new(size).sampling(sampling);
    let Ok(reference) = PixelLoss::squared(&image, &behind) else { return Ok(0) };

    let is_stated = range.is_stated();
    let tolerance = if size_of::<T>() == 4 { 1e-4 } else { 1e-12 };
    let reached = Cell::new(0);
    check(
        &[clip, attributes, color],
        false,
        |_| T::ONE,
        |tape, inputs| {
            let &[clip, attributes, behind] = inputs else { unreachable!("three inputs") };
            let background = match background {
                0 | 3 => Background::Zero,
                1 => Background::Color(behind),
                _ => Background::Color(tape.constant(&behind.value())),
            };
            let fragments = rasterize(clip, &mesh, options.creases(&[]))?;
            check_pieces(&fragments);
            let surface = interpolate(attributes, &fragments)?;
            let before = |background| fragments.picture(surface, background);
            let picture = before(background)?;
            reached.set(picture.values().shape()[0]);
            let color = match background {
                Background::Color(color) => color.value().data().to_vec(),
                _ => vec![T::ZERO; channels],
            };
            let sky =
                Tensor::from_flat_fn([size.height, size.width, channels], |k| color[k % channels]);
            let whole = before(Background::Image(tape.constant(&sky)))?.image()?;
            let [found, expected] = [picture.image()?.value(), whole.value()];
            assert_eq!(bits(found.data()), bits(expected.data()), "the picture");
            let loss = picture.loss(&reference)?;
            let terms = whole.try_sub(tape.constant(reference.reference()))?.value();
            let expected: f64 = terms.data().iter().map(|term| term.to_f64().powi(2)).sum();
            let is_close = (loss.item().to_f64() - expected).abs() <= tolerance * expected;
            assert!(is_close || !is_stated, "loss {} instead of {expected}", loss.item());
            Ok::<_, RenderError>(loss)
        },
    );
    Ok(reached.get())
}
