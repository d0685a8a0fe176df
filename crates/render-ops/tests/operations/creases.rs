use std::cell::Cell;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Cull, Mesh, RasterOptions, RenderError, Sampling, Size, VertexAttributes, rasterize,
};
use glam::{DMat3, DVec3};
use proptest::array::{uniform3, uniform4};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

/// Two faces that share the edge from vertex 1 to vertex 2, and two colours per vertex.
#[derive(Debug, Clone)]
struct Pair {
    clip: [[f64; 4]; 4],
    colors: [[f64; 2]; 4],
    size: Size,
}

/// The mesh with the creases of `attributes` as seams.
fn mark_creases<'a, 't>(
    mesh: &Mesh,
    clip: Var<'t, f64>,
    attributes: VertexAttributes<'a, 't, f64>,
    options: RasterOptions,
) -> Result<Mesh, RenderError> {
    let options = options.sampling(Sampling::Exact);
    let fragments = rasterize(clip, mesh, options.creases(&[attributes]))?;
    Ok(fragments.coverage.mesh().clone())
}

const FACES: [[u32; 3]; 2] = [[0, 1, 2], [2, 1, 3]];

fn pair() -> impl Strategy<Value = Pair> {
    let vertex = (uniform3(-1.0..1.0), 0.2..4.0).prop_map(|([x, y, z], w)| [x, y, z, w]);
    let corner = move |x: f64, y: f64| {
        vertex
            .clone()
            .prop_map(move |[a, b, z, w]| [(x + 0.2 * a) * w, (y + 0.2 * b) * w, z * w, w])
    };
    let clip = [corner(-0.5, 0.0), corner(0.0, -0.5), corner(0.0, 0.5), corner(0.5, 0.0)];
    let sizes = (5..60_usize, 5..60_usize);
    (clip, uniform4(proptest::array::uniform2(0.0..1.0)), sizes).prop_map(
        |(clip, colors, (width, height))| Pair { clip, colors, size: Size { width, height } },
    )
}

impl Pair {
    fn marked(&self, tolerance: f64) -> Mesh {
        let tape = Tape::<f64>::new();
        let clip = tape.constant(&Tensor::from(self.clip));
        let colors = tape.constant(&Tensor::from(self.colors));
        let mesh = Mesh::new(FACES.to_vec(), 4).unwrap();
        let options = RasterOptions::new(self.size).crease_tolerance(tolerance);
        mark_creases(&mesh, clip, colors.into(), options).unwrap()
    }

    fn has_crease(&self, tolerance: f64) -> bool {
        let mesh = self.marked(tolerance);
        assert_eq!(mesh.is_seam(0, 0), mesh.is_seam(1, 2));
        // No other edge has two faces.
        let others = [(0, 1), (0, 2), (1, 0), (1, 1)];
        assert!(others.iter().all(|&(face, corner)| !mesh.is_seam(face, corner)));
        mesh.is_seam(0, 0)
    }

    fn range(&self) -> f64 {
        let ends = |channel: usize| {
            let values = self.colors.map(|color| color[channel]);
            values.into_iter().fold(f64::MIN, f64::max)
                - values.into_iter().fold(f64::MAX, f64::min)
        };
        ends(0).max(ends(1))
    }

    /// A colour of a face's plane at a place in pixels, perspective-correct.
    fn color(&self, face: usize, [x, y]: [f64; 2], channel: usize) -> f64 {
        let Size { width, height } = self.size;
        let (x, y) = (2.0 * x / width as f64 - 1.0, 2.0 * y / height as f64 - 1.0);
        let corners = FACES[face].map(|vertex| self.clip[vertex as usize]);
        let q = corners.map(|[cx, cy, _, w]| [cx - x * w, cy - y * w]);
        let a = [0, 1, 2].map(|k| {
            let ([px, py], [qx, qy]) = (q[(k + 1) % 3], q[(k + 2) % 3]);
            px * qy - py * qx
        });
        let colors = FACES[face].map(|vertex| self.colors[vertex as usize][channel]);
        let sum: f64 = a.iter().sum();
        (0..3).map(|k| a[k] * colors[k]).sum::<f64>() / sum
    }

    /// The largest jump of a slope at the ends of the edge, per pixel, by difference quotients.
    fn bend(&self) -> f64 {
        let Size { width, height } = self.size;
        let place = |[x, y, _, w]: [f64; 4]| {
            [0.5 * (x / w + 1.0) * width as f64, 0.5 * (y / w + 1.0) * height as f64]
        };
        let [p, q] = [1, 2].map(|k| place(self.clip[k]));
        let [x, y] = [q[0] - p[0], q[1] - p[1]];
        let across = [y / x.hypot(y), -x / x.hypot(y)];
        let slope = |face: usize, [x, y]: [f64; 2], channel: usize| {
            const STEP: f64 = 1e-6;
            let at =
                |step: f64| self.color(face, [x + step * across[0], y + step * across[1]], channel);
            (at(STEP) - at(-STEP)) / (2.0 * STEP)
        };
        let jumps = [p, q].into_iter().flat_map(|end| {
            [0, 1].map(|channel| (slope(0, end, channel) - slope(1, end, channel)).abs())
        });
        jumps.fold(0.0, f64::max)
    }
}

