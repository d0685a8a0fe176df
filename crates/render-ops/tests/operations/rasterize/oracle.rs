//! Each pixel against a linear system, solved per pixel and face.

use super::*;

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
    Sees(Option<VisibleFace>),
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
    let mut nearest: Option<VisibleFace> = None;
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
            nearest = Some(VisibleFace { face, uv: [b[0] / sum, b[1] / sum], depth });
        }
    }
    Verdict::Sees(nearest)
}

/// Compares a picture with the oracle; returns how many pixels it could tell, and the number of
/// all.
pub(super) fn assert_is_the_oracles<T: Scalar>(
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
pub(super) fn vertex() -> impl Strategy<Value = [f64; 4]> {
    let w = prop_oneof![3 => 0.2..2.0_f32, 1 => -1.5..0.2_f32];
    let z = prop_oneof![3 => -0.9..0.9_f32, 1 => -3.0..3.0_f32];
    (-1.6..1.6_f32, -1.6..1.6_f32, z, w).prop_map(|(x, y, z, w)| [x, y, z, w].map(f64::from))
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
