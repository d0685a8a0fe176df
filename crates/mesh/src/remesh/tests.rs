//! Laws of remeshing.

use std::f64::consts::PI;

use bokashi_core::Tensor;
use bokashi_render_ops::glam::DVec3;
use proptest::prelude::*;

use super::guard::Proposal;
use super::*;
use crate::connectivity::Connectivity;
use crate::fixtures::{Model, cube, sheet, sphere, tetrahedron, torus};
use crate::measures::{self_intersections, signed_volume, surface_area};
use crate::subdivide::{Subdivision, subdivide};
use crate::triangle::{area_vector, quality};

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
    // A face that crosses others may become many that do.
    assert!(before > 0 || after == 0, "{after} crossings");
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
fn a_flat_sheet_stays_flat_with_its_outline_and_no_face_turned_over() {
    for (count, length) in [(3, 0.05), (40, 0.11), (12, 0.3)] {
        let new = remeshed(&sheet(count), &RemeshOptions::uniform(length));
        let area = |model: &Model| surface_area(&model.positions(), &model.mesh()).unwrap();
        assert!((area(&new) - 1.0).abs() < 1e-12, "{}", area(&new));
        for face in &new.faces {
            assert!(area_vector(face.map(|vertex| new.points[vertex as usize])).z > 0.0);
        }
        for corner in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            assert!(new.points.contains(&DVec3::new(corner[0], corner[1], 0.0)));
        }
        let share = share_within(&new, length, 0.5, 1.6);
        assert!(share > 0.95, "{count} {length}: {share}");
    }
}

#[test]
fn faces_become_regular_and_remeshing_again_changes_little() {
    // Far from regular: a stretched sphere.
    let model = sphere(16).moved(|p| DVec3::new(p.x, 0.4 * p.y, 2.0 * p.z));
    let options = RemeshOptions::uniform(0.12);
    let once = remeshed(&model, &options);
    let mean_quality = |model: &Model| {
        let corners = |face: &[u32; 3]| face.map(|vertex| model.points[vertex as usize]);
        let sum: f64 = model.faces.iter().map(|face| quality(corners(face))).sum();
        sum / model.faces.len() as f64
    };
    assert!(mean_quality(&once) > 0.93, "{}", mean_quality(&once));
    let twice = remeshed(&once, &options);
    let ratio = twice.faces.len() as f64 / once.faces.len() as f64;
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
    let volume = |model: &Model| signed_volume(&model.positions(), &model.mesh()).unwrap();
    assert!((volume(&twice) / volume(&once) - 1.0).abs() < 5e-3);
}

#[test]
fn lengths_per_vertex_make_a_mesh_fine_where_they_are_short() {
    let model = sphere(20);
    let lengths = model.points.iter().map(|p| if p.z > 0.5 { 0.05 } else { 0.2 }).collect();
    let new = remeshed(&model, &RemeshOptions::adaptive(lengths));
    let mean = |is_counted: fn(DVec3) -> bool| {
        let (mut sum, mut count) = (0.0, 0.0);
        for face in &new.faces {
            let corners = face.map(|vertex| new.points[vertex as usize]);
            if corners.iter().all(|p| is_counted(*p)) {
                sum += corners[0].distance(corners[1]);
                count += 1.0;
            }
        }
        sum / count
    };
    let (fine, coarse) = (mean(|p| p.z > 0.6), mean(|p| p.z < 0.2));
    assert!((fine / 0.05 - 1.0).abs() < 0.2 && (coarse / 0.2 - 1.0).abs() < 0.2, "{fine} {coarse}");
}

