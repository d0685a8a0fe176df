//! Small faces are drawn in blocks of pixels, others span by span: the picture does not tell.

use rayon::ThreadPoolBuilder;

use super::culling::{Corner, Fate, Verdict};
use super::oracle::{assert_is_the_oracles, vertex};
use super::setup::{LANES, Setup, beyond};
use super::*;
use crate::rasterize::blocks::SmallFace;

/// A face's setup, and what draws it in blocks if that can be; `None` where it is not drawn.
fn prepared(clip: &[[f64; 4]; 3], size: Size) -> Option<(Setup<f64>, Option<SmallFace<f64>>)> {
    let corners = [0, 1, 2].map(|index| Corner::new(clip.as_flattened(), index, size));
    let corners = corners.each_ref();
    let Verdict { orientation, fate, .. } =
        Verdict::from_corners(corners, [0, 1, 2], size.into(), f64::INFINITY);
    let small = SmallFace::new(corners, orientation, size);
    matches!(fate, Fate::Drawn { .. }).then(|| (Setup::new(corners, orientation, size), small))
}

fn setup(clip: &[[f64; 4]; 3], size: Size) -> Option<Setup<f64>> {
    prepared(clip, size).map(|(setup, _)| setup)
}

/// Faces in view, some of which touch the near plane: of three vertices, or slivers with a vertex beside
/// the line between the others.
fn face_in_view() -> impl Strategy<Value = [[f64; 4]; 3]> {
    let depth = prop_oneof![-1.0..0.99_f64, -1.0..-0.9998_f64];
    let vertex = (-1.0..1.0_f64, -1.0..1.0_f64, depth, 0.1..4.0_f64)
        .prop_map(|(x, y, depth, w)| [w * x, w * y, w * depth, w]);
    let sliver = (vertex.clone(), vertex.clone(), 0.0..1.0_f64, -16.0..-1.0_f64).prop_map(
        |(p, q, along, digits)| {
            let r: [f64; 4] = std::array::from_fn(|k| p[k] + along * (q[k] - p[k]));
            [p, q, [r[0] + f64::powf(10.0, digits), r[1], r[2], r[3]]]
        },
    );
    prop_oneof![prop::array::uniform3(vertex), sliver]
}

/// Vertices before the eye, some near it, and some behind; faces with corners on pixel centres.
fn face() -> impl Strategy<Value = [[f64; 4]; 3]> {
    let on_centers = (0..16_u8, 0..16_u8, -0.9..0.9_f64)
        .prop_map(|(x, y, z)| [f64::from(x) / 8.0 - 0.9375, f64::from(y) / 8.0 - 0.9375, z, 1.0]);
    prop::array::uniform3(prop_oneof![vertex(), on_centers])
}

/// Depths and faces, in blocks.
type Blocks = (Vec<[f64; LANES]>, Vec<[u64; LANES]>);

/// Rows of blocks.
fn rows_of<'a>(
    ys: &'a [f64],
    (depths, faces): &'a mut Blocks,
) -> impl Iterator<Item = (f64, &'a mut [[f64; LANES]], &'a mut [[u64; LANES]])> {
    let per_row = depths.len() / ys.len();
    let rows = depths.chunks_exact_mut(per_row).zip(faces.chunks_exact_mut(per_row));
    ys.iter().zip(rows).map(|(&y, (depths, faces))| (y, depths, faces))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn blocks_draw_what_spans_draw(
        faces in prop::array::uniform3(prop_oneof![face(), face_in_view()]),
        width in 1..22_usize,
        height in 1..17_usize,
        first in 0..17_usize,
    ) {
        // Blocks are drawn from row `first` on, and write beyond a width that they do not divide.
        let (size, first) = (Size { width, height }, first % height);
        let columns = size.width.next_multiple_of(LANES);
        let centers: Vec<f64> = (0..columns).map(|column| size.center_x(column)).collect();
        let (in_blocks, _) = centers.as_chunks();
        let ys: Vec<f64> = (first..size.height).map(|row| size.center_y(row)).collect();
        let count = ys.len() * in_blocks.len();
        let mut blocks = (vec![[beyond::<f64>(); LANES]; count], vec![[u64::MAX; LANES]; count]);
        let mut spans = blocks.clone();
        let in_spans = |setup: &mut Setup<f64>, pixels: &mut Blocks, face| {
            for (y, depths, faces) in rows_of(&ys, pixels) {
                let (depths, faces) = (depths.as_flattened_mut(), faces.as_flattened_mut());
                let (row, all) = (setup.row(y), [0, size.width]);
                setup.cover_span(&row, all, &centers[..size.width], depths, faces, face);
            }
        };
        let prepared = faces.iter().filter_map(|face| prepared(face, size));
        for (face, (mut setup, small)) in (0..).zip(prepared) {
            let Some(small) = small else { continue };
            let (depths, seen) = &mut blocks;
            let is_uncertain = small.cover(&ys, in_blocks, (depths, seen), in_blocks.len(), face);
            in_spans(&mut setup, &mut spans, face);
            if is_uncertain {
                in_spans(&mut setup, &mut blocks, face);
            } else {
                let (weights, expected) = (small.weights(), setup.weights());
                prop_assert_eq!((weights.edges, weights.is_plain), (expected.edges, expected.is_plain));
            }
        }
        // What lies in the padding means nothing.
        for ((_, blocks, seen), (_, spans, expected)) in
            rows_of(&ys, &mut blocks).zip(rows_of(&ys, &mut spans))
        {
            prop_assert_eq!(&blocks.as_flattened()[..width], &spans.as_flattened()[..width]);
            prop_assert_eq!(&seen.as_flattened()[..width], &expected.as_flattened()[..width]);
        }
    }
}

