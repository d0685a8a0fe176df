//! Extreme cases.

use super::oracle::assert_is_the_oracles;
use super::*;

#[test]
fn a_face_behind_the_eye_or_beside_the_image_or_out_of_the_depth_range_is_outside() {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.0, 0.5]];
    let cases: [[[f64; 4]; 3]; 5] = [
        corners.map(|[x, y]| [x, y, 0.0, -1.0]),
        corners.map(|[x, y]| [x, y, 0.0, 0.0]),
        corners.map(|[x, y]| [x + 2.0, y, 0.0, 1.0]),
        corners.map(|[x, y]| [x, y, 1.5, 1.0]),
        corners.map(|[x, y]| [x, y, -1.5, 1.0]),
    ];
    for clip in cases {
        let drawn = draw::<f32>(&clip.to_vec(), &[[0, 1, 2]], WIDE);
        assert_eq!(drawn.count(), 0);
        assert_eq!(drawn.culled, Culled { outside: 1, ..Culled::default() });
    }
}

#[test]
fn a_face_without_area_is_not_drawn_but_counted_and_gets_no_gradient() {
    let size = Size::square(16);
    let thirds = |k: f64| [0.1 * k, 0.1 * k, 0.0, 1.0];
    let lines: [[[f64; 4]; 3]; 6] = [
        // Through pixel centres, across, down and along the diagonal.
        [at_px(size, 1.5, 3.5), at_px(size, 7.5, 3.5), at_px(size, 12.5, 3.5)],
        [at_px(size, 3.5, 1.5), at_px(size, 3.5, 8.5), at_px(size, 3.5, 11.5)],
        [at_px(size, 1.5, 1.5), at_px(size, 4.5, 4.5), at_px(size, 9.5, 9.5)],
        // The same where no coordinate is exact: the area is a rounding error.
        [thirds(-7.0), thirds(1.0), thirds(6.0)],
        [[-0.7, -0.35, 0.1, 1.0], [0.2, 0.1, 0.1, 1.0], [0.6, 0.3, 0.1, 1.0]],
        // All in one point.
        [at_px(size, 3.5, 3.5), at_px(size, 3.5, 3.5), at_px(size, 3.5, 3.5)],
    ];
    for clip in lines {
        let clip = clip.to_vec();
        for face in orders([0, 1, 2]) {
            let [double, single] =
                [draw::<f64>(&clip, &[face], size), draw::<f32>(&clip, &[face], size)];
            assert_eq!(double.count(), 0, "{clip:?}");
            assert_eq!(double.culled, Culled { degenerate: 1, ..Culled::default() }, "{clip:?}");
            assert!(gradient::<f64>(&clip, &[face], size).iter().all(|&entry| entry == 0.0));
            // In f32 the three points may not be on one line any more.
            assert!(single.pixels.iter().flatten().all(|seen| seen.depth.is_finite()));
        }
    }
    let clip = vec![at_px(size, 1.0, 1.0), at_px(size, 9.0, 2.0)];
    let drawn = draw::<f32>(&clip, &[[0, 1, 1], [0, 0, 0]], size);
    assert_eq!((drawn.count(), drawn.culled.degenerate), (0, 2));
}

#[test]
fn a_face_has_an_orientation_unless_its_area_is_a_rounding_error() {
    let (size, tape) = (Size::square(16), Tape::<f64>::new());
    let orientations = |clip: &Clip, face: [u32; 3]| {
        let mesh = Mesh::new(vec![face], clip.len()).unwrap();
        let fragments = rasterize(tape.leaf(&tensor(clip)), &mesh, size).unwrap();
        fragments.coverage.orientations.clone()
    };
    // On a line but for rounding: in the image, and beside it, where faces are left out as outside.
    for shift in [0.0, 20.0] {
        let on_line = |k: f64| [0.1 * k + shift, 0.07 * k - 0.013, 0.0, 1.0];
        for k in 0..50 {
            let clip = [-7.0, 1.0 + 0.1 * f64::from(k), 6.0].map(on_line).to_vec();
            for face in orders([0, 1, 2]) {
                assert_eq!(orientations(&clip, face), [0], "{clip:?}");
            }
        }
        let off_line = [[-0.5, -0.5], [0.5, -0.5], [0.0, 0.5]];
        let clip = off_line.map(|[x, y]| [x + shift, y, 0.0, 1.0]).to_vec();
        assert_eq!([[0, 1, 2], [0, 2, 1]].map(|face| orientations(&clip, face)[0]), [1, -1]);
    }
}

