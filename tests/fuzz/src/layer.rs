//! Layers against images: the same picture and the same squared error, by either way.

use std::cell::Cell;

use arbitrary::{Result, Unstructured};
use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::{
    Background, Mesh, RasterOptions, Sampling, Target, antialias, interpolate, layer, rasterize,
    resolve,
};

use super::mesh::{check_pieces, faces, sampling, size};
use super::number::{Range, bits, expanded};
use super::step::check;

/// Runs the layer that `bytes` stand for; returns the number of its pixels, the rim included.
pub fn layers(bytes: &[u8]) -> usize {
    let bytes = expanded(bytes);
    let mut bytes = Unstructured::new(&bytes);
    let done = match bytes.arbitrary::<bool>() {
        Ok(true) => run::<f64>(&mut bytes),
        _ => run::<f32>(&mut bytes),
    };
    // Bytes that end too early stand for nothing.
    done.unwrap_or(0)
}

fn run<T: Scalar>(bytes: &mut Unstructured<'_>) -> Result<usize> {
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
    // Of the same background, so that pixels beside the layer are left out, or of another one.
    let behind = if background > 1 { color.clone() } else { Tensor::zeros([channels]) };
    let sampling = sampling(bytes)?;
    let options = RasterOptions { sampling, ..size.into() };
    let Ok(target) = Target::new(&image, &behind) else { return Ok(0) };

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
            let fragments = rasterize(clip, &mesh, options)?;
            check_pieces(&fragments);
            let surface = interpolate(attributes, &fragments)?;
            let mut layer = layer(surface, &fragments, background)?;
            let mut whole = resolve(surface, &fragments, background)?;
            if sampling == Sampling::Center {
                layer = layer.antialias(clip)?;
                whole = antialias(whole, &fragments, clip)?;
            }
            reached.set(layer.values.shape()[0]);
            let [found, expected] = [layer.image()?.value(), whole.value()];
            assert_eq!(bits(found.data()), bits(expected.data()), "the picture");
            let loss = layer.squared_error(&target)?;
            let terms = whole.try_sub(tape.constant(target.image()))?.value();
            let expected: f64 = terms.data().iter().map(|term| term.to_f64().powi(2)).sum();
            let is_close = (loss.item().to_f64() - expected).abs() <= tolerance * expected;
            assert!(is_close || !is_stated, "loss {} instead of {expected}", loss.item());
            Ok::<_, bokashi_render_ops::RenderError>(loss)
        },
    );
    Ok(reached.get())
}
