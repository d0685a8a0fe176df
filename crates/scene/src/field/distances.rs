//! Where a field starts: the distances of the points of a grid from a closed mesh, below 0 inside.
//!
//! A point is inside where the surface winds around it: of the faces that the ray upwards from it crosses, those that
//! face up count 1, and those that face down -1. The ray stands beside the point by a ten-thousandth of a cell, so that
//! it meets no edge of a mesh that is as regular as the grid. Which side of an edge it passes is asked once for both of
//! its faces: so a closed mesh has no gap.

use bokashi_core::Tensor;
use bokashi_core::parallel::write_each;
use bokashi_mesh::{Grid, MeshError, nearest_on_surface};
use bokashi_render_ops::Mesh;

/// How far beside its points a column of the grid is, in cells.
const BESIDE: [f64; 2] = [0.73e-4, 1.31e-4];
/// Columns in one piece of work.
const PER_PIECE: usize = 1 << 6;

/// The distances in cells, `[nx, ny, nz]`, cut off at `farthest`.
pub(super) fn signed_distances(
    grid: &Grid,
    positions: &Tensor<f32>,
    mesh: &Mesh,
    farthest: usize,
) -> Result<Tensor<f32>, MeshError> {
    let inside = are_inside(grid, positions, mesh);
    let near = points_near(grid, &inside, farthest);
    let (_, distances) = nearest_on_surface(&places(grid, &near), positions, mesh)?;
    let sign = |point: usize| if inside[point] { -1.0 } else { 1.0 };
    let mut values: Vec<f32> =
        (0..grid.point_count()).map(|point| sign(point) * farthest as f32).collect();
    for (&point, distance) in near.iter().zip(distances) {
        let distance = (distance / grid.spacing()).min(farthest as f64);
        values[point as usize] = sign(point as usize) * distance as f32;
    }
    Ok(Tensor::new(grid.shape(), values)?)
}

/// Colours at the points, `[P, 3]`: where `values` are near 0 those of the surface, elsewhere the mean of all.
pub(super) fn colors_near(
    grid: &Grid,
    values: &Tensor<f32>,
    positions: &Tensor<f32>,
    mesh: &Mesh,
    colors: &Tensor<f32>,
) -> Result<Tensor<f32>, MeshError> {
    let farthest = values.data().iter().fold(0.0, |most: f32, value| most.max(value.abs()));
    let all = (0..).zip(values.data()).filter(|(_, value)| value.abs() < farthest);
    let near: Vec<u32> = all.map(|(point, _)| point).collect();
    let count = colors.shape()[0].max(1) as f64;
    let mean = [0, 1, 2].map(|axis| {
        let sum: f64 = colors.data().iter().skip(axis).step_by(3).map(|&x| f64::from(x)).sum();
        (sum / count) as f32
    });
    let (nearest, _) = nearest_on_surface(&places(grid, &near), positions, mesh)?;
    let at = nearest.interpolated(colors)?;
    let mut rows = vec![mean; grid.point_count()];
    for (&point, color) in near.iter().zip(at.data().as_chunks::<3>().0) {
        rows[point as usize] = *color;
    }
    Ok(Tensor::from(&rows[..]))
}

/// Where some points stand, `[n, 3]`.
fn places(grid: &Grid, points: &[u32]) -> Tensor<f32> {
    let rows: Vec<_> =
        points.iter().map(|&point| grid.position(point as usize).map(|x| x as f32)).collect();
    Tensor::from(&rows[..])
}

