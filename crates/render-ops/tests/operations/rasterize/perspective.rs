//! Laws of exact coverage where w differs much between vertices.

use super::exact::{exact, picture};
use super::*;
use bokashi_render_ops::{Mesh, Size, depth, eye_depth, rasterize};
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use std::f64::consts::PI;

const BACKGROUND: [f64; 2] = [0.1, 0.9];

/// A triangle of three faces around a point inside it, whose edges are all seams: no pixel that a face
/// ends in shows its centre.
#[derive(Debug, Clone)]
struct Scene {
    clip: Clip,
    colors: Tensor<f64>,
    size: Size,
}

const FACES: [[u32; 3]; 3] = [[0, 1, 3], [1, 2, 3], [2, 0, 3]];

/// Distances w from 10^-span to 1.
fn scenes(span: f64) -> impl Strategy<Value = Scene> {
    let place = prop::array::uniform3(prop::array::uniform2(-1.3..1.3));
    let ws = prop::array::uniform4(0.0..1.0);
    let shares = prop::array::uniform3(0.2..1.2);
    let colors = prop::array::uniform8(0.0..1.0);
    let sizes = (1..5_usize, 1..5_usize);
    (place, ws, shares, colors, sizes).prop_map(
        move |(places, ws, shares, colors, (width, height))| {
            let total: f64 = shares.iter().sum();
            let inside = [0, 1]
                .map(|axis| -> f64 { (0..3).map(|i| shares[i] / total * places[i][axis]).sum() });
            let [p, q, r] = places;
            let clip = [p, q, r, inside].into_iter().zip(ws).map(|([x, y], w): (_, f64)| {
                let w = f64::powf(10.0, -span * w);
                [x * w, y * w, 0.0, w]
            });
            let colors = Tensor::new([4, 2], colors.to_vec()).unwrap();
            Scene { clip: clip.collect(), colors, size: Size { width, height } }
        },
    )
}

impl Scene {
    fn upstream(&self) -> Tensor<f64> {
        let shape = [self.size.height, self.size.width, 2];
        Tensor::from_flat_fn(shape, |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4)
    }

    fn mesh(&self) -> Mesh {
        Mesh::new(FACES.to_vec(), 4).unwrap().with_seams(|_, _| true)
    }

    /// The image, and the pixels that are resolved.
    fn image(&self, clip: &Clip) -> (Tensor<f64>, Vec<usize>) {
        let tape = Tape::<f64>::new();
        let [positions, colors] = [tape.leaf(&tensor(clip)), tape.leaf(&self.colors)];
        let image = picture(positions, colors, &self.mesh(), exact(self.size)).value();
        let fragments = rasterize(positions, &self.mesh(), exact(self.size).creases(&[])).unwrap();
        let resolved = fragments.coverage.boundary().map(|(pixel, _)| pixel).collect();
        (image, resolved)
    }

    fn loss(&self, clip: &Clip) -> (f64, Vec<usize>) {
        let (image, resolved) = self.image(clip);
        let upstream = self.upstream();
        let terms = image.data().iter().zip(upstream.data()).map(|(x, u)| x * u);
        (terms.sum(), resolved)
    }