#[test]
fn seams_keep_their_line() {
    let model = torus(24, 12, 0.4);
    // A ring across, and one around.
    let is_seam = |face: usize, corner: usize| {
        let [a, b] = [1, 2].map(|step| model.faces[face][(corner + step) % 3]);
        (a < 12 && b < 12) || (a % 12 == 0 && b % 12 == 0)
    };
    let mesh = model.mesh().with_seams(is_seam);
    let length_of = |positions: &Tensor<f64>, mesh: &Mesh| {
        let points = rows(positions);
        let mut sum = 0.0;
        for (index, face) in mesh.faces().iter().enumerate() {
            for corner in (0..3).filter(|corner| mesh.is_seam(index, *corner)) {
                let [a, b] = [1, 2].map(|step| points[face[(corner + step) % 3] as usize]);
                sum += a.distance(b) / 2.0;
            }
        }
        sum
    };
    let old = length_of(&model.positions(), &mesh);
    for length in [0.06, 0.3] {
        let derived = remesh(&model.positions(), &mesh, &RemeshOptions::uniform(length)).unwrap();
        check(&model, &derived);
        assert!(derived.mesh.faces().len() != model.faces.len());
        let new = length_of(&derived.positions, &derived.mesh);
        assert!((new / old - 1.0).abs() < 1e-12, "{old} {new}");
    }
}

#[test]
fn a_boundary_keeps_corners_of_120_degrees_and_loses_vertices_where_it_is_straight() {
    let corner = |k: u32| {
        let (sin, cos) = (f64::from(k) * PI / 3.0).sin_cos();
        DVec3::new(cos, sin, 0.0)
    };
    let corners: Vec<_> = (0..6).map(corner).collect();
    let hexagon = Model {
        points: [DVec3::ZERO].into_iter().chain(corners.iter().copied()).collect(),
        faces: (0..6).map(|k| [0, k + 1, (k + 1) % 6 + 1]).collect(),
    };
    let fine = subdivide(&hexagon.positions(), &hexagon.mesh(), Subdivision::Midpoint).unwrap();
    let fine = Model { points: rows(&fine.positions), faces: fine.mesh.faces().to_vec() };
    for model in [hexagon, fine] {
        let new = remeshed(&model, &RemeshOptions::uniform(3.0));
        assert!(corners.iter().all(|corner| new.points.contains(corner)), "{:?}", new.points);
        assert_eq!(Connectivity::new(&new.mesh()).boundary_edges, 6);
    }
}

#[test]
fn the_same_bits_come_out_twice_and_in_single_precision_too() {
    let model = torus(20, 12, 0.4).shaken(0.02, 5);
    let options = RemeshOptions::uniform(0.1);
    let single = model.positions().cast::<f32>();
    let [one, other] = [(); 2].map(|()| remesh(&single, &model.mesh(), &options).unwrap());
    assert_eq!(one.positions, other.positions);
    assert_eq!((one.mesh.faces(), &one.weights), (other.mesh.faces(), &other.weights));
    assert_eq!(one.carry(&single).unwrap(), one.positions);
}

#[test]
fn edges_beside_one_that_must_not_be_split_are_not_halved_without_end() {
    let mut sheets = sheet(2).and(sheet(2).moved(|p| DVec3::new(p.x, -p.y, p.y)));
    sheets = welded(sheets.and(sheet(2).moved(|p| DVec3::new(p.x, 0.0, p.y))));
    let new = remeshed(&sheets, &RemeshOptions { iterations: 1, ..RemeshOptions::uniform(0.05) });
    let shortest = new.faces.iter().map(|face| {
        let [a, b, c] = face.map(|vertex| new.points[vertex as usize]);
        a.distance(b).min(b.distance(c)).min(c.distance(a))
    });
    let shortest = shortest.fold(f64::INFINITY, f64::min);
    assert!(shortest > 0.02, "{shortest}");
    assert!(new.faces.len() < 6000, "{}", new.faces.len());
}

#[test]
fn slivers_of_an_old_mesh_are_gone() {
    let stretched = sphere(16).moved(|p| DVec3::new(p.x, 0.4 * p.y, 2.0 * p.z));
    let models = [
        torus(30, 5, 0.1),
        torus(12, 12, 0.4).shaken(0.05, 4),
        stretched,
        sphere(20).shaken(0.03, 9),
    ];
    for (index, model) in models.iter().enumerate() {
        for length in [0.1, 0.2, 0.4] {
            for (moves_vertices, least) in [(true, 0.45), (false, 0.2)] {
                let options = RemeshOptions { moves_vertices, ..RemeshOptions::uniform(length) };
                let new = remeshed(model, &options);
                let corners = |face: &[u32; 3]| face.map(|vertex| new.points[vertex as usize]);
                let worst = new.faces.iter().map(|face| quality(corners(face))).fold(1.0, f64::min);
                assert!(worst > least, "{index} {length} {moves_vertices}: {worst}");
            }
        }
    }
}

