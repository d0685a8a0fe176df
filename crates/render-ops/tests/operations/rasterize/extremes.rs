//! Extreme cases beside those of the catalogue.

use super::*;

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

#[test]
fn weights_on_edges_through_pixel_centres_are_not_negative_in_any_band() {
    // Bands of eight rows.
    let size = Size { width: 2048, height: 40 };
    let mut clip = Clip::new();
    for band in 0..5 {
        for k in 0..60 {
            let (x, y) = (30.0 * f64::from(k), 8.0 * f64::from(band));
            // None in the first band.
            let along = if band == 0 { y + 1.7 } else { y + 1.5 };
            let (near, far) = (x + 0.037 * f64::from(k), x + 25.0);
            let face = [[near, along], [far, along], [x + 3.0, y + 7.9]];
            clip.extend(face.map(|[x, y]| at_px(size, x, y)));
        }
    }
    let turned = |k: u32| [0, 1, 2].map(|i| 3 * k + (i + k) % 3);
    let faces: Vec<_> = (0..clip.len() as u32 / 3).map(turned).collect();
    for seen in draw::<f64>(&clip, &faces, size).pixels.iter().flatten() {
        assert!(seen.uv.iter().all(|weight| (0.0..=1.0).contains(weight)), "{seen:?}");
    }
}
