//! Faces without area or nearly so, faces that share edges and vertices, faces that hide one another.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Cull, Size, antialias_image, rasterize};

use crate::clip_scene::{ClipScene, many_faces, not_finite, orders};
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{largest, numbers, rounding};
use crate::oracle::{GridScene, STEPS};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    4 "repeated index in a face", "culled and counted", repeated_index;
    14 "collinear vertices", "no pixels, zero gradients", collinear;
    15 "sliver of 1e-7 px", "finite", narrow_sliver;
    16 "sliver through pixel centres", "finite, the centres it has", sliver_through_centers;
    17 "face between pixel centres", "no pixels", between_centers;
    18 "vertex on a pixel centre", "drawn once over a fan", vertex_on_center;
    19 "shared edge on pixel centres", "exactly once, all windings", shared_edge;
    20 "grid of quads", "no hole", grid_of_quads;
    21 "fan of 512 faces", "each pixel once", fan_of_512;
    22 "T-junction", "a gap of at most 1 px", t_junction;
    26 "identical faces", "the lower index", identical_faces;
    27 "depths within one ulp", "the same for any number of threads", depths_within_one_ulp;
    28 "crossing faces", "image right, missing gradient documented", crossing_faces;
    29 "back faces", "by flag", back_faces;
    49 "1e6 faces in one pixel", "the nearest, within the time limit", many_faces_in_a_pixel;
};

/// How many pixels are not covered as often as in whole numbers.
fn wrong_layers<T: Scalar>(scene: &GridScene) -> Result<usize, Failure> {
    let layers = scene.scene().layers::<T>()?;
    Ok(layers.iter().zip(scene.layers()).filter(|(found, expected)| **found != *expected).count())
}

fn repeated_index<T: Scalar>() -> Outcome {
    let points = [[0.7, 0.9], [7.8, 1.3], [4.2, 6.4]];
    let alone = ClipScene::from_px(&points, &[[0, 1, 2]], Size::square(8));
    let with = alone.with_faces(&[[0, 0, 1], [0, 1, 2], [2, 1, 2], [1, 1, 1]]);
    let (drawn, expected) = (with.draw::<T>()?, alone.draw::<T>()?);
    let mut wrong = drawn
        .pixels
        .iter()
        .zip(&expected.pixels)
        .filter(|(a, b)| a.map(|a| a.uv) != b.map(|b| b.uv))
        .count();
    wrong += drawn.culled.degenerate.abs_diff(3);
    wrong += usize::from(with.rendered::<T>(None)? != alone.rendered::<T>(None)?);
    let nothing = alone.with_faces(&[[0, 0, 1]]);
    let bars = nothing.rendered::<T>(None)?.clip_bar;
    wrong += nothing.draw::<T>()?.count() + bars.iter().filter(|&&bar| bar != 0.0).count();
    Ok(Verdict::exactly("not drawn, 3 counted; the image and gradients of the others", wrong))
}

fn collinear<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    let mut wrong = 0;
    // Through pixel centres, and beside them at points that are no fractions of two.
    for points in [
        [[0.5, 0.5], [3.5, 3.5], [7.5, 7.5]],
        [[1.0, 2.5], [6.0, 2.5], [3.0, 2.5]],
        [[0.1, 0.4], [2.1, 1.4], [6.1, 3.4]],
        [[3.3, 3.3], [3.3, 3.3], [7.0, 1.0]],
        [[4.4, 4.4], [4.4, 4.4], [4.4, 4.4]],
    ] {
        for order in orders([0, 1, 2]) {
            let scene = ClipScene::from_px(&points, &[order], size);
            let drawn = scene.draw::<T>()?;
            // In rounded numbers three points may be a sliver; it must not cover anything.
            wrong += drawn.count();
            let is_exact = rounding::<T>() < 1e-10;
            wrong += usize::from(is_exact && drawn.culled.degenerate != 1);
            let rendered = scene.rendered::<T>(None)?;
            let bars = rendered.clip_bar.iter().chain(&rendered.color_bar);
            wrong += bars.filter(|&&bar| bar != 0.0).count();
        }
    }
    let exact = ClipScene::from_px(&[[0.5, 0.5], [3.5, 3.5], [7.5, 7.5]], &[[0, 1, 2]], size);
    wrong += usize::from(exact.draw::<T>()?.culled.degenerate != 1);
    Ok(Verdict::exactly("no pixels, zero gradients", wrong))
}

