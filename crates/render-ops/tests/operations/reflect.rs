use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::reflect;
use glam::DVec3;

fn rows<'t>(tape: &'t Tape<f64>, rows: &[[f64; 3]]) -> Var<'t, f64> {
    tape.leaf(&Tensor::new([rows.len(), 3], rows.as_flattened().to_vec()).unwrap())
}

const DIRECTIONS: [[f64; 3]; 3] = [[1.0, -2.0, 3.0], [0.5, 0.25, -0.125], [1e-300, 0.0, 2e-300]];
const NORMALS: [[f64; 3]; 3] = [[0.0, 3.0, 0.0], [1.0, 2.0, -0.5], [-1e300, 1e300, 3e299]];

#[test]
fn the_part_along_the_normal_turns_round_and_the_rest_stays() {
    let tape = Tape::new();
    let found = reflect(rows(&tape, &DIRECTIONS), rows(&tape, &NORMALS)).unwrap();
    assert_eq!(found.value().data()[..3], [1.0, 2.0, 3.0]);
    for ((d, n), y) in DIRECTIONS.iter().zip(&NORMALS).zip(found.value().data().chunks(3)) {
        // Lengths whose squares are beyond the range of the numbers are among them.
        let unit = |v: &[f64]| {
            let v = DVec3::from_slice(v);
            (v / v.abs().max_element()).normalize()
        };
        let (y, d, m) = (DVec3::from_slice(y), DVec3::from_array(*d), unit(n));
        let size = d.abs().max_element();
        approx::assert_abs_diff_eq!(y.dot(m) / size, -d.dot(m) / size, epsilon = 2e-15);
        let (rest, before) = (y - y.dot(m) * m, d - d.dot(m) * m);
        for k in 0..3 {
            approx::assert_abs_diff_eq!(rest[k] / size, before[k] / size, epsilon = 2e-15);
        }
    }
}

#[test]
fn twice_mirrored_is_not_mirrored() {
    let tape = Tape::new();
    let normals = rows(&tape, &NORMALS);
    let twice = reflect(reflect(rows(&tape, &DIRECTIONS), normals).unwrap(), normals).unwrap();
    for (found, expected) in twice.value().data().iter().zip(DIRECTIONS.as_flattened()) {
        approx::assert_relative_eq!(found, expected, max_relative = 1e-14);
    }
}

#[test]
fn without_a_normal_a_direction_goes_on_and_lengths_of_normals_do_not_matter() {
    let tape = Tape::new();
    let directions = rows(&tape, &DIRECTIONS);
    let normals = rows(&tape, &[[0.0; 3], NORMALS[1], NORMALS[2].map(|x| 1e-290 * x)]);
    let out = reflect(directions, normals).unwrap();
    assert_eq!(out.value().data()[..3], DIRECTIONS[0]);
    let same = reflect(directions, rows(&tape, &NORMALS)).unwrap().value();
    for k in 3..9 {
        let (found, expected) = (out.value().data()[k], same.data()[k]);
        approx::assert_relative_eq!(found, expected, max_relative = 1e-14);
    }
    let gradients = out.sum().backward().unwrap();
    assert_eq!(gradients.get_or_zeros(directions).data()[..3], [1.0; 3]);
    let bars = gradients.get_or_zeros(normals);
    assert_eq!(bars.data()[..3], [0.0; 3]);
    // Along a normal nothing changes.
    let of_normal = bars.data()[3..6].iter().zip(NORMALS[1]);
    let along: f64 = of_normal.map(|(bar, entry)| bar * entry).sum();
    approx::assert_abs_diff_eq!(along, 0.0, epsilon = 1e-15);
}
