//! Layers in depth: none, more than there are, in one plane, opaque and clear.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Fragments, Layer, RasterOptions, Sampling, Size, composite, composite_layers,
    depth_layers, rasterize, rasterize_behind,
};

use crate::clip_scene::{BACKGROUND, ClipScene};
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes, keep_error};
use crate::measures::{motley, numbers};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    177 "layers: none, more than there are", "nothing; all of them", none_or_too_many;
    178 "layers: faces in one plane", "the lower index first, each once", in_one_plane;
    179 "layers: alpha 0 and 1", "the background; the nearest alone", opaque_and_clear;
    180 "layers: refused input", "an error", refused;
};

const SIZE: Size = Size { width: 9, height: 7 };

/// Triangles one behind another, each farther out than the triangle before it.
fn walls(depths: &[f64]) -> ClipScene {
    let mut clip = Vec::new();
    for (k, &z) in depths.iter().enumerate() {
        let reach = 0.5 + 0.2 * k as f64;
        let corners = [[-reach, -reach], [3.0 * reach, -reach], [-reach, 3.0 * reach]];
        clip.extend(corners.map(|[x, y]| [x, y, z, 1.0]));
    }
    let faces: Vec<_> = (0..depths.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    ClipScene::new(&clip, &faces, SIZE)
}

fn motley_rows<'t, T: Scalar>(tape: &'t Tape<T>, shape: &[usize], first: usize) -> Var<'t, T> {
    tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(motley(k + first))))
}

/// The picture of layers with motley colours times an alpha, its image first; then the gradients of
/// each layer's colours and alphas.
fn picture<'t, T: Scalar>(
    layers: &[Fragments<'t, T>],
    background: Var<'t, T>,
    alpha: impl Fn(usize) -> f64,
) -> Result<Vec<Vec<f64>>, Failure> {
    let tape = background.tape();
    let mut parts = Vec::new();
    for (k, fragments) in layers.iter().enumerate() {
        let (count, own) = (fragments.coverage.count(), T::from_f64(alpha(k)));
        let colors = motley_rows(tape, &[count, 2], 31 * k).value().map(|color| own * color);
        parts.push((tape.leaf(&colors), tape.leaf(&Tensor::full([count], own))));
    }
    let with = |(fragments, &(premultiplied, alpha))| Layer { fragments, premultiplied, alpha };
    let layers: Vec<_> = layers.iter().zip(&parts).map(with).collect();
    let image = composite_layers(&layers, Background::Color(background))?.image()?;
    let upstream = Tensor::from_flat_fn(image.shape(), |k| T::from_f64(motley(5 * k + 2)));
    let gradients = tape.vjp(&[(image, &upstream)])?;
    let mut found = vec![numbers(&image.value()), numbers(&gradients.get_or_zeros(background))];
    for (premultiplied, alpha) in parts {
        found.push(numbers(&gradients.get_or_zeros(premultiplied)));
        found.push(numbers(&gradients.get_or_zeros(alpha)));
    }
    Ok(found)
}

fn sky<T: Scalar>(tape: &Tape<T>) -> Var<'_, T> {
    tape.leaf(&Tensor::from(BACKGROUND.map(T::from_f64)))
}

/// The background's colour at every pixel.
fn empty() -> Vec<f64> {
    BACKGROUND.repeat(SIZE.pixels())
}

fn none_or_too_many<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    let tape = Tape::<T>::new();
    for scene in [walls(&[]), ClipScene::new(&[[9.0, 9.0, 0.0, 1.0]; 3], &[[0, 1, 2]], SIZE)] {
        let (clip, mesh) = (scene.leaf(&tape), scene.mesh()?);
        wrong += depth_layers(clip, &mesh, SIZE, None)?.len();
        // A layer of nothing is a layer.
        let nothing = rasterize(clip, &mesh, SIZE)?;
        let behind = rasterize_behind(&nothing, SIZE)?;
        wrong += behind.coverage.count();
        let found = picture(&[nothing, behind], sky(&tape), |_| 0.5)?;
        wrong += usize::from(found[0] != empty());
    }
    let scene = walls(&[-0.5, 0.0, 0.5]);
    let (clip, mesh) = (scene.leaf(&tape), scene.mesh()?);
    for (most, expected) in [(Some(0), 0), (Some(2), 2), (Some(3), 3), (Some(4), 3), (None, 3)] {
        wrong += depth_layers(clip, &mesh, SIZE, most)?.len().abs_diff(expected);
    }
    wrong += depth_layers(clip, &mesh, SIZE, Some(usize::MAX))?.len().abs_diff(3);
    let mut last = rasterize(clip, &mesh, SIZE)?;
    for _ in 0..6 {
        last = rasterize_behind(&last, SIZE)?;
    }
    let bars = last.barycentrics.sum().backward()?.get_or_zeros(clip);
    wrong += last.coverage.count() + usize::from(numbers(&bars).iter().any(|&bar| bar != 0.0));
    Ok(Verdict::exactly("nothing, and all that there are", wrong))
}

