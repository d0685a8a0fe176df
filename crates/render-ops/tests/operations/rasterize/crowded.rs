//! Many faces in a pixel or in a row of them.

use super::exact::{exact, loose_faces, picture};
use super::sheets::crumpled;
use super::*;
use bokashi_core::mixing::{GOLDEN, mixed};
use bokashi_render_ops::{
    BoundaryCounts, Cull, Limits, Mesh, RasterOptions, Size, interpolate, rasterize,
};

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
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size).creases(&[])).unwrap();
    let (weight, coverage) = (fragments.weight.unwrap().value(), &fragments.coverage);
    let found: Vec<_> =
        coverage.boundary().map(|(pixel, fragments)| (pixel, fragments.len())).collect();
    assert!(found.into_iter().eq((0..size.width).map(|pixel| (pixel, 2))));
    for (face, weight) in coverage.faces().zip(weight.data()) {
        assert!((weight - [0.75, 0.25][face]).abs() < 1e-14, "{face} {weight}");
    }
}

/// How many faces a wheel has: more than a pixel may hold and not be crowded.
const SPOKES: u32 = 600;

/// A wheel: its middle, then its rim, of radius 1.
fn wheel() -> (Vec<[f64; 2]>, Vec<[u32; 3]>) {
    let around = |k: u32| 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(SPOKES);
    let rim = (0..SPOKES).map(|k| [around(k).cos(), around(k).sin()]);
    let faces = (0..SPOKES).map(|k| [0, 1 + k, 1 + (k + 1) % SPOKES]);
    (std::iter::once([0.0; 2]).chain(rim).collect(), faces.collect())
}

/// A wheel within a pixel: what is covered, and how that changes with its radius, are told by its
/// rim; what is seen of it, by the w of its middle, too. Around its middle all faces meet.
#[test]
fn a_crowded_pixel_changes_with_its_outline_and_what_is_sampled_is_named() {
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
        let fragments = rasterize(clip, &mesh, exact(size).creases(&[])).unwrap();
        let counts = fragments.coverage.boundary_counts();
        assert_eq!((counts.pixels, counts.crowded), (1, 1));
        assert!(counts.sampled > 0.0 && counts.sampled < 1e-3, "{}", counts.sampled);
        let report = tape.take_report();
        let is_named = |reason: &str| reason.ends_with("parts of pixels are sampled");
        assert!(report.left_out.iter().any(|left| is_named(&left.reason)));
        let weight = fragments.weight.unwrap();
        let area = weight.sum();
        let spokes = f64::from(SPOKES);
        let expected = 0.5 * spokes * (std::f64::consts::TAU / spokes).sin() * 0.45 * 0.45;
        assert!((area.item() - expected).abs() < 1e-12, "{} {expected}", area.item());
        let slope = area.backward().unwrap().get_or_zeros(radius).item();
        assert!((slope * 0.45 / (2.0 * expected) - 1.0).abs() < 1e-11, "{slope}");
        // A colour of 1 at the rim and 0 in the middle is w s / (1 - s + w s) at the share s of the
        // radius.
        let color = interpolate(tape.constant(&is_rim), &fragments).unwrap();
        let seen = (color.reshape(weight.shape()).unwrap() * weight).sum();
        let mean = |w: f64| {
            let shares = (0..1000).map(|k| (f64::from(k) + 0.5) / 1000.0);
            let colors = shares.map(|s| 2.0 * s * w * s / (1.0 - s + w * s));
            expected * colors.sum::<f64>() / 1000.0
        };
        assert!((seen.item() / mean(w) - 1.0).abs() < 1e-4, "{w}: {} {}", seen.item(), mean(w));
        let by_w = seen.backward().unwrap().get_or_zeros(hub).item();
        let quotient = (mean(1.001 * w) - mean(0.999 * w)) / (0.002 * w);
        assert!((by_w / quotient - 1.0).abs() < 1e-3, "{w}: {by_w} {quotient}");
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
        let fragments =
            rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size).creases(&[])).unwrap();
        let weight: f64 = fragments.weight.unwrap().value().data().iter().sum();
        (fragments.coverage.clone(), weight)
    };
    let (behind, weight) = of_pile(1.0);
    // The seam passes through three pixels, and through corners of four more.
    let counts = behind.boundary_counts();
    assert_eq!((counts.pixels, counts.pieces, counts.crowded), (7, 10, 0));
    assert!(behind.faces().all(|face| face < 2) && (weight - 7.0).abs() < 1e-14);
    // Before the sheet it hides a part of it, and all but the nearest face are hidden.
    let (before, weight) = of_pile(-1.0);
    let counts = before.boundary_counts();
    assert_eq!((counts.pieces, counts.sampled), (11, 0.0));
    assert!((weight - 7.0).abs() < 1e-12, "{weight}");
}

