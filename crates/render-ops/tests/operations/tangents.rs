use crate::fixtures::{bent_sheet, number};
use approx::assert_relative_eq;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, tangents};
use glam::DVec3;

/// A textured mesh.
#[derive(Debug, Clone)]
struct Surface {
    positions: Vec<f64>,
    normals: Vec<f64>,
    coordinates: Vec<f64>,
    faces: Vec<[u32; 3]>,
    named: Vec<[u32; 3]>,
}

impl Surface {
    /// A bent sheet of `columns` by `rows` quads with crooked coordinates and normals of any length.
    fn sheet(columns: usize, rows: usize) -> Self {
        let (positions, faces) = bent_sheet(columns, rows);
        let vertices = positions.len() / 3;
        let normals = (0..vertices)
            .flat_map(|k| [0.3 * number(5 * k), 0.3 * number(7 * k + 1), 1.0 + 0.5 * number(k)]);
        // Rows of the texture run downwards.
        let coordinates = (0..vertices).flat_map(|k| {
            let [x, y] = [positions[3 * k], positions[3 * k + 1]];
            [0.8 * x + 0.3 * y + 0.05 * number(3 * k), 0.2 * x - 0.9 * y + 0.05 * number(k + 9)]
        });
        let (normals, coordinates) = (normals.collect(), coordinates.collect());
        Self { positions, normals, coordinates, named: faces.clone(), faces }
    }