#[test]
fn a_sliver_through_pixel_centres_is_finite() {
    let size = Size::square(16);
    for width in [1e-7, 1e-9] {
        let clip = vec![
            at_px(size, 2.5, 4.5 - width),
            at_px(size, 13.5, 4.5 - width),
            at_px(size, 13.5, 4.5 + width),
        ];
        let drawn = draw::<f64>(&clip, &[[0, 1, 2]], size);
        // The long side passes the centres of row 4 from above on its left half to below.
        assert!(drawn.count() >= 5, "{}", drawn.count());
        for seen in drawn.pixels.iter().flatten() {
            assert!(seen.uv.iter().all(|weight| (0.0..=1.0).contains(weight)), "{seen:?}");
        }
        assert!(gradient::<f64>(&clip, &[[0, 1, 2]], size).iter().all(|entry| entry.is_finite()));
        assert!(gradient::<f32>(&clip, &[[0, 1, 2]], size).iter().all(|entry| entry.is_finite()));
    }
}

#[test]
fn a_face_between_pixel_centres_covers_none() {
    let size = Size::square(8);
    let clip = vec![at_px(size, 2.6, 3.6), at_px(size, 3.4, 3.6), at_px(size, 3.0, 4.4)];
    let drawn = draw::<f64>(&clip, &[[0, 1, 2]], size);
    assert_eq!((drawn.count(), drawn.culled), (0, Culled::default()));
}

#[test]
fn a_face_with_far_away_vertices_covers_the_half_plane_that_it_should() {
    for far_px in [1e6, 1e15, 1e30] {
        // Seen from the middle everything above a line through (5.2, 5.2) of slope 1/2, y down.
        let size = Size { width: 13, height: 9 };
        let far = far_px / 4.0;
        let along = |k: f64| at_px(size, 5.2 + k * far, 5.2 - k * far / 2.0);
        let clip = vec![along(-1.0), along(1.0), at_px(size, 5.2 - 2.0 * far, 5.2 - 4.0 * far)];
        let line = [clip[0], clip[1]];
        let side = |x: f64, y: f64| {
            let [_, _, _, w] = line[0];
            let [px, py] = [line[0][0] / w, line[0][1] / w];
            let [dx, dy] = [line[1][0] - px, line[1][1] - py];
            dx * (y - py) - dy * (x - px)
        };
        for order in orders([0, 1, 2]) {
            for drawn in [draw::<f64>(&clip, &[order], size), draw::<f32>(&clip, &[order], size)] {
                assert!(drawn.pixels.iter().flatten().all(|seen| {
                    seen.uv.iter().all(|weight| (0.0..=1.0).contains(weight)) && seen.depth == 0.0
                }));
                // Beyond 1e15 px the line's position within the image is lost to rounding.
                if far_px > 1e7 {
                    continue;
                }
                for (pixel, seen) in drawn.pixels.iter().enumerate() {
                    let [x, y, ..] =
                        at_px(size, (pixel % 13) as f64 + 0.5, (pixel / 13) as f64 + 0.5);
                    let side = side(x, y) / far;
                    if side.abs() > 0.5 {
                        assert_eq!(seen.is_some(), side > 0.0, "pixel {pixel}");
                    }
                }
            }
        }
        // One that covers the screen with room to spare.
        let clip = vec![[-far, -far, 0.0, 1.0], [far, -far, 0.0, 1.0], [0.0, far, 0.0, 1.0]];
        assert_eq!(draw::<f64>(&clip, &[[0, 1, 2]], size).count(), size.pixels());
        assert_eq!(draw::<f32>(&clip, &[[0, 1, 2]], size).count(), size.pixels());
    }
}

