use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{
    Fragments, Mesh, RasterOptions, Sampling, Size, differentials, rasterize,
};

const SIZE: Size = Size { width: 9, height: 6 };

/// Two faces in strong perspective.
const CLIP: [[f64; 4]; 4] =
    [[-0.9, -0.8, 0.0, 1.0], [3.9, -3.1, 0.0, 4.0], [1.2, 1.4, 0.1, 1.5], [-0.4, 0.4, 0.0, 0.5]];

fn options(sampling: Sampling) -> RasterOptions {
    RasterOptions::new(SIZE).sampling(sampling)
}

/// Of the quad with vertices `clip(i, k)`.
fn quad(
    tape: &Tape<f64>,
    sampling: Sampling,
    clip: impl Fn(usize, usize) -> f64,
) -> Fragments<'_, f64> {
    let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4).unwrap();
    let clip = tape.leaf(&Tensor::from_fn([4, 4], |[i, k]| clip(i, k)));
    rasterize(clip, &mesh, options(sampling).creases(&[])).unwrap()
}

#[test]
fn without_perspective_they_are_the_slopes_of_a_plane() {
    // A face whose corners 0, 1 and 2 lie at (1, 1), (9, 1) and (1, 5) px of 9 x 6.
    let corner = |x: f64, y: f64| [2.0 * x / 9.0 - 1.0, 1.0 - 2.0 * y / 6.0, 0.0, 1.0];
    let corners = [corner(1.0, 1.0), corner(9.0, 1.0), corner(1.0, 5.0)];
    let tape = Tape::<f64>::new();
    let clip = tape.leaf(&Tensor::from_fn([3, 4], |[i, k]| corners[i][k]));
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    for sampling in [Sampling::Center, Sampling::Exact] {
        let fragments = rasterize(clip, &mesh, options(sampling).creases(&[])).unwrap();
        let found = differentials(&fragments).unwrap().value();
        assert!(found.size() > 40);
        for found in found.data().chunks_exact(4) {
            for (found, expected) in found.iter().zip([-0.125, -0.25, 0.125, 0.0]) {
                approx::assert_relative_eq!(*found, expected, epsilon = 1e-15);
            }
        }
    }
}

#[test]
fn they_are_the_difference_quotients_of_barycentrics_that_move_over_the_image() {
    let tape = Tape::new();
    let here = quad(&tape, Sampling::Center, |i, k| CLIP[i][k]);
    let found = differentials(&here).unwrap().value();
    for axis in 0..2 {
        // The surface moves by a small part of a pixel to the left, or up.
        let moved = |h: f64| {
            let shift = [-2.0 * h / SIZE.width as f64, 2.0 * h / SIZE.height as f64][axis];
            let moved = quad(&tape, Sampling::Center, |i, k| {
                CLIP[i][k] + if k == axis { shift * CLIP[i][3] } else { 0.0 }
            });
            assert!(moved.coverage.pixels().eq(here.coverage.pixels()));
            moved.barycentrics.value()
        };
        let (after, before) = (moved(1e-5), moved(-1e-5));
        for (k, (after, before)) in after.data().iter().zip(before.data()).enumerate() {
            let found = found.data()[2 * k + axis];
            approx::assert_relative_eq!(found, (after - before) / 2e-5, epsilon = 1e-9);
        }
    }
}

#[test]
fn a_piece_has_the_differentials_where_the_weights_are_its_means() {
    let tape = Tape::new();
    let exact = quad(&tape, Sampling::Exact, |i, k| CLIP[i][k]);
    let pieces = exact.coverage.centers()..exact.coverage.count();
    assert!(pieces.len() > 10);
    let found = differentials(&exact).unwrap().value();
    let faces: Vec<_> = exact.coverage.faces().collect();
    let uv = exact.barycentrics.value();
    for n in pieces {
        // The point with these weights, and points beside it, in NDC.
        let corners = exact.coverage.mesh().faces()[faces[n]].map(|v| CLIP[v as usize]);
        let [u, v] = [uv[[n, 0]], uv[[n, 1]]];
        let mix = |k: usize| u * corners[0][k] + v * corners[1][k] + (1.0 - u - v) * corners[2][k];
        let point = [mix(0) / mix(3), mix(1) / mix(3)];
        let matrix = glam::DMat3::from_cols_array_2d(&corners.map(|[x, y, _, w]| [x, y, w]));
        let at = |x: f64, y: f64| {
            let b = matrix.inverse() * glam::DVec3::new(x, y, 1.0);
            b / b.element_sum()
        };
        for (axis, h) in [(0, [1e-6, 0.0]), (1, [0.0, -1e-6])] {
            let extents = [SIZE.width, SIZE.height].map(|n| 2.0 / n as f64);
            let [dx, dy] = [h[0] * extents[0], h[1] * extents[1]];
            let slope =
                (at(point[0] + dx, point[1] + dy) - at(point[0] - dx, point[1] - dy)) / 2e-6;
            approx::assert_relative_eq!(found[[n, 0, axis]], slope.x, epsilon = 1e-8);
            approx::assert_relative_eq!(found[[n, 1, axis]], slope.y, epsilon = 1e-8);
        }
    }
}

#[test]
fn the_size_of_clip_positions_does_not_matter() {
    let run = |factors: [f64; 4]| {
        let tape = Tape::new();
        let fragments = quad(&tape, Sampling::Center, |i, k| factors[i] * CLIP[i][k]);
        differentials(&fragments).unwrap().value()
    };
    let plain = run([1.0; 4]);
    for power in [-40, 7, 150, -150] {
        assert_eq!(run([f64::powi(2.0, power); 4]), plain);
    }
}
