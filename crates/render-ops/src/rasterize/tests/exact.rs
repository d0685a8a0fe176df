//! Laws of exact coverage.

use super::*;
use crate::background::Background;
use crate::interpolate::interpolate;
use crate::resolve::resolve;

fn exact(size: Size) -> RasterOptions {
    RasterOptions { sampling: Sampling::Exact, ..size.into() }
}

/// The picture `[H, W, 2]` of vertices with colours, before a background.
fn picture<'t>(
    clip: bokashi_core::Var<'t, f64>,
    colors: bokashi_core::Var<'t, f64>,
    mesh: &Mesh,
    options: RasterOptions,
) -> bokashi_core::Var<'t, f64> {
    let fragments = rasterize(clip, mesh, options).unwrap();
    let surface = interpolate(colors, &fragments).unwrap();
    let background = clip.tape().constant(&Tensor::new([2], vec![0.1, 0.9]).unwrap());
    resolve(surface, &fragments, Background::Color(background)).unwrap()
}

/// The mean over `times` x `times` samples per pixel.
fn supersampled(
    clip: &Clip,
    colors: &Tensor<f64>,
    mesh: &Mesh,
    size: Size,
    times: usize,
) -> Vec<f64> {
    let Size { width, height } = size;
    let tape = Tape::<f64>::new();
    let large = Size { width: times * width, height: times * height };
    let large = picture(tape.leaf(&tensor(clip)), tape.leaf(colors), mesh, large.into());
    let mut means = vec![0.0; 2 * size.pixels()];
    for (k, value) in large.value().data().iter().enumerate() {
        let (pixel, channel) = (k / 2, k % 2);
        let (row, column) = (pixel / (times * width) / times, pixel % (times * width) / times);
        means[2 * (row * width + column) + channel] += value / (times * times) as f64;
    }
    means
}

