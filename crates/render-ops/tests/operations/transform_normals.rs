use crate::fixtures::{bent_sheet, number};
use approx::assert_relative_eq;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, face_normals, transform_normals};
use glam::{DMat3, DVec3};

const MATRIX: [f64; 9] = [1.2, -0.3, 0.5, 0.1, 0.9, -0.7, 0.4, 0.2, 1.6];
const NORMALS: [f64; 12] = [0.3, -0.2, 0.9, 1.4, 0.1, -0.6, -0.5, 0.8, 0.2, 0., 0., 2.];

/// Normals, and the gradients of both inputs for motley upstream.
fn run<T: Scalar>(normals: &[f64], matrix: &[f64]) -> [Vec<f64>; 3] {
    let tape = Tape::<T>::new();
    let side = if matrix.len() == 9 { 3 } else { 4 };
    let tensor = |shape: [usize; 2], of: &[f64]| {
        tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(of[k])))
    };
    let normals = tensor([normals.len() / 3, 3], normals);
    let matrix = tensor([side, side], matrix);
    let out = transform_normals(normals, matrix).unwrap();
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(number(k)));
    let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
    let all = [out.value(), gradients.get_or_zeros(normals), gradients.get_or_zeros(matrix)];
    all.map(|tensor| tensor.data().iter().map(|x| x.to_f64()).collect())
}

fn assert_near(found: &[f64], expected: &[f64], bound: f64) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert_relative_eq!(*found, *expected, epsilon = bound);
    }
}

#[test]
fn it_is_the_inverse_transpose_where_the_determinant_is_positive() {
    let matrix = DMat3::from_cols_array(&MATRIX).transpose();
    assert!(matrix.determinant() > 0.0);
    let [out, ..] = run::<f64>(&NORMALS, &MATRIX);
    for (normal, out) in NORMALS.chunks(3).zip(out.chunks(3)) {
        let expected = matrix.inverse().transpose() * DVec3::from_slice(normal);
        assert_near(out, &expected.normalize().to_array(), 1e-15);
    }
}

#[test]
fn it_is_the_normals_of_the_transformed_faces_also_under_a_mirror_and_a_projection() {
    let (positions, faces) = bent_sheet(5, 4);
    let mesh = Mesh::new(faces, positions.len() / 3).unwrap();
    let tape = Tape::<f64>::new();
    let normals = |positions: Vec<f64>| {
        let positions = Tensor::new([positions.len() / 3, 3], positions).unwrap();
        face_normals(tape.leaf(&positions), &mesh).unwrap().value().data().to_vec()
    };
    let before = normals(positions.clone());
    let mirror = MATRIX.map(|entry| -entry);
    // Onto the plane x = y, of rank 2.
    let flat = [0.5, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0];
    for matrix in [MATRIX, mirror, flat] {
        let moved = positions.chunks(3).flat_map(|p| {
            (0..3).map(move |i| (0..3).map(|j| matrix[3 * i + j] * p[j]).sum::<f64>())
        });
        let expected = normals(moved.collect());
        assert_near(&run::<f64>(&before, &matrix)[0], &expected, 1e-13);
    }
}

#[test]
fn a_shift_does_not_count_and_the_last_row_has_no_gradient() {
    let mut wide = [7.0; 16];
    for k in 0..9 {
        wide[k / 3 * 4 + k % 3] = MATRIX[k];
    }
    let [out, normals_bar, matrix_bar] = run::<f64>(&NORMALS, &MATRIX);
    let [same, same_bar, wide_bar] = run::<f64>(&NORMALS, &wide);
    assert_eq!((same, same_bar), (out, normals_bar));
    for (k, bar) in wide_bar.into_iter().enumerate() {
        let (i, j) = (k / 4, k % 4);
        let expected = if i < 3 && j < 3 { matrix_bar[3 * i + j] } else { 0.0 };
        assert_eq!(bar, expected);
    }
}

#[test]
fn factors_of_matrix_and_normals_do_not_matter() {
    let [out, normals_bar, matrix_bar] = run::<f64>(&NORMALS, &MATRIX);
    for [of_matrix, of_normals] in [[900, -900], [-700, 300], [100, 900], [-1, -1]] {
        let [a, n] = [of_matrix, of_normals].map(|power| f64::powi(2.0, power));
        let times = |by: f64, entries: &[f64]| -> Vec<f64> {
            entries.iter().map(|entry| by * entry).collect()
        };
        let [there, n_bar, a_bar] = run::<f64>(&times(n, &NORMALS), &times(a, &MATRIX));
        assert_eq!(there, out);
        assert_eq!((times(n, &n_bar), times(a, &a_bar)), (normals_bar.clone(), matrix_bar.clone()));
    }
}

#[test]
fn where_nothing_is_left_of_a_normal_it_is_zero_and_gives_no_gradient() {
    // A line, a point, and multiples of a vector that are a line to within rounding.
    let line = [1., 2., 3., 2., 4., 6., -1., -2., -3.];
    let rounded = [0.1, 0.7, 0.3].map(|x| [x, x / 3.0, x / 7.0]);
    let rounded = std::array::from_fn(|k| rounded[k % 3][k / 3]);
    let [a, b, c] = [0, 3, 6].map(|row| DVec3::from_slice(&rounded[row..]));
    assert!([a.cross(b), b.cross(c), c.cross(a)].iter().any(|cofactors| *cofactors != DVec3::ZERO));
    for matrix in [line, rounded, [0.0; 9]] {
        let [out, normals_bar, matrix_bar] = run::<f64>(&NORMALS, &matrix);
        let all = out.iter().chain(&normals_bar).chain(&matrix_bar);
        assert!(all.into_iter().all(|&entry| entry == 0.0), "{matrix:?}");
    }
    // A normal of 0, and one that lies in the plane onto which all is projected.
    let flat = [0.5, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0];
    let [out, bar, _] = run::<f64>(&[0., 0., 0., 1., 1., 0., 1., -1., 0.], &flat);
    assert_eq!((&out[..6], &bar[..6]), (&[0.0; 6][..], &[0.0; 6][..]));
    assert_near(&out[6..], &[0.5_f64.sqrt(), -(0.5_f64.sqrt()), 0.0], 1e-15);
}

#[test]
fn what_is_not_finite_is_not_masked() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut normals = NORMALS;
        normals[4] = bad;
        let [out, ..] = run::<f64>(&normals, &MATRIX);
        assert!(out[3..6].iter().any(|entry| entry.is_nan()) && out[0].is_finite());
        let mut matrix = MATRIX;
        matrix[7] = bad;
        assert!(
            run::<f64>(&NORMALS, &matrix)[0].chunks(3).all(|row| row.iter().any(|x| x.is_nan()))
        );
    }
}