proptest! {
    #[test]
    fn an_edge_is_a_crease_where_the_slope_jumps_by_more_than_eight_tolerances(pair in pair()) {
        let tolerance = pair.bend() / (8.0 * pair.range());
        prop_assert!(pair.has_crease(tolerance * (1.0 - 1e-4)));
        prop_assert!(!pair.has_crease(tolerance * (1.0 + 1e-4)));
    }

    #[test]
    fn what_is_linear_in_space_bends_nowhere_on_a_plane(pair in pair(), by in uniform4(-1.0..1.0)) {
        let mut flat = pair;
        // Vertex 3 in the plane of the others, in clip space, which is space, seen by a camera.
        let [a, b, c, _] = by;
        let mix = [1.0 - 0.5 * (a + b), 0.5 * a, 0.5 * b];
        flat.clip[3] =
            [0, 1, 2, 3].map(|k| (0..3).map(|at| mix[at] * flat.clip[at][k]).sum::<f64>());
        for color in 0..4 {
            let [x, y, z, w] = flat.clip[color];
            flat.colors[color] = [x + c * y, z - w];
        }
        // A vertex behind the eye has no place in the image.
        prop_assume!(flat.clip[3][3] > 1e-2);
        let is_wide = |face| determinant_of(&flat, face).abs() > 1e-2;
        prop_assume!(FACES.into_iter().all(is_wide) && flat.range() > 1e-2);
        prop_assert!(!flat.has_crease(1e-8));
    }

    #[test]
    fn a_mesh_times_a_power_of_two_has_the_same_creases(pair in pair(), power in -900..900_i32) {
        let tolerance = pair.bend() / (8.0 * pair.range());
        let mut scaled = pair.clone();
        scaled.clip = pair.clip.map(|vertex| vertex.map(|x| x * f64::powi(2.0, power)));
        for near in [1.0 - 1e-12, 1.0, 1.0 + 1e-12] {
            prop_assert_eq!(pair.has_crease(near * tolerance), scaled.has_crease(near * tolerance));
        }
    }
}

fn determinant_of(pair: &Pair, face: [u32; 3]) -> f64 {
    let corners = face.map(|vertex| {
        let [x, y, _, w] = pair.clip[vertex as usize];
        DVec3::new(x, y, w)
    });
    DMat3::from_cols_array_2d(&corners.map(|corner| corner.to_array())).determinant()
}

fn square() -> Pair {
    let clip = [[-0.5, 0.0], [0.0, -0.5], [0.0, 0.5], [0.5, 0.0]].map(|[x, y]| [x, y, 0.0, 1.0]);
    Pair { clip, colors: [[0.0; 2]; 4], size: Size::square(8) }
}

#[test]
fn an_edge_is_a_crease_where_the_value_jumps_by_more_than_two_tolerances() {
    let (pair, tape) = (square(), Tape::<f64>::new());
    let mesh = Mesh::new(FACES.to_vec(), 4).unwrap();
    let clip = tape.constant(&Tensor::from(pair.clip));
    // Each face has colours of its own, 0 and 1, and no slope.
    let indices = Mesh::new(vec![[0, 0, 0], [1, 1, 1]], 3).unwrap();
    let has_crease = |step: f64, tolerance: f64| {
        let values = tape.constant(&Tensor::from([[0.0], [step], [1.0]]));
        let options = RasterOptions::new(pair.size).crease_tolerance(tolerance);
        mark_creases(&mesh, clip, (values, &indices).into(), options).unwrap().is_seam(0, 0)
    };
    assert!(has_crease(0.5, 0.24) && !has_crease(0.5, 0.26));
    // With vertices of their own at the edge they may be the same.
    assert!(!has_crease(0.0, 1e-9));
}

#[test]
fn what_is_the_same_everywhere_bends_nowhere_and_what_is_no_number_everywhere() {
    let mut pair = square();
    pair.colors = [[0.3; 2]; 4];
    assert!(!pair.has_crease(1e-300));
    for odd in [f64::NAN, f64::INFINITY] {
        pair.colors[0][1] = odd;
        assert!(pair.has_crease(1e300));
    }
}

