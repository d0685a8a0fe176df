//! Points on surfaces, nearest points, and distances between surfaces.

use bokashi_core::parallel::with_threads;
use bokashi_core::{Tape, Tensor, TensorError};
use bokashi_mesh::{
    Grid, MeshError, PointDistance, chamfer_distance, draw_points, extract_surface, f_score,
    nearest_on_surface, nearest_points, normal_consistency,
};
use bokashi_render_ops::Mesh;
use proptest::prelude::*;

fn cloud(points: &[[f64; 3]]) -> Tensor<f64> {
    Tensor::new([points.len(), 3], points.as_flattened().to_vec()).unwrap()
}

fn rows(tensor: &Tensor<f64>) -> &[[f64; 3]] {
    tensor.data().as_chunks::<3>().0
}

fn squared(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
}

/// A ball's surface of some hundred faces.
fn ball(radius: f64) -> (Tensor<f64>, Mesh) {
    let grid = Grid::new([12; 3], [-1.31, -1.32, -1.33], 0.24).unwrap();
    let field = grid.sampled(|[x, y, z]| (x * x + y * y + z * z).sqrt() - radius);
    extract_surface(&field, None, &grid).unwrap()
}

/// Clouds on a coarse lattice, where many are equally near, or anywhere.
fn clouds() -> impl Strategy<Value = [Vec<[f64; 3]>; 2]> {
    let lattice = prop::array::uniform3((-2_i8..3).prop_map(f64::from));
    let anywhere = prop::array::uniform3(-1.0..1.0_f64);
    let line = (-1.0..1.0_f64).prop_map(|x| [x, 0.0, 0.0]);
    let point = prop_oneof![3 => lattice, 2 => anywhere, 1 => line];
    let cloud = prop::collection::vec(point, 1..80);
    (cloud.clone(), cloud).prop_map(|(a, b)| [a, b])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(
        std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(96)
    ))]

    #[test]
    fn the_nearest_point_is_the_first_of_the_nearest([queries, points] in clouds(), power in -900_i32..900) {
        let found = nearest_points(&cloud(&queries), &cloud(&points)).unwrap();
        for (k, query) in queries.iter().enumerate() {
            let squares = points.iter().map(|point| squared(*query, *point));
            let least = squares.clone().fold(f64::INFINITY, f64::min);
            let first = squares.clone().position(|square| square == least).unwrap();
            prop_assert_eq!(found.indices[k] as usize, first);
            prop_assert_eq!(found.distances[k], least.sqrt());
        }
        // A power of two changes nothing but the distances.
        let scaled = |points: &[[f64; 3]]| {
            cloud(&points.iter().map(|point| point.map(|x| x * 2.0_f64.powi(power))).collect::<Vec<_>>())
        };
        let again = nearest_points(&scaled(&queries), &scaled(&points)).unwrap();
        let squares = |indices: &[u32]| {
            let pairs = indices.iter().zip(&queries);
            pairs.map(|(&k, query)| squared(*query, points[k as usize])).collect::<Vec<_>>()
        };
        for ((square, of_scaled), far) in
            squares(&found.indices).into_iter().zip(squares(&again.indices)).zip(again.distances)
        {
            approx::assert_relative_eq!(square, of_scaled, max_relative = 1e-12);
            approx::assert_relative_eq!(far / 2.0_f64.powi(power), square.sqrt(), max_relative = 1e-12);
        }
    }

    #[test]
    fn no_point_of_a_surface_is_nearer_than_the_nearest([queries, corners] in clouds(), seed in 0_u64..99) {
        let count = corners.len() as u32;
        let face = |k: u32| [k, (k * 7 + seed as u32) % count, (k * 3 + 1) % count];
        let mesh = Mesh::new((0..count).map(face).collect(), corners.len()).unwrap();
        let (positions, queries) = (cloud(&corners), cloud(&queries));
        let (nearest, distances) = nearest_on_surface(&queries, &positions, &mesh).unwrap();
        let found = nearest.interpolated(&positions).unwrap();
        for (k, weights) in nearest.barycentrics().iter().enumerate() {
            prop_assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
            approx::assert_relative_eq!(weights.iter().sum::<f64>(), 1.0, epsilon = 1e-12);
            let far = squared(rows(&queries)[k], rows(&found)[k]).sqrt();
            approx::assert_relative_eq!(far, distances[k], epsilon = 1e-9);
        }
        // Neither are points all over the faces.
        for face in mesh.faces() {
            for (i, j) in (0..=4).flat_map(|i| (0..=4 - i).map(move |j| (i, j))) {
                let weights = [i as f64 / 4.0, j as f64 / 4.0, (4 - i - j) as f64 / 4.0];
                let at = [0, 1, 2].map(|axis| {
                    (0..3).map(|k| weights[k] * corners[face[k] as usize][axis]).sum::<f64>()
                });
                for (query, distance) in rows(&queries).iter().zip(&distances) {
                    prop_assert!(squared(*query, at).sqrt() >= distance - 1e-9);
                }
            }
        }
    }

    #[test]
    fn the_chamfer_distance_is_the_sum_of_both_means([x, y] in clouds()) {
        for (kind, power) in [(PointDistance::Euclidean, 0.5), (PointDistance::Squared, 1.0)] {
            let mean = |from: &[[f64; 3]], to: &[[f64; 3]]| {
                let least = from.iter().map(|p| {
                    to.iter().map(|q| squared(*p, *q)).fold(f64::INFINITY, f64::min).powf(power)
                });
                least.sum::<f64>() / from.len() as f64
            };
            let tape = Tape::new();
            let [a, b] = [&x, &y].map(|points| tape.leaf(&cloud(points)));
            let found = chamfer_distance(a, b, kind).unwrap().item();
            approx::assert_relative_eq!(found, mean(&x, &y) + mean(&y, &x), max_relative = 1e-12, epsilon = 1e-300);
            let same = chamfer_distance(a, a, kind).unwrap();
            prop_assert_eq!(same.item(), 0.0);
            prop_assert!(same.backward().unwrap().get_or_zeros(a).data().iter().all(|&x| x == 0.0));
        }
    }
}