    /// A square before the viewer, with u to the right and v downwards.
    fn square() -> Self {
        Self {
            positions: vec![0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.],
            normals: [0.0, 0.0, 1.0].repeat(4),
            coordinates: vec![0., 1., 1., 1., 1., 0., 0., 0.],
            faces: vec![[0, 1, 2], [0, 2, 3]],
            named: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    /// Tangents, and the gradients of positions, normals and coordinates for motley upstream.
    fn run<T: Scalar>(&self) -> [Vec<f64>; 4] {
        let tape = Tape::<T>::new();
        let mesh = Mesh::new(self.faces.clone(), self.positions.len() / 3).unwrap();
        let indices = Mesh::new(self.named.clone(), self.coordinates.len() / 2).unwrap();
        let leaf = |of: &[f64], width: usize| {
            tape.leaf(&Tensor::from_flat_fn([of.len() / width, width], |k| T::from_f64(of[k])))
        };
        let leaves = [leaf(&self.positions, 3), leaf(&self.normals, 3), leaf(&self.coordinates, 2)];
        let out = tangents(leaves[0], leaves[1], leaves[2], &indices, &mesh).unwrap();
        let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(number(k)));
        let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
        let [p, n, c] = leaves.map(|leaf| gradients.get_or_zeros(leaf));
        [out.value(), p, n, c].map(|all| all.data().iter().map(|x| x.to_f64()).collect())
    }

    fn numbers(&mut self, input: usize) -> &mut Vec<f64> {
        match input {
            0 => &mut self.positions,
            1 => &mut self.normals,
            _ => &mut self.coordinates,
        }
    }
}

fn rows(tangents: &[f64]) -> impl Iterator<Item = (DVec3, f64)> {
    tangents.chunks(4).map(|row| (DVec3::from_slice(row), row[3]))
}

#[test]
fn u_grows_along_the_tangent_and_v_falls_along_the_bitangent() {
    let [tangents, ..] = Surface::square().run::<f64>();
    assert_eq!(tangents, [1.0, 0.0, 0.0, 1.0].repeat(4));
    // Mirrored: u grows to the left. Turned over: v grows upwards.
    let mut mirrored = Surface::square();
    mirrored.coordinates = vec![1., 1., 0., 1., 0., 0., 1., 0.];
    assert_eq!(mirrored.run::<f64>()[0], [-1.0, 0.0, 0.0, -1.0].repeat(4));
    let mut turned = Surface::square();
    turned.coordinates = vec![0., 0., 1., 0., 1., 1., 0., 1.];
    assert_eq!(turned.run::<f64>()[0], [1.0, 0.0, 0.0, -1.0].repeat(4));
    for surface in [Surface::square(), mirrored, turned] {
        // v = v_0 + g . p over the square, whose corners give g.
        let v = |vertex: usize| surface.coordinates[2 * vertex + 1];
        let slope = DVec3::new(v(1) - v(0), v(3) - v(0), 0.0);
        for (tangent, sign) in rows(&surface.run::<f64>()[0]) {
            assert!((sign * DVec3::Z.cross(tangent)).dot(slope) < 0.0);
        }
    }
}

#[test]
fn tangents_are_sums_of_slopes_weighted_by_angles() {
    let surface = Surface::sheet(9, 6);
    let Surface { positions, normals, coordinates, faces, .. } = &surface;
    for (vertex, (tangent, sign)) in rows(&surface.run::<f64>()[0]).enumerate() {
        let normal = DVec3::from_slice(&normals[3 * vertex..]).normalize();
        let mut sum = DVec3::ZERO;
        for face in faces {
            let Some(k) = face.iter().position(|&other| other as usize == vertex) else { continue };
            let at = [0, 1, 2].map(|step| face[(k + step) % 3] as usize);
            let [p, q, r] = at.map(|vertex| DVec3::from_slice(&positions[3 * vertex..]));
            let [a, b, c] = at.map(|vertex| [coordinates[2 * vertex], coordinates[2 * vertex + 1]]);
            let ([du, dv], [eu, ev]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
            let slope = ((q - p) * ev - (r - p) * dv) / (du * ev - dv * eu);
            let angle = (q - p).reject_from(normal).angle_between((r - p).reject_from(normal));
            sum += angle * slope.reject_from(normal).normalize();
        }
        assert!((tangent - sum.normalize()).length() < 1e-13);
        assert_relative_eq!(tangent.dot(normal), 0.0, epsilon = 1e-15);
        assert_eq!(sign, 1.0);
    }
}

#[test]
fn factors_that_are_powers_of_two_and_what_is_added_to_u_change_no_bit() {
    let surface = Surface::sheet(4, 3);
    let [tangents, bars @ ..] = surface.run::<f64>();
    for powers in [[900, -400, 700], [-900, 600, -900], [1, 0, 3]] {
        let mut there = surface.clone();
        let scales = powers.map(|power| f64::powi(2.0, power));
        for (input, scale) in scales.into_iter().enumerate() {
            there.numbers(input).iter_mut().for_each(|x| *x *= scale);
        }
        let [found, there_bars @ ..] = there.run::<f64>();
        assert_eq!(found, tangents);
        for ((bars, there_bars), scale) in bars.iter().zip(there_bars).zip(scales) {
            let there_bars: Vec<f64> = there_bars.iter().map(|bar| scale * bar).collect();
            assert_eq!(&there_bars, bars);
        }
    }
    // The direction of u is the one in which v stays.
    let mut sheared = surface.clone();
    sheared.coordinates.chunks_mut(2).for_each(|row| row[0] += 0.7 * row[1] - 3.0);
    assert_eq!(sheared.run::<f64>()[0], tangents);
    assert!(bars[2].chunks(2).all(|bar| bar[0] == 0.0));
    assert!(bars[2].chunks(2).any(|bar| bar[1] != 0.0));
}

/// Compares all gradients with difference quotients.
fn assert_gradients(surface: &Surface) {
    let [_, bars @ ..] = surface.run::<f64>();
    let value = |surface: &Surface| -> f64 {
        let [tangents, ..] = surface.run::<f64>();
        tangents.iter().enumerate().map(|(k, entry)| number(k) * entry).sum()
    };
    for (input, bars) in bars.iter().enumerate() {
        for (k, bar) in bars.iter().enumerate() {
            let moved = |h: f64| {
                let mut surface = surface.clone();
                surface.numbers(input)[k] += h;
                value(&surface)
            };
            let quotient = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert_relative_eq!(*bar, quotient, max_relative = 1e-6, epsilon = 1e-7);
        }
    }
}

#[test]
fn a_seam_has_a_tangent_on_either_side() {
    // The right half of a strip starts the texture anew, turned by a quarter: coordinates of its own at
    // the two vertices in the middle.
    let surface = Surface {
        positions: vec![0., 0., 0., 1., 0., 0., 2., 0., 0., 0., 1., 0., 1., 1., 0., 2., 1., 0.],
        normals: [0.0, 0.0, 2.0].repeat(6),
        coordinates: vec![0., 1., 1., 1., 0., 0., 1., 0., 0., 0., 0., 1., 1., 0., 1., 1.],
        faces: vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
        named: vec![[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6]],
    };
    let [tangents, normal_bars, ..] = surface.run::<f64>();
    let (left, right) = tangents.split_at(16);
    assert_eq!(left, [1.0, 0.0, 0.0, 1.0].repeat(4));
    // u grows upwards there, and v to the right.
    assert_eq!(right, [0.0, 1.0, 0.0, 1.0].repeat(4));
    assert!(normal_bars.iter().all(|bar| bar.is_finite()));
}

#[test]
fn where_no_direction_is_there_is_no_tangent_and_no_gradient() {
    let nothing = [[0.0, 0.0, 0.0, 1.0].repeat(4), vec![0.0; 12], vec![0.0; 12], vec![0.0; 8]];
    let mut all_in_one = Surface::square();
    all_in_one.coordinates = vec![0.3; 8];
    let mut on_a_line = Surface::square();
    on_a_line.coordinates = vec![0.1, 0.3, 0.2, 0.6, 0.3, 0.9, 0.4, 1.2];
    let mut without_area = Surface::square();
    without_area.positions = vec![0., 0., 0., 1., 2., 3., 2., 4., 6., 3., 6., 9.];
    let mut without_normals = Surface::square();
    without_normals.normals.fill(0.0);
    let mut along_the_normal = Surface::square();
    along_the_normal.normals = [1.0, 0.0, 0.0].repeat(4);
    let mut without_faces = Surface::square();
    (without_faces.faces, without_faces.named) = (Vec::new(), Vec::new());
    let all =
        [all_in_one, on_a_line, without_area, without_normals, along_the_normal, without_faces];
    for surface in all {
        assert_eq!(surface.run::<f64>(), nothing, "{surface:?}");
    }
}

#[test]
fn directions_that_cancel_around_a_pole_are_no_tangent() {
    // Seven faces around vertex 0, all with v at the pole, and u around it: sums of sines.
    let (mut surface, ring) = (Surface::square(), 7);
    (surface.positions, surface.coordinates) = (vec![0.0, 0.0, 0.0], vec![0.5, 0.0]);
    let (mut faces, mut named) = (Vec::new(), Vec::new());
    for k in 0..ring {
        let (sin, cos) = (f64::from(k) / f64::from(ring) * std::f64::consts::TAU).sin_cos();
        surface.positions.extend([cos, sin, 0.0]);
        surface.coordinates.extend([0.0, 1.0, 1.0, 1.0]);
        faces.push([0, 1 + k, 1 + (k + 1) % ring]);
        named.push([0, 1 + 2 * k, 2 + 2 * k]);
    }
    surface.normals = [0.0, 0.0, 1.0].repeat(8);
    (surface.faces, surface.named) = (faces, named);
    let [tangents, bars @ ..] = surface.run::<f64>();
    assert_eq!(tangents[..4], [0.0, 0.0, 0.0, 1.0]);
    assert!(rows(&tangents).skip(1).all(|(tangent, _)| (tangent.length() - 1.0).abs() < 1e-15));
    assert!(bars.iter().flatten().all(|bar| bar.is_finite()));
}

#[test]
fn the_side_with_the_larger_angle_prevails_where_a_mirrored_texture_shares_coordinates() {
    // u grows towards the middle from both sides; the left side fills a quarter turn at vertices 1 and
    // 4, the right side half of that, as its faces are cut.
    let surface = Surface {
        positions: vec![0., 0., 0., 1., 0., 0., 2., 1., 0., 0., 1., 0., 1., 1., 0.],
        normals: [0.0, 0.0, 1.0].repeat(5),
        coordinates: vec![0., 1., 1., 1., 0., 0., 0., 0., 1., 0.],
        faces: vec![[0, 1, 4], [0, 4, 3], [1, 2, 4]],
        named: vec![[0, 1, 4], [0, 4, 3], [1, 2, 4]],
    };
    let [tangents, ..] = surface.run::<f64>();
    let found: Vec<_> = rows(&tangents).collect();
    assert_eq!(found[1], (DVec3::X, 1.0));
    assert_eq!(found[0], (DVec3::X, 1.0));
    assert_eq!(found[2].1, -1.0);
    // The other side has no part in the gradient, either.
    let mut crooked = surface;
    crooked.positions.iter_mut().enumerate().for_each(|(k, x)| *x += 0.2 * number(k));
    crooked.normals.iter_mut().enumerate().for_each(|(k, x)| *x += 0.2 * number(3 * k));
    assert_gradients(&crooked);
}

#[test]
fn an_edge_along_the_normal_makes_no_angle() {
    // Two faces meet at a right angle. At vertex 1 the normal lies in the first, along an edge of it.
    let surface = Surface {
        positions: vec![0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 0., 1.],
        normals: [0.0, 1.0, 0.0].repeat(4),
        coordinates: vec![0., 1., 1., 1., 1., 0., 0.5, 2.],
        faces: vec![[0, 1, 2], [1, 0, 3]],
        named: vec![[0, 1, 2], [1, 0, 3]],
    };
    let [tangents, bars @ ..] = surface.run::<f64>();
    let found: Vec<_> = rows(&tangents).collect();
    // Only the second face counts; u grows along x there, as v does not.
    assert!((found[1].0 - DVec3::X).length() < 1e-15 && found[2] == (DVec3::ZERO, 1.0));
    assert!(bars.iter().flatten().all(|bar| bar.is_finite()));
}
