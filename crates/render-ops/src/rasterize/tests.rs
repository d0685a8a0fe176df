//! Laws of rasterization: against an oracle that solves a linear system per pixel and face, then
//! identities, then the extreme cases.

use bokashi_core::{Tape, Tensor};
use proptest::prelude::*;

use super::*;
use crate::coverage::Culled;
use crate::depth::depth;

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Seen {
    face: u32,
    uv: [f64; 2],
    depth: f64,
}

/// A picture: what each pixel sees, row by row from the top, and which faces were not drawn.
#[derive(Debug, PartialEq)]
struct Drawn {
    pixels: Vec<Option<Seen>>,
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
    let fragments = rasterize(positions, &mesh, options)?;
    let coverage = &fragments.coverage;
    assert_eq!(fragments.barycentrics.shape(), [coverage.count(), 2].into());
    let depth = depth(&fragments)?;
    assert_eq!(depth.shape(), [coverage.count()].into());
    let (uv, depth) = (fragments.barycentrics.value(), depth.value());
    let faces: Vec<_> = coverage.faces().collect();
    let seen = |n: usize| Seen {
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
    Tensor::from_fn([clip.len(), 4], |k| T::from_f64(clip[k / 4][k % 4]))
}

/// The gradient of `sum u + 2 v + 3 depth` with respect to the clip positions.
fn gradient<T: Scalar>(clip: &Clip, faces: &[[u32; 3]], size: Size) -> Vec<f64> {
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&tensor(clip));
    let mesh = Mesh::new(faces.to_vec(), clip.len()).unwrap();
    let fragments = rasterize(positions, &mesh, size).unwrap();
    let uv_bar =
        Tensor::from_fn(fragments.barycentrics.shape(), |k| T::from_f64(1.0 + (k % 2) as f64));
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

// ---- The oracle

/// The weights b with `sum b_i (x_i, y_i, w_i) = (X, Y, 1)` for the pixel centre (X, Y) in NDC, by
/// Gaussian elimination; `None` for a singular system.
fn solve(vertices: [[f64; 4]; 3], ndc: [f64; 2]) -> Option<[f64; 3]> {
    let mut rows: [[f64; 4]; 3] = [
        [vertices[0][0], vertices[1][0], vertices[2][0], ndc[0]],
        [vertices[0][1], vertices[1][1], vertices[2][1], ndc[1]],
        [vertices[0][3], vertices[1][3], vertices[2][3], 1.0],
    ];
    for column in 0..3 {
        let pivot =
            (column..3).max_by(|&i, &j| rows[i][column].abs().total_cmp(&rows[j][column].abs()))?;
        rows.swap(column, pivot);
        if rows[column][column].abs() < 1e-9 {
            return None;
        }
        for row in column + 1..3 {
            let factor = rows[row][column] / rows[column][column];
            for k in column..4 {
                rows[row][k] -= factor * rows[column][k];
            }
        }
    }
    let mut b = [0.0; 3];
    for row in (0..3).rev() {
        let known: f64 = (row + 1..3).map(|k| rows[row][k] * b[k]).sum();
        b[row] = (rows[row][3] - known) / rows[row][row];
    }
    Some(b)
}

/// What the oracle knows of a pixel.
enum Verdict {
    Sees(Option<Seen>),
    /// An edge, the depth range or another face is too near to tell.
    TooClose,
}

fn oracle(clip: &Clip, faces: &[[u32; 3]], size: Size, pixel: usize) -> Verdict {
    let margin = 1e-6;
    let (column, row) = ((pixel % size.width) as f64, (pixel / size.width) as f64);
    let ndc = [
        (2.0 * column + 1.0) / size.width as f64 - 1.0,
        1.0 - (2.0 * row + 1.0) / size.height as f64,
    ];
    let mut nearest: Option<Seen> = None;
    for (face, indices) in (0..).zip(faces) {
        let vertices = indices.map(|index| clip[index as usize]);
        let Some(b) = solve(vertices, ndc) else { return Verdict::TooClose };
        let depth: f64 = (0..3).map(|i| vertices[i][2] * b[i]).sum();
        let least = b.into_iter().fold(f64::INFINITY, f64::min).min(1.0 - depth.abs());
        if least < -margin {
            continue;
        }
        if least < margin || nearest.is_some_and(|other| (other.depth - depth).abs() < margin) {
            return Verdict::TooClose;
        }
        let sum: f64 = b.iter().sum();
        if nearest.is_none_or(|other| depth < other.depth) {
            nearest = Some(Seen { face, uv: [b[0] / sum, b[1] / sum], depth });
        }
    }
    Verdict::Sees(nearest)
}

/// Compares a picture with the oracle; returns how many pixels it could tell, and the number of
/// all.
fn assert_is_the_oracles<T: Scalar>(
    clip: &Clip,
    faces: &[[u32; 3]],
    size: Size,
    tolerance: f64,
) -> [usize; 2] {
    let drawn = draw::<T>(clip, faces, size);
    let mut told = 0;
    for (pixel, found) in drawn.pixels.iter().enumerate() {
        let Verdict::Sees(expected) = oracle(clip, faces, size, pixel) else { continue };
        told += 1;
        match (found, expected) {
            (None, None) => {}
            (Some(found), Some(expected)) => {
                assert_eq!(found.face, expected.face, "pixel {pixel}");
                let pairs = found.uv.into_iter().zip(expected.uv);
                for (found, expected) in pairs.chain([(found.depth, expected.depth)]) {
                    assert!(
                        (found - expected).abs() < tolerance,
                        "{found} not {expected} at {pixel}"
                    );
                }
            }
            _ => panic!("{found:?} instead of {expected:?} at pixel {pixel}"),
        }
    }
    [told, size.pixels()]
}

/// Vertices before and behind the eye, in and out of the image and the depth range; coordinates
/// that f32 holds.
fn vertex() -> impl Strategy<Value = [f64; 4]> {
    let w = prop_oneof![3 => 0.2..2.0_f32, 1 => -1.5..0.2_f32];
    let z = prop_oneof![3 => -0.9..0.9_f32, 1 => -3.0..3.0_f32];
    (-1.6..1.6_f32, -1.6..1.6_f32, z, w).prop_map(|(x, y, z, w)| [x, y, z, w].map(f64::from))
}

fn size() -> impl Strategy<Value = Size> {
    (1..12_usize, 1..12_usize).prop_map(|(width, height)| Size { width, height })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    #[test]
    fn each_pixel_sees_what_the_linear_system_of_its_weights_says(
        clip in prop::collection::vec(vertex(), 12),
        size in size(),
    ) {
        let faces = [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]];
        assert_is_the_oracles::<f64>(&clip, &faces, size, 1e-8);
        assert_is_the_oracles::<f32>(&clip, &faces, size, 1e-5);
    }