    fn gradient(&self) -> Vec<f64> {
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&tensor(&self.clip));
        let image = picture(positions, tape.leaf(&self.colors), &self.mesh(), exact(self.size));
        let gradients = tape.vjp(&[(image, &self.upstream())]).unwrap();
        gradients.get_or_zeros(positions).data().to_vec()
    }

    /// The mean colour of a pixel, by clipping in the image and a quadrature.
    fn mean(&self, pixel: usize, nodes: &[[f64; 3]]) -> [f64; 2] {
        let Size { width, height } = self.size;
        let [column, row] = [pixel % width, height - 1 - pixel / width];
        let at = |k: usize, extent: usize| 2.0 * k as f64 / extent as f64 - 1.0;
        let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
        let from = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
        let area = 4.0 / (width * height) as f64;
        let mut mean = BACKGROUND;
        for face in FACES {
            let corners = face.map(|vertex| self.clip[vertex as usize]);
            let mut polygon: Vec<_> = corners.iter().map(|[x, y, _, w]| [x / w, y / w]).collect();
            if cross(from(polygon[0], polygon[1]), from(polygon[0], polygon[2])) < 0.0 {
                polygon.reverse();
            }
            let borders = [
                (0, 1.0, at(column, width)),
                (0, -1.0, -at(column + 1, width)),
                (1, 1.0, at(row, height)),
                (1, -1.0, -at(row + 1, height)),
            ];
            for (axis, sign, border) in borders {
                let inwards = |point: [f64; 2]| sign * point[axis] - border;
                let mut inside = Vec::new();
                for k in 0..polygon.len() {
                    let [p, q] = [polygon[k], polygon[(k + 1) % polygon.len()]];
                    let [a, b] = [inwards(p), inwards(q)];
                    if a >= 0.0 {
                        inside.push(p);
                    }
                    if a * b < 0.0 {
                        let share = a / (a - b);
                        inside.push([0, 1].map(|axis| p[axis] + share * (q[axis] - p[axis])));
                    }
                }
                polygon = inside;
            }
            // Weights but for a factor: linear over the image.
            let weights = |[x, y]: [f64; 2]| {
                let [p, q, r] =
                    corners.map(|corner| [corner[0] - x * corner[3], corner[1] - y * corner[3]]);
                [cross(q, r), cross(r, p), cross(p, q)]
            };
            let color =
                |vertex: u32, channel: usize| self.colors.data()[2 * vertex as usize + channel];
            for k in 2..polygon.len() {
                let [a, b, c] = [polygon[0], polygon[k - 1], polygon[k]];
                let share = cross(from(a, b), from(a, c)) / area;
                let [a, b, c] = [a, b, c].map(weights);
                for &[u, rest, weight] in nodes {
                    let far = [0, 1, 2].map(|i| rest * b[i] + u * c[i]);
                    for &[s, before, after] in nodes {
                        let n = [0, 1, 2].map(|i| before * a[i] + s * far[i]);
                        let share = share * weight * after * s;
                        for (channel, mean) in mean.iter_mut().enumerate() {
                            let sum: f64 = (0..3).map(|i| n[i] * color(face[i], channel)).sum();
                            let color = sum / (n[0] + n[1] + n[2]);
                            *mean += share * (color - BACKGROUND[channel]);
                        }
                    }
                }
            }
        }
        mean
    }
}

/// Nodes u of the tanh-sinh quadrature over [0, 1], 1 - u, and their weights.
fn nodes(steps: i32) -> Vec<[f64; 3]> {
    let step = 1.0 / f64::from(steps);
    let node = |k: i32| {
        let s = f64::from(k) * step;
        let e = (-PI * s.sinh()).exp();
        let [u, rest] = [1.0 / (1.0 + e), e / (1.0 + e)];
        [u, rest, u * rest * PI * s.cosh() * step]
    };
    (-4 * steps..=4 * steps).map(node).filter(|[.., weight]| *weight > 0.0).collect()
}

#[test]
fn pixels_are_means_under_any_perspective() {
    let mut runner = TestRunner::deterministic();
    let (nodes, mut pixels) = (nodes(10), 0);
    for span in [0.0, 0.7, 3.0, 4.5] {
        for _ in 0..60 {
            let scene = scenes(span).new_tree(&mut runner).unwrap().current();
            let (image, resolved) = scene.image(&scene.clip);
            for pixel in resolved {
                pixels += 1;
                let found = &image.data()[2 * pixel..2 * pixel + 2];
                for (found, expected) in found.iter().zip(scene.mean(pixel, &nodes)) {
                    let error = (found - expected).abs();
                    assert!(error < 1e-11, "{span}: {found} {expected} {error:e} {scene:?}");
                }
            }
        }
    }
    assert!(pixels > 500, "{pixels}");
}

