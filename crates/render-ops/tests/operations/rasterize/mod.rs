//! Laws of rasterization: against an oracle that solves a linear system per pixel and face, then
//! identities, then the extreme cases.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Cull, Culled, Mesh, RasterOptions, RenderError, Size, depth, rasterize};
use proptest::prelude::*;

mod blocks;
mod crowded;
mod exact;
mod extremes;
mod layers;
mod nearest;
mod oracle;
mod perspective;
mod pixel_borders;
mod sheets;
mod ties;
mod watertight;

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
struct VisibleFace {
    face: u32,
    uv: [f64; 2],
    depth: f64,
}

/// A picture: what each pixel sees, row by row from the top, and which faces were not drawn.
#[derive(Debug, PartialEq)]
struct Drawn {
    pixels: Vec<Option<VisibleFace>>,
    culled: Culled,
}

impl Drawn {
    fn faces(&self) -> Vec<Option<u32>> {
        self.pixels.iter().map(|seen| seen.map(|seen| seen.face)).collect()
    }

    fn count(&self) -> usize {
        self.pixels.iter().flatten().count()
    }
}

type Clip = Vec<[f64; 4]>;

fn try_draw<T: Scalar>(
    clip: &Clip,
    faces: &[[u32; 3]],
    options: impl Into<RasterOptions>,
) -> Result<Drawn, RenderError> {
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&tensor(clip));
    let mesh = Mesh::new(faces.to_vec(), clip.len())?;
    let fragments = rasterize(positions, &mesh, options.into().creases(&[]))?;
    let coverage = &fragments.coverage;
    assert_eq!(fragments.barycentrics.shape(), [coverage.count(), 2].into());
    let depth = depth(&fragments)?;
    assert_eq!(depth.shape(), [coverage.count()].into());
    let (uv, depth) = (fragments.barycentrics.value(), depth.value());
    let faces: Vec<_> = coverage.faces().collect();
    let seen = |n: usize| VisibleFace {
        face: faces[n] as u32,
        uv: [uv.data()[2 * n].to_f64(), uv.data()[2 * n + 1].to_f64()],
        depth: depth.data()[n].to_f64(),
    };
    let pixels: Vec<_> =
        (0..coverage.size().pixels()).map(|pixel| coverage.fragment_at(pixel).map(seen)).collect();
    assert_eq!(pixels.iter().flatten().count(), coverage.count());
    let places = coverage.pixels().map(|pixel| coverage.fragment_at(pixel));
    assert!(places.eq((0..coverage.count()).map(Some)));
    Ok(Drawn { pixels, culled: coverage.culled() })
}

fn draw<T: Scalar>(clip: &Clip, faces: &[[u32; 3]], options: impl Into<RasterOptions>) -> Drawn {
    try_draw::<T>(clip, faces, options).unwrap()
}

fn tensor<T: Scalar>(clip: &Clip) -> Tensor<T> {
    Tensor::from_flat_fn([clip.len(), 4], |k| T::from_f64(clip[k / 4][k % 4]))
}

/// The gradient of `sum u + 2 v + 3 depth` with respect to the clip positions.
fn gradient<T: Scalar>(clip: &Clip, faces: &[[u32; 3]], size: Size) -> Vec<f64> {
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&tensor(clip));
    let mesh = Mesh::new(faces.to_vec(), clip.len()).unwrap();
    let fragments = rasterize(positions, &mesh, size).unwrap();
    let uv_bar =
        Tensor::from_flat_fn(fragments.barycentrics.shape(), |k| T::from_f64(1.0 + (k % 2) as f64));
    let depth = depth(&fragments).unwrap();
    let depth_bar = Tensor::full(depth.shape(), T::from_f64(3.0));
    let seeds = [(fragments.barycentrics, &uv_bar), (depth, &depth_bar)];
    let gradients = tape.vjp(&seeds).unwrap();
    gradients.get_or_zeros(positions).data().iter().map(|entry| entry.to_f64()).collect()
}

