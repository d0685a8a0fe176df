//! Which triangles polygons become.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use glam::{DMat3, DQuat, DVec3, Vec3};

use super::{of_corners, only, read};
use crate::mesh::MeshKind::{Obj, Ply};
use crate::model::{Geometry, Model};

/// The letter U, counter-clockwise, with an area of 28.
const U: [[f64; 2]; 8] = [
    [0.0, 0.0],
    [6.0, 0.0],
    [6.0, 6.0],
    [4.0, 6.0],
    [4.0, 2.0],
    [2.0, 2.0],
    [2.0, 6.0],
    [0.0, 6.0],
];

fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
    points.iter().map(|&[x, y]| DVec3::new(x, y, 0.0)).collect()
}

/// What an OBJ file and a PLY file with this polygon become. The texture coordinates of a corner are x and
/// y, and v is up.
fn parsed(points: &[DVec3]) -> Model {
    let (mut obj, mut rows, mut coordinates) = (String::new(), String::new(), String::new());
    let (mut face, mut indices) = ("f".to_owned(), points.len().to_string());
    for (k, p) in points.iter().enumerate() {
        write!(obj, "v {:?} {:?} {:?}\nvt {:?} {:?}\n", p.x, p.y, p.z, p.x, 1.0 - p.y).unwrap();
        writeln!(rows, "{:?} {:?} {:?}", p.x, p.y, p.z).unwrap();
        write!(coordinates, " {:?} {:?}", p.x, 1.0 - p.y).unwrap();
        write!(face, " {}/{}", k + 1, k + 1).unwrap();
        write!(indices, " {k}").unwrap();
    }
    let from_obj = read(Obj, format!("{obj}{face}\n")).unwrap();
    let header = "element face 1\nproperty list uint int vertex_indices\n\
                  property list uint double texcoord\nend_header\n";
    let count = points.len();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty double x\nproperty double y\n\
         property double z\n{header}{rows}{indices} {}{coordinates}\n",
        2 * count
    );
    let from_ply = read(Ply, ply).unwrap();
    assert_eq!(from_obj, from_ply);
    from_obj
}

/// The sum of the vectors that stand on the faces, each as long as twice its face's area; and of their
/// lengths.
fn areas(geometry: &Geometry) -> (DVec3, f64) {
    let vectors = geometry.faces.iter().map(|face| {
        let [a, b, c] = face.map(|k| Vec3::from(geometry.positions[k as usize]).as_dvec3());
        (b - a).cross(c - a)
    });
    vectors
        .fold((DVec3::ZERO, 0.0), |(sum, length), vector| (sum + vector, length + vector.length()))
}

/// Checks that a polygon of `count` corners is covered once, with all of its corners, and turns as it did.
fn check_whole(model: &Model, count: usize, doubled: DVec3) {
    let geometry = only(model);
    assert_eq!([geometry.positions.len(), geometry.faces.len()], [count, count - 2]);
    let mut seen = vec![false; count];
    geometry.faces.iter().flatten().for_each(|&k| seen[k as usize] = true);
    assert!(seen.iter().all(|&seen| seen));
    let (sum, length) = areas(geometry);
    let largest = doubled.length();
    assert!((sum - doubled).length() < 1e-5 * largest, "{sum} {doubled}");
    assert!((length - largest).abs() < 1e-5 * largest, "{length} {largest}");
    // Attributes stay at their corners.
    let positions = geometry.faces.iter().flatten().map(|&k| geometry.positions[k as usize]);
    let coordinates = of_corners(&geometry.coordinates);
    for ([x, y, _], [u, v]) in positions.zip(coordinates) {
        assert!((x - u).abs() < 1e-5 && (y - v).abs() < 1e-5, "{x} {y} {u} {v}");
    }
}

/// Numbers from 0 to 1 that look random.
fn random(state: &mut u32) -> f64 {
    *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    f64::from(*state >> 8) / f64::from(1 << 24)
}

fn turned(axis: DVec3, angle: f64) -> DMat3 {
    DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle))
}

#[test]
fn a_concave_letter_has_its_area_from_each_corner_on_and_either_side() {
    for shift in 0..U.len() {
        let mut points = flat(&U);
        points.rotate_left(shift);
        let model = parsed(&points);
        check_whole(&model, 8, DVec3::new(0.0, 0.0, 56.0));
        assert!(model.notes.is_empty(), "{:?}", model.notes);
        points.reverse();
        check_whole(&parsed(&points), 8, DVec3::new(0.0, 0.0, -56.0));
    }
}

#[test]
fn corners_on_straight_sides_stay() {
    // Each side has further corners on it.
    for parts in 2..5 {
        let points: Vec<DVec3> = (0..8 * parts)
            .map(|k| {
                let [[ax, ay], [bx, by]] = [U[k / parts], U[(k / parts + 1) % 8]];
                let share = (k % parts) as f64 / parts as f64;
                DVec3::new(ax + share * (bx - ax), ay + share * (by - ay), 0.0)
            })
            .collect();
        check_whole(&parsed(&points), points.len(), DVec3::new(0.0, 0.0, 56.0));
    }
}

#[test]
fn any_polygon_that_is_seen_whole_from_its_middle_is_covered_once() {
    let mut state = 7;
    for case in 0..200 {
        let count = 4 + case % 40;
        let turn = turned(DVec3::new(random(&mut state) - 0.5, random(&mut state) - 0.5, 0.3), 9.0);
        let points: Vec<DVec3> = (0..count)
            .map(|k| {
                let angle = TAU * (k as f64 + 0.5 * random(&mut state)) / count as f64;
                let radius = 0.1 + random(&mut state);
                turn * DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
            })
            .collect();
        let doubled = (0..count).map(|k| points[k].cross(points[(k + 1) % count])).sum();
        let model = parsed(&points);
        check_whole(&model, count, doubled);
        assert!(model.notes.is_empty(), "{case}: {:?}", model.notes);
    }
}