/// Of steps in proportion to w, by quotients that are told to within a billionth of the largest entry:
/// three step sizes, from which the errors of the second order are taken out twice.
#[test]
fn gradients_under_any_perspective_are_difference_quotients() {
    let mut runner = TestRunner::deterministic();
    let (mut compared, mut left_out) = (0, 0);
    for span in [0.0, 0.7, 1.5, 3.0] {
        for _ in 0..100 {
            let scene = scenes(span).new_tree(&mut runner).unwrap().current();
            let (_, resolved) = scene.loss(&scene.clip);
            let entries: Vec<_> = (0..16).filter(|k| k % 4 != 2).collect();
            let gradient = scene.gradient();
            let scaled = |k: usize| gradient[k] * scene.clip[k / 4][3];
            let largest = entries.iter().fold(0.01, |most, &k| f64::max(most, scaled(k).abs()));
            for k in entries {
                let at = |step: f64| {
                    let mut moved = scene.clip.clone();
                    moved[k / 4][k % 4] += step * scene.clip[k / 4][3];
                    let (loss, pixels) = scene.loss(&moved);
                    (pixels == resolved).then_some(loss)
                };
                let slope = |step: f64| Some((at(step)? - at(-step)?) / (2.0 * step));
                let slopes = [4e-4, 2e-4, 1e-4].map(slope);
                let known = match slopes {
                    [Some(a), Some(b), Some(c)] => {
                        let [coarse, fine] = [(4.0 * b - a) / 3.0, (4.0 * c - b) / 3.0];
                        ((coarse - fine).abs() < 1e-9 * largest).then_some(fine)
                    }
                    _ => None,
                };
                let Some(expected) = known else {
                    left_out += 1;
                    continue;
                };
                compared += 1;
                let error = (scaled(k) - expected).abs();
                assert!(
                    error < 1e-8 * largest,
                    "{span}, {k}: {} {expected} of {largest}, {scene:?}",
                    scaled(k)
                );
            }
        }
    }
    assert!(compared > 3 * left_out, "{left_out} left out, {compared} not");
}

/// An edge moves over a pixel's corner. The depth of a piece is that at its mean barycentrics, with 1 / w
/// at the mean distance: the harmonic mean of 1 / w. At the pixel's centre it is the mean depth. So sums
/// of depths leap there; distances are means on one side as on the other but for the centre's own w.
#[test]
fn the_sum_of_depths_leaps_where_an_edge_comes_to_a_corner() {
    let size = Size::square(3);
    // A wall through 1 / w = 0.6 + 0.3 x, with the depth 1 - 0.5 / w; the pixel in the middle is a third
    // of the image wide.
    let [one, by_x] = [0.6, 0.3];
    let corner = |x: f64, y: f64| {
        let w = 1.0 / (one + by_x * x);
        [x * w, y * w, w - 0.5, w]
    };
    let depths = |shift: f64| {
        // The long edge runs through the middle pixel's upper right corner where `shift` is 0.
        let (low, high) = (-1.2, 2.0 / 3.0 + 1.2 + shift);
        let clip = vec![corner(low, low), corner(high, low), corner(low, high)];
        let tape = Tape::<f64>::new();
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let fragments =
            rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size).creases(&[])).unwrap();
        let coverage = &fragments.coverage;
        let of_middle: Vec<_> =
            (0..coverage.count()).filter(|&at| coverage.pixels().nth(at) == Some(4)).collect();
        assert_eq!(of_middle.len(), 1);
        let at = of_middle[0];
        let is_resolved = coverage.boundary().any(|(pixel, _)| pixel == 4);
        let distance = eye_depth(&fragments).unwrap().values().value().data()[at];
        (depth(&fragments).unwrap().value().data()[at], distance, is_resolved)
    };
    let (centre, distance, is_resolved) = depths(1e-3);
    assert!(!is_resolved);
    assert!((centre - (1.0 - 0.5 * one)).abs() < 1e-15 && (distance - 1.0 / one).abs() < 1e-15);
    let (mean, mean_distance, is_resolved) = depths(0.0);
    assert!(is_resolved);
    let [low, high] = [one - by_x / 3.0, one + by_x / 3.0];
    let expected = f64::ln(high / low) / (high - low);
    assert!((mean_distance - expected).abs() < 1e-15, "{mean_distance} {expected}");
    assert!((mean - (1.0 - 0.5 / expected)).abs() < 1e-15, "{mean}");
    assert!((mean - centre).abs() > 1e-3, "{mean} {centre}");
    // On the corner's other side it changes as little as the area that is lost.
    let (after, ..) = depths(-1e-5);
    assert!((after - mean).abs() < 1e-9, "{after} {mean}");
}