/// Faces of one colour each, which may overlap, pass through each other, and reach out of the depth
/// range and behind the eye.
fn loose_faces() -> impl Strategy<Value = (Clip, Tensor<f64>, Vec<[u32; 3]>)> {
    let depth = prop_oneof![4 => -0.9..0.9, 1 => -1.6..1.6];
    let w = prop_oneof![8 => 0.5..2.0, 1 => -0.6..-0.1];
    let vertex = (-1.3..1.3, -1.3..1.3, depth, w)
        .prop_map(|(x, y, z, w): (f64, f64, f64, f64)| [x * w.abs(), y * w.abs(), z * w.abs(), w]);
    let faces =
        proptest::collection::vec((prop::array::uniform3(vertex), 0.0..1.0, 0.0..1.0), 1..5);
    faces.prop_map(|faces| {
        let clip = faces.iter().flat_map(|(corners, ..)| *corners).collect();
        let colors: Vec<f64> = faces.iter().flat_map(|&(_, a, b)| [a, b].repeat(3)).collect();
        let count = faces.len();
        let faces = (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        (clip, Tensor::new([3 * count, 2], colors).unwrap(), faces)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn a_pixel_is_the_mean_of_many_samples(
        (clip, colors, faces) in loose_faces(),
        width in 1..9_usize,
        height in 1..9_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        let tape = Tape::<f64>::new();
        let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
        let expected = supersampled(&clip, &colors, &mesh, size, 64);
        for (&found, expected) in image.value().data().iter().zip(expected) {
            prop_assert!((found - expected).abs() < 0.02, "{found} instead of {expected}");
        }
    }

    // Wide enough for blocks of pixels; more than a sample's width off means a pixel that was not
    // resolved.
    #[test]
    fn a_wide_image_is_the_mean_of_some_samples(
        (clip, colors, faces) in loose_faces(),
        width in 20..50_usize,
        height in 1..6_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        let tape = Tape::<f64>::new();
        let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
        let expected = supersampled(&clip, &colors, &mesh, size, 32);
        for (&found, expected) in image.value().data().iter().zip(expected) {
            prop_assert!((found - expected).abs() < 0.08, "{found} instead of {expected}");
        }
    }

    // No edge is in sight, and whole blocks of pixels see both faces.
    #[test]
    fn faces_that_cover_the_image_pass_through_each_other_where_they_do(
        depths in prop::array::uniform6(-0.9..0.9),
        width in 1..60_usize,
        height in 1..20_usize,
    ) {
        let size = Size { width, height };
        let corners = [[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]];
        let clip: Clip = (0..6).map(|k| [corners[k % 3][0], corners[k % 3][1], depths[k], 1.0]).collect();
        let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
        let colors = Tensor::from_fn([6, 2], |k| if k < 6 { 0.0 } else { 1.0 });
        let tape = Tape::<f64>::new();
        let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
        let expected = supersampled(&clip, &colors, &mesh, size, 16);
        for (&found, expected) in image.value().data().iter().zip(expected) {
            prop_assert!((found - expected).abs() < 0.08, "{found} instead of {expected}");
        }
    }

    #[test]
    fn the_gradient_is_the_difference_quotient(
        (clip, _, faces) in loose_faces(),
        width in 1..9_usize,
        height in 1..9_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        // Other ones at each vertex, so that means move, too.
        let colors = Tensor::from_fn([clip.len(), 2], |k| ((k * 29 + 5) % 13) as f64 / 13.0);
        let upstream = Tensor::from_fn([height, width, 2], |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4);
        let loss = |clip: &Clip| -> f64 {
            let tape = Tape::<f64>::new();
            let image = picture(tape.leaf(&tensor(clip)), tape.leaf(&colors), &mesh, exact(size));
            image.value().data().iter().zip(upstream.data()).map(|(x, u)| x * u).sum()
        };
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&tensor(&clip));
        let image = picture(positions, tape.leaf(&colors), &mesh, exact(size));
        let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
        let found = gradients.get_or_zeros(positions);
        for k in 0..4 * clip.len() {
            let quotient = |step: f64| {
                let by = |sign: f64| {
                    let mut moved = clip.clone();
                    moved[k / 4][k % 4] += sign * step;
                    loss(&moved)
                };
                (by(1.0) - by(-1.0)) / (2.0 * step)
            };
            let [coarse, fine] = [1e-5, 5e-6].map(quotient);
            let error = (coarse - fine).abs();
            let found = found.data()[k];
            prop_assert!(
                (found - fine).abs() < 1e-5 * (1.0 + fine.abs()) + 3.0 * error,
                "entry {k}: {found} instead of {fine} ({coarse})"
            );
        }
    }
}

/// A wheel of thousands of faces within a pixel: what is covered, and how that
/// changes with its radius, are told by its rim.
#[test]
fn a_crowded_pixel_is_sampled_and_changes_with_its_outline() {
    const CORNERS: u32 = 2_500;
    let around = |k: u32| 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(CORNERS);
    let tape = Tape::<f64>::new();
    let rim = (0..CORNERS).map(|k| [around(k).cos(), around(k).sin(), 0.0, 1.0]);
    let unit: Vec<f64> = std::iter::once([0.0, 0.0, 0.0, 1.0]).chain(rim).flatten().collect();
    let unit = tape.constant(&Tensor::new([CORNERS as usize + 1, 4], unit).unwrap());
    let faces = (0..CORNERS).map(|k| [0, 1 + k, 1 + (k + 1) % CORNERS]).collect();
    let mesh = Mesh::new(faces, CORNERS as usize + 1).unwrap();
    // Pixels are one wide.
    let radius = tape.leaf(&Tensor::scalar(0.45));
    let scale = tape.constant(&Tensor::new([4], vec![1.0, 1.0, 0.0, 0.0]).unwrap());
    let middle = tape.constant(&Tensor::new([4], vec![0.5, 0.47, 0.0, 1.0]).unwrap());
    let clip = unit * scale * radius + middle;
    let size = Size { width: 2, height: 2 };
    let fragments = rasterize(clip, &mesh, exact(size)).unwrap();
    let counts = fragments.coverage.boundary_counts();
    assert_eq!((counts.pixels, counts.crowded), (1, 1));
    let report = tape.take_report();
    assert!(report.left_out.iter().any(|left| left.reason.ends_with("crowded pixels are sampled")));
    let area = fragments.weight.unwrap().sum();
    let expected = std::f64::consts::PI * 0.45 * 0.45;
    assert!((area.item() - expected).abs() < 0.02, "{} {expected}", area.item());
    let slope = area.backward().unwrap().get_or_zeros(radius).item();
    assert!((slope * 0.45 / (2.0 * expected) - 1.0).abs() < 1e-4, "{slope}");
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

/// Far from the middle of a large image, where a plane around that middle says little of so thin a
/// face: it is seen before what fills all its pixels, and has its slope.
#[test]
fn a_needle_before_a_surface_has_its_slope() {
    let size = Size::square(2048);
    let width = 1e-8;
    let (p, along) = ([1_100.2, 1_070.3], [903.1, 911.7]);
    let length = f64::hypot(along[0], along[1]);
    let q = [p[0] + along[0], p[1] + along[1]];
    let across = [along[1] / length, -along[0] / length];
    let r = [q[0] + width * across[0], q[1] + width * across[1]];
    let place = |[x, y]: [f64; 2], w: f64, depth: f64| {
        [w * (x / 1024.0 - 1.0), w * (1.0 - y / 1024.0), w * depth, w]
    };
    for depth in [0.1, 0.1 + 1e-12, -0.3] {
        let mut clip: Clip = [p, q, r].map(|point| place(point, 3.0, depth)).into();
        let cover = [[-9e3, -9e3], [9e3, -9e3], [0.0, 2e4]];
        clip.extend(cover.map(|point| place(point, 1.0, depth + 1e-6)));
        let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&tensor(&clip));
        let fragments = rasterize(positions, &mesh, exact(size)).unwrap();
        let is_needle = |face: usize| f64::from(u8::from(face == 0));
        let coverage = &fragments.coverage;
        let of_pieces = coverage.faces().skip(coverage.centers());
        let weight = fragments.weight.unwrap();
        let upstream = Tensor::new(weight.shape(), of_pieces.map(is_needle).collect()).unwrap();
        let gradient = tape.vjp(&[(weight, &upstream)]).unwrap().get_or_zeros(positions);
        // r moves across: half the length for each pixel, 3 units of clip space for 1024 of them.
        let [x, y] = [gradient.data()[8], -gradient.data()[9]].map(|bar| bar * 3.0 / 1024.0);
        let slope = x * across[0] + y * across[1];
        assert!((slope / (0.5 * length) - 1.0).abs() < 1e-6, "{depth}: {slope}");
    }
}

/// From behind the eye to beyond the far plane, before a wall: nothing but where it meets that is a
/// boundary.
#[test]
fn a_ground_that_is_clipped_makes_no_boundary_of_its_inside() {
    let size = Size::square(64);
    // At height -1 below the eye, at the distances -1 and 50, far at about 11; a wall at 8.
    let ground = |x: f64, w: f64| [x, -1.0, 1.2 * w - 2.2, w];
    let wall = |x: f64, y: f64| [8.0 * x, 8.0 * y, 1.2 * 8.0 - 2.2, 8.0];
    let clip: Clip = vec![
        ground(-90.0, -1.0),
        ground(90.0, -1.0),
        ground(0.0, 50.0),
        wall(-3.0, -3.0),
        wall(9.0, -3.0),
        wall(-3.0, 9.0),
    ];
    let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
    let tape = Tape::<f64>::new();
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size)).unwrap();
    let counts = fragments.coverage.boundary_counts();
    // A row of pixels, or two beside its line, and where the ground leaves the near plane.
    let seen = fragments.coverage.faces().filter(|&face| face == 0).count();
    assert!(seen > 64 * 10 && (64..=4 * 64).contains(&counts.pixels), "{seen} {counts:?}");
}