#[test]
fn convex_polygons_stay_fans_and_other_faces_stay_where_they_are() {
    let mut text = String::new();
    let circle = (0..7).map(|k| (TAU * f64::from(k) / 7.0).sin_cos());
    circle.for_each(|(y, x)| writeln!(text, "v {x} {y} 0").unwrap());
    flat(&U).iter().for_each(|p| writeln!(text, "v {} {} 1", p.x, p.y).unwrap());
    text.push_str("f 1 2 3 4 5 6 7\nf 8 9 10 11 12 13 14 15\nf 1 3 5\nf 7 6 5 4\n");
    let faces = &only(&read(Obj, text).unwrap()).faces.clone();
    let fan: Vec<[u32; 3]> = (1..6).map(|k| [0, k, k + 1]).collect();
    assert_eq!(faces[..5], fan);
    assert!(faces[5..11].iter().flatten().all(|&vertex| vertex >= 7));
    assert_eq!(faces[11..], [[0, 2, 4], [6, 5, 4], [6, 4, 3]]);
}

#[test]
fn polygons_without_a_right_answer_are_counted() {
    let note = |points: &[DVec3]| parsed(points).notes.join("; ");
    let crosses = "a polygon crosses itself and became a fan around its first corner";
    let star: Vec<[f64; 2]> = (0..5)
        .map(|k| {
            let (y, x) = (TAU * f64::from(2 * k % 5) / 5.0).sin_cos();
            [x, y]
        })
        .collect();
    let bow = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
    let uneven = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]];
    let loops = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [1.0, -1.0], [0.0, 4.0]];
    for points in [&star[..], &bow, &uneven, &loops] {
        assert_eq!(note(&flat(points)), crosses, "{points:?}");
    }
    // The plane of U goes up and down by a tenth.
    let mut bent = flat(&U);
    bent.iter_mut().enumerate().for_each(|(k, p)| p.z = if k % 2 == 0 { 0.1 } else { -0.1 });
    let model = parsed(&bent);
    let off = "a polygon has corners that are off its plane by more than 1 % of its size";
    assert_eq!(model.notes, [off]);
    assert_eq!(only(&model).faces.len(), 6);
    // A quadrilateral of a round surface.
    let points = flat(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let round: Vec<DVec3> = points.iter().map(|p| *p + 0.02 * p.x * p.y * DVec3::Z).collect();
    assert!(note(&round).is_empty(), "{}", note(&round));
    // Several are counted.
    let text = "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\nf 2 3 4 1\n";
    assert_eq!(read(Obj, text).unwrap().notes, [format!("{crosses} (2 times)")]);
}

/// A slit leads to a hole and back.
#[test]
fn a_hole_that_a_slit_leads_to_stays_a_hole() {
    let text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 1 1 0\nv 1 3 0\nv 3 3 0\nv 3 1 0\n\
                f 1 2 3 4 1 5 6 7 8 5\n";
    let model = read(Obj, text).unwrap();
    let (sum, length) = areas(only(&model));
    assert_eq!((sum, length), (DVec3::new(0.0, 0.0, 24.0), 24.0));
    assert!(model.notes.is_empty(), "{:?}", model.notes);
}

#[test]
fn a_polygon_of_very_many_corners_takes_time_in_proportion() {
    let start = std::time::Instant::now();
    let count = 20_000;
    // A saw with corners on straight sides.
    let mut points: Vec<[f64; 2]> =
        (0..count).map(|k| [f64::from(k), [0.0, 1.0, 2.0, 1.0][k as usize % 4]]).collect();
    points.extend([[f64::from(count), 9.0], [0.0, 9.0]]);
    let model = parsed(&flat(&points));
    assert_eq!(only(&model).faces.len(), points.len() - 2);
    assert!(model.notes.is_empty(), "{:?}", model.notes);
    assert!(start.elapsed().as_secs() < 30, "{:?}", start.elapsed());
}

/// Corners on a coarse grid meet, lie on sides and on lines very often.
#[test]
fn any_polygon_is_covered_once_or_counted() {
    let (mut state, mut whole, mut large) = (3, 0, 0);
    for case in 0..4000 {
        let count = 4 + case % 9;
        let mut at = || (5.0 * random(&mut state)).floor();
        let points: Vec<DVec3> = (0..count).map(|_| DVec3::new(at(), at(), 0.0)).collect();
        let doubled: DVec3 = (0..count).map(|k| points[k].cross(points[(k + 1) % count])).sum();
        let mut obj: String =
            points.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
        // MeshContext it a face that is left where the polygon is none.
        obj.push_str("v 9 9 0\nv 10 9 0\nv 9 10 0\nf -1 -2 -3\nf");
        (1..=count).for_each(|k| write!(obj, " {k}").unwrap());
        let model = read(Obj, obj).unwrap();
        if model.notes.iter().any(|note| note.contains("crosses itself")) {
            continue;
        }
        let (_, length) = areas(only(&model));
        assert!((length - 1.0 - doubled.length()).abs() < 1e-5, "{points:?}: {length} {doubled}");
        whole += 1;
        large += usize::from(count > 4 && doubled != DVec3::ZERO);
    }
    assert!(whole > 300 && large > 100, "{whole} {large}");
}