#[test]
fn a_vertex_may_not_make_slivers_or_turn_faces_over() {
    let model = sheet(4);
    let (mesh, lengths) = (model.mesh(), vec![0.25; model.points.len()]);
    let changing = Changing::new(&mesh, &model.points, lengths);
    let vertex = 12;
    let gone = &changing.around[vertex as usize];
    let allows = |x: f64, y: f64, z: f64| {
        let at = model.points[vertex as usize] + 0.25 * DVec3::new(x, y, z);
        let proposals = gone.iter().map(|&old| {
            let face = changing.faces[old as usize];
            let points = [0, 1, 2]
                .map(|k| if face[k] == vertex { at } else { model.points[face[k] as usize] });
            Proposal { face, points, old }
        });
        changing.allows(gone, &proposals.collect::<Vec<_>>())
    };
    assert!(allows(0.0, 0.0, 0.0) && allows(0.3, 0.2, 0.1) && allows(-0.5, -0.5, 0.0));
    // Flat and narrow; beyond a neighbour; far above.
    assert!(!allows(0.97, 0.0, 0.0) && !allows(1.3, 0.0, 0.0) && !allows(0.0, 0.0, 1.5));
}

#[test]
fn sheets_that_pass_close_by_stay_apart() {
    // Two bowls, one in the other, so close that coarse faces of one would cut the other.
    let inner = sphere(24).moved(|p| 0.985 * p);
    let both = sphere(24).and(inner);
    let mut options = RemeshOptions::uniform(0.35);
    remeshed(&both, &options);
    options.keeps_apart = false;
    let derived = remesh(&both.positions(), &both.mesh(), &options).unwrap();
    let crossings = self_intersections(&derived.positions, &derived.mesh).unwrap();
    assert!(!crossings.is_empty(), "the scene should need the check");
}

