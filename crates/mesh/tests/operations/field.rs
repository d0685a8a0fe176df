//! Surfaces of fields.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

use bokashi_core::parallel::with_threads;
use bokashi_core::{Tape, Tensor};
use bokashi_mesh::{Grid, MeshError, extract_surface, field_surface};
use bokashi_render_ops::glam::DMat4;
use bokashi_render_ops::{Background, Mesh, RasterOptions, Silhouettes, Size, project, render};
use proptest::prelude::*;

/// The points of a surface.
fn points(positions: &Tensor<f64>) -> &[[f64; 3]] {
    positions.data().as_chunks::<3>().0
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let entry = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    [entry(1, 2), entry(2, 0), entry(0, 1)]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

/// Positive where fronts are outside.
fn volume(positions: &Tensor<f64>, mesh: &Mesh) -> f64 {
    let at = points(positions);
    let of = |[a, b, c]: [u32; 3]| dot(at[a as usize], cross(at[b as usize], at[c as usize])) / 6.0;
    mesh.faces().iter().map(|&face| of(face)).sum()
}

/// How often each edge is passed in each direction.
fn passed(mesh: &Mesh) -> BTreeMap<[u32; 2], [usize; 2]> {
    let mut passed = BTreeMap::<_, [usize; 2]>::new();
    for face in mesh.faces() {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            assert_ne!(a, b, "a face names a vertex twice");
            passed.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
        }
    }
    passed
}

/// Panics unless each edge has two faces that pass it in two directions, and the faces around each vertex are one fan;
/// returns the Euler characteristic.
fn assert_closed_manifold(mesh: &Mesh) -> i64 {
    let edges = passed(mesh);
    assert!(edges.values().all(|passed| *passed == [1, 1]), "an edge is open or crowded");
    let mut around = vec![BTreeMap::new(); mesh.vertex_count()];
    for face in mesh.faces() {
        for k in 0..3 {
            around[face[k] as usize].insert(face[(k + 1) % 3], face[(k + 2) % 3]);
        }
    }
    for next in &around {
        let first = *next.keys().next().expect("a vertex has faces");
        let mut at = next[&first];
        let mut count = 1;
        while at != first {
            (at, count) = (next[&at], count + 1);
        }
        assert_eq!(count, next.len(), "two fans meet at a vertex");
    }
    mesh.vertex_count() as i64 - edges.len() as i64 + mesh.faces().len() as i64
}

