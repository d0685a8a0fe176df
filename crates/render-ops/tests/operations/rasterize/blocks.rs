//! Small faces are drawn in blocks of pixels, others span by span: the picture does not tell.

use super::oracle::assert_is_the_oracles;
use super::*;
use bokashi_render_ops::{Mesh, Size, rasterize};
use rayon::ThreadPoolBuilder;

/// Pixels of a block.
const LANES: usize = 8;

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
        for width in [1e-1, 1e-4, 1e-7, 1e-9, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12] {
            let sliver = sliver(size, width, end);
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
    }
}

#[test]
fn the_last_block_of_a_row_ends_at_the_right_border_whatever_the_width() {
    for width in 1..=35 {
        let size = Size { width, height: 5 };
        for reach in (1..=width.min(6)).chain(15..=width.min(19)) {
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