    #[test]
    fn a_jittered_grid_with_any_w_has_no_hole_and_no_double(
        jitter in prop::collection::vec((-0.2..0.2_f64, -0.2..0.2_f64, 0.2..5.0_f64), 36),
        flips in prop::collection::vec(0..6_usize, 50),
        size in size(),
    ) {
        // A grid of 5 by 5 quads over the image and beyond it; every vertex that is not on the rim
        // is moved, by less than makes a face fold over.
        let clip: Clip = (0..36)
            .map(|k| {
                let (column, row, (dx, dy, w)) = (k % 6, k / 6, jitter[k]);
                let inner = |at: usize, moved: f64| {
                    (at as f64 + if (1..5).contains(&at) { moved } else { 0.0 }) * 0.5 - 1.25
                };
                [inner(column, dx) * w, inner(row, dy) * w, 0.3 * w, w]
            })
            .collect();
        let faces: Vec<[u32; 3]> = (0..25)
            .flat_map(|k| {
                let corner = (k % 5 + 6 * (k / 5)) as u32;
                [[corner, corner + 1, corner + 7], [corner, corner + 7, corner + 6]]
            })
            .zip(&flips)
            .map(|(face, &order)| orders(face)[order])
            .collect();
        prop_assert!(layers::<f64>(&clip, &faces, size).iter().all(|&count| count == 1));
        prop_assert!(layers::<f32>(&clip, &faces, size).iter().all(|&count| count == 1));
    }
}

#[test]
fn the_oracle_can_tell_nearly_every_pixel() {
    let clip = vec![
        [-0.9, -0.8, 0.1, 1.0],
        [1.4, -0.9, 0.3, 1.2],
        [0.2, 0.9, -0.4, 0.8],
        [-2.0, 1.0, 0.2, -0.5],
    ];
    let size = Size { width: 40, height: 30 };
    let [told, all] = assert_is_the_oracles::<f64>(&clip, &[[0, 1, 2], [1, 2, 3]], size, 1e-10);
    assert!(told * 1000 > all * 999, "{told} of {all}");
}

// ---- Watertight

#[test]
fn a_shared_edge_through_pixel_centres_is_drawn_once_for_all_windings_and_orders() {
    // Around a square, the diagonals of which pass through pixel centres, and so do its sides; a
    // rhombus, whose shared edge is vertical or horizontal.
    let square = [(1.5, 1.5), (5.5, 1.5), (5.5, 5.5), (1.5, 5.5)];
    let rhombus = [(3.5, 0.5), (6.5, 3.5), (3.5, 6.5), (0.5, 3.5)];
    // Six pixels wide and with corners in thirds: nothing is exact.
    let skew = [(0.5, 0.5), (5.1, 1.0 / 3.0), (5.5, 5.5), (1.0 / 3.0, 5.1)];
    for (corners, sides) in [(square, [8, 8]), (rhombus, [8, 8]), (skew, [6, 6]), (skew, [7, 9])] {
        let size = Size { width: sides[0], height: sides[1] };
        let clip: Clip = corners.iter().map(|&(x, y)| at_px(size, x, y)).collect();
        let split = [[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]];
        let whole = layers::<f64>(&clip, &split[0], size);
        for [left, right] in split {
            for (left, right) in
                orders(left).into_iter().flat_map(|l| orders(right).map(|r| (l, r)))
            {
                assert_eq!(layers::<f64>(&clip, &[left, right], size), whole, "{left:?} {right:?}");
                assert!(layers::<f32>(&clip, &[left, right], size).iter().all(|&count| count <= 1));
            }
        }
        assert!(whole.iter().all(|&count| count <= 1));
        assert!(whole.contains(&1));
    }
    // Of the sides of the square the left and the top one belong to it: 4 x 4 pixel centres.
    let size = Size::square(8);
    let clip: Clip = square.iter().map(|&(x, y)| at_px(size, x, y)).collect();
    let drawn = draw::<f64>(&clip, &[[0, 1, 2], [0, 2, 3]], size);
    for (pixel, seen) in drawn.pixels.iter().enumerate() {
        let inside = (1..5).contains(&(pixel % 8)) && (1..5).contains(&(pixel / 8));
        assert_eq!(seen.is_some(), inside, "pixel {pixel}");
    }
}

