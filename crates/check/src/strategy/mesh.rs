//! Closed meshes.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

/// Vertices and faces, counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosedMesh {
    /// Positions `(x, y, z)`.
    pub positions: Vec<[f64; 3]>,
    /// Three vertices each.
    pub faces: Vec<[u32; 3]>,
}

/// Closed meshes of 4 to 40 faces: a tetrahedron, bipyramids, a cube, a torus; jittered, perhaps
/// nearly flat or long and thin; with their vertices renamed and their faces shuffled.
pub fn closed_mesh() -> BoxedStrategy<ClosedMesh> {
    let ring = 3..=7_u32;
    let plain = prop_oneof![
        Just(bipyramid(2)),
        ring.prop_map(bipyramid),
        Just(cube()),
        (3..=5_u32, 3..=4_u32).prop_map(|(major, minor)| torus(major, minor)),
    ];
    let squeeze = prop_oneof![3 => Just(1.0), 1 => select(&[1e-3, 1e-7, 30.0][..])];
    (plain, squeeze, 0..3_usize, 0.0..0.12)
        .prop_flat_map(|(mesh, factor, axis, jitter)| {
            let vertices = mesh.positions.len();
            let order = Just((0..vertices as u32).collect::<Vec<_>>()).prop_shuffle();
            let faces = Just(mesh.faces.clone()).prop_shuffle();
            let turns = vec(0..3_usize, mesh.faces.len());
            let offsets = vec([-1.0..1.0, -1.0..1.0, -1.0..1.0], vertices);
            (Just(mesh), order, faces, turns, offsets).prop_map(
                move |(mesh, order, mut faces, turns, offsets)| {
                    let mut positions = mesh.positions.clone();
                    for (vertex, &name) in order.iter().enumerate() {
                        let mut position = mesh.positions[vertex];
                        for (x, offset) in position.iter_mut().zip(offsets[vertex]) {
                            *x += jitter * offset;
                        }
                        position[axis] *= factor;
                        positions[name as usize] = position;
                    }
                    for (face, turn) in faces.iter_mut().zip(turns) {
                        *face = face.map(|vertex| order[vertex as usize]);
                        face.rotate_left(turn);
                    }
                    ClosedMesh { positions, faces }
                },
            )
        })
        .boxed()
}

/// Two poles over a ring of `ring` vertices; with a ring of 2, a tetrahedron.
fn bipyramid(ring: u32) -> ClosedMesh {
    if ring == 2 {
        let positions =
            vec![[0.5, 0.5, 0.5], [0.5, -0.5, -0.5], [-0.5, 0.5, -0.5], [-0.5, -0.5, 0.5]];
        return ClosedMesh { positions, faces: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] };
    }
    let mut positions = vec![[0.0, 0.0, 0.7], [0.0, 0.0, -0.7]];
    let mut faces = Vec::new();
    for k in 0..ring {
        let (sin, cos) = (f64::from(k) / f64::from(ring) * std::f64::consts::TAU).sin_cos();
        positions.push([0.6 * cos, 0.6 * sin, 0.0]);
        let (here, next) = (2 + k, 2 + (k + 1) % ring);
        faces.extend([[0, here, next], [1, next, here]]);
    }
    ClosedMesh { positions, faces }
}

fn cube() -> ClosedMesh {
    let corner = |k: u32| [k >> 2 & 1, k >> 1 & 1, k & 1].map(|bit| f64::from(bit) - 0.5);
    // The four corners of each side, counter-clockwise from outside.
    let sides =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ClosedMesh { positions: (0..8).map(corner).collect(), faces }
}

fn torus(major: u32, minor: u32) -> ClosedMesh {
    let turn =
        |k: u32, count: u32| (f64::from(k) / f64::from(count) * std::f64::consts::TAU).sin_cos();
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for i in 0..major {
        for j in 0..minor {
            let ((sin_i, cos_i), (sin_j, cos_j)) = (turn(i, major), turn(j, minor));
            let radius = 0.6 + 0.25 * cos_j;
            positions.push([radius * cos_i, radius * sin_i, 0.25 * sin_j]);
            let vertex = |i: u32, j: u32| i % major * minor + j % minor;
            let [a, b, c, d] =
                [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    ClosedMesh { positions, faces }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::super::draws;
    use super::*;

    #[test]
    fn every_edge_joins_two_faces_of_one_winding() {
        for ClosedMesh { positions, faces } in draws(closed_mesh(), 200) {
            let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
            for face in &faces {
                for k in 0..3 {
                    assert!((face[k] as usize) < positions.len());
                    *edges.entry((face[k], face[(k + 1) % 3])).or_default() += 1;
                }
            }
            for (&(a, b), &count) in &edges {
                assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)), "edge {a} {b}");
            }
            // Vertices - edges + faces: 2 for a sphere, 0 for a torus.
            let euler = positions.len() as i64 - edges.len() as i64 / 2 + faces.len() as i64;
            assert!(euler == 2 || euler == 0);
        }
    }

    /// Six times the volume.
    fn volume(mesh: &ClosedMesh) -> f64 {
        let volume = |face: &[u32; 3]| {
            let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] =
                face.map(|vertex| mesh.positions[vertex as usize]);
            ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        };
        mesh.faces.iter().map(volume).sum()
    }

    #[test]
    fn outside_is_outside() {
        for mesh in [bipyramid(2), bipyramid(3), bipyramid(6), cube(), torus(5, 4)] {
            assert!(volume(&mesh) > 0.1, "{mesh:?}");
        }
        assert!((volume(&cube()) - 6.0).abs() < 1e-12);
    }

    #[test]
    fn some_are_nearly_flat_and_some_have_a_hole() {
        let meshes = draws(closed_mesh(), 200);
        let flat = |mesh: &&ClosedMesh| volume(mesh).abs() < 1e-3;
        assert!(meshes.iter().filter(flat).count() > 10);
        assert!(meshes.iter().any(|mesh| mesh.faces.len() == 2 * mesh.positions.len()));
        assert!(meshes.iter().any(|mesh| mesh.faces.len() == 4));
    }
}