#[test]
fn what_cannot_be_remeshed_is_refused_or_stays() {
    let model = sphere(2);
    let said = |options: &RemeshOptions| {
        remesh(&model.positions(), &model.mesh(), options).unwrap_err().to_string()
    };
    for (length, shown) in [(0.0, "0"), (-1.0, "-1"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        let message = format!("remesh needs finite lengths above 0, got {shown}");
        assert_eq!(said(&RemeshOptions::uniform(length)), message);
    }
    let message = "remesh needs a length for each of the 18 vertices, got 2";
    assert_eq!(said(&RemeshOptions::adaptive(vec![1.0; 2])), message);
    let empty = Model { points: Vec::new(), faces: Vec::new() };
    assert!(remeshed(&empty, &RemeshOptions::uniform(1.0)).faces.is_empty());
    // Lengths beyond all reason are defined, too.
    let mut options = RemeshOptions::uniform(f64::MIN_POSITIVE);
    options.most_faces = 500;
    assert!((490..=500).contains(&remeshed(&sphere(3), &options).faces.len()));
    remeshed(&sphere(3), &RemeshOptions::uniform(f64::MAX));
    // Two faces; one alone with its boundary; one whose boundary is straight at a corner.
    let one = Model { faces: vec![[0, 1, 2]], ..sheet(1) };
    let mut flat = one.clone();
    flat.points[1] = DVec3::new(0.5, 0.01, 0.0);
    for model in [sheet(1), one, flat] {
        let coarse = remeshed(&model, &RemeshOptions::uniform(10.0));
        assert_eq!(coarse.faces.len(), model.faces.len());
    }
    // No iteration changes nothing.
    let mut options = RemeshOptions::uniform(0.1);
    options.iterations = 0;
    assert_eq!(remeshed(&model, &options).faces, model.faces);
}

/// A model that some seed draws: a plain one, shaken, and what it is for.
fn drawn(kind: usize, shake: f64, seed: u64) -> Model {
    let model = match kind {
        0 => tetrahedron(),
        1 => cube(),
        2 => torus(9, 6, 0.45),
        3 => sphere(4),
        4 => sheet(4),
        5 => torus(30, 5, 0.1),
        // Two parts that meet at one vertex.
        6 => welded(sphere(2).and(sphere(2).moved(|p| p + 2.0 * DVec3::X))),
        // Three sheets at one edge.
        7 => {
            let mut sheets = sheet(3).and(sheet(3).moved(|p| DVec3::new(p.x, -p.y, p.y)));
            sheets = sheets.and(sheet(3).moved(|p| DVec3::new(p.x, 0.0, p.y)));
            welded(sheets)
        }
        // Cut open: each face has vertices of its own along a line.
        8 => {
            let mut model = torus(10, 8, 0.4);
            let first = model.points.len() as u32;
            model.points.extend_from_within(..8);
            let half = model.faces.len() - 16;
            let below = |it: &&mut u32| **it < 8;
            model.faces[half..].iter_mut().flatten().filter(below).for_each(|it| *it += first);
            model
        }
        // Faces that name a vertex twice, a vertex without a face, and the same face the other way round.
        9 => {
            let mut model = sphere(3);
            let count = model.points.len() as u32;
            model.points.push(DVec3::splat(3.0));
            model.faces.extend([[0, 0, 1], [count, count, count], [5, 5, count]]);
            let [a, b, c] = model.faces[4];
            model.faces.push([c, b, a]);
            model
        }
        // A fan: all faces at one vertex.
        10 => {
            let rim = (0..40).map(|k| {
                DVec3::new((k as f64 / 5.0).cos(), (k as f64 / 5.0).sin(), k as f64 / 9.0)
            });
            let points = [DVec3::ZERO].into_iter().chain(rim).collect();
            Model { points, faces: (1..40).map(|k| [0, k, k + 1]).collect() }
        }
        // Slivers.
        _ => sphere(6).moved(|p| DVec3::new(p.x, 1e-3 * p.y, 30.0 * p.z)),
    };
    model.shaken(shake, seed)
}

/// Vertices at one place joined.
fn welded(model: Model) -> Model {
    let first = |vertex: &u32| {
        let place = model.points[*vertex as usize];
        model.points.iter().position(|it| *it == place).unwrap() as u32
    };
    let faces = model.faces.iter().map(|face| [0, 1, 2].map(|k| first(&face[k]))).collect();
    Model { faces, ..model }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn topology_is_kept_and_nothing_crosses_that_did_not(
        kind in 0..12_usize,
        shake in prop_oneof![Just(0.0), Just(0.01), Just(0.1), Just(0.3)],
        seed in any::<u64>(),
        length in prop_oneof![Just(0.05), 0.1..0.5, Just(1.0), Just(5.0)],
        moves_vertices in any::<bool>(),
        adaptive in any::<bool>(),
        iterations in 1..6_usize,
        exponent in prop_oneof![Just(0), Just(-20), Just(20), Just(-900), Just(900)],
    ) {
        let model = drawn(kind, shake, seed);
        let count = model.points.len();
        let mut options = RemeshOptions::uniform(length);
        if adaptive {
            let lengths = (0..count).map(|v| length * if v % 3 == 0 { 1.0 } else { 2.5 });
            options = RemeshOptions::adaptive(lengths.collect());
        }
        options.most_faces = 3000;
        (options.moves_vertices, options.iterations) = (moves_vertices, iterations);
        let derived = remesh(&model.positions(), &model.mesh(), &options).unwrap();
        check(&model, &derived);
        prop_assert!(derived.mesh.faces().len() <= 3000.max(model.faces.len()));
        // A power of two scales every number without rounding.
        let scale = 2_f64.powi(exponent);
        let scaled_lengths = match &options.lengths {
            EdgeLengths::Uniform(length) => EdgeLengths::Uniform(length * scale),
            EdgeLengths::PerVertex(lengths) => {
                EdgeLengths::PerVertex(lengths.iter().map(|length| length * scale).collect())
            }
        };
        let scaled_options = RemeshOptions { lengths: scaled_lengths, ..options };
        let scaled = model.positions().map(|x| x * scale);
        let again = remesh(&scaled, &model.mesh(), &scaled_options).unwrap();
        prop_assert_eq!(again.mesh.faces(), derived.mesh.faces());
        prop_assert_eq!(&again.weights, &derived.weights);
    }
}