#[test]
fn ends_behind_the_eye_do_not_count() {
    let mut pair = square();
    pair.colors = [[0.0; 2], [1.0; 2], [0.0; 2], [0.0; 2]];
    assert!(pair.has_crease(1e-2));
    let behind = |w: [f64; 2]| {
        let mut pair = pair.clone();
        (pair.clip[1][3], pair.clip[2][3]) = (w[0], w[1]);
        pair.has_crease(1e-2)
    };
    assert!(behind([-1.0, 1.0]) && behind([1.0, -1.0]) && !behind([-1.0, -1.0]));
}

proptest! {
    /// Whichever way each of two faces turns.
    #[test]
    fn only_between_faces_that_are_not_drawn_no_crease_is_looked_for(
        pair in pair(),
        turned: [bool; 2],
        mirrored: bool,
        cull in prop_oneof![Just(Cull::Back), Just(Cull::Front)],
    ) {
        let mut pair = pair;
        if mirrored {
            pair.clip.iter_mut().for_each(|[x, ..]| *x = -*x);
        }
        let mut faces = FACES;
        for (face, turned) in faces.iter_mut().zip(turned) {
            if turned {
                face.swap(0, 1);
            }
        }
        let mesh = Mesh::new(faces.to_vec(), 4).unwrap();
        let tape = Tape::<f64>::new();
        let clip = tape.constant(&Tensor::from(pair.clip.map(|[x, y, _, w]| [x, y, 0.0, w])));
        let colors = tape.constant(&Tensor::from(pair.colors));
        let options = RasterOptions::new(pair.size).cull(cull);
        let not_drawn = rasterize(clip, &mesh, options).unwrap().coverage.culled().facing;
        let all = mark_creases(&mesh, clip, colors.into(), pair.size.into()).unwrap();
        let drawn = mark_creases(&mesh, clip, colors.into(), options).unwrap();
        for (face, corner) in (0..2).flat_map(|face| [0, 1, 2].map(|corner| (face, corner))) {
            let expected = all.is_seam(face, corner) && not_drawn < 2;
            prop_assert_eq!(drawn.is_seam(face, corner), expected);
        }
    }
}

/// A bumpy ground of cells that are cut in two, and attributes of their own for each of its faces' corners, or
/// one for each vertex.
#[derive(Debug, Clone)]
struct Ground {
    faces: Vec<[u32; 3]>,
    clip: Vec<[f64; 4]>,
    indices: Option<Vec<[u32; 3]>>,
    channels: usize,
    values: Vec<f64>,
}

fn ground() -> impl Strategy<Value = Ground> {
    let counts = (1..9_usize, 1..9_usize, 1..10_usize);
    let random = counts.prop_flat_map(|counts| {
        let (wide, high, channels) = counts;
        let vertices = (wide + 1) * (high + 1);
        let bumps = proptest::collection::vec(uniform3(-1.0..1.0), vertices);
        let values = proptest::collection::vec(-1.0..1.0, 6 * vertices * channels);
        let shift = proptest::option::of(0..6 * vertices);
        (Just(counts), bumps, values, shift)
    });
    random.prop_map(|((wide, high, channels), bumps, values, shift)| {
        let index = |i: usize, j: usize| (j * (wide + 1) + i) as u32;
        let clip = (0..bumps.len()).map(|vertex| {
            let ([a, b, c], w) = (bumps[vertex], 2.0 + bumps[vertex][2]);
            let (i, j) = (vertex % (wide + 1), vertex / (wide + 1));
            let [x, y] = [(i, a), (j, b)].map(|(at, by)| 0.2 * (at as f64 + 0.6 * by) - 0.9);
            [x * w, y * w, 0.3 * c * w, w]
        });
        let clip = clip.collect();
        let cells = (0..wide * high).map(|cell| (cell % wide, cell / wide));
        let faces: Vec<_> = cells
            .flat_map(|(i, j)| {
                let [p, q] = [index(i, j), index(i + 1, j)];
                let [r, s] = [index(i + 1, j + 1), index(i, j + 1)];
                [[p, q, r], if (i + j) % 3 == 0 { [s, r, p] } else { [p, r, s] }]
            })
            .collect();
        let shifted = |shift: usize| {
            let rows = values.len() / channels;
            faces.iter().map(|face| face.map(|k| ((k as usize + shift) % rows) as u32)).collect()
        };
        Ground { indices: shift.map(shifted), clip, channels, values: values.clone(), faces }
    })
}