/// Never crowded.
const WITHOUT_CUTS: Limits = Limits { faces: usize::MAX, cuts: usize::MAX, ..Limits::DEFAULT };

struct Scene {
    clip: Clip,
    mesh: Mesh,
    size: Size,
    cull: Cull,
}

/// What came of a scene.
struct Drawing {
    /// `[H, W, 2]`.
    image: Vec<f64>,
    gradient: Vec<f64>,
    counts: BoundaryCounts,
}

impl Scene {
    /// A picture whose edges are all seams.
    fn new(clip: Clip, faces: Vec<[u32; 3]>, size: Size) -> Self {
        let mesh = Mesh::new(faces, clip.len()).unwrap().with_seams(|_, _| true);
        Self { clip, mesh, size, cull: Cull::None }
    }

    /// Triangles that have no vertices in common.
    fn loose(clip: Clip, size: Size) -> Self {
        let faces = (0..clip.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        Self::new(clip, faces, size)
    }

    /// With each pixel as the mean of `times` by `times` pixels.
    fn draw(&self, times: usize, limits: Limits) -> Drawing {
        let Size { width, height } = self.size;
        let size = Size { width: times * width, height: times * height };
        let options = RasterOptions { limits, ..exact(size).cull(self.cull) };
        let colors =
            Tensor::from_flat_fn([self.clip.len(), 2], |k| ((k * 29 + 5) % 13) as f64 / 12.0);
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&tensor(&self.clip));
        let image = picture(positions, tape.leaf(&colors), &self.mesh, options);
        let counts = rasterize(positions, &self.mesh, options.creases(&[]))
            .unwrap()
            .coverage
            .boundary_counts();
        let share = 1.0 / (times * times) as f64;
        let of_mean = |k: usize| {
            let (pixel, channel) = (k / 2, k % 2);
            let (row, column) = (pixel / size.width / times, pixel % size.width / times);
            2 * (row * width + column) + channel
        };
        let upstream = Tensor::from_flat_fn([size.height, size.width, 2], |k| {
            share * (((of_mean(k) * 37 + 11) % 17) as f64 / 17.0 - 0.4)
        });
        let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
        let mut means = vec![0.0; 2 * width * height];
        for (k, value) in image.value().data().iter().enumerate() {
            means[of_mean(k)] += share * value;
        }
        let gradient = gradients.get_or_zeros(positions).data().to_vec();
        Drawing { image: means, gradient, counts }
    }
}