#[test]
fn a_fan_around_a_point_draws_each_pixel_once() {
    for size in [Size::square(16), Size { width: 10, height: 14 }] {
        for count in [3, 4, 5, 8, 64, 512] {
            for center in [(7.5, 7.5), (4.5, 6.5), (4.5, 6.25), (5.3, 7.1)] {
                let mut clip = vec![at_px(size, center.0, center.1)];
                clip.extend((0..count).map(|k| {
                    let angle = f64::from(k) * std::f64::consts::TAU / f64::from(count);
                    at_px(size, center.0 + 40.0 * angle.cos(), center.1 + 40.0 * angle.sin())
                }));
                let faces: Vec<_> = (0..count as u32)
                    .map(|k| orders([0, k + 1, (k + 1) % count as u32 + 1])[k as usize % 6])
                    .collect();
                let once = |layers: Vec<usize>| layers.iter().all(|&count| count == 1);
                assert!(
                    once(layers::<f64>(&clip, &faces, size)),
                    "{count} faces at {center:?}, {size}"
                );
                assert!(
                    once(layers::<f32>(&clip, &faces, size)),
                    "{count} faces at {center:?}, {size}"
                );
            }
        }
    }
}

#[test]
fn a_grid_with_its_lines_on_pixel_centres_has_no_hole_and_no_double() {
    // On a width that is a power of two the lines lie exactly on the centres, on the other one
    // they lie off by rounding, so that the rim may be drawn or not.
    for (width, is_exact) in [(16, true), (12, false), (11, false)] {
        let size = Size { width, height: 8 };
        let at = |k: usize| ((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
        let clip: Clip = (0..size.pixels()).map(|k| at_px(size, at(k).0, at(k).1)).collect();
        let faces: Vec<[u32; 3]> = (0..7 * width)
            .filter(|k| k % width < width - 1)
            .flat_map(|k| {
                let (k, below) = (k as u32, (k + width) as u32);
                match k % 2 {
                    0 => [[k, k + 1, below + 1], [k, below + 1, below]],
                    _ => [[k, below, k + 1], [k + 1, below, below + 1]],
                }
            })
            .collect();
        for layers in [layers::<f64>(&clip, &faces, size), layers::<f32>(&clip, &faces, size)] {
            for (pixel, count) in layers.into_iter().enumerate() {
                let (column, row) = (pixel % width, pixel / width);
                let is_owned = column < width - 1 && row < 7;
                if is_exact || (1..width - 1).contains(&column) && (1..7).contains(&row) {
                    assert_eq!(count, usize::from(is_owned), "pixel {pixel} of {size}");
                }
                assert!(count <= 1, "pixel {pixel} of {size}");
            }
        }
    }
}

#[test]
fn bands_join_without_a_seam() {
    let size = Size { width: 300, height: 170 };
    let clip = vec![
        [-1.0, -1.0, 0.0, 1.0],
        [3.0, -1.0, 0.0, 1.0],
        [-1.0, 3.0, 0.0, 1.0],
        [0.9, 0.8, -0.5, 1.0],
    ];
    let drawn = draw::<f32>(&clip, &[[0, 1, 2], [0, 1, 3]], size);
    assert_eq!(drawn.count(), size.pixels());
    let tall = Size { width: 1, height: 40_000 };
    assert_eq!(draw::<f32>(&clip, &[[0, 1, 2]], tall).count(), 40_000);
    let [told, all] = assert_is_the_oracles::<f64>(&clip, &[[0, 1, 3]], size, 1e-9);
    assert!(told * 100 > all * 99);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(4000) })]

    #[test]
    fn three_points_on_a_line_but_for_rounding_are_not_drawn(
        pixel in 0..12 * 9_usize,
        angle in 0.0..std::f64::consts::TAU,
        points in prop::array::uniform3((-1.0..1.0_f64, 0.5..1.5_f64)),
    ) {
        let size = Size { width: 12, height: 9 };
        let [x, y, ..] = at_px(size, (pixel % 12) as f64 + 0.5, (pixel / 12) as f64 + 0.5);
        let (sin, cos) = angle.sin_cos();
        let clip = points.map(|(t, w)| [(x + t * cos) * w, (y + t * sin) * w, 0.1 * w, w]);
        let drawn = draw::<f64>(&clip.to_vec(), &[[0, 1, 2]], size);
        prop_assert_eq!(drawn.count(), 0);
        prop_assert_eq!(drawn.culled.degenerate + drawn.culled.outside, 1);
    }
}