fn sphere([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt() - 0.8
}

fn torus([x, y, z]: [f64; 3]) -> f64 {
    let around = (x * x + y * y).sqrt() - 0.7;
    (around * around + z * z).sqrt() - 0.3
}

/// 1 apart from 0 by (0.1, 0.2, 0.3), so that no vertex is hit.
fn grid(cells: usize) -> Grid {
    let spacing = 2.4 / cells as f64;
    let shift = |share: f64| -1.2 + share * spacing;
    Grid::new([cells + 1; 3], [shift(0.1), shift(0.2), shift(0.3)], spacing).unwrap()
}

#[test]
fn a_sphere_and_a_torus_have_their_volume_and_their_topology() {
    type Field = fn([f64; 3]) -> f64;
    let (ball, ring) = (4.0 / 3.0 * PI * 0.8_f64.powi(3), 2.0 * PI * PI * 0.7 * 0.3 * 0.3);
    for (field, exact, characteristic) in [(sphere as Field, ball, 2), (torus, ring, 0)] {
        let mut last = f64::INFINITY;
        for cells in [16, 32, 64] {
            let grid = grid(cells);
            let (positions, mesh) = extract_surface(&grid.sampled(field), None, &grid).unwrap();
            assert_eq!(assert_closed_manifold(&mesh), characteristic);
            // The error falls with the square of the spacing.
            let error = (volume(&positions, &mesh) / exact - 1.0).abs();
            assert!(error < 0.4 * last && error < 20.0 / (cells * cells) as f64, "{error}");
            let off = points(&positions).iter().map(|&p| field(p).abs()).fold(0.0, f64::max);
            assert!(off < 0.5 * grid.spacing().powi(2) / 0.3, "a vertex is {off} off");
            last = error;
        }
    }
}

#[test]
fn the_front_of_every_face_is_outside() {
    let grid = grid(20);
    let (positions, mesh) = extract_surface(&grid.sampled(sphere), None, &grid).unwrap();
    let at = points(&positions);
    for face in mesh.faces() {
        let [a, b, c] = face.map(|vertex| at[vertex as usize]);
        assert!(dot(cross(minus(b, a), minus(c, a)), a) > 0.0);
    }
}

/// Whether a face has two corners at one place.
fn is_flat(positions: &Tensor<f64>, face: [u32; 3]) -> bool {
    let [a, b, c] = face.map(|vertex| points(positions)[vertex as usize]);
    a == b || b == c || c == a
}

#[test]
fn fields_that_are_exactly_0_at_points_have_no_flat_faces() {
    let grid = Grid::new([9; 3], [-4.0; 3], 1.0).unwrap();
    let distance = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt() - 3.0;
    let diamond = |[x, y, z]: [f64; 3]| x.abs() + y.abs() + z.abs() - 3.0;
    let cube = |[x, y, z]: [f64; 3]| x.abs().max(y.abs()).max(z.abs()) - 2.0;
    // The second has all of its vertices at points of the grid.
    type Field<'a> = &'a dyn Fn([f64; 3]) -> f64;
    let fields: [(Field<'_>, f64); 4] = [
        (&distance, 4.0 / 3.0 * PI * 27.0),
        (&|p| distance(p).min(0.0), f64::NAN),
        (&diamond, 36.0),
        // Every second edge is cut off between points of the grid, since cells have one diagonal.
        (&cube, 54.0),
    ];
    for (field, exact) in fields {
        let (positions, mesh) = extract_surface(&grid.sampled(field), None, &grid).unwrap();
        assert_eq!(assert_closed_manifold(&mesh), 2);
        assert!(!mesh.faces().iter().any(|&face| is_flat(&positions, face)));
        let volume = volume(&positions, &mesh);
        assert!(exact.is_nan() || (volume / exact - 1.0).abs() < 0.06, "{volume}");
    }
    // A point alone outside, with the number 0, is no bubble.
    let inside = |p: [f64; 3]| if p == [0.0; 3] { 0.0 } else { distance(p) };
    let (positions, mesh) = extract_surface(&grid.sampled(inside), None, &grid).unwrap();
    assert_eq!(assert_closed_manifold(&mesh), 2);
    assert!(!mesh.faces().iter().any(|&face| is_flat(&positions, face)));
}

#[test]
fn two_shapes_that_meet_in_a_plane_stay_two() {
    let grid = Grid::new([7, 5, 5], [-3.0, -2.0, -2.0], 1.0).unwrap();
    let field = grid.sampled(|[x, y, z]| {
        let wall = y.abs().max(z.abs()) - 1.5;
        (-x.abs()).max(wall).max(x.abs() - 2.5)
    });
    let (positions, mesh) = extract_surface(&field, None, &grid).unwrap();
    assert_eq!(assert_closed_manifold(&mesh), 4);
    assert!(!mesh.faces().iter().any(|&face| is_flat(&positions, face)));
    let at = points(&positions);
    assert!(mesh.faces().iter().all(|face| {
        let sides = face.map(|vertex| at[vertex as usize][0]);
        sides.iter().all(|&x| x >= 0.0) || sides.iter().all(|&x| x <= 0.0)
    }));
}

#[test]
fn a_plane_that_leaves_the_grid_is_open_and_exact() {
    let grid = Grid::new([3, 4, 70], [0.0; 3], 0.5).unwrap();
    let normal = [0.3, -0.5, 0.81];
    let field = grid.sampled(|p| dot(normal, p) - 9.13);
    let (positions, mesh) = extract_surface(&field, None, &grid).unwrap();
    assert!(mesh.adjacency().boundary_edges() > 0);
    // Border vertices lie exactly in the planes of the border.
    let last = grid.position(grid.point_count() - 1);
    let is_at_border = |p: &&[f64; 3]| (0..3).any(|axis| p[axis] == 0.0 || p[axis] == last[axis]);
    let open = passed(&mesh).into_iter().filter(|(_, passed)| *passed != [1, 1]);
    let ends: BTreeSet<_> = open.flat_map(|(edge, _)| edge).collect();
    assert!(ends.iter().all(|&end| is_at_border(&&points(&positions)[end as usize])));
    assert!(points(&positions).iter().all(|&p| (dot(normal, p) - 9.13).abs() < 1e-12));
}

/// What a picture shows of a sphere grows with it.
#[test]
fn a_picture_of_a_field_has_its_gradient() {
    let grid = grid(12);
    let tape = Tape::new();
    let field = tape.leaf(&grid.sampled(|[x, y, z]| sphere([1.3 * x, 1.3 * y, 1.3 * z])));
    let surface = field_surface(field, None, &grid).unwrap();
    let clip = project(surface.positions, &DMat4::IDENTITY, None).unwrap();
    let white = tape.constant_full([surface.mesh.vertex_count(), 1], 1.0);
    let options = RasterOptions::new(Size::square(32)).silhouettes(Silhouettes::Exact);
    let picture = render(clip, &surface.mesh, white, options, Background::Zero).unwrap();
    let area = picture.image().unwrap().sum();
    let covered = area.item() / 1024.0 * 4.0;
    let disc = PI * (0.8_f64 / 1.3).powi(2);
    assert!((covered / disc - 1.0).abs() < 0.03, "{covered} {disc}");
    // To add a number to the field everywhere is to shrink the sphere: by 1 / 1.3 of it.
    let slope: f64 = area.backward().unwrap().get(field).unwrap().data().iter().sum();
    let expected = -2.0 * PI * 0.8 / 1.3 / 1.3 * 1024.0 / 4.0;
    assert!((slope / expected - 1.0).abs() < 0.05, "{slope} {expected}");
}

#[test]
fn a_field_without_a_change_of_sign_has_an_empty_surface() {
    let grid = Grid::new([2, 3, 4], [0.0; 3], 1.0).unwrap();
    for value in [1.0, -1.0, 0.0, -0.0] {
        let field = Tensor::full([24], value);
        let (positions, mesh) = extract_surface::<f32>(&field, None, &grid).unwrap();
        assert_eq!((&positions.shape()[..], mesh.faces().len()), (&[0, 3][..], 0));
        let tape = Tape::new();
        let leaf = tape.leaf(&field);
        let surface = field_surface(leaf, None, &grid).unwrap();
        let gradients = surface.positions.sum().backward().unwrap();
        assert!(gradients.get_or_zeros(leaf).data().iter().all(|&x| x == 0.0));
    }
}

#[test]
fn what_is_no_number_is_refused_by_its_place() {
    let grid = Grid::new([3, 4, 5], [0.0; 3], 1.0).unwrap();
    for (index, point) in [(0, [0, 0, 0]), (59, [2, 3, 4]), (37, [1, 3, 2])] {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let field = Tensor::from_flat_fn([60], |k| if k == index { bad } else { 1.0 });
            let refused = extract_surface(&field, None, &grid).unwrap_err();
            let MeshError::FieldValue { point: found, .. } = refused else { panic!("{refused}") };
            assert_eq!(found, point);
            let offsets =
                Tensor::from_flat_fn([60, 3], |k| if k == 3 * index + 1 { bad } else { 0.1 });
            let field = Tensor::full([3, 4, 5], 1.0);
            let refused = extract_surface(&field, Some(&offsets), &grid).unwrap_err();
            let MeshError::PointPosition { point: found, .. } = refused else {
                panic!("{refused}")
            };
            assert_eq!(found, point);
        }
    }
}

#[test]
fn grids_without_cells_or_numbers_are_refused() {
    for shape in [[1, 2, 2], [2, 0, 2], [2, 2, usize::MAX], [1 << 11, 1 << 10, 1 << 10]] {
        let refused = Grid::new(shape, [0.0; 3], 1.0).unwrap_err();
        assert_eq!(refused, MeshError::GridShape { shape });
    }
    for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::MAX] {
        assert!(matches!(Grid::new([3; 3], [0.0; 3], spacing), Err(MeshError::GridPlace { .. })));
    }
    assert!(Grid::new([2; 3], [0.0, f64::NAN, 0.0], 1.0).is_err());
    // In f64 its points have a place, in f32 they have none.
    let far = Grid::new([2; 3], [1e200, 0.0, 0.0], 1.0).unwrap();
    let field = |k: usize| if k == 3 { -1.0 } else { 1.0 };
    let refused = extract_surface(&Tensor::from_flat_fn([8], field), None, &far);
    assert!(refused.is_ok_and(|(positions, _): (Tensor<f64>, _)| positions.is_finite()));
    let refused =
        extract_surface::<f32>(&Tensor::from_flat_fn([8], |k| field(k) as f32), None, &far);
    assert!(matches!(refused, Err(MeshError::PointPosition { .. })));
}

