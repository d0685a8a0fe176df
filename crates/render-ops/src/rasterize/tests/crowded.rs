//! Many faces in a pixel or in a row of them.

use super::exact::{exact, picture, supersampled};
use super::*;
use crate::interpolate::interpolate;

/// More pairs of a pixel and a face in one row than are gathered at once: an edge along all of it,
/// and thousands of faces behind.
#[test]
fn a_row_of_many_faces_is_gathered_in_parts() {
    const FACES: u32 = 2_200;
    let size = Size { width: 2048, height: 1 };
    let front = [[-9.0, 0.5], [9.0, 0.5], [0.0, -30.0]];
    let mut clip: Clip = front.map(|[x, y]| [x, y, -0.95, 1.0]).into();
    let mut faces = vec![[0, 1, 2]];
    for k in 0..FACES {
        let depth = 1.8 * f64::from(k) / f64::from(FACES) - 0.9;
        clip.extend([[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]].map(|[x, y]| [x, y, depth, 1.0]));
        faces.push([3, 4, 5].map(|corner| 3 * k + corner));
    }
    let mesh = Mesh::new(faces, clip.len()).unwrap();
    let tape = Tape::<f64>::new();
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size)).unwrap();
    let (weight, coverage) = (fragments.weight.unwrap().value(), &fragments.coverage);
    let found: Vec<_> =
        coverage.boundary().map(|(pixel, fragments)| (pixel, fragments.len())).collect();
    assert!(found.into_iter().eq((0..size.width).map(|pixel| (pixel, 2))));
    for (face, weight) in coverage.faces().zip(weight.data()) {
        assert!((weight - [0.75, 0.25][face]).abs() < 1e-14, "{face} {weight}");
    }
}

/// How many faces a wheel has: more than a pixel may hold and not be crowded.
const SPOKES: u32 = 2_500;

/// A wheel: its middle, then its rim, of radius 1.
fn wheel() -> (Vec<[f64; 2]>, Vec<[u32; 3]>) {
    let around = |k: u32| 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(SPOKES);
    let rim = (0..SPOKES).map(|k| [around(k).cos(), around(k).sin()]);
    let faces = (0..SPOKES).map(|k| [0, 1 + k, 1 + (k + 1) % SPOKES]);
    (std::iter::once([0.0; 2]).chain(rim).collect(), faces.collect())
}

/// A wheel within a pixel: what is covered, and how that changes with its radius, are told by its
/// rim; what is seen of it, by the w of its middle, too.
#[test]
fn a_crowded_pixel_is_sampled_and_changes_with_its_outline() {
    let (points, faces) = wheel();
    let mesh = Mesh::new(faces, points.len()).unwrap();
    let size = Size { width: 2, height: 2 };
    for w in [1.0, 0.25, 4.0] {
        let tape = Tape::<f64>::new();
        // Pixels are one wide.
        let (radius, hub) = (tape.leaf(&Tensor::scalar(0.45)), tape.leaf(&Tensor::scalar(w)));
        let clip: Clip = points.iter().map(|&[x, y]| [x, y, 0.0, 0.0]).collect();
        let mut is_hub = Tensor::zeros([points.len(), 1]);
        is_hub.data_mut()[0] = 1.0;
        let is_rim = is_hub.map(|is_hub| 1.0 - is_hub);
        let middle = tape.constant(&Tensor::new([4], vec![0.5, 0.47, 0.0, 1.0]).unwrap());
        let factors = tape.constant(&is_hub) * hub + tape.constant(&is_rim);
        let clip = tape.constant(&tensor(&clip)) * radius + middle * factors;
        let fragments = rasterize(clip, &mesh, exact(size)).unwrap();
        let counts = fragments.coverage.boundary_counts();
        assert_eq!((counts.pixels, counts.crowded), (1, 1));
        let report = tape.take_report();
        let is_named = |reason: &str| reason.ends_with("crowded pixels are sampled");
        assert!(report.left_out.iter().any(|left| is_named(&left.reason)));
        let weight = fragments.weight.unwrap();
        let area = weight.sum();
        let expected = std::f64::consts::PI * 0.45 * 0.45;
        assert!((area.item() - expected).abs() < 0.02, "{} {expected}", area.item());
        let slope = area.backward().unwrap().get_or_zeros(radius).item();
        assert!((slope * 0.45 / (2.0 * expected) - 1.0).abs() < 1e-4, "{slope}");
        // A colour of 1 at the rim and 0 in the middle is w s / (1 - s + w s) at the share s of the
        // radius.
        let color = interpolate(tape.constant(&is_rim), &fragments).unwrap();
        let seen = (color.reshape(weight.shape()).unwrap() * weight).sum();
        let mean = |w: f64| {
            let shares = (0..1000).map(|k| (f64::from(k) + 0.5) / 1000.0);
            let colors = shares.map(|s| 2.0 * s * w * s / (1.0 - s + w * s));
            expected * colors.sum::<f64>() / 1000.0
        };
        assert!((seen.item() / mean(w) - 1.0).abs() < 0.05, "{w}: {} {}", seen.item(), mean(w));
        let by_w = seen.backward().unwrap().get_or_zeros(hub).item();
        let quotient = (mean(1.001 * w) - mean(0.999 * w)) / (0.002 * w);
        assert!((by_w / quotient - 1.0).abs() < 0.01, "{w}: {by_w} {quotient}");
    }
}

