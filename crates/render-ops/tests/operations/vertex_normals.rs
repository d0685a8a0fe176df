use crate::fixtures::{bent_sheet, number};
use approx::assert_relative_eq;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, Weighting, vertex_normals};
use glam::DVec3;

const WEIGHTINGS: [Weighting; 2] = [Weighting::Area, Weighting::Angle];

/// Normals, and gradients for motley upstream.
fn run<T: Scalar>(positions: &[f64], faces: &[[u32; 3]], by: Weighting) -> [Vec<f64>; 2] {
    let tape = Tape::<T>::new();
    let count = positions.len() / 3;
    let mesh = Mesh::new(faces.to_vec(), count).unwrap();
    let positions = tape.leaf(&Tensor::from_flat_fn([count, 3], |k| T::from_f64(positions[k])));
    let normals = vertex_normals(positions, &mesh, by).unwrap();
    let upstream = Tensor::from_flat_fn(normals.shape(), |k| T::from_f64(number(k)));
    let gradients = tape.vjp(&[(normals, &upstream)]).unwrap();
    let entries = |tensor: &Tensor<T>| tensor.data().iter().map(|x| x.to_f64()).collect();
    [entries(&normals.value()), entries(&gradients.get_or_zeros(positions))]
}

fn scaled_by(scale: f64, numbers: &[f64]) -> Vec<f64> {
    numbers.iter().map(|x| scale * x).collect()
}

/// The corners of a cube around the origin, and two triangles per side, cut along these diagonals.
fn cube(cuts: u32) -> (Vec<f64>, Vec<[u32; 3]>) {
    let positions = (0..24).map(|k| f64::from((k / 3) >> (2 - k % 3) & 1) - 0.5).collect();
    let sides =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let faces = sides.iter().enumerate().flat_map(|(side, &[a, b, c, d])| match cuts >> side & 1 {
        0 => [[a, b, c], [a, c, d]],
        _ => [[b, c, d], [b, d, a]],
    });
    (positions, faces.collect())
}

#[test]
fn normals_are_weighted_sums_of_the_normals_around() {
    let (positions, faces) = bent_sheet(11, 6);
    let point = |vertex: u32| DVec3::from_slice(&positions[3 * vertex as usize..]);
    for by in WEIGHTINGS {
        let [normals, _] = run::<f64>(&positions, &faces, by);
        for (vertex, normal) in normals.chunks(3).enumerate() {
            let mut sum = DVec3::ZERO;
            for face in &faces {
                let Some(k) = face.iter().position(|&other| other as usize == vertex) else {
                    continue;
                };
                let [p, q, r] = [0, 1, 2].map(|step| point(face[(k + step) % 3]));
                let cross = (q - p).cross(r - p);
                sum += match by {
                    Weighting::Area => cross,
                    Weighting::Angle => cross.normalize() * (q - p).angle_between(r - p),
                };
            }
            assert!((DVec3::from_slice(normal) - sum.normalize()).length() < 1e-14);
        }
    }
}

#[test]
fn by_angle_the_normals_of_a_cube_are_its_diagonals_however_its_sides_are_cut() {
    for cuts in 0..64 {
        let (positions, faces) = cube(cuts);
        let [normals, _] = run::<f64>(&positions, &faces, Weighting::Angle);
        for (normal, position) in normals.iter().zip(&positions) {
            assert_relative_eq!(*normal, position.signum() / 3.0_f64.sqrt(), epsilon = 1e-15);
        }
    }
    let (positions, faces) = cube(0);
    let [by_area, _] = run::<f64>(&positions, &faces, Weighting::Area);
    assert!(by_area.iter().any(|entry| (entry.abs() - 1.0 / 3.0_f64.sqrt()).abs() > 0.1));
}

#[test]
fn positions_times_a_power_of_two_give_the_same_bits_and_the_gradient_divided_by_it() {
    let (positions, faces) = bent_sheet(5, 4);
    // The same numbers in f32.
    let positions: Vec<f64> = positions.iter().map(|&x| f64::from(x as f32)).collect();
    for by in WEIGHTINGS {
        let [normals, bars] = run::<f64>(&positions, &faces, by);
        for power in [-900, -100, 100, 900] {
            let scale = f64::powi(2.0, power);
            let [there, there_bars] = run::<f64>(&scaled_by(scale, &positions), &faces, by);
            assert_eq!((&there, &scaled_by(scale, &there_bars)), (&normals, &bars));
        }
        let [normals, bars] = run::<f32>(&positions, &faces, by);
        for power in [-100, -50, 50, 100] {
            let scale = f64::powi(2.0, power);
            let [there, there_bars] = run::<f32>(&scaled_by(scale, &positions), &faces, by);
            assert_eq!((&there, &scaled_by(scale, &there_bars)), (&normals, &bars));
        }
    }
}