// ---- Which face is seen

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
fn of_identical_faces_the_one_of_lower_index_is_seen() {
    let (clip, faces) = layered();
    let twice: Vec<_> = faces.iter().chain(&faces).copied().collect();
    for options in [WIDE, Size::square(1)] {
        let (once, twice) =
            (draw::<f32>(&clip, &faces, options), draw::<f32>(&clip, &twice, options));
        assert_eq!(once.pixels, twice.pixels);
    }
}

#[test]
fn a_hidden_face_changes_nothing() {
    let (mut clip, mut faces) = layered();
    let before = draw::<f32>(&clip, &faces, WIDE);
    // Behind the first face: the same corners, moved back.
    for corner in 0..3 {
        let [x, y, z, w] = clip[corner];
        clip.push([x, y, z + 0.05, w]);
    }
    faces.push([7, 8, 9]);
    assert_eq!(draw::<f32>(&clip, &faces, WIDE), before);
}

#[test]
fn permuting_the_faces_permutes_the_ids_and_nothing_else() {
    let (clip, faces) = layered();
    let order = [3, 0, 4, 2, 1];
    let permuted: Vec<_> = order.iter().map(|&face| faces[face]).collect();
    let mut drawn = draw::<f64>(&clip, &permuted, WIDE);
    for seen in drawn.pixels.iter_mut().flatten() {
        seen.face = order[seen.face as usize] as u32;
    }
    assert_eq!(drawn, draw::<f64>(&clip, &faces, WIDE));
}

#[test]
fn the_order_of_corners_moves_the_weights_and_nothing_else() {
    let (clip, faces) = layered();
    let plain = draw::<f64>(&clip, &faces, WIDE);
    for order in 0..6 {
        let turned: Vec<_> = faces.iter().map(|&face| orders(face)[order]).collect();
        let other = draw::<f64>(&clip, &turned, WIDE);
        assert_eq!(other.faces(), plain.faces());
        for (seen, plain) in other.pixels.iter().zip(&plain.pixels) {
            let (Some(seen), Some(plain)) = (seen, plain) else { continue };
            let weights = |[u, v]: [f64; 2]| [u, v, 1.0 - u - v];
            let (face, corners) = (faces[plain.face as usize], turned[plain.face as usize]);
            for (corner, weight) in corners.iter().zip(weights(seen.uv)) {
                let at = face.iter().position(|other| other == corner).unwrap();
                approx::assert_relative_eq!(weight, weights(plain.uv)[at], epsilon = 1e-13);
            }
            approx::assert_relative_eq!(seen.depth, plain.depth, epsilon = 1e-13);
        }
    }
}

#[test]
fn every_face_shows_its_front_or_its_back() {
    let (clip, faces) = layered();
    let drawn = |cull, face| draw::<f32>(&clip, &[face], RasterOptions { size: WIDE, cull });
    for face in faces {
        let all = drawn(Cull::None, face);
        let [front, back] = [Cull::Back, Cull::Front].map(|cull| drawn(cull, face));
        assert_eq!(front.count() + back.count(), all.count());
        assert_eq!(front.culled.facing + back.culled.facing, 1);
        // The other winding shows the other side.
        let turned = drawn(Cull::Back, orders(face)[3]);
        assert_eq!(turned.faces(), back.faces());
    }
    // Counter-clockwise on the screen, y up, is the front.
    let clip = vec![[-1.0, -1.0, 0.0, 1.0], [1.0, -1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]];
    let options = RasterOptions { size: WIDE, cull: Cull::Back };
    assert!(draw::<f32>(&clip, &[[0, 1, 2]], options).count() > 0);
    assert_eq!(draw::<f32>(&clip, &[[0, 2, 1]], options).count(), 0);
}

#[test]
fn scaling_all_clip_positions_by_a_power_of_two_changes_no_bit() {
    let (clip, faces) = layered();
    let scaled = |factor: f64| -> Clip { clip.iter().map(|p| p.map(|c| c * factor)).collect() };
    let plain = draw::<f64>(&clip, &faces, WIDE);
    for exponent in [-1000, -300, -70, -1, 1, 70, 300, 1000] {
        let factor = 2.0_f64.powi(exponent);
        assert_eq!(draw::<f64>(&scaled(factor), &faces, WIDE), plain, "2^{exponent}");
        // The gradient has degree -1.
        let expected = gradient::<f64>(&clip, &faces, WIDE).into_iter().map(|entry| entry / factor);
        assert_eq!(
            gradient::<f64>(&scaled(factor), &faces, WIDE),
            expected.collect::<Vec<_>>(),
            "2^{exponent}"
        );
    }
    let plain = draw::<f32>(&clip, &faces, WIDE);
    for exponent in [-100, -50, 50, 120] {
        assert_eq!(draw::<f32>(&scaled(2.0_f64.powi(exponent)), &faces, WIDE), plain);
    }
}

