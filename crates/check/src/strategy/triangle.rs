//! Triangles in clip space, well- and ill-shaped.

use std::f64::consts::TAU;

use proptest::prelude::*;
use proptest::sample::select;

/// Three vertices `(x, y, z, w)` in clip space.
pub type Triangle = [[f64; 4]; 3];

/// Triangles of every kind below.
pub fn triangle() -> BoxedStrategy<Triangle> {
    prop_oneof![
        4 => well_shaped(),
        2 => sliver(),
        1 => degenerate(),
        2 => aligned(8),
        2 => through_the_eye(),
        1 => any_size(),
    ]
    .boxed()
}

/// Angles above 20 degrees, partly outside the image, with w from 0.5 to 2.
pub fn well_shaped() -> BoxedStrategy<Triangle> {
    (
        center(),
        0.0..TAU,
        [-0.25..0.25, -0.25..0.25, -0.25..0.25],
        0.2..1.2,
        [vertex(), vertex(), vertex()],
    )
        .prop_map(|(center, angle, jitters, size, vertices)| {
            std::array::from_fn(|k| {
                let angle: f64 = angle + (k as f64 / 3.0) * TAU + jitters[k];
                clip_position(
                    [center[0] + size * angle.cos(), center[1] + size * angle.sin()],
                    vertices[k],
                )
            })
        })
        .boxed()
}

/// Long and thin: the width goes down to 1e-7 of the length, along any direction, also the axes
/// and diagonals.
pub fn sliver() -> BoxedStrategy<Triangle> {
    let angle = prop_oneof![0.0..TAU, (0..8_u32).prop_map(|k| f64::from(k) / 8.0 * TAU)];
    let width = (-7.0..-0.7).prop_map(|power: f64| 10.0_f64.powf(power));
    (center(), angle, width, 0.3..1.8, 0.0..1.0, [vertex(), vertex(), vertex()])
        .prop_map(|(center, angle, width, length, along, vertices)| {
            let (sin, cos) = angle.sin_cos();
            // A needle where the third vertex is over an end, a cap where it is over the middle.
            let local = [[-0.5, 0.0], [0.5, 0.0], [along - 0.5, width]];
            std::array::from_fn(|k| {
                let [x, y] = local[k].map(|s: f64| s * length);
                let turned = [center[0] + x * cos - y * sin, center[1] + x * sin + y * cos];
                clip_position(turned, vertices[k])
            })
        })
        .boxed()
}

/// Without an area: collinear vertices, two in one place, or all three.
pub fn degenerate() -> BoxedStrategy<Triangle> {
    // Multiples of 1/64, so that collinear is exactly that.
    let coordinate = || (-64..=64_i32).prop_map(|k| f64::from(k) / 64.0);
    ([coordinate(), coordinate()], [-16..=16_i32, -16..=16_i32], [0..=2_i32, 0..=2_i32])
        .prop_map(|(start, step, multiples)| {
            let vertex_at = |multiple: i32| {
                let offset = step.map(|step| f64::from(step * multiple) / 64.0);
                [start[0] + offset[0], start[1] + offset[1], 0.0, 1.0]
            };
            [vertex_at(0), vertex_at(multiples[0]), vertex_at(multiples[1])]
        })
        .boxed()
}

/// Vertices on corners, sides and centres of the pixels of an image of `pixels` by `pixels`,
/// exactly, or off by one part in 1e7.
pub fn aligned(pixels: u32) -> BoxedStrategy<Triangle> {
    let coordinate = move || {
        let off = prop_oneof![3 => Just(0.0), 1 => select(&[1e-7, -1e-7][..])];
        // Twice as many places as pixels: sides and centres.
        (0..=2 * pixels, off).prop_map(move |(k, off)| f64::from(k) / f64::from(pixels) - 1.0 + off)
    };
    let vertex = move || (coordinate(), coordinate(), select(&[-0.5, 0.0, 0.25][..]));
    [vertex(), vertex(), vertex()]
        .prop_map(|vertices| vertices.map(|(x, y, z)| [x, y, z, 1.0]))
        .boxed()
}