#[test]
fn meshes_of_every_size_in_one_have_the_normals_of_each() {
    let (positions, faces) = bent_sheet(4, 3);
    let count = positions.len() as u32 / 3;
    let sizes = [-900, -400, 0, 400, 900].map(|power| f64::powi(2.0, power));
    let all: Vec<f64> = sizes.iter().flat_map(|&size| scaled_by(size, &positions)).collect();
    let all_faces: Vec<[u32; 3]> = (0..5)
        .flat_map(|part| faces.iter().map(move |face| face.map(|vertex| vertex + part * count)))
        .collect();
    for by in WEIGHTINGS {
        let [alone, _] = run::<f64>(&positions, &faces, by);
        let [together, bars] = run::<f64>(&all, &all_faces, by);
        assert!(together.chunks(alone.len()).all(|part| part == alone));
        assert!(bars.iter().all(|bar| bar.is_finite()));
    }
}

#[test]
fn a_tiny_face_counts_as_little_as_its_area_says_and_as_much_as_its_angle() {
    // Two faces at vertex 0, a large one that looks up and a tiny one that looks along x.
    let tiny = f64::powi(2.0, -600);
    let positions = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., tiny, 0., 0., 0., tiny];
    let faces = [[0, 1, 2], [0, 3, 4]];
    let [by_area, bars] = run::<f64>(&positions, &faces, Weighting::Area);
    assert_eq!(by_area[..3], [0.0, 0.0, 1.0]);
    assert_eq!(by_area[9..], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert!(bars.iter().all(|bar| bar.is_finite()));
    let [by_angle, _] = run::<f64>(&positions, &faces, Weighting::Angle);
    let half = 0.5_f64.sqrt();
    for (found, expected) in by_angle[..3].iter().zip([half, 0.0, half]) {
        assert_relative_eq!(*found, expected, epsilon = 1e-15);
    }
}

#[test]
fn no_motion_of_the_whole_changes_a_loss() {
    let (positions, faces) = bent_sheet(3, 3);
    for by in WEIGHTINGS {
        let [_, bars] = run::<f64>(&positions, &faces, by);
        for axis in 0..3 {
            let sum: f64 = bars.iter().skip(axis).step_by(3).sum();
            assert_relative_eq!(sum, 0.0, epsilon = 1e-13);
        }
        let along: f64 = bars.iter().zip(&positions).map(|(bar, x)| bar * x).sum();
        assert_relative_eq!(along, 0.0, epsilon = 1e-13);
    }
}

#[test]
fn a_vertex_without_a_proper_face_has_neither_normal_nor_gradient() {
    // Vertex 3 has a face of collinear corners, vertex 4 one that names it twice, vertex 5 none.
    let positions = [0., 0., 0., 1., 0., 0., 0., 1., 0., 2., 0., 0., 0.3, 0.4, 0.5, 0.7, 0.8, 0.9];
    let faces = [[0, 1, 2], [0, 1, 3], [4, 4, 0]];
    for by in WEIGHTINGS {
        for run in [run::<f64>, run::<f32>] {
            let [normals, bars] = run(&positions, &faces, by);
            assert_eq!(normals[..9], [0., 0., 1., 0., 0., 1., 0., 0., 1.]);
            assert!(normals[9..].iter().chain(&bars[9..]).all(|&entry| entry == 0.0));
            assert!(bars[..9].iter().any(|&bar| bar != 0.0));
            assert_eq!(run(&positions, &[], by), [[0.0; 18], [0.0; 18]]);
        }
    }
}

#[test]
fn normals_that_cancel_to_within_rounding_are_zero() {
    // Both sides of a bent sheet, with the same vertices: in any order of corners and faces.
    let (positions, mut faces) = bent_sheet(6, 5);
    let back: Vec<_> = faces.iter().rev().map(|&[a, b, c]| [b, a, c]).collect();
    faces.extend(back);
    for by in WEIGHTINGS {
        for size in [1e-30, 1.0, 1e30] {
            let [normals, bars] = run::<f64>(&scaled_by(size, &positions), &faces, by);
            assert!(normals.iter().chain(&bars).all(|&entry| entry == 0.0));
        }
    }
}

#[test]
fn a_needle_beside_others_keeps_the_digits_of_the_sum() {
    // A fan of 512 faces in one plane, whose normal is known.
    let (u, v) = (DVec3::new(3.0, -2.0, 1.0), DVec3::new(1.0, 4.0, 5.0));
    let mut positions = vec![0.0; 3];
    for k in 0..=512 {
        let (sin, cos) = (f64::from(k) / 512.0 * 0.01).sin_cos();
        positions.extend((cos * u + sin * v).to_array());
    }
    let faces: Vec<[u32; 3]> = (1..=512).map(|k| [0, k, k + 1]).collect();
    for by in WEIGHTINGS {
        let [normals, _] = run::<f64>(&positions, &faces, by);
        let error = (DVec3::from_slice(&normals) - u.cross(v).normalize()).length();
        // Each corner is rounded to the plane, by 1e-16 of needles 1e-4 wide.
        assert!(error < 1e-13, "{error:e}");
    }
}