fn narrow_sliver<T: Scalar>() -> Outcome {
    // 2^-23 px wide: coordinates as near to the image's middle as that are exact in f32.
    let size = Size::square(9);
    let half = f64::powi(2.0, -24) / 9.0 * 2.0;
    let mut wrong = 0;
    let mut count = 0;
    for across in [false, true] {
        for order in orders([0, 1, 2]) {
            let points = [[-half, -0.875], [half, -0.875], [0.0, 0.875]];
            let place = |[x, y]: [f64; 2]| if across { [y, x, 0.0, 1.0] } else { [x, y, 0.0, 1.0] };
            let scene = ClipScene::new(&points.map(place), &[order], size);
            // The centres of the middle line at -8/9, -6/9, ..., 8/9: all but the outer two.
            let line =
                |pixel: usize| if across { (pixel / 9, pixel % 9) } else { (pixel % 9, pixel / 9) };
            let covered: Vec<_> = (0..81)
                .map(|pixel| line(pixel).0 == 4 && (1..8).contains(&line(pixel).1))
                .collect();
            let drawn = scene.draw::<T>()?;
            wrong += drawn.differs_from(&covered) + not_finite::<T>(&scene)?;
            wrong += usize::from(
                drawn
                    .pixels
                    .iter()
                    .flatten()
                    .any(|seen| seen.uv.iter().any(|weight| !(0.0..=1.0).contains(weight))),
            );
            count += drawn.count();
        }
    }
    Ok(Verdict::exactly(format!("{count} fragments, as they should be; finite gradients"), wrong))
}

fn sliver_through_centers<T: Scalar>() -> Outcome {
    let center = |column: i64| column * STEPS + STEPS / 2;
    let mut wrong = 0;
    for third in
        [[center(9), center(9) + 1], [center(3) + 1, center(3)], [center(12), center(12) - 1]]
    {
        for order in orders([0, 1, 2]) {
            let points = vec![[center(0), center(0)], [center(15), center(15)], third];
            let scene = GridScene { points, faces: vec![order], size: Size::square(16) };
            wrong += wrong_layers::<T>(&scene)? + not_finite::<T>(&scene.scene())?;
            let drawn = scene.scene().draw::<T>()?;
            let mut weights = drawn.pixels.iter().flatten().flat_map(|seen| seen.uv);
            wrong += usize::from(!weights.all(|weight| (0.0..=1.0).contains(&weight)));
        }
    }
    Ok(Verdict::exactly("the centres that the rule for edges gives it; finite gradients", wrong))
}

fn between_centers<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for order in orders([0, 1, 2]) {
        let points = [[2.6, 3.6], [3.4, 3.6], [3.0, 4.4]];
        let scene = ClipScene::from_px(&points, &[order], Size::square(8));
        let drawn = scene.draw::<T>()?;
        let bars = scene.rendered::<T>(None)?.clip_bar;
        wrong += drawn.count() + drawn.culled.degenerate;
        wrong += bars.iter().filter(|&&bar| bar != 0.0).count();
    }
    Ok(Verdict::exactly("no pixels, zero gradients", wrong))
}

/// A fan of `count` faces around `center`, on the grid.
fn fan(center: [i64; 2], radius: f64, count: u32, size: Size) -> GridScene {
    let mut points = vec![center];
    points.extend((0..count).map(|k| {
        let angle = f64::from(k) / f64::from(count) * std::f64::consts::TAU;
        [(angle.cos(), 0), (angle.sin(), 1)]
            .map(|(share, axis)| center[axis] + (radius * STEPS as f64 * share).round() as i64)
    }));
    let faces = (0..count).map(|k| {
        let face = [0, 1 + k, 1 + (k + 1) % count];
        orders(face)[k as usize % 6]
    });
    GridScene { points, faces: faces.collect(), size }
}

/// How many pixels of a fan are not covered exactly once, or as in whole numbers.
fn wrong_in_fan<T: Scalar>(fan: &GridScene) -> Result<usize, Failure> {
    let layers = fan.scene().layers::<T>()?;
    Ok(wrong_layers::<T>(fan)? + layers.iter().filter(|&&count| count > 1).count())
}

fn vertex_on_center<T: Scalar>() -> Outcome {
    let center = 8 * STEPS + STEPS / 2;
    let mut wrong = 0;
    for count in [3, 4, 5, 8, 13] {
        let fan = fan([center, center], 6.3, count, Size::square(16));
        wrong += wrong_in_fan::<T>(&fan)?;
        wrong += usize::from(fan.scene().layers::<T>()?[8 * 16 + 8] != 1);
    }
    Ok(Verdict::exactly("the centre belongs to one face of the fan", wrong))
}