#[test]
fn a_depth_is_linear_where_its_rounding_cannot_be_seen() {
    let size = Size::square(16);
    let has_plane = |clip: [[f64; 4]; 3]| setup(&clip, size).unwrap().has_plane();
    let face = |z: f64, w: f64| [[-0.7, -0.8, z, w], [0.8, -0.6, 0.3, 1.0], [0.1, 0.9, -0.4, 1.2]];
    assert!(has_plane(face(0.2, 1.0)) && has_plane(face(-900.0, 1.0)));
    // Vertex 0 behind the eye, in its plane, and too far away in depth.
    assert!(!has_plane(face(0.2, -0.1)) && !has_plane(face(0.2, 0.0)));
    assert!(!has_plane(face(1100.0, 1.0)) && !has_plane(face(-0.9, 1e-4)));
    let behind = face(0.2, -0.1);
    assert!(!has_plane([behind[1], behind[0], behind[2]]));
    assert!(!has_plane([behind[1], behind[2], behind[0]]));
}

/// A sliver of this width along the centres of row 4, from column 2 to `end`, with depths from 1.35
/// down to -0.45. It covers the centres of its right half, and the first half of these centres lies
/// behind 0.
fn sliver(size: Size, width: f64, end: f64) -> [[f64; 4]; 3] {
    let at = |x: f64, y: f64, depth: f64| {
        let [x, y, _, w] = at_px(size, x, y);
        [x, y, depth, w]
    };
    [at(2.5, 4.5 - width, 1.35), at(end, 4.5 - width, -0.45), at(end, 4.5 + width, -0.45)]
}