fn in_one_plane<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    // The same face again and again, turned around and its corners named anew; and other faces of a
    // plane that is not parallel to the image.
    let corners = [[-0.9, -0.8], [0.9, -0.7], [0.0, 0.9]];
    let around = [[-3.0, -3.0], [3.0, -3.0], [0.0, 3.0]];
    for slope in [0.0, 0.25] {
        let at = |&[x, y]: &[f64; 2]| [x, y, slope * (x + 0.5 * y), 1.0];
        let clip: Vec<_> = corners.iter().chain(&around).map(at).collect();
        let [a, b] = [[0, 1, 2], [3, 4, 5]];
        let same = [a, [1, 2, 0], [2, 1, 0], a, a];
        // Depths of two faces of a plane that leans agree but for rounding.
        let both: &[[u32; 3]] = if slope == 0.0 { &[b, a, b, a] } else { &[] };
        for faces in [&same[..], both] {
            let scene = ClipScene::new(&clip, faces, SIZE);
            let tape = Tape::<T>::new();
            let layers = depth_layers(scene.leaf(&tape), &scene.mesh()?, SIZE, None)?;
            let mut seen = vec![Vec::new(); SIZE.pixels()];
            for layer in &layers {
                for (face, pixel) in layer.coverage.faces().zip(layer.coverage.pixels()) {
                    seen[pixel].push(face);
                }
            }
            let mut expected = vec![Vec::new(); SIZE.pixels()];
            for (k, &face) in faces.iter().enumerate() {
                let alone = scene.with_faces(&[face]).draw::<T>()?;
                for (expected, seen) in expected.iter_mut().zip(alone.pixels) {
                    expected.extend(seen.map(|_| k));
                }
            }
            for (mut seen, expected) in seen.into_iter().zip(expected) {
                // On a slope, corners in another order may be one rounding nearer.
                if slope != 0.0 {
                    seen.sort_unstable();
                }
                wrong += usize::from(seen != expected);
            }
        }
    }
    Ok(Verdict::exactly("each once, the lower index first", wrong))
}

fn opaque_and_clear<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    let scene = walls(&[-0.5, 0.0, 0.5]);
    let tape = Tape::<T>::new();
    let clip = scene.leaf(&tape);
    let layers = depth_layers(clip, &scene.mesh()?, SIZE, None)?;
    let sky = sky(&tape);

    let opaque = picture(&layers, sky, |_| 1.0)?;
    let front = motley_rows(&tape, &[layers[0].coverage.count(), 2], 0);
    let nearest = composite(front, &layers[0], Background::Color(sky))?.image()?;
    wrong += usize::from(opaque[0] != numbers(&nearest.value()));
    // Nothing reaches what is hidden: colours and alphas of the second layer and the third.
    wrong += opaque[4..].iter().flatten().filter(|&&bar| bar != 0.0).count();

    let clear = picture(&layers, sky, |_| 0.0)?;
    wrong += usize::from(clear[0] != empty());
    // Everything reaches every colour, and the background.
    let upstream =
        |pixel: usize| [0, 1].map(|c| T::from_f64(motley(5 * (2 * pixel + c) + 2)).to_f64());
    for (k, layer) in layers.iter().enumerate() {
        let expected: Vec<_> = layer.coverage.pixels().flat_map(upstream).collect();
        wrong += usize::from(clear[2 + 2 * k] != expected);
    }
    // A clear layer in front changes nothing; alphas beyond 1 and below 0 are what they are.
    let mixed = picture(&layers, sky, |k| [0.0, 1.0, 0.5][k])?;
    wrong += mixed[6..].iter().flatten().filter(|&&bar| bar != 0.0).count();
    let beyond = picture(&layers, sky, |k| [-0.5, 2.0, 1e30][k])?;
    wrong += beyond.iter().flatten().filter(|entry| !entry.is_finite()).count();
    Ok(Verdict::exactly("the nearest alone; the background", wrong))
}

fn refused<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let scene = walls(&[-0.5, 0.0]);
    let (clip, mesh) = (scene.leaf(&tape), scene.mesh()?);
    let exact = RasterOptions::new(SIZE).sampling(Sampling::Exact);
    let layers = depth_layers(clip, &mesh, SIZE, None)?;
    let small = rasterize(clip, &mesh, Size::square(4))?;
    let pieces = rasterize(clip, &mesh, exact.creases(&[]))?;
    let say = |fragments: &[&Fragments<'_, T>], short: usize| {
        let mut parts = Vec::new();
        for fragments in fragments {
            let count = fragments.coverage.count();
            let [colors, alpha] = [&[count, 2][..], &[count - short]].map(Tensor::zeros);
            parts.push((tape.constant(&colors), tape.constant(&alpha)));
        }
        let with =
            |(&fragments, &(premultiplied, alpha))| Layer { fragments, premultiplied, alpha };
        let layers: Vec<_> = fragments.iter().zip(&parts).map(with).collect();
        keep_error(composite_layers(&layers, Background::Zero))
    };
    let (front, behind) = (&layers[0], &layers[1]);
    let count = front.coverage.count();
    let is_alone = |&pixel: &usize| behind.coverage.fragment_at(pixel).is_none();
    let alone = front.coverage.pixels().find(is_alone).ok_or("the layers are alike")?;
    let exactly = "needs fragments at pixel centres, got exact coverage, whose pieces say nothing of \
                   what lies behind them";
    let results = vec![
        (say(&[], 0), "composite_layers needs at least one layer, got none".to_owned()),
        (
            say(&[front], 1),
            format!("composite_layers needs alphas of shape [{count}], got shape [{}]", count - 1),
        ),
        (
            say(&[front, &small], 0),
            "a layer needs the size of the layer in front, 9 x 7, got 4 x 4".to_owned(),
        ),
        (
            say(&[behind, front], 0),
            format!(
                "layers need to follow each other from the front, got layer 1 at pixel {alone}, where \
                 layer 0 is not"
            ),
        ),
        (keep_error(depth_layers(clip, &mesh, exact, None)), format!("depth_layers {exactly}")),
        (say(&[&pieces], 0), format!("composite_layers {exactly}")),
        (keep_error(rasterize_behind(&pieces, SIZE)), format!("rasterize_behind {exactly}")),
    ];
    Ok(Verdict::refused(results))
}
