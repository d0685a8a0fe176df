//! Edges that antialiasing finds, and those that it must not.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, Size, antialias_image, rasterize};

use crate::clip_scene::{ClipScene, at_px, orders};
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, numbers, rounding};
use crate::oracle::antialiased;

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    30 "edge with three faces", "the stated rule", edge_of_three_faces;
    31 "duplicated vertices", "silhouettes, reported", duplicated_vertices;
    32 "blends on four sides of a pixel", "within the stated bound", blends_on_all_sides;
    33 "edge at exactly 45 degrees", "defined", edge_at_45_degrees;
    34 "crossing exactly half-way", "defined", crossing_half_way;
};

/// What antialiasing makes of an image `[H, W]` of `color(pixel, triangle id)`: the image before,
/// the one after, and the gradient of the sum of its entries with respect to the positions.
struct Antialiased {
    covered: Vec<bool>,
    before: Vec<f64>,
    after: Vec<f64>,
    clip_bar: Vec<f64>,
}

fn antialias_of<T: Scalar>(
    scene: &ClipScene,
    color: impl Fn(usize, u32) -> f64,
) -> Result<Antialiased, Failure> {
    let tape = Tape::<T>::new();
    let clip = scene.leaf(&tape);
    let fragments = rasterize(clip, &scene.mesh()?, scene.size)?;
    let ids = fragments.coverage.triangle_ids();
    let shape = [scene.size.height, scene.size.width, 1];
    let image = tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(color(k, ids[k]))));
    let out = antialias_image(image, &fragments)?;
    Ok(Antialiased {
        covered: ids.iter().map(|&id| id > 0).collect(),
        before: numbers(&image.value()),
        after: numbers(&out.value()),
        clip_bar: numbers(&out.sum().backward()?.get_or_zeros(clip)),
    })
}

/// The largest difference from the paper's text for faces in pixels, in all orders.
fn against_the_text<T: Scalar>(
    faces: &[[[f64; 2]; 3]],
    size: Size,
    bound: f64,
    outcome: &str,
) -> Outcome {
    let (mut error, mut blended, mut finite) = (0.0_f64, 0, true);
    for corners in faces {
        for order in orders([0, 1, 2]) {
            let found =
                antialias_of::<T>(&ClipScene::from_px(corners, &[order], size), |k, _| motley(k))?;
            let expected = antialiased(*corners, &found.covered, &found.before, size);
            error = error.maximum_or_nan(difference(&found.after, &expected));
            let pairs = found.after.iter().zip(&found.before);
            blended += pairs.filter(|(after, before)| after != before).count();
            finite &= found.clip_bar.iter().all(|bar| bar.is_finite());
        }
    }
    Ok(Verdict::within(format!("{blended} blended pixels; {outcome}"), error, bound)
        .and(blended > 0, "nothing was blended")
        .and(finite, "a gradient is not finite"))
}

/// For positions of up to 16 px, rounded to `T`.
fn position_bound<T: Scalar>() -> f64 {
    64.0 * rounding::<T>()
}

/// By how much the pixel at the middle is moved by the blend with each of its neighbours (right,
/// left, below, above), and by all of them where it differs from all by 1.
fn moves_at_the_middle<T: Scalar>(scene: &ClipScene) -> Result<([f64; 4], f64), Failure> {
    let middle = 8 * 3 + 3;
    let move_of = |lit: usize| -> Result<f64, Failure> {
        let found = antialias_of::<T>(scene, |k, _| f64::from(u8::from(k == lit)))?;
        Ok(found.after[middle] - found.before[middle])
    };
    let [right, left] = [move_of(middle + 1)?, move_of(middle - 1)?];
    let [below, above] = [move_of(middle + 8)?, move_of(middle - 8)?];
    Ok(([right, left, below, above], -move_of(middle)?))
}

