//! Laws of remeshing.

use bokashi_core::{Tensor, parallel};
use bokashi_render_ops::glam::DVec3;

use super::*;
use crate::connectivity::Connectivity;
use crate::fixtures::{Model, cube, sheet, sphere, tetrahedron, torus};
use crate::measures::{self_intersections, signed_volume, surface_area};

fn remeshed(model: &Model, options: &RemeshOptions) -> Model {
    let derived = remesh(&model.positions(), &model.mesh(), options).unwrap();
    check(model, &derived);
    Model { points: rows(&derived.positions), faces: derived.mesh.faces().to_vec() }
}

fn rows(positions: &Tensor<f64>) -> Vec<DVec3> {
    positions.data().as_chunks::<3>().0.iter().map(|row| DVec3::from_array(*row)).collect()
}

/// What holds of every remeshed model.
fn check(model: &Model, derived: &DerivedMesh<f64>) {
    let [old, new] = [&model.mesh(), &derived.mesh].map(Connectivity::new);
    assert_eq!(old.euler_characteristic(), new.euler_characteristic());
    assert_eq!(old.parts(), new.parts());
    assert_eq!(old.boundary_loops, new.boundary_loops);
    assert_eq!(old.is_closed(), new.is_closed());
    assert_eq!(old.crowded_edges, new.crowded_edges);
    assert_eq!(old.pinched_vertices, new.pinched_vertices);
    assert_eq!(old.is_oriented, new.is_oriented);
    for row in 0..derived.weights.rows() {
        let (columns, weights) = derived.weights.row(row);
        assert!((1..=3).contains(&columns.len()));
        assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
    assert_eq!(derived.carry(&model.positions()).unwrap(), derived.positions);
    let crossings =
        |positions: &Tensor<f64>, mesh: &Mesh| self_intersections(positions, mesh).unwrap().len();
    let before = crossings(&model.positions(), &model.mesh());
    let after = crossings(&derived.positions, &derived.mesh);
    assert!(after <= before, "{after} crossings of {before}");
}

/// The share of edges whose length is between these multiples of `length`.
fn share_within(model: &Model, length: f64, least: f64, most: f64) -> f64 {
    let (mut within, mut all) = (0.0, 0.0);
    for &[a, b, c] in &model.faces {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let [p, q] = [from, to].map(|vertex| model.points[vertex as usize]);
            all += 1.0;
            within += f64::from(u8::from((least..=most).contains(&(p.distance(q) / length))));
        }
    }
    within / all
}

#[test]
fn edges_of_a_torus_get_the_length_that_is_asked_for() {
    for (around, across) in [(12, 6), (100, 40), (8, 60)] {
        for length in [0.08, 0.15, 0.25] {
            let new = remeshed(&torus(around, across, 0.4), &RemeshOptions::uniform(length));
            let share = share_within(&new, length, 0.5, 1.6);
            println!(
                "{around} {across} {length}: {} faces, {share} {}",
                new.faces.len(),
                share_within(&new, length, 0.8, 1.34)
            );
            assert!(share > 0.99, "{around} {across} {length}: {share}");
        }
    }
}

#[test]
fn a_sphere_keeps_its_volume() {
    let fine = sphere(40);
    for length in [0.05, 0.1, 0.2] {
        let new = remeshed(&fine, &RemeshOptions::uniform(length));
        let volume = |model: &Model| signed_volume(&model.positions(), &model.mesh()).unwrap();
        let ratio = volume(&new) / volume(&fine);
        println!("{length}: {} faces, volume {ratio}", new.faces.len());
        assert!((ratio - 1.0).abs() < 0.01 * (length / 0.1).powi(2).max(1.0), "{length}: {ratio}");
    }
}

#[test]
fn time() {
    let fine = sphere(50);
    for keeps_apart in [false, true] {
        let mut options = RemeshOptions::uniform(0.025);
        options.keeps_apart = keeps_apart;
        let start = std::time::Instant::now();
        let new = remesh(&fine.positions(), &fine.mesh(), &options).unwrap();
        println!(
            "{} to {} faces in {:?}",
            fine.faces.len(),
            new.mesh.faces().len(),
            start.elapsed()
        );
    }
}