#[test]
fn a_grid_around_a_box_has_the_box_within_its_second_layer() {
    let (low, high) = ([-1.0, 0.0, 2.0], [3.0, 1.0, 2.5]);
    let grid = Grid::around(low, high, 8).unwrap();
    assert_eq!((grid.shape(), grid.spacing()), ([11, 5, 4], 0.5));
    let last = grid.position(grid.point_count() - 1);
    for axis in 0..3 {
        assert!(grid.origin()[axis] <= low[axis] - 0.5 && last[axis] >= high[axis] + 0.5);
    }
    for (low, high, cells) in [([0.0; 3], [0.0; 3], 4), ([0.0; 3], [1.0; 3], 0)] {
        assert!(Grid::around(low, high, cells).is_err());
    }
    for axis in 0..3 {
        let mut low = [0.0; 3];
        low[axis] = 1.5;
        let refused = Grid::around(low, [1.0; 3], 3).unwrap_err();
        assert_eq!(refused, MeshError::GridBox { low, high: [1.0; 3] });
    }
}

/// Numbers at the points of a small grid within a border of outside; some of them are exactly 0, tiny or huge.
fn enclosed() -> impl Strategy<Value = (Grid, Tensor<f64>)> {
    let number = prop_oneof![
        6 => -1.0..1.0,
        2 => Just(0.0),
        1 => Just(-0.0),
        1 => Just(-1e-300),
        1 => Just(1e-300),
        1 => Just(-1e300),
        1 => Just(1e300),
    ];
    let sides = (3_usize..7, 3_usize..7, prop_oneof![4 => 3_usize..7, 1 => 62_usize..68]);
    sides.prop_flat_map(move |(nx, ny, nz)| {
        prop::collection::vec(number.clone(), nx * ny * nz).prop_map(move |numbers: Vec<f64>| {
            let grid = Grid::new([nx, ny, nz], [-1.0, 2.0, 0.5], 0.25).unwrap();
            let is_border = |at: [usize; 3]| {
                at.iter().zip(grid.shape()).any(|(&k, extent)| k == 0 || k + 1 == extent)
            };
            let value = |k: usize| {
                let outside = numbers[k].abs();
                if is_border(grid.place(k)) { outside } else { numbers[k] }
            };
            (grid, Tensor::from_flat_fn([nx, ny, nz], value))
        })
    })
}