/// One, two or three vertices behind the eye, or w close to 0, or of very different sizes.
pub fn through_the_eye() -> BoxedStrategy<Triangle> {
    let w = prop_oneof![
        3 => 0.3..2.0,
        2 => -1.0..-0.1,
        1 => select(&[0.0, 1e-38, 1e-6, -1e-6, 1e6][..]),
    ];
    let vertex = || (-1.3..1.3, -1.3..1.3, -1.2..1.2, w.clone());
    [vertex(), vertex(), vertex()]
        .prop_map(|vertices| vertices.map(|(x, y, z, w)| [x, y, z, w]))
        .boxed()
}

/// From 1e-12 to 1e12 of the image in size.
pub fn any_size() -> BoxedStrategy<Triangle> {
    (well_shaped(), -12.0..12.0)
        .prop_map(|(triangle, power)| {
            let size = 10.0_f64.powf(power);
            triangle.map(|[x, y, z, w]| [x * size, y * size, z, w])
        })
        .boxed()
}

fn center() -> [std::ops::Range<f64>; 2] {
    [-0.7..0.7, -0.7..0.7]
}

/// z / w and w.
fn vertex() -> (std::ops::Range<f64>, std::ops::Range<f64>) {
    (-0.9..0.9, 0.5..2.0)
}

/// The clip position of a place in the image.
fn clip_position([x, y]: [f64; 2], (depth, w): (f64, f64)) -> [f64; 4] {
    [x * w, y * w, depth * w, w]
}

#[cfg(test)]
mod tests {
    use super::super::draws;
    use super::*;

    /// Twice the area over the square of the longest side, in the image.
    fn shape([a, b, c]: &Triangle) -> f64 {
        let [a, b, c] = [a, b, c].map(|p| [p[0] / p[3], p[1] / p[3]]);
        let side = |p: [f64; 2], q: [f64; 2]| [q[0] - p[0], q[1] - p[1]];
        let ([ux, uy], [vx, vy]) = (side(a, b), side(a, c));
        let longest = [side(a, b), side(b, c), side(a, c)]
            .iter()
            .fold(0.0, |longest: f64, [x, y]| longest.max(x * x + y * y));
        if longest == 0.0 { 0.0 } else { (ux * vy - uy * vx).abs() / longest }
    }

    #[test]
    fn each_kind_has_its_shape() {
        assert!(draws(well_shaped(), 200).iter().all(|triangle| shape(triangle) > 0.4));
        let slivers = draws(sliver(), 200);
        assert!(slivers.iter().all(|triangle| shape(triangle) < 0.25));
        assert!(slivers.iter().any(|triangle| shape(triangle) < 1e-6));
        let flat = draws(degenerate(), 200);
        assert!(flat.iter().all(|triangle| shape(triangle) == 0.0));
        assert!(flat.iter().any(|[a, b, c]| a == b && b == c));
        assert!(flat.iter().any(|[a, b, c]| a != b && b != c && a != c));
    }

    #[test]
    fn aligned_vertices_hit_pixel_centres_and_corners() {
        let scaled = draws(aligned(8), 100).into_iter().flatten();
        let halves: Vec<f64> = scaled.map(|[x, ..]| (x + 1.0) * 8.0).collect();
        let hits = |odd: f64| halves.iter().filter(|&&k| k % 2.0 == odd).count();
        assert!(hits(0.0) > 50 && hits(1.0) > 50);
        assert!(halves.iter().any(|k| k.fract() != 0.0));
    }

    #[test]
    fn some_faces_reach_behind_the_eye() {
        let behind = |triangle: &Triangle| triangle.iter().filter(|p| p[3] <= 0.0).count();
        let triangles = draws(through_the_eye(), 300);
        assert!((0..=3).all(|count| triangles.iter().any(|t| behind(t) == count)));
        assert!(triangles.iter().flatten().any(|p| p[3] == 0.0));
        let sizes = draws(any_size(), 100);
        let largest = |t: &Triangle| t.iter().fold(0.0, |l: f64, p| l.max(p[0].abs()));
        assert!(sizes.iter().any(|t| largest(t) > 1e9));
        assert!(sizes.iter().any(|t| largest(t) < 1e-9));
    }

    #[test]
    fn every_kind_is_drawn() {
        let triangles = draws(triangle(), 300);
        let some = |kind: fn(&Triangle) -> bool| triangles.iter().any(kind);
        assert!(some(|t| shape(t) == 0.0) && some(|t| shape(t) > 0.4));
        assert!(some(|t| t.iter().any(|p| p[3] < 0.0)));
        assert!(some(|t| shape(t) > 0.0 && shape(t) < 1e-3));
    }
}