#[test]
fn points_are_drawn_in_proportion_to_area() {
    // Two faces, one three times as large as the other, one without an area and one that names a vertex twice.
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -3.0, 0.0], [2.0, 0.0, 0.0]];
    let mesh = Mesh::new(vec![[0, 1, 4], [0, 1, 2], [1, 1, 2], [0, 3, 1], [0, 1, 4]], 5).unwrap();
    let positions = cloud(&corners);
    let drawn = draw_points(&positions, &mesh, 400, 7).unwrap();
    let of = |face| drawn.faces().iter().filter(|&&other| other == face).count();
    assert_eq!([0, 1, 2, 3, 4].map(of), [0, 100, 0, 300, 0]);
    let points = drawn.interpolated(&positions).unwrap();
    let mean = |axis: usize| rows(&points).iter().map(|point| point[axis]).sum::<f64>() / 400.0;
    // The centroids, (1/3, 1/3) and (1/3, -1), weighted by area.
    assert!((mean(0) - 1.0 / 3.0).abs() < 0.04 && (mean(1) + 2.0 / 3.0).abs() < 0.1);
    assert_eq!(
        draw_points(&positions, &mesh, 400, 7).unwrap().barycentrics(),
        drawn.barycentrics()
    );
    assert_ne!(
        draw_points(&positions, &mesh, 400, 8).unwrap().barycentrics(),
        drawn.barycentrics()
    );
    assert_eq!(draw_points(&positions, &mesh, 0, 8).unwrap().count(), 0);
    for power in [-1000, -400, 400, 1000] {
        let scaled = positions.map(|x: f64| x * 2.0_f64.powi(power));
        let again = draw_points(&scaled, &mesh, 400, 7).unwrap();
        assert_eq!(again.barycentrics(), drawn.barycentrics());
    }
}

#[test]
fn points_move_with_the_surface_and_pull_its_vertices() {
    let (positions, mesh) = ball(0.8);
    let drawn = draw_points(&positions, &mesh, 50, 1).unwrap();
    let tape = Tape::new();
    let leaf = tape.leaf(&positions);
    let points = drawn.interpolate(leaf).unwrap();
    let gradients = points.sum().backward().unwrap();
    let mut expected = vec![[0.0; 3]; mesh.vertex_count()];
    for (face, weights) in drawn.faces().iter().zip(drawn.barycentrics()) {
        for k in 0..3 {
            let vertex = mesh.faces()[*face as usize][k] as usize;
            expected[vertex].iter_mut().for_each(|sum: &mut f64| *sum += weights[k]);
        }
    }
    for (found, expected) in rows(gradients.get(leaf).unwrap()).iter().zip(expected) {
        (0..3).for_each(|axis| {
            approx::assert_relative_eq!(found[axis], expected[axis], epsilon = 1e-12)
        });
    }
}