fn blends_on_all_sides<T: Scalar>() -> Outcome {
    // Points in 1/64 px of an image of 8 x 8 are exact in both precisions, and so are the slopes
    // and the distances here: nothing is rounded but the quotients of shares that add up to more than 1.
    let size = Size::square(8);
    let (mut wrong, mut reach) = (0, 0.0_f64);
    let mut check = |scene: &ClipScene, shares: [f64; 4]| -> Result<(), Failure> {
        let (moves, all) = moves_at_the_middle::<T>(scene)?;
        let sum: f64 = shares.iter().sum();
        let is_off = |(found, share): (&f64, f64)| {
            (found - share / sum.max(1.0)).abs() > rounding::<T>() || share == 0.0
        };
        wrong += usize::from(moves.iter().zip(shares).any(is_off));
        wrong += usize::from((all - sum.min(1.0)).abs() > 4.0 * rounding::<T>());
        reach = reach.maximum_or_nan(all);
        Ok(())
    };
    // One face around the centre: two sides of it cross one line each; the third, at exactly 45
    // degrees, is steep enough for both others. All cross at the distance `d`.
    let mut alone = Vec::new();
    for d in [0.25, 1.0 / 64.0] {
        for [x, y] in [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
            let at = |across: f64, down: f64| [3.5 + x * across, 3.5 + y * down];
            let corners = [at(-d, -d), at(2.0 * d, -d), at(-d, 2.0 * d)];
            for order in orders([0, 1, 2]) {
                check(&ClipScene::from_px(&corners, &[order], size), [0.5 - d; 4])?;
            }
            alone.push(corners);
        }
    }
    // Four faces over the four neighbours, up to the distances `d` from the centre between them.
    let d = [1.0 / 64.0, 1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0];
    let mut points = Vec::new();
    for (d, [x, y]) in d.into_iter().zip([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]) {
        let at =
            |along: f64, across: f64| [3.5 + x * along + y * across, 3.5 + y * along + x * across];
        points.extend([at(d, -0.5), at(d, 0.5), at(3.0, 0.0)]);
    }
    let faces = [[0, 1, 2], [4, 3, 5], [8, 6, 7], [9, 11, 10]];
    check(&ClipScene::from_px(&points, &faces, size), d.map(|d| 0.5 - d))?;

    let stated = "4 blends at the middle, whose shares add up to 1 at most";
    let found = against_the_text::<T>(&alone, size, position_bound::<T>(), stated)?;
    Ok(found
        .and(wrong == 0, format!("{wrong} times the shares or their sum are others"))
        .and((reach - 1.0).abs() < 1e-6, format!("a pixel moved by up to {reach} steps in colour")))
}

/// What becomes of `image`, of 8 x 8 pixels, with a face at the bottom left, or else at the bottom
/// right. The face's edge at 45 degrees goes through the centres of a diagonal. A pixel of the
/// diagonal moves half-way to its left neighbour, and half-way to its neighbour above or below on the
/// same side.
///
/// A centre on an edge counts as a little to the right of it. So the first face covers none of the
/// diagonal: it reaches over from the left and from below, through distances of 1. The other face
/// covers all of the diagonal, and ends there, at distances of 0 to the left and above.
fn through_centers(image: &[f64], is_left: bool) -> Vec<f64> {
    let mut out = image.to_vec();
    for row in 0..8 {
        let column = if is_left { row } else { 7 - row };
        let pixel = 8 * row + column;
        let left = (column > 0).then(|| pixel - 1);
        let other =
            if is_left { (row < 7).then(|| pixel + 8) } else { (row > 0).then(|| pixel - 8) };
        for neighbour in [left, other].into_iter().flatten() {
            out[pixel] += 0.5 * (image[neighbour] - image[pixel]);
        }
    }
    out
}

fn edge_at_45_degrees<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    // Shifts in eighths of a pixel: the slopes are exactly 1 in both precisions.
    let pair = |shift: f64| {
        [
            [[-10.0 + shift, -10.0], [20.0 + shift, 20.0], [-40.0, 21.0]],
            [[18.0 + shift, -10.0], [-12.0 + shift, 20.0], [40.0, 21.0]],
        ]
    };
    // The ties: through the centres, and half-way between them, where no pixel moves.
    let mut error = 0.0_f64;
    for shift in [0.0, 0.5] {
        for (corners, is_left) in pair(shift).into_iter().zip([true, false]) {
            for order in orders([0, 1, 2]) {
                let scene = ClipScene::from_px(&corners, &[order], size);
                let found = antialias_of::<T>(&scene, |k, _| motley(k))?;
                let covers = |k: usize| {
                    let (row, column) = (k / 8, k % 8);
                    match (is_left, shift == 0.0) {
                        (true, true) => column < row,
                        (true, false) => column <= row,
                        (false, true) => column + row >= 7,
                        (false, false) => column + row >= 8,
                    }
                };
                let covered: Vec<_> = (0..64).map(covers).collect();
                let expected = match shift == 0.0 {
                    true => through_centers(&found.before, is_left),
                    false => found.before.clone(),
                };
                error = error.maximum_or_nan(difference(&found.after, &expected));
                error = error.maximum_or_nan(if found.covered == covered { 0.0 } else { 1.0 });
            }
        }
    }
    let shifts = [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];
    let faces: Vec<_> = shifts.into_iter().flat_map(pair).collect();
    let outcome = "each by the pair's rule; through centres and half-way as worked out";
    let found = against_the_text::<T>(&faces, size, position_bound::<T>(), outcome)?;
    // Three numbers of up to 1 are added: each sum is rounded once.
    Ok(found.and(error <= 4.0 * rounding::<T>(), format!("the ties are off by {error:.1e}")))
}

