use crate::fixtures::number;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::perturbed_normals;
use glam::DVec3;

const NORMALS: [f64; 9] = [0.3, -0.2, 0.9, 1.4, 0.1, -0.6, -0.5, 0.8, 0.2];
const TANGENTS: [f64; 12] = [1.0, 0.2, -0.1, 1.0, 0.3, -0.7, 0.5, -0.4, 0.9, 0.8, 2.0, -1.0];
const VALUES: [f64; 9] = [0.4, -0.3, 0.8, -0.6, 0.5, 0.2, 0.1, 0.9, -0.4];

/// Perturbed normals, and the gradients of all inputs for motley upstream.
fn run<T: Scalar>(inputs: [&[f64]; 3]) -> [Vec<f64>; 4] {
    let tape = Tape::<T>::new();
    let leaf = |of: &[f64], width: usize| {
        tape.leaf(&Tensor::from_flat_fn([of.len() / width, width], |k| T::from_f64(of[k])))
    };
    let [n, t, v] = [(0, 3), (1, 4), (2, 3)].map(|(i, width)| leaf(inputs[i], width));
    let out = perturbed_normals(n, t, v).unwrap();
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(number(k)));
    let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
    let [n, t, v] = [n, t, v].map(|leaf| gradients.get_or_zeros(leaf));
    [out.value(), n, t, v].map(|all| all.data().iter().map(|x| x.to_f64()).collect())
}

#[test]
fn a_map_value_is_a_vector_in_the_frame_of_tangent_bitangent_and_normal() {
    let [out, ..] = run::<f64>([&NORMALS, &TANGENTS, &VALUES]);
    for (k, out) in out.chunks(3).enumerate() {
        let m = DVec3::from_slice(&NORMALS[3 * k..]).normalize();
        let d = DVec3::from_slice(&TANGENTS[4 * k..]).reject_from(m).normalize();
        let b = TANGENTS[4 * k + 3].signum() * m.cross(d);
        let [x, y, z] = [0, 1, 2].map(|i| VALUES[3 * k + i]);
        let expected = (x * d + y * b + z * m).normalize();
        assert!((DVec3::from_slice(out) - expected).length() < 1e-15);
    }
}

#[test]
fn x_y_and_z_of_the_map_are_tangent_bitangent_and_normal() {
    let (n, t) = ([0.0, 0.0, 2.0], [3.0, 0.0, 5.0, 1.0]);
    for (value, expected) in [
        ([0.5, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([0.0, 0.5, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, 0.0, 0.5], [0.0, 0.0, 1.0]),
    ] {
        assert_eq!(run::<f64>([&n, &t, &value])[0], expected);
        let mirrored = [t[0], t[1], t[2], -0.3];
        let expected = [expected[0], -expected[1], expected[2]];
        assert_eq!(run::<f64>([&n, &mirrored, &value])[0], expected);
    }
}

#[test]
fn lengths_do_not_matter() {
    let [out, bars @ ..] = run::<f64>([&NORMALS, &TANGENTS, &VALUES]);
    for powers in [[900, -900, 600], [-900, 900, -900], [3, 1, -2]] {
        let scales = powers.map(|power| f64::powi(2.0, power));
        let scaled = |input: usize, numbers: &[f64]| -> Vec<f64> {
            numbers.iter().map(|x| scales[input] * x).collect()
        };
        let inputs = [scaled(0, &NORMALS), scaled(1, &TANGENTS), scaled(2, &VALUES)];
        let [there, there_bars @ ..] = run::<f64>([&inputs[0], &inputs[1], &inputs[2]]);
        assert_eq!(there, out);
        for input in 0..3 {
            assert_eq!(scaled(input, &there_bars[input]), bars[input]);
        }
    }
}

#[test]
fn the_sign_has_no_gradient() {
    let inputs = [NORMALS.to_vec(), TANGENTS.to_vec(), VALUES.to_vec()];
    let [_, bars @ ..] = run::<f64>([&inputs[0], &inputs[1], &inputs[2]]);
    assert!(bars[1].iter().skip(3).step_by(4).all(|&bar| bar == 0.0));
}

#[test]
fn without_a_tangent_the_normal_stays_and_its_gradient_is_that_of_its_direction() {
    for t in [[0.0, 0.0, 0.0, 1.0], [0.6, -0.4, 1.8, 1.0], [-0.1, 0.2 / 3.0, -0.3, -1.0]] {
        let [out, n_bar, t_bar, v_bar] = run::<f64>([&NORMALS[..3], &t, &VALUES[..3]]);
        let normal = DVec3::from_slice(&NORMALS[..3]);
        let (unit, bar) = (normal.normalize(), DVec3::from([0, 1, 2].map(number)));
        let expected = (bar - unit.dot(bar) * unit) / normal.length();
        for k in 0..3 {
            assert!((out[k] - unit[k]).abs() < 1e-15 && (n_bar[k] - expected[k]).abs() < 1e-15);
        }
        assert!(t_bar.iter().chain(&v_bar).all(|&bar| bar == 0.0));
    }
}

#[test]
fn a_normal_or_a_map_value_of_zero_gives_zero_and_no_gradient() {
    let zero = [0.0; 3];
    for (n, v) in [(&zero, &VALUES[..3]), (&zero, &zero[..])] {
        let all = run::<f64>([n, &TANGENTS[..4], v]);
        assert!(all.iter().flatten().all(|&entry| entry == 0.0));
    }
    let all = run::<f64>([&NORMALS[..3], &TANGENTS[..4], &zero]);
    assert!(all.iter().flatten().all(|&entry| entry == 0.0));
    assert!(run::<f64>([&[], &[], &[]]).iter().all(Vec::is_empty));
}

#[test]
fn what_is_not_finite_is_not_masked() {
    for bad in [f64::NAN, f64::INFINITY] {
        for input in 0..3 {
            let mut inputs = [NORMALS.to_vec(), TANGENTS.to_vec(), VALUES.to_vec()];
            inputs[input][1] = bad;
            let [out, ..] = run::<f64>([&inputs[0], &inputs[1], &inputs[2]]);
            assert!(out[..3].iter().any(|entry| entry.is_nan()), "{input}");
            assert!(out[3..].iter().all(|entry| entry.is_finite()));
        }
    }
}