#[test]
fn a_sliver_is_seen_where_it_is_the_nearer_one() {
    // In blocks and in spans.
    for size in [Size::square(16), Size { width: 400, height: 9 }] {
        let end = size.width as f64 - 2.5;
        let mut refused = 0;
        for width in [1e-1, 1e-4, 1e-7, 1e-9, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12] {
            let sliver = sliver(size, width, end);
            let Some(setup) = setup(&sliver, size) else { continue };
            refused += usize::from(!setup.has_plane());
            let mut clip = sliver.to_vec();
            let alone = draw::<f64>(&clip, &[[0, 1, 2]], size);
            assert!(width < 1e-9 || alone.count() > size.width / 4);
            clip.extend([[-9.0, -9.0, 0.0, 1.0], [9.0, -9.0, 0.0, 1.0], [0.0, 9.0, 0.0, 1.0]]);
            for faces in [[[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [1, 2, 0]]] {
                let both = draw::<f64>(&clip, &faces, size);
                let nearer = u32::from(faces[0][0] == 3);
                for (k, (seen, alone)) in both.pixels.iter().zip(&alone.pixels).enumerate() {
                    let along = ((k % size.width) as f64 - 2.0) / (end - 2.5);
                    let is_close = (along - 0.75).abs() < 0.01;
                    let is_near = alone.is_some() && along > 0.75;
                    let face = seen.unwrap().face;
                    assert!(is_close || (face == nearer) == is_near, "pixel {k}, {width} px");
                }
            }
        }
        assert!(refused > 1, "slivers with an uncertain depth are among them");
    }
}

#[test]
fn the_last_block_of_a_row_ends_at_the_right_border_whatever_the_width() {
    for width in 1..=21 {
        let size = Size { width, height: 5 };
        for reach in 1..=width.min(6) {
            // A face over the last columns, which ends beyond them, and one that ends before.
            let left = (width - reach) as f64 + 0.2;
            for right in [width as f64 + 3.0, width as f64 - 0.3] {
                let px = [(left, -3.0), (right, 2.2), (left, 7.0)];
                let clip: Clip = px.iter().map(|&(x, y)| at_px(size, x, y)).collect();
                let [told, all] = assert_is_the_oracles::<f64>(&clip, &[[0, 1, 2]], size, 1e-9);
                assert_eq!(told, all);
                assert!(draw::<f64>(&clip, &[[0, 1, 2]], size).count() > 0);
            }
        }
    }
}

#[test]
fn an_image_of_another_width_shows_nothing_of_the_one_before() {
    // Widths of one number of blocks, and of one number of rows per band: one band, and several.
    for (widths, height) in [([29, 30, 31, 32, 29], 20), ([1025, 1026, 1027, 1028, 1025], 40)] {
        for threads in [1, 2] {
            let mut tape = Tape::<f64>::new();
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                for (step, width) in (0..).zip(widths) {
                    let size = Size { width, height };
                    let (clip, mesh) = faces_over_the_right_border(size, step);
                    let on = |tape: &Tape<f64>| {
                        let fragments = rasterize(tape.leaf(&clip), &mesh, size).unwrap();
                        let ids = fragments.coverage.triangle_ids();
                        (ids, fragments.barycentrics.value())
                    };
                    assert!(on(&tape) == on(&Tape::new()), "{size} on {threads} threads");
                    tape.reset();
                }
            });
        }
    }
}

/// Faces whose corners lie on pixel centres, those beyond the right border among them.
fn on_centers(size: Size) -> impl Strategy<Value = Clip> {
    let column = 0..size.width.next_multiple_of(LANES) + 2;
    let corner = (column, 0..size.height, 1..9_u8).prop_map(move |(column, row, depth)| {
        let [x, y, _, w] = at_px(size, column as f64 + 0.5, row as f64 + 0.5);
        [x, y, 0.1 * f64::from(depth), w]
    });
    prop::collection::vec(corner, 9)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn what_was_drawn_before_beyond_the_border_changes_no_bit(
        (size, before, clip) in (1..14_usize, 1..10_usize).prop_flat_map(|(width, height)| {
            let size = Size { width, height };
            (Just(size), on_centers(size), on_centers(size))
        }),
    ) {
        let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]], 9).unwrap();
        let bits = |tape: &Tape<f64>, clip: &Clip| {
            let barycentrics = rasterize(tape.leaf(&tensor(clip)), &mesh, size).unwrap().barycentrics;
            barycentrics.value().data().iter().map(|value| value.to_bits()).collect::<Vec<_>>()
        };
        let mut tape = Tape::new();
        bits(&tape, &before);
        tape.reset();
        prop_assert_eq!(bits(&tape, &clip), bits(&Tape::new(), &clip));
    }
}

/// Faces of few rows and columns, which are drawn in blocks, and one of many, which is drawn in
/// spans; at each step farther away than at the one before, and in another order.
fn faces_over_the_right_border(size: Size, step: usize) -> (Tensor<f64>, Mesh) {
    let few = (0..size.height / 4).map(|k| (size.width as f64 - 5.7, 4.0 * k as f64));
    let (right, z) = (size.width as f64 + 9.0, 0.1 * step as f64 - 0.9);
    let clip: Clip = few
        .chain([(0.2, 1.0)])
        .flat_map(|(left, top)| [(left, top), (right, top + 1.0), (left, top + 2.7)])
        .map(|(x, y)| {
            let [x, y, _, w] = at_px(size, x, y);
            [x, y, z, w]
        })
        .collect();
    let mut faces: Vec<_> =
        (0..clip.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    faces.rotate_left(step);
    (tensor(&clip), Mesh::new(faces, clip.len()).unwrap())
}
