//! Meshes to start from: a sphere, a cube, a plane.
//!
//! Sphere and cube are six grids that share the vertices at their edges; the sphere's grid lines are at equal
//! angles. The six sides lie beside each other in the texture, three across and two down.

use std::f32::consts::FRAC_PI_4;

use glam::DVec3;

use crate::model::{Geometry, Indexed, Submesh};

/// The part of a side's place in the texture that lies around the side.
const MARGIN: f32 = 1.0 / 32.0;

/// The axes of a side: where it points, and along which u and v grow.
const SIDES: [[[f32; 3]; 3]; 6] = [
    [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
    [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
    [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
];

/// The cells along a side, for about so many faces on so many sides.
fn cells(faces: usize, sides: usize) -> usize {
    ((faces as f64 / (2 * sides) as f64).sqrt().round() as usize).clamp(1, 4096)
}

/// A sphere of radius 1 with about so many faces.
pub(crate) fn sphere(faces: usize) -> Geometry {
    let cells = cells(faces, 6);
    grids(
        "sphere",
        cells,
        |share| if share == 1.0 { 1.0 } else { (FRAC_PI_4 * share).tan() },
        |point| {
            let length = point.iter().map(|x| x * x).sum::<f32>().sqrt();
            point.map(|x| x / length)
        },
    )
}

/// A cube from -1 to 1 with about so many faces.
pub(crate) fn cube(faces: usize) -> Geometry {
    let cells = cells(faces, 6);
    let mut cube = grids("cube", cells, |share| share, |point| point);
    // Sides are flat to their edges.
    let normals = SIDES.map(|[out, ..]| out).to_vec();
    let faces = (0..cube.faces.len()).map(|face| [(face / (2 * cells * cells)) as u32; 3]);
    cube.normals = Some(Indexed { rows: normals, faces: faces.collect() });
    cube
}

/// A square from -1 to 1 in x and y with about so many faces, seen from +z.
pub(crate) fn plane(faces: usize) -> Geometry {
    let cells = cells(faces, 1);
    let side = cells + 1;
    let share = |k: usize| k as f32 / cells as f32;
    let rows = (0..side * side).map(|k| [share(k % side), share(k / side)]);
    let coordinates: Vec<_> = rows.collect();
    let positions = coordinates.iter().map(|[u, v]| [2.0 * u - 1.0, 1.0 - 2.0 * v, 0.0]).collect();
    let faces: Vec<_> = grid_faces(cells).collect();
    geometry("plane", positions, faces.clone(), Indexed { rows: coordinates, faces })
}

/// The faces of a grid with row-major corners.
fn grid_faces(cells: usize) -> impl Iterator<Item = [u32; 3]> {
    let corner = move |row: usize, column: usize| (row * (cells + 1) + column) as u32;
    (0..cells * cells).flat_map(move |k| {
        let (row, column) = (k / cells, k % cells);
        let [a, b] = [corner(row, column), corner(row, column + 1)];
        let [c, d] = [corner(row + 1, column), corner(row + 1, column + 1)];
        // Upside down and back: v grows downwards.
        [[a, c, d], [a, d, b]]
    })
}

/// Six grids, each vertex moved by `map`. Lines that stand at a share of the way from a side's middle to its
/// border, 1 at the border, are moved to `line` of that share.
fn grids(
    name: &str,
    cells: usize,
    line: impl Fn(f32) -> f32,
    map: impl Fn([f32; 3]) -> [f32; 3],
) -> Geometry {
    let side = cells + 1;
    // Mirrored lines are mirrored to the bit, or neighbouring sides would not meet.
    let line = |k: usize| {
        let offset = line((2 * k).abs_diff(cells) as f32 / cells as f32);
        if 2 * k < cells { -offset } else { offset }
    };
    let mut corners = Vec::with_capacity(6 * side * side);
    let mut rows = Vec::with_capacity(6 * side * side);
    for (side_index, [out, along, down]) in SIDES.iter().enumerate() {
        for k in 0..side * side {
            let [s, t] = [line(k % side), line(k / side)];
            corners.push(map([0, 1, 2].map(|axis| out[axis] + s * along[axis] + t * down[axis])));
            let share = |k: usize| k as f32 / cells as f32;
            let [u, v] = [share(k % side), share(k / side)];
            // Away from the neighbours in the texture, which a coarse level would mix in.
            let [u, v] = [u, v].map(|share| MARGIN + share * (1.0 - 2.0 * MARGIN));
            rows.push([((side_index % 3) as f32 + u) / 3.0, ((side_index / 3) as f32 + v) / 2.0]);
        }
    }
    let mut faces = Vec::with_capacity(12 * cells * cells);
    for side_index in 0..6 {
        let first = (side_index * side * side) as u32;
        faces.extend(grid_faces(cells).map(|face| face.map(|corner| corner + first)));
    }
    let (positions, joined) = joined(&corners);
    let vertices = faces.iter().map(|face| face.map(|corner| joined[corner as usize])).collect();
    geometry(name, positions, vertices, Indexed { rows, faces })
}

/// Corners in one place as one vertex: the places, and which vertex each corner is.
fn joined(corners: &[[f32; 3]]) -> (Vec<[f32; 3]>, Vec<u32>) {
    let mut seen = std::collections::HashMap::new();
    let mut positions = Vec::new();
    let vertices = corners.iter().map(|corner| {
        // -0 is 0.
        let bits = corner.map(|x| (x + 0.0).to_bits());
        *seen.entry(bits).or_insert_with(|| {
            positions.push(corner.map(|x| x + 0.0));
            positions.len() as u32 - 1
        })
    });
    let vertices = vertices.collect();
    (positions, vertices)
}

fn geometry(
    name: &str,
    positions: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
    coordinates: Indexed<2>,
) -> Geometry {
    Geometry {
        name: name.to_owned(),
        positions,
        submeshes: vec![Submesh { material: None, faces: 0..faces.len() }],
        offset: DVec3::ZERO,
        faces,
        colors: None,
        coordinates: Some(coordinates),
        normals: None,
        tangents: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the volume.
    fn volume(geometry: &Geometry) -> f64 {
        let faces = geometry.faces.iter().map(|face| {
            let [a, b, c] =
                face.map(|k| glam::Vec3::from(geometry.positions[k as usize]).as_dvec3());
            a.dot(b.cross(c))
        });
        faces.sum()
    }

    #[test]
    fn spheres_and_cubes_are_closed_and_turn_their_front_outside() {
        for faces in [12, 48, 1280, 20_000] {
            for (shape, volume_of) in
                [(sphere(faces), 8.0 * std::f64::consts::PI), (cube(faces), 48.0)]
            {
                let found = shape.faces.len();
                assert!(found.abs_diff(faces) * 5 <= faces, "{found} of {faces}");
                let edges = shape.faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
                let edges: std::collections::HashSet<_> = edges.collect();
                assert_eq!(edges.len(), 3 * found, "an edge has one face on each side");
                assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
                assert_eq!(shape.positions.len(), found / 2 + 2, "Euler");
                let found = volume(&shape);
                assert!(found > 0.0 && found <= 1.000_001 * volume_of, "{found} of {volume_of}");
                assert!(faces < 1000 || found > 0.98 * volume_of, "{found} of {volume_of}");
            }
        }
    }

    #[test]
    fn textures_are_seen_as_they_are_from_the_front() {
        for shape in [sphere(300), cube(12), plane(8)] {
            let coordinates = shape.coordinates.unwrap();
            for (face, corners) in shape.faces.iter().zip(&coordinates.faces) {
                let [a, b, c] = face.map(|k| glam::Vec3::from(shape.positions[k as usize]));
                let [p, q, r] = corners.map(|k| glam::Vec2::from(coordinates.rows[k as usize]));
                assert!((b - a).cross(c - a).length() > 0.0);
                // Counter-clockwise in space, and with v down clockwise in numbers.
                assert!((q - p).perp_dot(r - p) < 0.0);
            }
        }
    }

    #[test]
    fn a_plane_is_seen_from_above() {
        let plane = plane(2);
        assert_eq!(plane.faces.len(), 2);
        assert_eq!(plane.positions[0], [-1.0, 1.0, 0.0]);
        assert_eq!(plane.coordinates.as_ref().unwrap().rows[0], [0.0, 0.0]);
        let [a, b, c] = plane.faces[0].map(|k| glam::Vec3::from(plane.positions[k as usize]));
        assert!((b - a).cross(c - a).z > 0.0);
    }
}