/// The points that lie at most so many cells along the axes from one whose neighbour is on the other side.
fn points_near(grid: &Grid, inside: &[bool], farthest: usize) -> Vec<u32> {
    let [nx, ny, nz] = grid.shape();
    let strides = [(nx, ny * nz), (ny, nz), (nz, 1)];
    let mut near = vec![false; inside.len()];
    for (extent, stride) in strides {
        for point in (0..inside.len()).filter(|point| point / stride % extent + 1 < extent) {
            if inside[point] != inside[point + stride] {
                (near[point], near[point + stride]) = (true, true);
            }
        }
    }
    for (extent, stride) in strides {
        let before = near.clone();
        write_each(&mut near, 1 << 12, |point| {
            let place = point / stride % extent;
            let range = place.saturating_sub(farthest)..=(place + farthest).min(extent - 1);
            range.into_iter().any(|other| before[point + other * stride - place * stride])
        });
    }
    (0..).zip(&near).filter(|(_, near)| **near).map(|(point, _)| point).collect()
}

/// Which points are inside.
fn are_inside(grid: &Grid, positions: &Tensor<f32>, mesh: &Mesh) -> Vec<bool> {
    let [nx, ny, nz] = grid.shape();
    let vertices: Vec<[f64; 3]> =
        positions.data().as_chunks::<3>().0.iter().map(|row| row.map(f64::from)).collect();
    let column = |i: usize, j: usize| {
        let [x, y, _] = grid.position((i * ny + j) * nz);
        [x + BESIDE[0] * grid.spacing(), y + BESIDE[1] * grid.spacing()]
    };
    let mut crossings = vec![Vec::new(); nx * ny];
    for face in mesh.faces() {
        let corners = face.map(|vertex| vertices[vertex as usize]);
        let range = |axis: usize, extent: usize| {
            let place = |x: f64| (x - grid.origin()[axis]) / grid.spacing();
            let least =
                corners.iter().map(|corner| place(corner[axis])).fold(f64::INFINITY, f64::min);
            let most = corners.iter().map(|corner| place(corner[axis])).fold(0.0, f64::max);
            (least - 1.0).max(0.0) as usize..extent.min(most as usize + 2)
        };
        for i in range(0, nx) {
            for j in range(1, ny) {
                if let Some(crossing) = crossing(*face, &vertices, column(i, j)) {
                    crossings[i * ny + j].push(crossing);
                }
            }
        }
    }
    let mut columns = vec![Vec::new(); nx * ny];
    write_each(&mut columns, PER_PIECE, |at| {
        let above = |z: f64| {
            let all = crossings[at].iter().filter(|(height, _)| *height > z);
            all.map(|(_, up)| up).sum::<i32>()
        };
        (0..nz).map(|k| above(grid.position(at * nz + k)[2]) != 0).collect()
    });
    columns.concat()
}

