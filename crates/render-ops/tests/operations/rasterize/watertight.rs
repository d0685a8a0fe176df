//! No pixel is lost or drawn twice between faces that share an edge, or between bands.

use super::oracle::assert_is_the_oracles;
use super::*;

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    #[test]
    fn a_jittered_grid_with_any_w_has_no_hole_and_no_double(
        jitter in prop::collection::vec((-0.2..0.2_f64, -0.2..0.2_f64, 0.2..5.0_f64), 36),
        flips in prop::collection::vec(0..6_usize, 50),
        size in size(),
    ) {
        // A grid of 5 by 5 quads over the image and beyond it; every vertex that is not on the rim
        // is moved, by less than makes a face fold over.
        let clip: Clip = (0..36)
            .map(|k| {
                let (column, row, (dx, dy, w)) = (k % 6, k / 6, jitter[k]);
                let inner = |at: usize, moved: f64| {
                    (at as f64 + if (1..5).contains(&at) { moved } else { 0.0 }) * 0.5 - 1.25
                };
                [inner(column, dx) * w, inner(row, dy) * w, 0.3 * w, w]
            })
            .collect();
        let faces: Vec<[u32; 3]> = (0..25)
            .flat_map(|k| {
                let corner = (k % 5 + 6 * (k / 5)) as u32;
                [[corner, corner + 1, corner + 7], [corner, corner + 7, corner + 6]]
            })
            .zip(&flips)
            .map(|(face, &order)| orders(face)[order])
            .collect();
        prop_assert!(layers::<f64>(&clip, &faces, size).iter().all(|&count| count == 1));
        prop_assert!(layers::<f32>(&clip, &faces, size).iter().all(|&count| count == 1));
    }
}

#[test]
fn bands_join_without_a_seam() {
    let size = Size { width: 300, height: 170 };
    let clip = vec![
        [-1.0, -1.0, 0.0, 1.0],
        [3.0, -1.0, 0.0, 1.0],
        [-1.0, 3.0, 0.0, 1.0],
        [0.9, 0.8, -0.5, 1.0],
    ];
    let drawn = draw::<f32>(&clip, &[[0, 1, 2], [0, 1, 3]], size);
    assert_eq!(drawn.count(), size.pixels());
    let tall = Size { width: 1, height: 40_000 };
    assert_eq!(draw::<f32>(&clip, &[[0, 1, 2]], tall).count(), 40_000);
    let [told, all] = assert_is_the_oracles::<f64>(&clip, &[[0, 1, 3]], size, 1e-9);
    assert!(told * 100 > all * 99);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(4000) })]

    #[test]
    fn three_points_on_a_line_but_for_rounding_are_not_drawn(
        pixel in 0..12 * 9_usize,
        angle in 0.0..std::f64::consts::TAU,
        points in prop::array::uniform3((-1.0..1.0_f64, 0.5..1.5_f64)),
    ) {
        let size = Size { width: 12, height: 9 };
        let [x, y, ..] = at_px(size, (pixel % 12) as f64 + 0.5, (pixel / 12) as f64 + 0.5);
        let (sin, cos) = angle.sin_cos();
        let clip = points.map(|(t, w)| [(x + t * cos) * w, (y + t * sin) * w, 0.1 * w, w]);
        let drawn = draw::<f64>(&clip.to_vec(), &[[0, 1, 2]], size);
        prop_assert_eq!(drawn.count(), 0);
        prop_assert_eq!(drawn.culled.degenerate + drawn.culled.outside, 1);
    }
}

#[test]
fn a_shared_edge_on_pixel_centres_loses_none_whatever_its_w() {
    // The edge's coordinates are those of the centres times w, rounded: divided by w again they may
    // lie a little beside them.
    let size = Size { width: 8, height: 8 };
    for k in 0..500 {
        let w = 0.3 + 0.0123 * f64::from(k);
        let column = |x: f64, y: f64, w: f64| [x * w / 8.0, y * w, 0.0, w];
        for x in [-5.0, 3.0, 5.0] {
            let clip = vec![
                column(-24.0, -3.0, 1.0),
                column(-24.0, 3.0, 1.0),
                column(x, -3.0, w),
                column(x, 3.0, w),
                column(24.0, -3.0, 1.0),
                column(24.0, 3.0, 1.0),
            ];
            let faces = [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]];
            assert!(layers::<f64>(&clip, &faces, size).iter().all(|&count| count == 1), "{x} {w}");
            let turned: Clip = clip.iter().map(|&[x, y, z, w]| [y, x, z, w]).collect();
            assert!(
                layers::<f64>(&turned, &faces, size).iter().all(|&count| count == 1),
                "{x} {w}"
            );
        }
    }
}