fn fan_of_512<T: Scalar>() -> Outcome {
    let size = Size::square(64);
    let mut wrong = 0;
    for offset in [0, STEPS / 2, 21] {
        let center = [32 * STEPS + offset, 31 * STEPS + offset];
        let whole = fan(center, 28.0, 512, size);
        wrong += wrong_in_fan::<T>(&whole)?;
        let all = whole.scene().draw::<T>()?;
        wrong += all.differs_from(&whole.covered());
    }
    // Far beyond the image, with corners that are rounded.
    let size = Size { width: 10, height: 14 };
    for count in [5, 64, 512_u32] {
        for center in [[4.5, 6.5], [4.5, 6.25], [5.3, 7.1]] {
            let corner = |k: u32| {
                let angle = f64::from(k) * std::f64::consts::TAU / f64::from(count);
                [center[0] + 40.0 * angle.cos(), center[1] + 40.0 * angle.sin()]
            };
            let points: Vec<_> = [center].into_iter().chain((0..count).map(corner)).collect();
            let face = |k: u32| orders([0, 1 + k, 1 + (k + 1) % count])[k as usize % 6];
            let faces: Vec<_> = (0..count).map(face).collect();
            let layers = ClipScene::from_px(&points, &faces, size).layers::<T>()?;
            wrong += layers.iter().filter(|&&count| count != 1).count();
        }
    }
    Ok(Verdict::exactly("each pixel once", wrong))
}

fn shared_edge<T: Scalar>() -> Outcome {
    let at = |x: i64, y: i64| [x * STEPS + STEPS / 2, y * STEPS + STEPS / 2];
    // Quadrilaterals whose diagonal runs along pixel centres: level, upright, sloped.
    let quads = [
        [at(1, 3), at(4, 1), at(7, 3), at(4, 6)],
        [at(3, 1), at(6, 4), at(3, 7), at(1, 4)],
        [at(1, 1), at(6, 1), at(6, 6), at(1, 6)],
        [at(6, 1), at(6, 6), at(1, 6), at(1, 1)],
        [at(0, 2), at(5, 0), at(6, 5), at(2, 7)],
    ];
    let mut wrong = 0;
    for points in quads {
        for first in orders([0, 1, 2]) {
            for second in orders([0, 2, 3]) {
                let faces = vec![first, second];
                let scene = GridScene { points: points.to_vec(), faces, size: Size::square(8) };
                wrong += wrong_layers::<T>(&scene)?;
                wrong += scene.scene().layers::<T>()?.iter().filter(|&&count| count > 1).count();
            }
        }
    }
    Ok(Verdict::exactly("each pixel once, for 36 windings and orders of 5 pairs", wrong))
}

fn grid_of_quads<T: Scalar>() -> Outcome {
    // Lines on pixel centres, and lines that bend at points which no f32 or f64 rounds.
    let mut wrong = 0;
    for bend in [0, 11] {
        let (columns, rows) = (8_i64, 8_i64);
        let mut points = Vec::new();
        for row in 0..=rows {
            for column in 0..=columns {
                let inner = (1..columns).contains(&column) && (1..rows).contains(&row);
                let shift = if inner { bend * ((3 * row + 5 * column) % 7 - 3) } else { 0 };
                let place =
                    |k: i64| (2 * k - 1).max(0) * STEPS + if k == 0 { 0 } else { STEPS / 2 };
                points.push([place(column) + shift, place(row) - shift]);
            }
        }
        let mut faces = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let corner = |r: i64, c: i64| ((row + r) * (columns + 1) + column + c) as u32;
                let [a, b, c, d] = [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)];
                let pair = if (row + column) % 2 == 0 {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, b, d], [d, b, c]]
                };
                faces.extend(
                    pair.iter().zip([row, column]).map(|(&face, k)| orders(face)[k as usize % 6]),
                );
            }
        }
        let scene = GridScene { points, faces, size: Size::square(16) };
        let layers = scene.scene().layers::<T>()?;
        wrong += wrong_layers::<T>(&scene)?;
        // No hole and no double: the border is at the centres of the last row and column.
        let inside = |pixel: usize| pixel % 16 < 15 && pixel / 16 < 15;
        let counts = layers.iter().enumerate().filter(|&(pixel, _)| inside(pixel));
        wrong += counts.filter(|&(_, &count)| count != 1).count();
    }
    Ok(Verdict::exactly("no hole, no pixel twice", wrong))
}