#[test]
fn coordinates_up_to_the_largest_number_cover_the_half_plane_that_they_should() {
    // A strip upwards from a base line: the far vertex is too far for its distance to matter, and
    // a coordinate times the width, or the product of two of another vertex's, is beyond f64.
    let size = Size { width: 12, height: 10 };
    for middle in [0.0, 0.05] {
        let strip = |far: f64| {
            vec![[-0.55, -0.45, 0.1, 1.0], [0.65, -0.45, 0.1, 1.0], [middle, far, 0.0, 1.0]]
        };
        let expected = draw::<f64>(&strip(1e30), &[[0, 1, 2]], size);
        assert_eq!(expected.count(), 7 * 7);
        for far in [1e59, 1e100, 1e154, 1e200, 1e306, f64::MAX] {
            for order in orders([0, 1, 2]) {
                let drawn = draw::<f64>(&strip(far), &[order], size);
                assert_eq!(drawn.faces(), expected.faces(), "{far} {order:?}");
                let near = drawn.pixels.iter().zip(&expected.pixels);
                for (seen, expected) in near.filter_map(|(seen, near)| seen.zip(*near)) {
                    approx::assert_relative_eq!(seen.depth, expected.depth, max_relative = 1e-12);
                }
                let bars = gradient::<f64>(&strip(far), &[order], size);
                assert!(bars.iter().all(|bar| bar.is_finite()));
            }
        }
    }
}

#[test]
fn a_vertex_times_a_power_of_two_is_the_same_point_with_another_weight() {
    let size = Size { width: 11, height: 9 };
    let base = vec![[-0.8, -0.7, 0.2, 1.0], [0.9, -0.5, -0.1, 1.2], [0.1, 0.85, 0.3, 0.9]];
    let plain = draw::<f64>(&base, &[[0, 1, 2]], size);
    assert!(plain.count() > 20);
    let bars = gradient::<f64>(&base, &[[0, 1, 2]], size);
    for k in [-980, -400, -190, -30, 30, 190, 400, 980] {
        let factor = f64::powi(2.0, k);
        let mut scaled = base.clone();
        scaled[0] = scaled[0].map(|c| factor * c);
        let drawn = draw::<f64>(&scaled, &[[0, 1, 2]], size);
        assert_eq!(drawn.faces(), plain.faces());
        for (seen, plain) in drawn.pixels.iter().flatten().zip(plain.pixels.iter().flatten()) {
            assert_eq!(seen.depth, plain.depth);
            // In the sum that is the pixel's point, the vertex has its old share.
            let [u, v] = plain.uv;
            let total = u / factor + v + (1.0 - u - v);
            approx::assert_relative_eq!(seen.uv[0], u / factor / total, max_relative = 1e-12);
            approx::assert_relative_eq!(seen.uv[1], v / total, max_relative = 1e-12);
        }
        // The depth does not move, so its gradient is the old one in the old coordinates; that of
        // the weights is orthogonal to the positions.
        let scaled_bars = gradient::<f64>(&scaled, &[[0, 1, 2]], size);
        let terms = scaled_bars
            .iter()
            .zip(scaled.as_flattened())
            .map(|(bar, c)| bar * c)
            .collect::<Vec<_>>();
        let total: f64 = terms.iter().sum();
        let extent: f64 = terms.iter().map(|term| term.abs()).sum();
        assert!(total.abs() <= 1e-12 * extent, "{k}: {total} of {extent}");
        assert_eq!(scaled_bars.iter().map(|bar| bar.is_finite()).filter(|&ok| !ok).count(), 0);
        approx::assert_relative_eq!(scaled_bars[2] * factor, bars[2], max_relative = 1e-12);
    }
}

#[test]
fn denormal_coordinates_are_drawn_as_others() {
    // Multiples of 2^-6: exact, however small the unit is.
    let size = Size { width: 9, height: 7 };
    let unit: Clip =
        vec![[-60.0, -50.0, 3.0, 64.0], [61.0, -40.0, -5.0, 64.0], [3.0, 55.0, 7.0, 48.0]];
    let scaled =
        |unit_size: f64| -> Clip { unit.iter().map(|p| p.map(|c| c * unit_size)).collect() };
    let plain = draw::<f64>(&unit, &[[0, 1, 2]], size);
    assert!(plain.count() > 10);
    assert_eq!(draw::<f64>(&scaled(f64::from_bits(1)), &[[0, 1, 2]], size), plain);
    let plain = draw::<f32>(&unit, &[[0, 1, 2]], size);
    assert_eq!(draw::<f32>(&scaled(f32::from_bits(1).into()), &[[0, 1, 2]], size), plain);
}

#[test]
fn a_negative_zero_is_a_zero() {
    let size = Size::square(3);
    // The corner and two of the sides pass through the centre of the image.
    let clip =
        |zero: f64| vec![[zero, zero, zero, 1.0], [1.0, zero, zero, 1.0], [zero, 1.0, zero, 1.0]];
    for face in orders([0, 1, 2]) {
        assert_eq!(draw::<f64>(&clip(-0.0), &[face], size), draw::<f64>(&clip(0.0), &[face], size));
        assert_eq!(
            gradient::<f64>(&clip(-0.0), &[face], size),
            gradient::<f64>(&clip(0.0), &[face], size)
        );
    }
}