/// The clip position of a point of the image, in pixels from its top left corner, where the centre
/// of column i is at i + 1/2.
fn at_px(size: Size, x: f64, y: f64) -> [f64; 4] {
    [2.0 * x / size.width as f64 - 1.0, 1.0 - 2.0 * y / size.height as f64, 0.0, 1.0]
}

/// How many of the faces, each drawn alone, cover each pixel.
fn layers<T: Scalar>(clip: &Clip, faces: &[[u32; 3]], size: Size) -> Vec<usize> {
    let mut layers = vec![0; size.pixels()];
    for &face in faces {
        for (count, seen) in layers.iter_mut().zip(draw::<T>(clip, &[face], size).pixels) {
            *count += usize::from(seen.is_some());
        }
    }
    layers
}

/// The six orders of a face's corners: three rotations in either winding.
fn orders([a, b, c]: [u32; 3]) -> [[u32; 3]; 6] {
    [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [b, a, c], [a, c, b]]
}

/// Sizes of small images.
fn size() -> impl Strategy<Value = Size> {
    (1..12_usize, 1..12_usize).prop_map(|(width, height)| Size { width, height })
}

/// A scene of several layers, some through each other, one behind the eye in part.
fn layered() -> (Clip, Vec<[u32; 3]>) {
    let clip = vec![
        [-0.9, -0.7, 0.2, 1.0],
        [0.8, -0.9, -0.3, 1.1],
        [0.1, 0.9, 0.5, 0.9],
        [-0.5, 0.8, -0.6, 1.3],
        [1.2, 0.3, 0.1, 0.7],
        [-0.2, -1.1, 0.4, 1.6],
        [0.4, 0.2, 0.3, -0.4],
    ];
    (clip, vec![[0, 1, 2], [3, 4, 5], [0, 4, 3], [6, 1, 3], [2, 5, 1]])
}

const WIDE: Size = Size { width: 31, height: 22 };

#[test]
fn faces_are_counted_anew_in_each_step() {
    // More faces than a thread judges at once. Some reach behind the eye, repeat a vertex, or lie outside.
    let number = |k: usize| ((k * k * 31 + k * 7919 + 13) % 10007) as f64 / 5003.5 - 1.0;
    let count = 3000;
    let vertex = |v: usize| {
        let w = if v % 11 == 3 { -0.3 } else { 1.0 };
        [2.0 * number(5 * v), number(5 * v + 1), 0.4 * number(5 * v + 2), w]
    };
    let clip: Clip = (0..3 * count).map(vertex).collect();
    let in_front: Clip = clip.iter().map(|&[x, y, z, w]| [x, y, z, w.abs()]).collect();
    let face =
        |k: u32| if k.is_multiple_of(97) { [3 * k; 3] } else { [3 * k, 3 * k + 1, 3 * k + 2] };
    let faces: Vec<_> = (0..count as u32).map(face).collect();
    let options = RasterOptions::new(Size::square(16)).cull(Cull::Back);
    let mesh = Mesh::new(faces.clone(), clip.len()).unwrap();
    let mut tape = Tape::<f64>::new();
    for (clip, has_faces_behind) in [(&clip, true), (&in_front, false), (&clip, true)] {
        let fragments = rasterize(tape.leaf(&tensor(clip)), &mesh, options).unwrap();
        let mut expected = Culled::default();
        for &face in &faces {
            let corners = face.map(|vertex| clip[vertex as usize]).to_vec();
            let alone = if face[0] == face[1] { [0, 0, 0] } else { [0, 1, 2] };
            let Culled { degenerate, outside, facing } =
                draw::<f64>(&corners, &[alone], options).culled;
            expected.degenerate += degenerate;
            expected.outside += outside;
            expected.facing += facing;
        }
        assert_eq!(fragments.coverage.culled(), expected);
        assert!(expected.degenerate > 0 && expected.outside > 0 && expected.facing > 0);
        let left_out = tape.take_report().left_out;
        let is_whole_rows = left_out.iter().any(|left| left.reason.contains("behind the eye"));
        assert_eq!(is_whole_rows, !has_faces_behind);
        tape.reset();
    }
}