fn t_junction<T: Scalar>() -> Outcome {
    // An edge with a vertex on its other side alone, which rounding puts beside it. Some of the
    // edges go through pixel centres: there the least bend decides whether a centre is covered.
    let size = Size::square(64);
    let mut edges = Vec::new();
    for k in 0..4 {
        edges.push([[1.0 + 0.1 * f64::from(k), 1.3], [62.9, 30.0 + 7.7 * f64::from(k)]]);
        edges.push([[0.5, 2.5 + f64::from(k)], [60.5, 22.5 + f64::from(k)]]);
        edges.push([[0.5, 42.5 + f64::from(k)], [60.5, 12.5 + f64::from(k)]]);
    }
    let (mut largest_gap, mut missing, mut crossings) = (0, 0, 0);
    for ends in edges {
        // None of them divides a side into parts that the numbers hold exactly.
        for share in (1..23).map(|k| f64::from(k) / 23.0) {
            let between =
                [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]));
            // Above and below them quadrilaterals that reach beyond the image.
            let beyond = |end: [f64; 2], x: f64, y: f64| [end[0] + x, end[1] + y];
            let [high, other_high] = [beyond(ends[0], -3.0, -90.0), beyond(ends[1], 3.0, -90.0)];
            let [low, other_low] = [beyond(ends[0], -3.0, 90.0), beyond(ends[1], 3.0, 90.0)];
            let points = [ends[0], ends[1], between, high, other_high, low, other_low];
            let faces = [[0, 1, 4], [0, 4, 3], [0, 2, 5], [2, 1, 6], [2, 6, 5]];
            let drawn = ClipScene::from_px(&points, &faces, size).draw::<T>()?;
            // All of these columns have to be covered; a gap is a run of pixels that are not.
            for column in 2..60 {
                let holes: Vec<_> =
                    (0..64).map(|row| drawn.pixels[row * 64 + column].is_none()).collect();
                let runs = holes.chunk_by(|a, b| a == b).filter(|run| run[0]);
                largest_gap = largest_gap.max(runs.map(<[bool]>::len).max().unwrap_or(0));
                missing += holes.iter().filter(|&&hole| hole).count();
                crossings += 1;
            }
        }
    }
    let outcome = format!("gaps of 1 px at {missing} of {crossings} columns, and no wider ones");
    Ok(Verdict::within(outcome, largest_gap as f64, 1.0)
        .and(missing > 0, "no gap was met, so nothing is known of them"))
}

fn identical_faces<T: Scalar>() -> Outcome {
    let clip = [[-0.9, -0.8, 0.1, 1.0], [0.8, -0.7, 0.3, 1.2], [0.1, 0.9, -0.2, 0.9]];
    let mut wrong = 0;
    for first in orders([0, 1, 2]) {
        for second in orders([0, 1, 2]) {
            // The same depths only where the corners are in the same order.
            let exactly = first == second;
            let scene = ClipScene::new(&clip, &[first, second, first], Size::square(9));
            let drawn = scene.draw::<T>()?;
            let seen =
                |face: u32| drawn.pixels.iter().flatten().filter(|seen| seen.face == face).count();
            wrong += seen(2) + if exactly { seen(1) } else { 0 };
            wrong += usize::from(drawn.count() < 20);
        }
    }
    Ok(Verdict::exactly("the one of the lower index, everywhere", wrong))
}

fn depths_within_one_ulp<T: Scalar>() -> Outcome {
    // Layers at 1/2, and at the next number above it.
    let above = 0.5 + rounding::<T>();
    let mut clip = Vec::new();
    let mut faces = Vec::new();
    for layer in 0..6_u32 {
        let z = [0.5, above, 0.5, above, 0.5, 0.5][layer as usize];
        for [x, y] in [[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]] {
            clip.push([x, y, z, 1.0]);
        }
        faces.push([3 * layer, 3 * layer + 1, 3 * layer + 2]);
    }
    faces.swap(0, 1);
    let scene = ClipScene::new(&clip, &faces, Size { width: 160, height: 140 });
    let bits = |threads: usize| -> Result<_, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| Ok((scene.draw::<T>()?, scene.rendered::<T>(Some(1.1))?)))
    };
    let one = bits(1)?;
    let mut wrong = 0;
    for threads in [2, 4, 8] {
        wrong += usize::from(bits(threads)? != one);
    }
    // Face 0 of the list now is the farther one of the first two.
    wrong += one.0.pixels.iter().filter(|seen| seen.is_none_or(|seen| seen.face != 1)).count();
    Ok(Verdict::exactly("the nearer one, bitwise the same for 1, 2, 4 and 8 threads", wrong))
}