/// Beside a wheel that crowds their pixel, in perspective: most samples see one face.
#[test]
fn a_face_of_many_samples_has_their_mean() {
    let (points, mut faces) = wheel();
    let mut clip: Clip =
        points.iter().map(|[x, y]| [0.7 + 0.2 * x, 0.7 + 0.2 * y, 0.5, 1.0]).collect();
    let first = clip.len() as u32;
    faces.push([first, first + 1, first + 2]);
    clip.extend([[-1.0, -1.1, 0.0, 1.0], [0.9, -1.1, 0.0, 1.0], [-2.0, 4.4, 0.0, 4.0]]);
    let mesh = Mesh::new(faces, clip.len()).unwrap();
    let colors = Tensor::from_flat_fn([clip.len(), 2], |k| {
        let vertex = (k / 2) as u32;
        if vertex < first { 0.5 } else { f64::from((vertex - first) % 3 == 2 - k as u32 % 2) }
    });
    let tape = Tape::<f64>::new();
    let size = Size::square(1);
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size)).unwrap();
    assert_eq!(fragments.coverage.boundary_counts().crowded, 1);
    let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
    let expected = supersampled(&clip, &colors, &mesh, size, 16);
    for (&found, expected) in image.value().data().iter().zip(expected) {
        assert!((found - expected).abs() < 1e-13, "{found} instead of {expected}");
    }
}

/// Thousands of faces in a pixel, behind a sheet that a seam cuts there, or before it.
#[test]
fn what_lies_behind_a_full_pixel_does_not_crowd_it() {
    const PILE: u32 = 3_000;
    let size = Size { width: 3, height: 3 };
    let of_pile = |sign: f64| {
        let sheet = [[-4.0, -4.0], [4.0, -4.0], [-4.0, 4.0], [4.0, 4.0]];
        let mut clip: Clip = sheet.map(|[x, y]| [x, y, 0.0, 1.0]).into();
        let mut faces = vec![[0, 1, 2], [1, 3, 2]];
        for k in 0..PILE {
            let depth = sign * (0.1 + 0.8 * f64::from(k) / f64::from(PILE));
            clip.extend([[-0.2, -0.2], [0.25, -0.1], [0.0, 0.2]].map(|[x, y]| [x, y, depth, 1.0]));
            faces.push([0, 1, 2].map(|corner| 4 + 3 * k + corner));
        }
        let mesh =
            Mesh::new(faces, clip.len()).unwrap().with_seams(|face, corner| face + corner == 0);
        let tape = Tape::<f64>::new();
        let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size)).unwrap();
        let weight: f64 = fragments.weight.unwrap().value().data().iter().sum();
        (fragments.coverage.clone(), weight)
    };
    let (behind, weight) = of_pile(1.0);
    // The seam passes through three pixels, and through corners of four more.
    let counts = behind.boundary_counts();
    assert_eq!((counts.pixels, counts.pieces, counts.crowded), (7, 10, 0));
    assert!(behind.faces().all(|face| face < 2) && (weight - 7.0).abs() < 1e-14);
    let (before, _) = of_pile(-1.0);
    assert_eq!(before.boundary_counts().crowded, 1);
}