impl Ground {
    /// The creases of some of its faces, the other ones left out.
    fn marked(&self, some: &[usize], options: RasterOptions) -> Mesh {
        let tape = Tape::<f64>::new();
        let clip = tape.constant(&Tensor::from_fn([self.clip.len(), 4], |[v, k]| self.clip[v][k]));
        let rows = if self.indices.is_some() {
            self.values.len() / self.channels
        } else {
            self.clip.len()
        };
        let value = |[row, channel]: [usize; 2]| {
            // Of a range that faces alone do not have.
            let value = self.values[row * self.channels + channel];
            if row == 0 { 3.0 * value.signum() } else { value }
        };
        let values = tape.constant(&Tensor::from_fn([rows, self.channels], value));
        let faces = |all: &[[u32; 3]]| some.iter().map(|&face| all[face]).collect();
        let mesh = Mesh::new(faces(&self.faces), self.clip.len()).unwrap();
        let indices = self.indices.as_ref().map(|all| Mesh::new(faces(all), rows).unwrap());
        let attributes = indices.as_ref().map_or(values.into(), |indices| (values, indices).into());
        mark_creases(&mesh, clip, attributes, options).unwrap()
    }
}

#[test]
fn each_edge_of_a_mesh_is_a_crease_as_its_two_faces_alone_say() {
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::default() };
    let culls = prop_oneof![Just(Cull::None), Just(Cull::Back), Just(Cull::Front)];
    // Edges that are none, and that are.
    let counts = [Cell::new(0), Cell::new(0)];
    let check = |(ground, tolerance, cull): (Ground, f64, Cull)| {
        let options = RasterOptions::new(Size::square(16)).cull(cull).crease_tolerance(tolerance);
        let all: Vec<_> = (0..ground.faces.len()).collect();
        let mesh = ground.marked(&all, options);
        for (one, other) in all.iter().flat_map(|&one| (0..one).map(move |other| (other, one))) {
            let corner = |face: usize, beyond: usize| {
                let is_across = |k: &usize| !ground.faces[beyond].contains(&ground.faces[face][*k]);
                let across: Vec<_> = (0..3).filter(is_across).collect();
                (across.len() == 1).then(|| across[0])
            };
            if let (Some(k), Some(l)) = (corner(one, other), corner(other, one)) {
                let pair = ground.marked(&[one, other], options);
                prop_assert_eq!(mesh.is_seam(one, k), pair.is_seam(0, k));
                prop_assert_eq!(mesh.is_seam(other, l), pair.is_seam(1, l));
                prop_assert_eq!(pair.is_seam(0, k), pair.is_seam(1, l));
                let count = &counts[usize::from(pair.is_seam(0, k))];
                count.set(count.get() + 1);
            }
        }
        Ok(())
    };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
        .run(&(ground(), 0.01..0.6, culls), check)
        .unwrap();
    let counts = counts.map(Cell::into_inner);
    assert!(counts.iter().all(|&count| count > 100), "smooth edges and creases: {counts:?}");
}

#[test]
fn seams_of_the_mesh_stay() {
    let pair = square();
    let tape = Tape::<f64>::new();
    let mesh = Mesh::new(FACES.to_vec(), 4).unwrap().with_seams(|face, k| (face, k) == (0, 1));
    let clip = tape.constant(&Tensor::from(pair.clip));
    for color in [0.0, 1.0] {
        let colors = tape.constant(&Tensor::from([[0.0], [0.0], [0.0], [color]]));
        let marked = mark_creases(&mesh, clip, colors.into(), pair.size.into()).unwrap();
        assert!(marked.is_seam(0, 1) && marked.is_seam(0, 0) == (color > 0.0));
        // They share what was built for the mesh.
        assert!(std::ptr::eq(mesh.adjacency(), marked.adjacency()));
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let tape = Tape::<f64>::new();
    let mesh = Mesh::new(FACES.to_vec(), 4).unwrap();
    let clip = tape.constant(&Tensor::zeros([4, 4]));
    let message = |clip, shape: [usize; 2], indices: &Mesh, tolerance: f64| {
        let colors = tape.constant(&Tensor::zeros(shape));
        let options = RasterOptions::new(Size::square(4)).crease_tolerance(tolerance);
        let attributes = (colors, indices).into();
        mark_creases(&mesh, clip, attributes, options).unwrap_err().to_string()
    };
    let few = Mesh::new(vec![[0, 1, 2]], 4).unwrap();
    assert_eq!(
        message(clip, [4, 3], &few, 1e-3),
        "indices need one face per face of the mesh, 2, got 1"
    );
    assert_eq!(
        message(tape.constant(&Tensor::zeros([3, 4])), [4, 3], &mesh, 1e-3),
        "rasterize needs clip positions of shape [4, 4], got shape [3, 4]"
    );
    for shape in [[5, 3], [4, 0]] {
        assert_eq!(
            message(clip, shape, &mesh, 1e-3),
            format!("rasterize needs attributes of shape [4, C], C > 0, got shape {shape:?}")
        );
    }
    for tolerance in [0.0, -1.0, f64::NAN] {
        assert_eq!(
            message(clip, [4, 3], &mesh, tolerance),
            format!("rasterize needs a positive tolerance of creases, got {tolerance}")
        );
    }
}