#[test]
fn gradients_of_the_chamfer_distance_pull_the_nearest_together() {
    let x = cloud(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    let y = cloud(&[[0.25, 0.0, 0.0], [5.0, 0.0, 0.0], [1.5, 0.0, 0.0]]);
    let tape = Tape::new();
    let [a, b] = [&x, &y].map(|points| tape.leaf(points));
    let gradients = chamfer_distance(a, b, PointDistance::Squared).unwrap().backward().unwrap();
    // 2 (p - q) / n of each pair, n = 2 from x and n = 3 from y.
    let of_x = [-0.25 - 0.5 / 3.0, -0.5 - 8.0 / 3.0 - 1.0 / 3.0];
    let of_y = [0.25 + 0.5 / 3.0, 8.0 / 3.0, 0.5 + 1.0 / 3.0];
    for (row, expected) in rows(gradients.get(a).unwrap()).iter().zip(of_x) {
        approx::assert_relative_eq!(row[0], expected, epsilon = 1e-12);
        assert_eq!(row[1..], [0.0; 2]);
    }
    for (row, expected) in rows(gradients.get(b).unwrap()).iter().zip(of_y) {
        approx::assert_relative_eq!(row[0], expected, epsilon = 1e-12);
    }
}

#[test]
fn a_surface_agrees_with_itself_and_less_with_another() {
    let (positions, mesh) = ball(0.8);
    let (larger, other) = ball(1.0);
    let same = normal_consistency((&positions, &mesh), (&positions, &mesh), 500, 3).unwrap();
    assert!((same - 1.0).abs() < 1e-12, "{same}");
    let near = normal_consistency((&positions, &mesh), (&larger, &other), 500, 3).unwrap();
    assert!(near > 0.9 && near < 0.9999, "{near}");
    // A square, and the same on its edge: normals at right angles.
    let square = |axis: usize| {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[u, v]| {
            let mut corner = [0.0; 3];
            (corner[axis], corner[2]) = (u, v);
            corner
        });
        (cloud(&corners), Mesh::new(vec![[0, 1, 2], [0, 2, 3], [0, 0, 1]], 4).unwrap())
    };
    let [(one, faces), (two, others)] = [square(0), square(1)];
    let crossed = normal_consistency((&one, &faces), (&two, &others), 100, 3).unwrap();
    assert!(crossed.abs() < 1e-12, "{crossed}");
    // A flat square, and the same with an upright one far above it. Seen from the flat one they agree. Seen from the
    // upright half of the other surface they are at right angles.
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let flat: Vec<_> = corners.iter().map(|&[u, v]| [u, v, 0.0]).collect();
    let upright = corners.iter().map(|&[u, v]| [u, 0.0, v + 5.0]);
    let both: Vec<_> = flat.iter().copied().chain(upright).collect();
    let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let flat = (cloud(&flat), Mesh::new(faces[..2].to_vec(), 4).unwrap());
    let both = (cloud(&both), Mesh::new(faces, 8).unwrap());
    for [one, other] in [[&flat, &both], [&both, &flat]] {
        let mean = normal_consistency((&one.0, &one.1), (&other.0, &other.1), 100, 3).unwrap();
        assert!((mean - 0.75).abs() < 1e-12, "{mean}");
    }
}