#[test]
fn images_of_one_row_column_or_pixel_are_strips_of_larger_ones() {
    let (clip, faces) = layered();
    // A row of an image of 3 rows, and the same row as an image of its own.
    let tall = draw::<f64>(&clip, &faces, Size { width: 17, height: 3 });
    let strip: Clip = clip.iter().map(|&[x, y, z, w]| [x, 3.0 * y, z, w]).collect();
    let strip = draw::<f64>(&strip, &faces, Size { width: 17, height: 1 });
    assert_eq!(strip.faces(), tall.faces()[17..34]);
    let wide = draw::<f64>(&clip, &faces, Size { width: 3, height: 17 });
    let strip: Clip = clip.iter().map(|&[x, y, z, w]| [3.0 * x, y, z, w]).collect();
    let strip = draw::<f64>(&strip, &faces, Size { width: 1, height: 17 });
    let middle: Vec<_> = wide.faces().chunks(3).map(|row| row[1]).collect();
    assert_eq!(strip.faces(), middle);
    let one = draw::<f64>(&clip, &faces, Size::square(1));
    assert_eq!(one.pixels.len(), 1);
    assert_eq!(one.faces()[0], draw::<f64>(&clip, &faces, Size::square(3)).faces()[4]);
}

#[test]
fn a_vertex_at_infinity_is_the_limit_of_ones_far_away() {
    let size = Size { width: 12, height: 9 };
    // w = 0: the direction (1, 0.3) of the image plane, at a depth that ends up within the range.
    for at_infinity in [[1.0, 0.3, 0.0, 0.0], [-0.4, 1.0, 0.2, 0.0]] {
        let with = |last: [f64; 4]| vec![[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], last];
        let far = at_infinity.map(|c| c + 0.0);
        let far = [far[0], far[1], far[2], 1e-9];
        let (limit, near) = (
            draw::<f64>(&with(at_infinity), &[[0, 1, 2]], size),
            draw::<f64>(&with(far), &[[0, 1, 2]], size),
        );
        assert!(limit.count() > 10);
        assert_eq!(limit.faces(), near.faces());
        assert_is_the_oracles::<f64>(&with(at_infinity), &[[0, 1, 2]], size, 1e-9);
        assert!(
            gradient::<f64>(&with(at_infinity), &[[0, 1, 2]], size).iter().all(|g| g.is_finite())
        );
    }
    // Two such vertices: a half-plane's wedge.
    let clip = vec![[0.05, 0.05, 0.0, 1.0], [1.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.0, 0.0]];
    assert_is_the_oracles::<f64>(&clip, &[[0, 1, 2]], size, 1e-9);
    assert!(draw::<f32>(&clip, &[[0, 1, 2]], size).count() > 10);
}

#[test]
fn weights_stay_between_zero_and_one_for_w_over_twelve_orders() {
    let size = Size { width: 64, height: 48 };
    let ndc = [[-0.8, -0.9], [0.9, -0.6], [0.0, 0.95]];
    let clip: Clip =
        ndc.iter().zip([1e-6, 1.0, 1e6]).map(|([x, y], w)| [x * w, y * w, 0.2 * w, w]).collect();
    for drawn in [draw::<f64>(&clip, &[[0, 1, 2]], size), draw::<f32>(&clip, &[[0, 1, 2]], size)] {
        assert!(drawn.count() > 500);
        for seen in drawn.pixels.iter().flatten() {
            let [u, v] = seen.uv;
            assert!(
                [u, v, 1.0 - u - v].iter().all(|weight| (-1e-7..=1.0).contains(weight)),
                "{seen:?}"
            );
            approx::assert_relative_eq!(seen.depth, 0.2, max_relative = 1e-6);
        }
    }
}

