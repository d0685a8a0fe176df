//! Edges that antialiasing finds, and those that it must not.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, Size, antialias, rasterize};

use super::oracle::antialiased;
use super::row::{Failure, Found, Outcome};
use super::scene::{Scene, difference, largest, motley, numbers, orders, rounding};

/// What antialiasing makes of an image `[H, W]` of `color(pixel, triangle id)`: the image before,
/// the one after, and the gradient of the sum of its entries with respect to the positions.
struct Antialiased {
    covered: Vec<bool>,
    before: Vec<f64>,
    after: Vec<f64>,
    clip_bar: Vec<f64>,
}

fn antialias_of<T: Scalar>(
    scene: &Scene,
    color: impl Fn(usize, u32) -> f64,
) -> Result<Antialiased, Failure> {
    let tape = Tape::<T>::new();
    let clip = scene.leaf(&tape);
    let fragments = rasterize(clip, &scene.mesh()?, scene.size)?;
    let ids = fragments.coverage.triangle_ids();
    let shape = [scene.size.height, scene.size.width, 1];
    let image = tape.leaf(&Tensor::from_fn(shape, |k| T::from_f64(color(k, ids[k]))));
    let out = antialias(image, &fragments, clip)?;
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
                antialias_of::<T>(&Scene::of_px(corners, &[order], size), |k, _| motley(k))?;
            let expected = antialiased(*corners, &found.covered, &found.before, size);
            error = error.greater(difference(&found.after, &expected));
            let pairs = found.after.iter().zip(&found.before);
            blended += pairs.filter(|(after, before)| after != before).count();
            finite &= found.clip_bar.iter().all(|bar| bar.is_finite());
        }
    }
    Ok(Found::within(format!("{blended} blended pixels; {outcome}"), error, bound)
        .and(blended > 0, "nothing was blended")
        .and(finite, "a gradient is not finite"))
}

/// For positions of up to 16 px, rounded to `T`.
fn position_bound<T: Scalar>() -> f64 {
    64.0 * rounding::<T>()
}

pub(super) fn blends_on_all_sides<T: Scalar>() -> Outcome {
    // Around one pixel centre, at distances below 1/2 to the right and left, above and below.
    let faces = [
        [[3.1, 3.2], [3.95, 3.3], [3.55, 4.0]],
        [[3.2, 3.9], [3.5, 3.05], [3.8, 3.9]],
        [[3.4, 3.4], [3.7, 3.45], [3.5, 3.72]],
    ];
    let size = Size::square(7);
    let mut reach = 0.0_f64;
    for corners in &faces {
        let scene = Scene::of_px(corners, &[[0, 1, 2]], size);
        let found = antialias_of::<T>(&scene, |k, _| f64::from(u8::from(k == 24)))?;
        reach = reach.greater(difference(&found.after, &found.before));
    }
    let stated = "each share at most 1/2, four of them at most 2 steps in colour";
    let found = against_the_text::<T>(&faces, size, position_bound::<T>(), stated)?;
    Ok(found.and(reach <= 2.0, format!("a pixel moved by {reach} steps in colour")))
}

pub(super) fn edge_at_45_degrees<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    // Shifts in eighths of a pixel: the slopes are exactly 1 in both precisions. Not those that
    // put the edge through a centre, or half-way, where rounding decides what straddles.
    let faces: Vec<_> = [0.125, 0.25, 0.375, 0.625, 0.75, 0.875]
        .into_iter()
        .flat_map(|shift| {
            [
                [[-10.0 + shift, -10.0], [20.0 + shift, 20.0], [-40.0, 21.0]],
                [[18.0 + shift, -10.0], [-12.0 + shift, 20.0], [40.0, 21.0]],
            ]
        })
        .collect();
    against_the_text::<T>(&faces, size, position_bound::<T>(), "each by the pair's rule")
}

pub(super) fn crossing_half_way<T: Scalar>() -> Outcome {
    let size = Size { width: 8, height: 4 };
    let mut error = 0.0_f64;
    let mut moved = 0.0_f64;
    for (sign, far) in [(1.0, -200.0), (-1.0, 200.0)] {
        for order in orders([0, 1, 2]) {
            let points = [[4.0, -300.0], [4.0, 300.0], [far, 3.0]];
            let scene = Scene::of_px(&points, &[order], size);
            let found = antialias_of::<T>(&scene, |_, id| f64::from(id))?;
            error = error.greater(difference(&found.after, &found.before));
            // A step to the right covers 4 rows of W / 2 pixels more, or less.
            let slope = found.clip_bar[0] + found.clip_bar[4];
            moved = moved.greater((slope - sign * 16.0).abs());
        }
    }
    let bound = 64.0 * rounding::<T>();
    Ok(Found::within(
        "no pixel moves, and the gradient is the area's, 16",
        error.greater(moved),
        16.0 * bound,
    ))
}

pub(super) fn edge_of_three_faces<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    let alone = Scene::of_px(&[[4.3, -30.0], [4.4, 30.0], [-20.0, 3.0]], &[[0, 1, 2]], size);
    let mut three = alone.clone();
    // Behind the first face, where they are not seen.
    for x in [-2.0, -5.0] {
        let [x, y, ..] = super::scene::at_px(size, x, 3.5);
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
    Ok(Found::within("joins none of them, counted as crowded; blends as a boundary", error, 0.0)
        .and(wrong == 0, "adjacency does not follow the rule")
        .and(blended, "the edge is not blended"))
}

pub(super) fn duplicated_vertices<T: Scalar>() -> Outcome {
    let size = Size::square(8);
    let points =
        [[-9.0, -9.0], [20.0, -8.0], [22.0, 18.0], [-8.0, 15.0], [-9.0, -9.0], [22.0, 18.0]];
    let shared = Scene::of_px(&points, &[[0, 1, 2], [0, 2, 3]], size);
    let split = shared.with_faces(&[[0, 1, 2], [4, 5, 3]]);
    let edges = |scene: &Scene| -> Result<usize, Failure> {
        let mesh: Mesh = scene.mesh()?;
        Ok(mesh.adjacency().boundary_edges())
    };
    let (whole, seam) = (edges(&shared)?, edges(&split)?);
    let one = antialias_of::<T>(&shared, |k, _| motley(k))?;
    let other = antialias_of::<T>(&split, |k, _| motley(k))?;
    let same = antialias_of::<T>(&split, |_, _| 0.7)?;
    // On a surface of one colour the seam does not show.
    let error = difference(&same.after, &same.before).greater(largest(same.clip_bar));
    Ok(Found::within(
        "the seam blends as a silhouette; 6 boundary edges reported, not 4",
        error,
        0.0,
    )
    .and((whole, seam) == (4, 6), format!("{whole} and {seam} boundary edges"))
    .and(one.after == one.before, "the shared edge is blended")
    .and(other.after != other.before, "the seam is not blended"))
}
