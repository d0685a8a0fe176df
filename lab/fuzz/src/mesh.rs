//! Faces and positions in clip space: rasterize, interpolate, composite, antialias.

use std::cell::Cell;

use arbitrary::{Result, Unstructured};
use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::{
    Background, Cull, Fragments, Mesh, RasterOptions, Sampling, Size, depth, interpolate,
    interpolate_indexed, rasterize,
};

use super::number::{Range, in_either_precision};
use super::step::check;

/// Runs the mesh that `bytes` stand for; returns the number of fragments.
pub fn mesh(bytes: &[u8]) -> usize {
    in_either_precision(bytes, run::<f32>, run::<f64>)
}

/// Faces over `vertex_count` vertices, one index in 32 out of range.
pub(super) fn faces(bytes: &mut Unstructured<'_>, vertex_count: usize) -> Result<Vec<[u32; 3]>> {
    let count = bytes.int_in_range(0..=16)?;
    let mut faces = Vec::with_capacity(count);
    for _ in 0..count {
        let mut face = [0; 3];
        for index in &mut face {
            let most = vertex_count + usize::from(bytes.ratio(1, 32)?);
            *index = bytes.int_in_range(0..=most.saturating_sub(1))? as u32;
        }
        faces.push(face);
    }
    Ok(faces)
}

/// A size of up to 16 pixels a side, 0 included.
pub(super) fn size(bytes: &mut Unstructured<'_>) -> Result<Size> {
    Ok(Size { width: bytes.int_in_range(0..=16)?, height: bytes.int_in_range(0..=16)? })
}

/// What a pixel is the picture of: read last, since inputs were kept before there was a choice.
pub(super) fn sampling(bytes: &mut Unstructured<'_>) -> Result<Sampling> {
    Ok(if bytes.arbitrary::<u8>()? & 1 == 0 { Sampling::Center } else { Sampling::Exact })
}

/// Pieces of a pixel cover some of it each, or none, beside a side on the pixel's border; and no more
/// than all of it together.
pub(super) fn check_pieces<T: Scalar>(fragments: &Fragments<'_, T>) {
    let Some(weights) = fragments.weight.map(|weight| weight.value()) else { return };
    let slack = if size_of::<T>() == 4 { 1e-6 } else { 1e-12 };
    let coverage = &fragments.coverage;
    for (pixel, pieces) in coverage.boundary() {
        let weight = |&piece: &u32| weights.data()[piece as usize - coverage.centers()].to_f64();
        let weights: Vec<_> = pieces.iter().map(weight).collect();
        let total: f64 = weights.iter().sum();
        assert!(weights.iter().all(|&weight| weight >= 0.0), "{weights:?} in pixel {pixel}");
        assert!(total <= 1.0 + slack, "{total} of pixel {pixel}");
    }
}

/// Weights within the face, depths within the view, one fragment per pixel.
pub(super) fn check_fragments<T: Scalar>(fragments: &Fragments<'_, T>) {
    let slack = if size_of::<T>() == 4 { 1e-5 } else { 1e-12 };
    let depth = depth(fragments).expect("fragments that are whole").value();
    let centers = fragments.coverage.centers();
    let weights = fragments.barycentrics.value();
    // The weights of a piece are rounded the more coarsely the smaller it is.
    for weights in weights.data().chunks_exact(2).take(centers) {
        let (u, v) = (weights[0].to_f64(), weights[1].to_f64());
        for weight in [u, v, 1.0 - u - v] {
            assert!((-slack..=1.0 + slack).contains(&weight), "weights {u} {v}");
        }
    }
    let depths = &depth.data()[..centers];
    assert!(depths.iter().all(|depth| (-1.0..=1.0).contains(&depth.to_f64())), "{depth:?}");
    let coverage = &fragments.coverage;
    for (fragment, pixel) in coverage.pixels().enumerate().take(centers) {
        assert_eq!(coverage.fragment_at(pixel), Some(fragment));
    }
    let culled = coverage.culled();
    let drawn_or_culled = culled.degenerate + culled.outside + culled.facing;
    assert!(drawn_or_culled <= coverage.mesh().faces().len());
}

fn run<T: Scalar>(bytes: &mut Unstructured<'_>) -> Result<usize> {
    let range = Range::choose::<T>(bytes)?;
    let size = size(bytes)?;
    let cull = *bytes.choose(&[Cull::None, Cull::Back, Cull::Front])?;
    let vertex_count = bytes.int_in_range(0..=12)?;
    let channels = bytes.int_in_range(1..=4)?;
    let faces = faces(bytes, vertex_count)?;
    let face_count = faces.len();
    let Ok(mesh) = Mesh::new(faces, vertex_count) else { return Ok(0) };
    let background: u8 = bytes.int_in_range(0..=2)?;
    let indexed = bytes.ratio(1, 4)?;
    let clip: Tensor<T> = range.tensor(bytes, &[vertex_count, 4])?;
    // Attributes of a mesh of their own, of one vertex, where they are indexed.
    let rows = if indexed { 1 } else { vertex_count };
    let attributes = range.tensor(bytes, &[rows, channels])?;
    let behind = match background {
        1 => range.tensor(bytes, &[channels])?,
        _ => range.tensor(bytes, &[size.height, size.width, channels])?,
    };
    let attribute_mesh = indexed.then(|| Mesh::new(vec![[0; 3]; face_count], 1));
    let attribute_mesh = attribute_mesh.transpose().expect("indices of 0 below 1");
    let sampling = sampling(bytes)?;
    // The third weight of a piece is what is missing to 1: of a vertex that is nearly all of w it
    // has to be more than rounding for a depth.
    let has_depths = sampling == Sampling::Center
        || clip.data().iter().skip(3).step_by(4).all(|w| (0.01..100.0).contains(&w.abs().to_f64()));
    let options = RasterOptions::new(size).cull(cull).sampling(sampling);

    let inputs = [clip, attributes, behind];
    let upstream = |k: usize| T::from_f64(0.5 - (k % 3) as f64);
    let reached = Cell::new(0);
    check(&inputs, range.is_stated(), upstream, |_, inputs| {
        let &[clip, attributes, behind] = inputs else { unreachable!("three inputs") };
        let fragments = rasterize(clip, &mesh, options.creases(&[]))?;
        check_fragments(&fragments);
        check_pieces(&fragments);
        reached.set(fragments.coverage.count());
        let count = fragments.coverage.count();
        let surface = match &attribute_mesh {
            Some(mesh) => interpolate_indexed(attributes, mesh, &fragments)?,
            None => interpolate(attributes, &fragments)?,
        };
        let background = match background {
            0 => Background::Zero,
            1 => Background::Color(behind),
            _ => Background::Image(behind),
        };
        // Darker with depth, so that depths have gradients too.
        let surface =
            if has_depths { surface * depth(&fragments)?.reshape([count, 1])? } else { surface };
        fragments.picture(surface, background)?.image()
    });
    Ok(reached.get())
}
