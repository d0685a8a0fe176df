use crate::fixtures::{bent_sheet, number};
use approx::assert_relative_eq;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, face_normals};
use glam::DVec3;

/// Normals, and gradients for motley upstream.
fn run<T: Scalar>(positions: &[f64], faces: &[[u32; 3]]) -> [Vec<f64>; 2] {
    let tape = Tape::<T>::new();
    let count = positions.len() / 3;
    let mesh = Mesh::new(faces.to_vec(), count).unwrap();
    let positions = Tensor::from_flat_fn([count, 3], |k| T::from_f64(positions[k]));
    let positions = tape.leaf(&positions);
    let normals = face_normals(positions, &mesh).unwrap();
    let upstream = Tensor::from_flat_fn(normals.shape(), |k| T::from_f64(number(k)));
    let gradients = tape.vjp(&[(normals, &upstream)]).unwrap();
    let entries = |tensor: &Tensor<T>| tensor.data().iter().map(|x| x.to_f64()).collect();
    [entries(&normals.value()), entries(&gradients.get_or_zeros(positions))]
}

#[test]
fn normals_are_the_cross_products_of_edges() {
    let (positions, faces) = bent_sheet(13, 7);
    let [normals, _] = run::<f64>(&positions, &faces);
    for (face, normal) in faces.iter().zip(normals.chunks(3)) {
        let [p, q, r] = face.map(|vertex| DVec3::from_slice(&positions[3 * vertex as usize..]));
        let expected = (q - p).cross(r - p).normalize();
        assert!((DVec3::from_slice(normal) - expected).length() < 1e-15);
    }
}

#[test]
fn a_face_seen_counter_clockwise_looks_at_the_viewer() {
    let corners = [0.0, 0.0, 5.0, 1.0, 0.0, 5.0, 0.0, 1.0, 5.0];
    assert_eq!(run::<f32>(&corners, &[[0, 1, 2], [0, 2, 1]])[0], [0., 0., 1., 0., 0., -1.]);
}

#[test]
fn positions_times_a_power_of_two_give_the_same_bits_and_the_gradient_divided_by_it() {
    let (positions, faces) = bent_sheet(5, 4);
    // The same numbers in f32.
    let positions: Vec<f64> = positions.iter().map(|&x| f64::from(x as f32)).collect();
    let scaled = |positions: &[f64], scale: f64| -> Vec<f64> {
        positions.iter().map(|x| scale * x).collect()
    };
    let [normals, bars] = run::<f64>(&positions, &faces);
    for power in [-900, -100, 100, 900] {
        let scale = f64::powi(2.0, power);
        let [there, there_bars] = run::<f64>(&scaled(&positions, scale), &faces);
        assert_eq!((there, scaled(&there_bars, scale)), (normals.clone(), bars.clone()));
    }
    let [normals, bars] = run::<f32>(&positions, &faces);
    for power in [-100, -50, 50, 100] {
        let scale = f64::powi(2.0, power);
        let [there, there_bars] = run::<f32>(&scaled(&positions, scale), &faces);
        assert_eq!((there, scaled(&there_bars, scale)), (normals.clone(), bars.clone()));
    }
}

#[test]
fn no_loss_of_normals_changes_where_all_is_moved_or_all_is_larger() {
    let (positions, faces) = bent_sheet(3, 2);
    let [_, bars] = run::<f64>(&positions, &faces);
    for axis in 0..3 {
        let sum: f64 = bars.iter().skip(axis).step_by(3).sum();
        assert_relative_eq!(sum, 0.0, epsilon = 1e-13);
    }
    let along: f64 = bars.iter().zip(&positions).map(|(bar, x)| bar * x).sum();
    assert_relative_eq!(along, 0.0, epsilon = 1e-13);
}

#[test]
fn degenerate_faces_have_neither_normal_nor_gradient() {
    // Collinear, a vertex twice, and a face at two vertices in one place.
    let positions = [0., 0., 0., 1., 2., 3., 2., 4., 6., 0., 0., 0.];
    let faces = [[0, 1, 2], [0, 1, 1], [0, 3, 1], [2, 2, 2]];
    assert_eq!(run::<f64>(&positions, &faces), [vec![0.0; 12], vec![0.0; 12]]);
    assert_eq!(run::<f32>(&positions, &faces), [vec![0.0; 12], vec![0.0; 12]]);
    assert_eq!(run::<f64>(&positions, &[]), [vec![], vec![0.0; 12]]);
}