#[test]
fn the_gradient_is_orthogonal_to_the_positions() {
    // Scaling a vertex's four coordinates by one factor for all changes nothing.
    let (clip, faces) = layered();
    let gradient = gradient::<f64>(&clip, &faces, WIDE);
    let terms = || gradient.iter().zip(clip.as_flattened()).map(|(bar, c)| bar * c);
    let size: f64 = terms().map(f64::abs).sum();
    assert!(size > 1.0 && terms().sum::<f64>().abs() < 1e-13 * size);
}

// ---- Extreme cases

#[test]
fn a_face_behind_the_eye_or_beside_the_image_or_out_of_the_depth_range_is_outside() {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.0, 0.5]];
    let cases: [[[f64; 4]; 3]; 5] = [
        corners.map(|[x, y]| [x, y, 0.0, -1.0]),
        corners.map(|[x, y]| [x, y, 0.0, 0.0]),
        corners.map(|[x, y]| [x + 2.0, y, 0.0, 1.0]),
        corners.map(|[x, y]| [x, y, 1.5, 1.0]),
        corners.map(|[x, y]| [x, y, -1.5, 1.0]),
    ];
    for clip in cases {
        let drawn = draw::<f32>(&clip.to_vec(), &[[0, 1, 2]], WIDE);
        assert_eq!(drawn.count(), 0);
        assert_eq!(drawn.culled, Culled { outside: 1, ..Culled::default() });
    }
}

#[test]
fn a_face_without_area_is_not_drawn_but_counted_and_gets_no_gradient() {
    let size = Size::square(16);
    let thirds = |k: f64| [0.1 * k, 0.1 * k, 0.0, 1.0];
    let lines: [[[f64; 4]; 3]; 6] = [
        // Through pixel centres, across, down and along the diagonal.
        [at_px(size, 1.5, 3.5), at_px(size, 7.5, 3.5), at_px(size, 12.5, 3.5)],
        [at_px(size, 3.5, 1.5), at_px(size, 3.5, 8.5), at_px(size, 3.5, 11.5)],
        [at_px(size, 1.5, 1.5), at_px(size, 4.5, 4.5), at_px(size, 9.5, 9.5)],
        // The same where no coordinate is exact: the area is a rounding error.
        [thirds(-7.0), thirds(1.0), thirds(6.0)],
        [[-0.7, -0.35, 0.1, 1.0], [0.2, 0.1, 0.1, 1.0], [0.6, 0.3, 0.1, 1.0]],
        // All in one point.
        [at_px(size, 3.5, 3.5), at_px(size, 3.5, 3.5), at_px(size, 3.5, 3.5)],
    ];
    for clip in lines {
        let clip = clip.to_vec();
        for face in orders([0, 1, 2]) {
            let [double, single] =
                [draw::<f64>(&clip, &[face], size), draw::<f32>(&clip, &[face], size)];
            assert_eq!(double.count(), 0, "{clip:?}");
            assert_eq!(double.culled, Culled { degenerate: 1, ..Culled::default() }, "{clip:?}");
            assert!(gradient::<f64>(&clip, &[face], size).iter().all(|&entry| entry == 0.0));
            // In f32 the three points may not be on one line any more.
            assert!(single.pixels.iter().flatten().all(|seen| seen.depth.is_finite()));
        }
    }
    let clip = vec![at_px(size, 1.0, 1.0), at_px(size, 9.0, 2.0)];
    let drawn = draw::<f32>(&clip, &[[0, 1, 1], [0, 0, 0]], size);
    assert_eq!((drawn.count(), drawn.culled.degenerate), (0, 2));
}

#[test]
fn a_sliver_through_pixel_centres_is_finite() {
    let size = Size::square(16);
    for width in [1e-7, 1e-9] {
        let clip = vec![
            at_px(size, 2.5, 4.5 - width),
            at_px(size, 13.5, 4.5 - width),
            at_px(size, 13.5, 4.5 + width),
        ];
        let drawn = draw::<f64>(&clip, &[[0, 1, 2]], size);
        // The long side passes the centres of row 4 from above on its left half to below.
        assert!(drawn.count() >= 5, "{}", drawn.count());
        for seen in drawn.pixels.iter().flatten() {
            assert!(seen.uv.iter().all(|weight| (0.0..=1.0).contains(weight)), "{seen:?}");
        }
        assert!(gradient::<f64>(&clip, &[[0, 1, 2]], size).iter().all(|entry| entry.is_finite()));
        assert!(gradient::<f32>(&clip, &[[0, 1, 2]], size).iter().all(|entry| entry.is_finite()));
    }
}

#[test]
fn a_face_between_pixel_centres_covers_none() {
    let size = Size::square(8);
    let clip = vec![at_px(size, 2.6, 3.6), at_px(size, 3.4, 3.6), at_px(size, 3.0, 4.4)];
    let drawn = draw::<f64>(&clip, &[[0, 1, 2]], size);
    assert_eq!((drawn.count(), drawn.culled), (0, Culled::default()));
}