fn crossing_faces<T: Scalar>() -> Outcome {
    // z = x / 2 and z = -x / 2 over the whole image: they cross at x = 0, between two columns.
    let corners = [[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]];
    let mut clip = Vec::new();
    for slope in [0.5, -0.5] {
        clip.extend(corners.map(|[x, y]| [x, y, slope * x / 4.0, 1.0]));
    }
    let scene = ClipScene::new(&clip, &[[0, 1, 2], [3, 4, 5]], Size { width: 10, height: 6 });
    let drawn = scene.draw::<T>()?;
    let expected = |pixel: usize| Some(u32::from(pixel % 10 >= 5));
    let wrong = drawn.faces().iter().enumerate().filter(|&(k, &face)| face != expected(k)).count();
    // The line of the crossing is no edge of either face: moving it has no gradient by antialias.
    let tape = Tape::<T>::new();
    let clip = scene.leaf(&tape);
    let fragments = rasterize(clip, &scene.mesh()?, scene.size)?;
    let ids = fragments.coverage.triangle_ids();
    let image = Tensor::from_flat_fn([6, 10, 1], |k| T::from_f64(f64::from(ids[k])));
    let out = antialias_image(tape.constant(&image), &fragments)?;
    let unblended = out.value() == image;
    let bars = numbers(&out.sum().backward()?.get_or_zeros(clip));
    let outcome =
        "the nearer face at each pixel; the crossing itself has no gradient, as documented";
    Ok(Verdict::exactly(outcome, wrong)
        .and(unblended, "pixels are blended across the crossing")
        .and(largest(bars) == 0.0, "the crossing has a gradient, against the documentation"))
}

fn back_faces<T: Scalar>() -> Outcome {
    // Counter-clockwise on the screen is the front.
    let clip = [[-0.8, -0.9, 0.0, 1.0], [0.9, -0.7, 0.0, 1.0], [0.1, 0.8, 0.0, 1.0]];
    let (front, back) = ([0, 1, 2], [0, 2, 1]);
    let mut wrong = 0;
    for (face, cull, is_drawn) in [
        (front, Cull::None, true),
        (back, Cull::None, true),
        (front, Cull::Back, true),
        (back, Cull::Back, false),
        (front, Cull::Front, false),
        (back, Cull::Front, true),
    ] {
        let drawn = ClipScene::new(&clip, &[face], Size::square(8)).draw_culling::<T>(cull)?;
        let whole = ClipScene::new(&clip, &[face], Size::square(8)).draw::<T>()?;
        wrong += usize::from(drawn.culled.facing != usize::from(!is_drawn));
        wrong += if is_drawn { usize::from(drawn != whole) } else { drawn.count() };
    }
    Ok(Verdict::exactly("drawn or counted, as the flag says", wrong))
}

fn many_faces_in_a_pixel<T: Scalar>() -> Outcome {
    let (clip, mesh, nearest, depth) = many_faces::<T>()?;
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&clip);
    let fragments = rasterize(positions, &mesh, Size::square(3))?;
    let coverage = &fragments.coverage;
    let mut wrong = usize::from(!coverage.faces().eq([nearest]) || !coverage.pixels().eq([4]));
    let seen_depth = bokashi_render_ops::depth(&fragments)?;
    // Half that of its third vertex.
    let error = (seen_depth.item().to_f64() - 0.5 * depth).abs();
    let image = tape.leaf(&Tensor::from_flat_fn([3, 3, 1], |k| T::from_f64((k == 4) as u8 as f64)));
    let image = antialias_image(image, &fragments)?;
    wrong += usize::from(!image.value().is_finite());
    let gradients = seen_depth.sum().backward()?;
    let bars = gradients.get_or_zeros(positions);
    let own = 4 * (nearest + 2) + 2;
    let others =
        bars.data()[8..].iter().skip(2).step_by(4).filter(|bar| bar.to_f64() != 0.0).count();
    wrong += usize::from(bars.data()[own].to_f64() != 0.5) + others.abs_diff(1);
    // Only the time limit of a case bounds the time: a search of 1e12 pairs would not end in it.
    Ok(Verdict::within("the nearest one, and its gradient alone", error, 0.0)
        .and(wrong == 0, "another face is seen, or a gradient is wrong"))
}