#[test]
fn depth_stays_within_its_range_and_a_plane_cut_by_it_shows_its_visible_part() {
    // From in front of the near plane to behind the far plane: z / w = 2 y, visible for |y| <= 1/2.
    let size = Size { width: 8, height: 32 };
    let clip = vec![[-1.0, -1.0, -2.0, 1.0], [3.0, -1.0, -2.0, 1.0], [-1.0, 3.0, 6.0, 1.0]];
    for drawn in [draw::<f64>(&clip, &[[0, 1, 2]], size), draw::<f32>(&clip, &[[0, 1, 2]], size)] {
        for (pixel, seen) in drawn.pixels.iter().enumerate() {
            let y = 1.0 - (2.0 * (pixel / 8) as f64 + 1.0) / 32.0;
            assert_eq!(seen.is_some(), y.abs() <= 0.5, "pixel {pixel}");
            if let Some(seen) = seen {
                assert!((-1.0..=1.0).contains(&seen.depth));
                approx::assert_relative_eq!(seen.depth, 2.0 * y, epsilon = 1e-6);
            }
        }
    }
    // A face in the near plane itself is visible.
    let clip: Clip = clip.iter().map(|&[x, y, _, w]| [x, y, -w, w]).collect();
    assert_eq!(draw::<f32>(&clip, &[[0, 1, 2]], size).count(), size.pixels());
}

#[test]
fn a_mesh_without_faces_is_background() {
    let drawn = draw::<f32>(&vec![[0.0, 0.0, 0.0, 1.0]], &[], WIDE);
    assert_eq!((drawn.count(), drawn.culled), (0, Culled::default()));
    assert_eq!(gradient::<f32>(&vec![[0.0, 0.0, 0.0, 1.0]], &[], WIDE), [0.0; 4]);
}

/// A quadrilateral of whole numbers times `unit`: exact down to the smallest number there is.
fn whole_numbers(unit: f64) -> Clip {
    let whole = [
        [-60.0, -50.0, 3.0, 64.0],
        [61.0, -40.0, -5.0, 64.0],
        [30.0, 55.0, 7.0, 60.0],
        [-40.0, 44.0, -9.0, 48.0],
    ];
    whole.iter().map(|vertex| vertex.map(|c| c * unit)).collect()
}

#[test]
fn a_gradient_beyond_the_range_of_the_numbers_is_infinite_and_not_nan() {
    // In every row both faces are seen, so there are several runs, with terms of either sign.
    let faces = [[0, 1, 2], [0, 2, 3]];
    let single = gradient::<f32>(&whole_numbers(f64::from(f32::from_bits(1))), &faces, WIDE);
    let double = gradient::<f64>(&whole_numbers(f64::from_bits(1)), &faces, WIDE);
    for bars in [single, double] {
        assert!(bars.iter().any(|bar| bar.is_infinite()));
        assert!(bars.iter().all(|bar| !bar.is_nan()), "{bars:?}");
    }
}

#[test]
fn an_edge_on_pixel_centres_is_cut_by_the_near_and_the_far_plane_too() {
    // z / w = x / 4 in pixels from the middle, exactly; the upper side, on centres, is the face's.
    let size = Size::square(16);
    let px = [(-8.0, 4.5), (40.0, 4.5), (-8.0, 40.0)];
    let clip: Clip = px
        .iter()
        .map(|&(x, y)| {
            let [x_clip, y_clip, ..] = at_px(size, x, y);
            [x_clip, y_clip, (x - 8.5) / 4.0, 1.0]
        })
        .collect();
    for drawn in [draw::<f64>(&clip, &[[0, 1, 2]], size), draw::<f32>(&clip, &[[0, 1, 2]], size)] {
        for row in [4, 5] {
            let seen = drawn.pixels[16 * row..][..16].iter().map(Option::is_some);
            // Both ends of the range are in it.
            assert!(seen.eq((0..16).map(|column| (4..=12).contains(&column))), "row {row}");
        }
    }
}

#[test]
fn weights_on_edges_through_pixel_centres_are_not_negative() {
    let size = Size::square(16);
    // Sides along a row and along a column of centres, from a point that is off by rounding.
    for k in 0..200 {
        let (near, far) = (0.037 * f64::from(k), 30.0 + 0.1 * f64::from(k));
        for clip in [
            vec![at_px(size, near, 6.5), at_px(size, far, 6.5), at_px(size, 3.0, 40.0)],
            vec![at_px(size, 6.5, near), at_px(size, 6.5, far), at_px(size, 40.0, 3.0)],
        ] {
            for face in orders([0, 1, 2]) {
                for seen in draw::<f64>(&clip, &[face], size).pixels.iter().flatten() {
                    assert!(seen.uv.iter().all(|weight| (0.0..=1.0).contains(weight)), "{seen:?}");
                }
            }
        }
    }
}