#[test]
fn a_face_with_far_away_vertices_covers_the_half_plane_that_it_should() {
    for far_px in [1e6, 1e15, 1e30] {
        // Seen from the middle everything above a line through (5.2, 5.2) of slope 1/2, y down.
        let size = Size { width: 13, height: 9 };
        let far = far_px / 4.0;
        let along = |k: f64| at_px(size, 5.2 + k * far, 5.2 - k * far / 2.0);
        let clip = vec![along(-1.0), along(1.0), at_px(size, 5.2 - 2.0 * far, 5.2 - 4.0 * far)];
        let line = [clip[0], clip[1]];
        let side = |x: f64, y: f64| {
            let [_, _, _, w] = line[0];
            let [px, py] = [line[0][0] / w, line[0][1] / w];
            let [dx, dy] = [line[1][0] - px, line[1][1] - py];
            dx * (y - py) - dy * (x - px)
        };
        for order in orders([0, 1, 2]) {
            for drawn in [draw::<f64>(&clip, &[order], size), draw::<f32>(&clip, &[order], size)] {
                assert!(drawn.pixels.iter().flatten().all(|seen| {
                    seen.uv.iter().all(|weight| (0.0..=1.0).contains(weight)) && seen.depth == 0.0
                }));
                // Beyond 1e15 px the line's position within the image is lost to rounding.
                if far_px > 1e7 {
                    continue;
                }
                for (pixel, seen) in drawn.pixels.iter().enumerate() {
                    let [x, y, ..] =
                        at_px(size, (pixel % 13) as f64 + 0.5, (pixel / 13) as f64 + 0.5);
                    let side = side(x, y) / far;
                    if side.abs() > 0.5 {
                        assert_eq!(seen.is_some(), side > 0.0, "pixel {pixel}");
                    }
                }
            }
        }
        // One that covers the screen with room to spare.
        let clip = vec![[-far, -far, 0.0, 1.0], [far, -far, 0.0, 1.0], [0.0, far, 0.0, 1.0]];
        assert_eq!(draw::<f64>(&clip, &[[0, 1, 2]], size).count(), size.pixels());
        assert_eq!(draw::<f32>(&clip, &[[0, 1, 2]], size).count(), size.pixels());
    }
}

#[test]
fn coordinates_up_to_the_largest_number_cover_the_half_plane_that_they_should() {
    // A strip upwards from a base line: the far vertex is too far for its distance to matter, and
    // a coordinate times the width, or the product of two of another vertex's, is beyond f64.
    let size = Size { width: 12, height: 10 };
    for middle in [0.0, 0.05] {
        let strip = |far: f64| {
            vec![[-0.55, -0.45, 0.1, 1.0], [0.65, -0.45, 0.1, 1.0], [middle, far, 0.0, 1.0]]
        };
        let expected = draw::<f64>(&strip(1e30), &[[0, 1, 2]], size);
        assert_eq!(expected.count(), 7 * 7);
        for far in [1e59, 1e100, 1e154, 1e200, 1e306, f64::MAX] {
            for order in orders([0, 1, 2]) {
                let drawn = draw::<f64>(&strip(far), &[order], size);
                assert_eq!(drawn.faces(), expected.faces(), "{far} {order:?}");
                let near = drawn.pixels.iter().zip(&expected.pixels);
                for (seen, expected) in near.filter_map(|(seen, near)| seen.zip(*near)) {
                    approx::assert_relative_eq!(seen.depth, expected.depth, max_relative = 1e-12);
                }
                let bars = gradient::<f64>(&strip(far), &[order], size);
                assert!(bars.iter().all(|bar| bar.is_finite()));
            }
        }
    }
}

#[test]
fn a_vertex_times_a_power_of_two_is_the_same_point_with_another_weight() {
    let size = Size { width: 11, height: 9 };
    let base = vec![[-0.8, -0.7, 0.2, 1.0], [0.9, -0.5, -0.1, 1.2], [0.1, 0.85, 0.3, 0.9]];
    let plain = draw::<f64>(&base, &[[0, 1, 2]], size);
    assert!(plain.count() > 20);
    let bars = gradient::<f64>(&base, &[[0, 1, 2]], size);
    for k in [-980, -400, -190, -30, 30, 190, 400, 980] {
        let factor = f64::powi(2.0, k);
        let mut scaled = base.clone();
        scaled[0] = scaled[0].map(|c| factor * c);
        let drawn = draw::<f64>(&scaled, &[[0, 1, 2]], size);
        assert_eq!(drawn.faces(), plain.faces());
        for (seen, plain) in drawn.pixels.iter().flatten().zip(plain.pixels.iter().flatten()) {
            assert_eq!(seen.depth, plain.depth);
            // In the sum that is the pixel's point, the vertex has its old share.
            let [u, v] = plain.uv;
            let total = u / factor + v + (1.0 - u - v);
            approx::assert_relative_eq!(seen.uv[0], u / factor / total, max_relative = 1e-12);
            approx::assert_relative_eq!(seen.uv[1], v / total, max_relative = 1e-12);
        }
        // The depth does not move, so its gradient is the old one in the old coordinates; that of
        // the weights is orthogonal to the positions.
        let scaled_bars = gradient::<f64>(&scaled, &[[0, 1, 2]], size);
        let terms = scaled_bars
            .iter()
            .zip(scaled.as_flattened())
            .map(|(bar, c)| bar * c)
            .collect::<Vec<_>>();
        let total: f64 = terms.iter().sum();
        let extent: f64 = terms.iter().map(|term| term.abs()).sum();
        assert!(total.abs() <= 1e-12 * extent, "{k}: {total} of {extent}");
        assert_eq!(scaled_bars.iter().map(|bar| bar.is_finite()).filter(|&ok| !ok).count(), 0);
        approx::assert_relative_eq!(scaled_bars[2] * factor, bars[2], max_relative = 1e-12);
    }
}