/// Whether some point lies inside with room around it. A neighbour's number must not be so much larger than its own
/// that rounding puts the surface at the point itself.
fn has_inside(grid: &Grid, field: &Tensor<f64>) -> bool {
    let [_, ny, nz] = grid.shape();
    let index = |[i, j, k]: [usize; 3]| (i * ny + j) * nz + k;
    let numbers = field.data();
    (0..grid.point_count()).filter(|&point| numbers[point] < 0.0).any(|point| {
        (0..3).any(|axis| {
            let mut beside = grid.place(point);
            beside[axis] += 1;
            numbers[index(beside)] < -1e12 * numbers[point]
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(
        std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(96)
    ))]

    #[test]
    fn a_surface_inside_the_grid_is_a_closed_manifold_around_what_is_inside((grid, field) in enclosed()) {
        let (positions, mesh) = extract_surface(&field, None, &grid).unwrap();
        let edges = passed(&mesh);
        prop_assert!(edges.values().all(|passed| *passed == [1, 1]));
        if !mesh.faces().is_empty() {
            assert_closed_manifold(&mesh);
        }
        prop_assert!(positions.is_finite());
        prop_assert!(volume(&positions, &mesh) > -1e-12);
        prop_assert!(!mesh.faces().is_empty() || !has_inside(&grid, &field));
        let single = field.map(|x| x.clamp(-1e30, 1e30)).cast::<f32>();
        let (narrow, same) = extract_surface(&single, None, &grid).unwrap();
        prop_assert!(narrow.is_finite());
        assert_eq!(passed(&same).values().filter(|passed| **passed != [1, 1]).count(), 0);
    }

    #[test]
    fn threads_change_no_bit((grid, field) in enclosed(), seed in 0_u64..99) {
        let offsets = Tensor::from_flat_fn([grid.point_count(), 3], |k| {
            0.1 * ((k as f64 + seed as f64) * 12.9898).sin() * grid.spacing()
        });
        let all = [1, 2, 3].map(|threads| with_threads(threads, || results(&grid, &field, &offsets)));
        prop_assert!(all[0] == all[1] && all[0] == all[2]);
    }
}

/// The bits of the positions and of both gradients, and the faces.
fn results(grid: &Grid, field: &Tensor<f64>, offsets: &Tensor<f64>) -> (Vec<u64>, Vec<[u32; 3]>) {
    let tape = Tape::new();
    let [field, offsets] = [field, offsets].map(|of| tape.leaf(of));
    let surface = field_surface(field, Some(offsets), grid).unwrap();
    let upstream = Tensor::from_flat_fn(surface.positions.shape(), |k| (k as f64 * 0.731).sin());
    let gradients = tape.vjp(&[(surface.positions, &upstream)]).unwrap();
    let values = [surface.positions.value(), gradients.get_or_zeros(field)];
    let values = values.into_iter().chain([gradients.get_or_zeros(offsets)]);
    let bits =
        values.flat_map(|tensor| tensor.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>());
    (bits.collect(), surface.mesh.faces().to_vec())
}

/// Over many pieces of work.
#[test]
fn threads_change_no_bit_of_a_large_surface() {
    let grid = grid(70);
    let field = grid.sampled(torus);
    let offsets = Tensor::from_flat_fn([grid.point_count(), 3], |k| {
        0.2 * (k as f64 * 12.9898).sin() * grid.spacing()
    });
    let all = [1, 2, 3].map(|threads| with_threads(threads, || results(&grid, &field, &offsets)));
    assert!(all[0] == all[1] && all[0] == all[2]);
}

#[test]
fn gradients_are_the_slopes_of_the_vertices() {
    let grid = grid(6);
    let field = grid.sampled(|p| sphere(p) + 0.05 * (9.0 * p[0]).sin());
    let offsets = Tensor::from_flat_fn([grid.point_count(), 3], |k| 0.05 * (k as f64).sin());
    let loss = |field: &Tensor<f64>, offsets: &Tensor<f64>| {
        let (positions, _) = extract_surface(field, Some(offsets), &grid).unwrap();
        let term = |(k, x): (usize, &f64)| (k as f64 * 0.731).sin() * x;
        positions.data().iter().enumerate().map(term).sum::<f64>()
    };
    let tape = Tape::new();
    let leaves = [&field, &offsets].map(|of| tape.leaf(of));
    let surface = field_surface(leaves[0], Some(leaves[1]), &grid).unwrap();
    let upstream = Tensor::from_flat_fn(surface.positions.shape(), |k| (k as f64 * 0.731).sin());
    let gradients = tape.vjp(&[(surface.positions, &upstream)]).unwrap();
    let moved = |of: &Tensor<f64>, at: usize, by: f64| {
        let mut moved = of.clone();
        moved.data_mut()[at] += by;
        moved
    };
    let h = 1e-5;
    let mut touched = 0;
    for at in 0..grid.point_count() {
        let [up, down] = [h, -h].map(|h| loss(&moved(&field, at, h), &offsets));
        let found = gradients.get_or_zeros(leaves[0]).data()[at];
        approx::assert_relative_eq!(
            found,
            (up - down) / (2.0 * h),
            epsilon = 1e-6,
            max_relative = 1e-5
        );
        touched += usize::from(found != 0.0);
    }
    assert!(touched > 20 && touched < grid.point_count(), "{touched}");
    for at in 0..3 * grid.point_count() {
        let [up, down] = [h, -h].map(|h| loss(&field, &moved(&offsets, at, h)));
        let found = gradients.get_or_zeros(leaves[1]).data()[at];
        approx::assert_relative_eq!(
            found,
            (up - down) / (2.0 * h),
            epsilon = 1e-6,
            max_relative = 1e-5
        );
    }
}

/// Also where numbers are exactly 0, and vertices of several edges are one.
#[test]
fn each_vertex_stands_on_its_edge_where_the_field_is_0_along_it() {
    let grid = Grid::around([-1.0; 3], [1.0; 3], 8).unwrap();
    for radius in [0.7, 0.5] {
        let field = grid.sampled(|[x, y, z]| x.abs().max(y.abs()).max(0.9 * z.abs()) - radius);
        let tape = Tape::<f64>::new();
        let surface = field_surface(tape.constant(&field), None, &grid).unwrap();
        assert_eq!(surface.edges.len(), surface.mesh.vertex_count());
        let positions = surface.positions.value();
        for (vertex, [a, b]) in points(&positions).iter().zip(&surface.edges) {
            let [of_a, of_b] = [a, b].map(|&end| field.data()[end as usize]);
            assert!(of_a < 0.0 && of_b >= 0.0, "{of_a} {of_b}");
            let [from, to] = [a, b].map(|&end| grid.position(end as usize));
            let share = of_a / (of_a - of_b);
            let expected = [0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis]));
            let off = minus(*vertex, expected);
            assert!(dot(off, off) < 1e-24, "{vertex:?} for {expected:?}");
        }
    }
}