fn crossing_half_way<T: Scalar>() -> Outcome {
    let size = Size { width: 8, height: 4 };
    let mut error = 0.0_f64;
    let mut moved = 0.0_f64;
    for (sign, far) in [(1.0, -200.0), (-1.0, 200.0)] {
        for order in orders([0, 1, 2]) {
            let points = [[4.0, -300.0], [4.0, 300.0], [far, 3.0]];
            let scene = ClipScene::from_px(&points, &[order], size);
            let found = antialias_of::<T>(&scene, |_, id| f64::from(id))?;
            error = error.maximum_or_nan(difference(&found.after, &found.before));
            // A step to the right covers 4 rows of W / 2 pixels more, or less.
            let slope = found.clip_bar[0] + found.clip_bar[4];
            moved = moved.maximum_or_nan((slope - sign * 16.0).abs());
        }
    }
    let bound = 64.0 * rounding::<T>();
    Ok(Verdict::within(
        "no pixel moves, and the gradient is the area's, 16",
        error.maximum_or_nan(moved),
        16.0 * bound,
    ))
}

fn edge_of_three_faces<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    let alone = ClipScene::from_px(&[[4.3, -30.0], [4.4, 30.0], [-20.0, 3.0]], &[[0, 1, 2]], size);
    let mut three = alone.clone();
    // Behind the first face, where they are not seen.
    for x in [-2.0, -5.0] {
        let [x, y, ..] = at_px(size, x, 3.5);
        three.clip.push([x, y, 0.5, 1.0]);
    }
    three.faces = vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]];
    let mesh = three.mesh()?;
    let adjacency = mesh.adjacency();
    let mut wrong = usize::from(adjacency.crowded_edges() != 1);
    wrong += usize::from(adjacency.boundary_edges() != 6);
    wrong += (0..3).filter(|&face| adjacency.across(face, 2).is_some()).count();
    let color = |k: usize, id: u32| motley(k) + f64::from(id.min(1));
    let (found, expected) = (antialias_of::<T>(&three, color)?, antialias_of::<T>(&alone, color)?);
    let error = difference(&found.after, &expected.after);
    let blended = difference(&found.after, &found.before) > 0.0;
    Ok(Verdict::within("joins none of them, counted as crowded; blends as a boundary", error, 0.0)
        .and(wrong == 0, "adjacency does not follow the rule")
        .and(blended, "the edge is not blended"))
}

fn duplicated_vertices<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    let points =
        [[-9.0, -9.0], [20.0, -8.0], [22.0, 18.0], [-8.0, 15.0], [-9.0, -9.0], [22.0, 18.0]];
    let shared = ClipScene::from_px(&points, &[[0, 1, 2], [0, 2, 3]], size);
    let split = shared.with_faces(&[[0, 1, 2], [4, 5, 3]]);
    let edges = |scene: &ClipScene| -> Result<usize, Failure> {
        let mesh: Mesh = scene.mesh()?;
        Ok(mesh.adjacency().boundary_edges())
    };
    let (whole, seam) = (edges(&shared)?, edges(&split)?);
    let one = antialias_of::<T>(&shared, |k, _| motley(k))?;
    let other = antialias_of::<T>(&split, |k, _| motley(k))?;
    let same = antialias_of::<T>(&split, |_, _| 0.7)?;
    // On a surface of one colour the seam does not show.
    let error = difference(&same.after, &same.before).maximum_or_nan(largest(same.clip_bar));
    Ok(Verdict::within(
        "the seam blends as a silhouette; 6 boundary edges reported, not 4",
        error,
        0.0,
    )
    .and((whole, seam) == (4, 6), format!("{whole} and {seam} boundary edges"))
    .and(one.after == one.before, "the shared edge is blended")
    .and(other.after != other.before, "the seam is not blended"))
}