/// How high the vertical line through a place meets a face, and 1 where that faces up, else -1.
fn crossing(face: [u32; 3], vertices: &[[f64; 3]], [x, y]: [f64; 2]) -> Option<(f64, i32)> {
    // Twice the area of the triangle of an edge and the place, the same for both faces of the edge but for its sign.
    let area = |a: u32, b: u32| {
        let ([p, q], sign) = if a < b { ([a, b], 1.0) } else { ([b, a], -1.0) };
        let [p, q] = [p, q].map(|vertex| vertices[vertex as usize]);
        let area = (p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x);
        (sign * area, (area >= 0.0) == (sign > 0.0))
    };
    let [a, b, c] = face;
    let [(of_c, first), (of_a, second), (of_b, third)] = [area(a, b), area(b, c), area(c, a)];
    if first != second || second != third {
        return None;
    }
    let [za, zb, zc] = face.map(|vertex| vertices[vertex as usize][2]);
    let sum = of_a + of_b + of_c;
    let height = if sum == 0.0 { za } else { (of_a * za + of_b * zb + of_c * zc) / sum };
    Some((height, if first { 1 } else { -1 }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bokashi_mesh::extract_surface;

    /// The cube from -1 to 1, whose faces lie in planes of a grid and whose diagonals meet its columns.
    fn cube() -> (Tensor<f32>, Mesh) {
        let positions = Tensor::from_fn(
            [8, 3],
            |[corner, axis]| {
                if corner >> axis & 1 == 1 { 1.0 } else { -1.0 }
            },
        );
        let sides =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        (positions, Mesh::new(faces, 8).unwrap())
    }

    #[test]
    fn points_of_a_mesh_as_regular_as_the_grid_lie_on_their_sides() {
        let grid = Grid::new([9, 9, 9], [-2.0; 3], 0.5).unwrap();
        let (positions, mesh) = cube();
        let turned = mesh.faces().iter().map(|&[a, b, c]| [a, c, b]).collect();
        for mesh in [mesh, Mesh::new(turned, 8).unwrap()] {
            let found = signed_distances(&grid, &positions, &mesh, 3).unwrap();
            for point in 0..grid.point_count() {
                let place = grid.position(point).map(f64::abs);
                let beyond = place.map(|x| (x - 1.0).max(0.0));
                let outside = beyond.iter().map(|x| x * x).sum::<f64>().sqrt();
                let inside = place.iter().fold(0.0, |most: f64, x| most.max(*x)) - 1.0;
                let expected = (if outside > 0.0 { outside } else { inside }) / 0.5;
                let found = f64::from(found.data()[point]);
                // A point on the surface is on either side of it.
                let off =
                    if expected == 0.0 { found.abs() } else { found - expected.clamp(-3.0, 3.0) };
                assert!(off.abs() < 1e-6, "{found} for {expected} at {place:?}");
            }
        }
    }

    #[test]
    fn a_ring_has_a_hole_and_what_is_twice_inside_is_inside() {
        let grid = Grid::around([-1.2; 3], [1.2; 3], 20).unwrap();
        let ring = |[x, y, z]: [f64; 3]| (x.hypot(z) - 0.7).hypot(y) - 0.3;
        let (positions, mesh) = extract_surface(&grid.sampled::<f32>(ring), None, &grid).unwrap();
        let found = signed_distances(&grid, &positions, &mesh, 3).unwrap();
        for (point, value) in found.data().iter().enumerate() {
            let expected = ring(grid.position(point)) / grid.spacing();
            let near = expected.clamp(-3.0, 3.0);
            assert!((f64::from(*value) - near).abs() < 0.2, "{value} for {expected}");
            assert!(expected.abs() < 0.05 || (*value < 0.0) == (expected < 0.0));
        }
        // Two of it, one upon the other.
        let count = mesh.vertex_count() as u32;
        let twice = |face: &[u32; 3]| [*face, face.map(|vertex| vertex + count)];
        let faces = mesh.faces().iter().flat_map(twice).collect();
        let rows = positions.data().repeat(2);
        let positions = Tensor::new([2 * count as usize, 3], rows).unwrap();
        let both = Mesh::new(faces, 2 * count as usize).unwrap();
        let again = signed_distances(&grid, &positions, &both, 3).unwrap();
        assert_eq!(again.data(), found.data());
    }

    #[test]
    fn points_near_a_surface_have_its_colors() {
        let grid = Grid::new([9, 9, 9], [-2.0; 3], 0.5).unwrap();
        let (positions, mesh) = cube();
        let values = signed_distances(&grid, &positions, &mesh, 2).unwrap();
        let colors = positions.map(|x| 0.5 + 0.25 * x);
        let found = colors_near(&grid, &values, &positions, &mesh, &colors).unwrap();
        for point in 0..grid.point_count() {
            let place = grid.position(point);
            let row = &found.data()[3 * point..][..3];
            let outermost = place.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let expected = match outermost {
                // Where the nearest point is plain.
                1.0..=1.5 => place.map(|x| 0.5 + 0.25 * x.clamp(-1.0, 1.0)),
                0.0 | 2.0 => [0.5; 3],
                _ => continue,
            };
            let off = (0..3).map(|k| (f64::from(row[k]) - expected[k]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "{row:?} for {expected:?} at {place:?}");
        }
    }
}