impl Drawing {
    /// How far the image is from another one.
    fn image_error(&self, other: &Self) -> f64 {
        let pairs = self.image.iter().zip(&other.image);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    /// The same of the gradients, relative to the largest entry.
    fn gradient_error(&self, other: &Self) -> f64 {
        let largest = other.gradient.iter().fold(1.0, |most: f64, entry| most.max(entry.abs()));
        let pairs = self.gradient.iter().zip(&other.gradient);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest
    }
}

/// Numbers in [-1, 1) from a seed.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(GOLDEN);
        (mixed(state) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Triangles of some size anywhere in the image, in perspective; they pass through each other.
fn heap(count: usize, reach: f64, size: usize, seed: u64) -> Scene {
    let mut number = numbers(seed);
    let mut clip = Clip::new();
    for _ in 0..count {
        let center = [number(), number(), 0.8 * number()];
        clip.extend((0..3).map(|_| {
            let w = 1.25 + 0.75 * number();
            let [x, y, z] = [reach, reach, 0.1 * reach].map(|reach| reach * number());
            [w * (center[0] + x), w * (center[1] + y), w * (center[2] + z), w]
        }));
    }
    Scene::loose(clip, Size::square(size))
}

/// A sphere with as many faces behind as before.
fn sphere(rows: u32, size: usize) -> Scene {
    let columns = 2 * rows;
    let mut clip = Clip::new();
    let mut faces = Vec::new();
    for row in 0..=rows {
        for column in 0..columns {
            let (sin, cos) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
            let angle = 0.3 + std::f64::consts::TAU * f64::from(column) / f64::from(columns);
            let [x, y, z] = [sin * angle.cos(), cos, sin * angle.sin()];
            let [y, z] = [0.9 * y - 0.43 * z, 0.43 * y + 0.9 * z];
            clip.push([0.83 * x + 0.01, 0.81 * y - 0.02, 0.6 * z, 1.0]);
            if row < rows {
                let at =
                    |down: u32, right: u32| (row + down) * columns + (column + right) % columns;
                faces.extend([[at(0, 0), at(1, 0), at(0, 1)], [at(0, 1), at(1, 0), at(1, 1)]]);
            }
        }
    }
    Scene::new(clip, faces, Size::square(size))
}

#[test]
fn a_crowded_pixel_is_the_mean_of_smaller_pixels() {
    // With how many times as many pixels along each side no pixel is crowded.
    for (scene, times) in [
        (heap(2_000, 0.1, 1, 1), 8),
        (heap(700, 0.3, 1, 2), 8),
        (heap(600, 1.0, 2, 3), 4),
        (sphere(40, 2), 8),
    ] {
        let (found, expected) = (scene.draw(1, Limits::DEFAULT), scene.draw(times, WITHOUT_CUTS));
        assert!(found.counts.crowded > 0 && expected.counts.crowded == 0);
        let [value, gradient] = [found.image_error(&expected), found.gradient_error(&expected)];
        assert!(found.counts.sampled == 0.0, "{}", found.counts.sampled);
        assert!(value < 1e-11 && gradient < 1e-8, "{value:e} {gradient:e}");
    }
}

#[test]
fn what_is_sampled_bounds_the_error() {
    let mut sampled_drawings = 0;
    for seed in 0..5 {
        let scene = heap(60, 0.6, 2, seed);
        let expected = scene.draw(1, WITHOUT_CUTS);
        for (depth, work) in [(1, 1 << 20), (3, 1 << 20), (6, 1 << 20), (12, 1 << 12), (12, 0)] {
            let limits = Limits { faces: 3, faces_of_cell: 3, depth, work, ..Limits::DEFAULT };
            let found = scene.draw(1, limits);
            let (error, sampled) = (found.image_error(&expected), found.counts.sampled);
            assert!(error <= sampled + 1e-13, "{seed} {depth}: {error} of {sampled}");
            assert!(sampled < 4.0 + 1e-12, "{sampled}");
            sampled_drawings += usize::from(sampled > 0.0);
        }
    }
    assert!(sampled_drawings > 8, "{sampled_drawings}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn cuts_change_nothing(
        (clip, _, _) in loose_faces(),
        width in 1..4_usize,
        height in 1..4_usize,
        // Whether to move places to borders and middles of pixels.
        snap in prop_oneof![Just(0.0), Just(2.0)],
        faces_of_cell in prop_oneof![Just(usize::MAX), Just(4_usize)],
    ) {
        let size = Size { width, height };
        let snapped = |x: f64, extent: usize| {
            let steps = snap * extent as f64;
            (x * steps).round() / steps
        };
        // Only the first face: where an edge lies exactly before another face's edge, there is a kink. And
        // without perspective: what is shaded beside a side on a border is shaded at two places, but of
        // each part of it where it is cut.
        let clip = clip.into_iter().enumerate().map(|(k, [x, y, z, w])| {
            if snap == 0.0 {
                return [x, y, z, w];
            }
            let [x, y] = [x / w, y / w];
            let is_first = k < 3;
            let x = if is_first { snapped(x, width) } else { x };
            let y = if is_first { snapped(y, height) } else { y };
            [x, y, z, 1.0]
        });
        let scene = Scene::loose(clip.collect(), size);
        let limits = Limits { faces: 0, faces_of_cell, ..Limits::DEFAULT };
        let (found, expected) = (scene.draw(1, limits), scene.draw(1, WITHOUT_CUTS));
        prop_assume!(found.counts.crowded > 0);
        prop_assert!(faces_of_cell == 4 || found.counts.sampled == 0.0);
        let (value, gradient) = (found.image_error(&expected), found.gradient_error(&expected));
        prop_assert!(value <= 1e-12 + found.counts.sampled, "{value}");
        prop_assert!(gradient < 1e-10 || found.counts.sampled > 0.0, "{gradient}");
    }

    /// In a pixel, faces that surely lie side by side are not held against each other: here in part, for the
    /// sheet folds and leaves the depth range. In a cell of a crowded pixel that is so of neighbours alone;
    /// `sheets` has a law that does not rely on these.
    #[test]
    fn cuts_change_nothing_of_a_sheet_of_small_faces(
        (clip, faces) in crumpled(),
        width in 1..4_usize,
        height in 1..4_usize,
        deeper in 1.0..3.0,
        cull in prop_oneof![Just(Cull::None), Just(Cull::Back), Just(Cull::Front)],
    ) {
        let clip: Clip = clip.into_iter().map(|[x, y, z, w]| [x, y, deeper * z, w]).collect();
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        let scene = Scene { clip, mesh, size: Size { width, height }, cull };
        let limits = Limits { faces: 0, faces_of_cell: usize::MAX, ..Limits::DEFAULT };
        let (found, expected) = (scene.draw(1, Limits::DEFAULT), scene.draw(1, limits));
        prop_assert_eq!((found.counts.crowded, expected.counts.sampled), (0, 0.0));
        let (value, gradient) = (found.image_error(&expected), found.gradient_error(&expected));
        prop_assert!(value < 1e-12, "{value}");
        prop_assert!(gradient < 1e-7, "{gradient}");
    }
}

/// A sheet of small faces whose rim crosses the pixel, and a tip that pokes through its middle. All but the tip
/// is beyond the depth range, so the tip ends at none of its edges.
#[test]
fn a_tip_within_the_depth_range_takes_its_place_from_a_sheet() {
    let (columns, rows) = ([-2.0, -0.9, 0.1, 0.8], [-2.0, 0.0, 2.0]);
    let mut clip: Clip = rows.iter().flat_map(|&y| columns.map(|x| [x, y, 0.9, 1.0])).collect();
    let mut faces = Vec::new();
    for corner in (0..7).filter(|corner| corner % 4 < 3) {
        faces.extend([[corner, corner + 1, corner + 5], [corner, corner + 5, corner + 4]]);
    }
    let hub = clip.len() as u32;
    clip.push([-0.3, 0.1, 0.85, 1.0]);
    for k in 0..6 {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 6.0).sin_cos();
        clip.push([0.5 * cos - 0.3, 0.5 * sin + 0.1, 1.3, 1.0]);
        faces.push([hub, hub + 1 + k, hub + 1 + (k + 1) % 6]);
    }
    let mesh = Mesh::new(faces, clip.len()).unwrap();
    let tape = Tape::<f64>::new();
    let fragments =
        rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(Size::square(1)).creases(&[])).unwrap();
    let weights = fragments.weight.unwrap().value();
    let of = |is_tip: bool| -> f64 {
        let pairs = fragments.coverage.faces().zip(weights.data());
        pairs.filter(|(face, _)| (*face >= 12) == is_tip).map(|(_, weight)| weight).sum()
    };
    // It comes through at a ninth of the way to its ring: a hexagon.
    let tip = 1.5 * f64::sqrt(3.0) * f64::powi(0.5 / 9.0, 2) / 4.0;
    let (found, sheet) = (of(true), of(false));
    assert!((found - tip).abs() < 1e-12 && (sheet - (0.9 - tip)).abs() < 1e-12, "{found} {sheet}");
}