#[test]
fn denormal_coordinates_are_drawn_as_others() {
    // Multiples of 2^-6: exact, however small the unit is.
    let size = Size { width: 9, height: 7 };
    let unit: Clip =
        vec![[-60.0, -50.0, 3.0, 64.0], [61.0, -40.0, -5.0, 64.0], [3.0, 55.0, 7.0, 48.0]];
    let scaled =
        |unit_size: f64| -> Clip { unit.iter().map(|p| p.map(|c| c * unit_size)).collect() };
    let plain = draw::<f64>(&unit, &[[0, 1, 2]], size);
    assert!(plain.count() > 10);
    assert_eq!(draw::<f64>(&scaled(f64::from_bits(1)), &[[0, 1, 2]], size), plain);
    let plain = draw::<f32>(&unit, &[[0, 1, 2]], size);
    assert_eq!(draw::<f32>(&scaled(f32::from_bits(1).into()), &[[0, 1, 2]], size), plain);
}

#[test]
fn a_negative_zero_is_a_zero() {
    let size = Size::square(3);
    // The corner and two of the sides pass through the centre of the image.
    let clip =
        |zero: f64| vec![[zero, zero, zero, 1.0], [1.0, zero, zero, 1.0], [zero, 1.0, zero, 1.0]];
    for face in orders([0, 1, 2]) {
        assert_eq!(draw::<f64>(&clip(-0.0), &[face], size), draw::<f64>(&clip(0.0), &[face], size));
        assert_eq!(
            gradient::<f64>(&clip(-0.0), &[face], size),
            gradient::<f64>(&clip(0.0), &[face], size)
        );
    }
}

#[test]
fn images_of_one_row_column_or_pixel_are_strips_of_larger_ones() {
    let (clip, faces) = layered();
    // A row of an image of 3 rows, and the same row as an image of its own.
    let tall = draw::<f64>(&clip, &faces, Size { width: 17, height: 3 });
    let strip: Clip = clip.iter().map(|&[x, y, z, w]| [x, 3.0 * y, z, w]).collect();
    let strip = draw::<f64>(&strip, &faces, Size { width: 17, height: 1 });
    assert_eq!(strip.faces(), tall.faces()[17..34]);
    let wide = draw::<f64>(&clip, &faces, Size { width: 3, height: 17 });
    let strip: Clip = clip.iter().map(|&[x, y, z, w]| [3.0 * x, y, z, w]).collect();
    let strip = draw::<f64>(&strip, &faces, Size { width: 1, height: 17 });
    let middle: Vec<_> = wide.faces().chunks(3).map(|row| row[1]).collect();
    assert_eq!(strip.faces(), middle);
    let one = draw::<f64>(&clip, &faces, Size::square(1));
    assert_eq!(one.pixels.len(), 1);
    assert_eq!(one.faces()[0], draw::<f64>(&clip, &faces, Size::square(3)).faces()[4]);
}

#[test]
fn a_vertex_at_infinity_is_the_limit_of_ones_far_away() {
    let size = Size { width: 12, height: 9 };
    // w = 0: the direction (1, 0.3) of the image plane, at a depth that ends up within the range.
    for at_infinity in [[1.0, 0.3, 0.0, 0.0], [-0.4, 1.0, 0.2, 0.0]] {
        let with = |last: [f64; 4]| vec![[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], last];
        let far = at_infinity.map(|c| c + 0.0);
        let far = [far[0], far[1], far[2], 1e-9];
        let (limit, near) = (
            draw::<f64>(&with(at_infinity), &[[0, 1, 2]], size),
            draw::<f64>(&with(far), &[[0, 1, 2]], size),
        );
        assert!(limit.count() > 10);
        assert_eq!(limit.faces(), near.faces());
        assert_is_the_oracles::<f64>(&with(at_infinity), &[[0, 1, 2]], size, 1e-9);
        assert!(
            gradient::<f64>(&with(at_infinity), &[[0, 1, 2]], size).iter().all(|g| g.is_finite())
        );
    }
    // Two such vertices: a half-plane's wedge.
    let clip = vec![[0.05, 0.05, 0.0, 1.0], [1.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.0, 0.0]];
    assert_is_the_oracles::<f64>(&clip, &[[0, 1, 2]], size, 1e-9);
    assert!(draw::<f32>(&clip, &[[0, 1, 2]], size).count() > 10);
}