#[test]
fn an_f_score_counts_what_is_near() {
    let truth = cloud(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    let found = cloud(&[[0.0, 0.5, 0.0], [9.0, 0.0, 0.0]]);
    let score = f_score(&found, &truth, 0.5).unwrap();
    assert_eq!((score.precision, score.recall), (0.5, 0.25));
    approx::assert_relative_eq!(score.score, 1.0 / 3.0);
    let none = f_score(&found, &truth, 0.25).unwrap();
    assert_eq!((none.precision, none.recall, none.score), (0.0, 0.0, 0.0));
    for bad in [-0.1, f64::NAN] {
        assert!(matches!(
            f_score(&found, &truth, bad),
            Err(MeshError::Tensor(TensorError::Value { .. }))
        ));
    }
    assert_eq!(f_score(&truth, &truth, 0.0).unwrap().score, 1.0);
}

/// The message of what was refused.
fn refusal<R>(result: Result<R, MeshError>) -> String {
    result.map(drop).unwrap_err().to_string()
}

#[test]
fn what_has_no_distance_is_refused() {
    let some = cloud(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let none = Tensor::zeros([0, 3]);
    let flat = Mesh::new(vec![[0, 1, 2], [1, 1, 2]], 3).unwrap();
    let empty = Mesh::new(vec![], 3).unwrap();
    let bad = cloud(&[[0.0; 3], [1.0, f64::NAN, 0.0], [2.0, 0.0, 0.0]]);
    let rule = "needs points of shape [n, 3] with n from 1 up, got shape [0, 3]";
    assert_eq!(refusal(nearest_points(&some, &none)), format!("nearest_points {rule}"));
    assert_eq!(nearest_points(&none, &some).unwrap().indices, []);
    assert_eq!(
        refusal(nearest_points(&Tensor::zeros([3]), &some)),
        "nearest_points needs points of shape [n, 3], got shape [3]"
    );
    assert_eq!(
        refusal(nearest_points(&bad, &some)),
        "nearest_points needs finite numbers in row 1 of the points, got NaN"
    );
    assert_eq!(
        refusal(nearest_on_surface(&some, &some, &empty)),
        "nearest_on_surface needs a mesh with faces, got none"
    );
    assert_eq!(
        refusal(nearest_on_surface(&some, &none, &flat)),
        "nearest_on_surface needs positions of shape [3, 3], got shape [0, 3]"
    );
    assert_eq!(
        refusal(draw_points(&some, &flat, 4, 0)),
        "draw_points needs a face with an area, got none among 2"
    );
    assert_eq!(
        refusal(draw_points(&some, &empty, 4, 0)),
        "draw_points needs a face with an area, got none among 0"
    );
    assert_eq!(
        refusal(draw_points(&some, &flat, 1 << 31, 0)),
        "draw_points needs fewer than 2^31 points, got 2147483648"
    );
    assert_eq!(
        refusal(draw_points(&bad, &flat, 4, 0)),
        "draw_points needs finite numbers in row 1 of the positions, got NaN"
    );
    assert_eq!(
        refusal(normal_consistency((&some, &flat), (&some, &flat), 4, 0)),
        "normal_consistency needs a face with an area, got none among 2"
    );
    let (positions, mesh) = ball(0.8);
    assert_eq!(
        refusal(normal_consistency((&positions, &mesh), (&positions, &mesh), 0, 0)),
        "normal_consistency needs points from 1 up, got 0"
    );
    let (tape, other) = (Tape::new(), Tape::new());
    let [x, y] = [&some, &none].map(|points| tape.leaf(points));
    for (x, y) in [(x, y), (y, x)] {
        let before = tape.len();
        let refused = chamfer_distance(x, y, PointDistance::Squared);
        assert_eq!((refusal(refused), tape.len()), (format!("chamfer_distance {rule}"), before));
    }
    assert_eq!(
        refusal(chamfer_distance(x, other.leaf(&some), PointDistance::Squared)),
        "chamfer_distance needs variables of one tape, got one of another"
    );
}

#[test]
fn threads_change_no_bit() {
    let (positions, mesh) = ball(0.8);
    let (other, _) = ball(1.0);
    let run = || {
        let drawn = draw_points(&positions, &mesh, 2000, 5).unwrap();
        let tape = Tape::new();
        let [x, y] = [&positions, &other].map(|of| tape.leaf(of));
        let points = drawn.interpolate(x).unwrap();
        let distance = chamfer_distance(points, y, PointDistance::Euclidean).unwrap();
        let gradients = distance.backward().unwrap();
        let values = [distance.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y)];
        let (_, far) = nearest_on_surface(&other, &positions, &mesh).unwrap();
        let bits = values.iter().flat_map(|of| of.data()).chain(&far).map(|x| x.to_bits());
        bits.collect::<Vec<_>>()
    };
    let all = [1, 2, 3].map(|threads| with_threads(threads, run));
    assert!(all[0] == all[1] && all[0] == all[2]);
}