#[test]
fn weights_stay_between_zero_and_one_for_w_over_twelve_orders() {
    let size = Size { width: 64, height: 48 };
    let ndc = [[-0.8, -0.9], [0.9, -0.6], [0.0, 0.95]];
    let clip: Clip =
        ndc.iter().zip([1e-6, 1.0, 1e6]).map(|([x, y], w)| [x * w, y * w, 0.2 * w, w]).collect();
    for drawn in [draw::<f64>(&clip, &[[0, 1, 2]], size), draw::<f32>(&clip, &[[0, 1, 2]], size)] {
        assert!(drawn.count() > 500);
        for seen in drawn.pixels.iter().flatten() {
            let [u, v] = seen.uv;
            assert!(
                [u, v, 1.0 - u - v].iter().all(|weight| (-1e-7..=1.0).contains(weight)),
                "{seen:?}"
            );
            approx::assert_relative_eq!(seen.depth, 0.2, max_relative = 1e-6);
        }
    }
}

#[test]
fn depth_stays_within_its_range_and_a_plane_cut_by_it_shows_its_visible_part() {
    // From in front of the near plane to behind the far plane: z / w = 2 y, visible for |y| <= 1/2.
    let size = Size { width: 8, height: 32 };
    let clip = vec![[-1.0, -1.0, -2.0, 1.0], [3.0, -1.0, -2.0, 1.0], [-1.0, 3.0, 6.0, 1.0]];
    for drawn in [draw::<f64>(&clip, &[[0, 1, 2]], size), draw::<f32>(&clip, &[[0, 1, 2]], size)] {
        for (pixel, seen) in drawn.pixels.iter().enumerate() {
            let y = 1.0 - (2.0 * (pixel / 8) as f64 + 1.0) / 32.0;
            assert_eq!(seen.is_some(), y.abs() <= 0.5, "pixel {pixel}");
            if let Some(seen) = seen {
                assert!((-1.0..=1.0).contains(&seen.depth));
                approx::assert_relative_eq!(seen.depth, 2.0 * y, epsilon = 1e-6);
            }
        }
    }
    // A face in the near plane itself is visible.
    let clip: Clip = clip.iter().map(|&[x, y, _, w]| [x, y, -w, w]).collect();
    assert_eq!(draw::<f32>(&clip, &[[0, 1, 2]], size).count(), size.pixels());
}

#[test]
fn a_mesh_without_faces_is_background() {
    let drawn = draw::<f32>(&vec![[0.0, 0.0, 0.0, 1.0]], &[], WIDE);
    assert_eq!((drawn.count(), drawn.culled), (0, Culled::default()));
    assert_eq!(gradient::<f32>(&vec![[0.0, 0.0, 0.0, 1.0]], &[], WIDE), [0.0; 4]);
}

#[test]
fn a_position_that_is_not_finite_is_refused_by_its_vertex() {
    let mut clip = layered().0;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        clip[3] = [0.5, bad, 0.0, 1.0];
        // A vertex that no face uses is refused too.
        let error = try_draw::<f64>(&clip, &[[0, 1, 2]], WIDE).unwrap_err();
        let message =
            format!("clip positions need to be finite, got (0.5, {bad}, 0, 1) at vertex 3");
        assert_eq!(error.to_string(), message);
    }
}

#[test]
fn wrong_sizes_and_shapes_are_refused() {
    let (clip, faces) = layered();
    let empty = Size { width: 0, height: 5 };
    let error = try_draw::<f32>(&clip, &faces, empty).unwrap_err();
    assert_eq!(
        error.to_string(),
        "an image needs at least one pixel and fewer than 2^32, got 0 x 5"
    );
    let tape = Tape::<f32>::new();
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    for shape in [vec![12], vec![4, 3], vec![2, 4], vec![3, 4, 1]] {
        let clip = tape.leaf(&Tensor::zeros(shape.as_slice()));
        let before = tape.len();
        let error = rasterize(clip, &mesh, WIDE).unwrap_err();
        assert!(
            error.to_string().starts_with("rasterize needs clip positions of shape [3, 4], got")
        );
        assert_eq!(tape.len(), before);
    }
}

/// A quadrilateral of whole numbers times `unit`: exact down to the smallest number there is.
fn whole_numbers(unit: f64) -> Clip {
    let whole = [
        [-60.0, -50.0, 3.0, 64.0],
        [61.0, -40.0, -5.0, 64.0],
        [30.0, 55.0, 7.0, 60.0],
        [-40.0, 44.0, -9.0, 48.0],
    ];
    whole.iter().map(|vertex| vertex.map(|c| c * unit)).collect()
}

#[test]
fn a_gradient_beyond_the_range_of_the_numbers_is_infinite_and_not_nan() {
    // In every row both faces are seen, so there are several runs, with terms of either sign.
    let faces = [[0, 1, 2], [0, 2, 3]];
    let single = gradient::<f32>(&whole_numbers(f64::from(f32::from_bits(1))), &faces, WIDE);
    let double = gradient::<f64>(&whole_numbers(f64::from_bits(1)), &faces, WIDE);
    for bars in [single, double] {
        assert!(bars.iter().any(|bar| bar.is_infinite()));
        assert!(bars.iter().all(|bar| !bar.is_nan()), "{bars:?}");
    }
}
