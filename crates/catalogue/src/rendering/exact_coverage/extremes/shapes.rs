//! Shapes of faces and meshes, and where they lie in the pixels.

use bokashi_core::Scalar;
use bokashi_render_ops::{Cull, Size};

use super::{Checked, Picture, SIZE, options, parts_bound};
use crate::areas::visible_areas;
use crate::clip_scene::{ClipScene, at_px, orders};
use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    72 "exact: slivers", "their areas, finite", slivers;
    73 "exact: along pixel borders", "the areas, the whole's slope", on_pixel_borders;
    74 "exact: fans of up to 512 faces", "each pixel once", fans;
    75 "exact: T-junction", "a gap as wide as rounding", t_junction;
    81 "exact: mesh within a pixel", "its area and slope", smaller_than_a_pixel;
    82 "exact: face that turns edge-on", "area to 0, finite", turning_edge_on;
    83 "exact: seams on every edge", "what is covered stays", seams_everywhere;
    84 "exact: images of 1 x N and 1 x 1", "areas and slopes", strips_and_single_pixels;
    86 "exact: back faces, loose edges", "by flag; nothing hidden", sides_and_edges;
};

fn slivers<T: Scalar>() -> Outcome {
    // 2^-23 px wide; from corner to corner; between pixel centres; none of them needs a centre.
    let half = f64::powi(2.0, -24) / 7.0 * 2.0;
    let narrow = [[-half, -0.875, 0.0, 1.0], [half, -0.875, 0.0, 1.0], [0.0, 0.875, 0.0, 1.0]];
    let mut checked = Checked::default();
    for order in orders([0, 1, 2]) {
        checked.add::<T>(&ClipScene::new(&narrow, &[order], SIZE), false)?;
        let points = [[0.4, 0.3], [6.6, 5.4], [6.6, 5.42]];
        checked.add::<T>(&ClipScene::from_px(&points, &[order], SIZE), true)?;
        let points = [[2.6, 3.6], [3.4, 3.6], [3.0, 4.4]];
        checked.add::<T>(&ClipScene::from_px(&points, &[order], SIZE), true)?;
    }
    let area = visible_areas(&narrow, &[[0, 1, 2]], SIZE, [3, 3])[0];
    let found =
        Picture::new::<T>(&ClipScene::new(&narrow, &[[0, 1, 2]], SIZE))?.covered()[3 * 7 + 3];
    let off = (found / area - 1.0).abs();
    Ok(checked
        .verdict::<T>("each sliver with its area", 1e-13)
        .and(off < 1e-6, format!("an area of {area:.1e} px is off by {off:.1e} of it")))
}

fn on_pixel_borders<T: Scalar>() -> Outcome {
    // Sides along borders, corners on corners and on borders; of 8 x 8 pixels all is exact.
    let size = Size::square(8);
    let (mut checked, mut steps) = (Checked::default(), 0.0_f64);
    for points in [
        [[2.0, 1.0], [6.0, 1.0], [2.0, 5.0]],
        [[1.0, 4.0], [7.0, 4.0], [4.0, 7.0]],
        [[3.0, 2.0], [3.0, 6.0], [7.0, 4.0]],
        [[3.0, 2.5], [5.5, 6.0], [1.25, 5.0]],
        [[3.0, 3.0], [4.0, 3.0], [3.0, 4.0]],
    ] {
        for order in orders([0, 1, 2]) {
            let scene = ClipScene::from_px(&points, &[order], size);
            checked.add::<T>(&scene, false)?;
            // The whole area's slope, whichever pixels its sides are in: a side from p to q, moved
            // by the mean of its ends, covers q_y - p_y more. One along a border counts half in each of
            // its pixels.
            let is_area = |k: usize| f64::from(u8::from(k % 3 == 2));
            let found = Picture::with::<T>(&scene, scene.mesh()?, options(size), is_area)?;
            let side = |p: [f64; 2], q: [f64; 2]| q[1] - p[1];
            let [a, b, c] = points;
            let turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            for (k, [p, q, r]) in [[a, b, c], [b, c, a], [c, a, b]].into_iter().enumerate() {
                // Half of both, and 4 pixels to a unit of clip space.
                let expected = 2.0 * turn.signum() * (side(p, q) + side(r, p));
                steps = steps.maximum_or_nan((found.clip_bar[4 * k] - expected).abs());
            }
        }
    }
    Ok(checked
        .verdict::<T>("exact; all sides' slope", 8e-15)
        .and(steps <= 64.0 * rounding::<T>(), format!("a face's slope is off by {steps:.1e}")))
}

/// A fan of `count` faces around a point, in pixels, its corners on a circle.
fn fan(center: [f64; 2], radius: f64, count: u32, size: Size) -> ClipScene {
    let mut points = vec![center];
    points.extend((0..count).map(|k| {
        let (sin, cos) = (f64::from(k) / f64::from(count) * std::f64::consts::TAU).sin_cos();
        [center[0] + radius * cos, center[1] + radius * sin]
    }));
    let faces: Vec<_> =
        (0..count).map(|k| orders([0, 1 + k, 1 + (k + 1) % count])[k as usize % 6]).collect();
    ClipScene::from_px(&points, &faces, size)
}

fn fans<T: Scalar>() -> Outcome {
    let size = Size::square(16);
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for center in [[8.0, 8.0], [8.5, 8.5], [7.7, 8.3]] {
        for count in [3, 4, 5, 13, 64, 512] {
            let scene = fan(center, 6.3, count, size);
            let picture = Picture::new::<T>(&scene)?;
            let angle = std::f64::consts::TAU / f64::from(count);
            let area = 0.5 * f64::from(count) * 6.3 * 6.3 * angle.sin();
            let found: f64 = picture.covered().iter().sum();
            // Some 20 pixels of the rim hold up to 9 faces each of 64, but of 512 up to 50.
            error = error.maximum_or_nan((found / area - 1.0).abs());
            parts = parts.maximum_or_nan(picture.parts);
            wrong += picture.wrong + usize::from(picture.sampled > 0.0);
        }
    }
    // Corners are rounded to f32.
    Ok(Verdict::within("the polygon's area, each pixel covered once", error, 8.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, format!("{wrong} numbers not finite, or pixels sampled")))
}

fn t_junction<T: Scalar>() -> Outcome {
    let size = Size::square(16);
    let (mut gap, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for share in (1..23).map(|k| f64::from(k) / 23.0) {
        let ends = [[0.5, 2.5], [15.3, 13.7]];
        let between = [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]));
        let beyond = |end: [f64; 2], x: f64, y: f64| [end[0] + x, end[1] + y];
        let [high, other_high] = [beyond(ends[0], -3.0, -40.0), beyond(ends[1], 3.0, -40.0)];
        let [low, other_low] = [beyond(ends[0], -3.0, 40.0), beyond(ends[1], 3.0, 40.0)];
        let points = [ends[0], ends[1], between, high, other_high, low, other_low];
        let faces = [[0, 1, 4], [0, 4, 3], [0, 2, 5], [2, 1, 6], [2, 6, 5]];
        let picture = Picture::new::<T>(&ClipScene::from_px(&points, &faces, size))?;
        let inner = |pixel: usize| (1..15).contains(&(pixel % 16));
        let covered = picture.covered();
        let gaps = covered.iter().enumerate().filter(|(pixel, _)| inner(*pixel));
        gap = gap.maximum_or_nan(largest(gaps.map(|(_, covered)| 1.0 - covered)));
        parts = parts.maximum_or_nan(picture.parts);
        wrong += picture.wrong;
    }
    // Positions of up to 1 are rounded, in units of 8 px.
    Ok(Verdict::within("a gap as wide as rounding", gap, 16.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, "a number is not finite"))
}

/// A tetrahedron around a point in pixels.
pub(crate) fn tetrahedron([x, y]: [f64; 2], radius: f64, size: Size) -> ClipScene {
    let corners = [[1.0, 0.1, -0.2], [-0.6, 0.9, 0.3], [-0.5, -0.8, 0.1], [0.1, 0.05, 0.9]];
    let points = corners.map(|[a, b, _]| [x + radius * a, y + radius * b]);
    let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
    let mut scene = ClipScene::from_px(&points, &faces, size);
    for (place, corner) in scene.clip.iter_mut().zip(corners) {
        place[2] = 0.5 * corner[2];
    }
    scene
}

fn smaller_than_a_pixel<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    for radius in [0.4, 0.1] {
        // Within a pixel, beside its centre; over a border.
        for center in [[3.45, 2.55], [3.03, 2.6], [2.98, 3.01]] {
            checked.add::<T>(&tetrahedron(center, radius, SIZE), true)?;
        }
    }
    Ok(checked.verdict::<T>("each closed mesh with its area and slope", 1e-12))
}

fn turning_edge_on<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    for power in [4, 10, 20, 40, 60, 1000] {
        let flat = 3.0 * f64::powi(2.0, -power);
        let points = [[1.2, 2.25], [5.7, 2.25], [3.3, 2.25 + flat]];
        checked.add::<T>(&ClipScene::from_px(&points, &[[0, 1, 2]], SIZE), power < 12)?;
        // Into the depth.
        let mut deep = ClipScene::from_px(&points, &[[0, 1, 2]], SIZE);
        deep.clip[2][2] = 0.9;
        checked.add::<T>(&deep, power < 12)?;
    }
    Ok(checked.verdict::<T>("areas down to 0; finite gradients", 1e-13))
}

fn seams_everywhere<T: Scalar>() -> Outcome {
    // Of w = 1 colours are linear, so that it does not matter where a pixel is cut.
    let mut scenes = vec![fan([3.4, 3.2], 2.6, 7, SIZE), tetrahedron([3.3, 2.8], 2.9, SIZE)];
    scenes.push(fan([3.5, 3.5], 2.5, 5, SIZE));
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for scene in scenes {
        let plain = Picture::new::<T>(&scene)?;
        let mesh = scene.mesh()?.with_seams(|_, _| true);
        let cut = Picture::with::<T>(&scene, mesh, options(scene.size), |k| motley(3 * k + 1))?;
        error = error.maximum_or_nan(difference(&cut.covered(), &plain.covered()));
        // What a pixel without a boundary shows at its centre is no mean where faces meet in it.
        let is_cut = |pixel: &usize| {
            let count = scene.faces.len();
            cut.areas[pixel * count..][..count].iter().filter(|&&area| area > 0.0).count() > 1
        };
        for pixel in (0..scene.size.pixels()).filter(|pixel| !is_cut(pixel)) {
            let own = 3 * pixel..3 * pixel + 3;
            error = error.maximum_or_nan(difference(&cut.image[own.clone()], &plain.image[own]));
        }
        parts = parts.maximum_or_nan(cut.parts);
        wrong += cut.wrong + usize::from(cut.sampled > 0.0);
    }
    Ok(Verdict::within("what is covered stays", error, 16.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, "a number is not finite"))
}

fn strips_and_single_pixels<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    for (width, height) in [(1, 1), (16, 1), (1, 16), (2, 1), (70, 1), (1, 70)] {
        let (w, h) = (width as f64, height as f64);
        for order in orders([0, 1, 2]) {
            let points = [[-0.47 * w, -h], [1.1 * w, 0.63 * h], [0.27 * w, 1.7 * h]];
            checked
                .add::<T>(&ClipScene::from_px(&points, &[order], Size { width, height }), true)?;
        }
    }
    Ok(checked.verdict::<T>("each with its area and slope", 1e-13))
}

fn sides_and_edges<T: Scalar>() -> Outcome {
    let corners = [[0.9, 0.8], [6.2, 1.3], [3.1, 5.4], [5.9, 5.5]];
    let quad = ClipScene::from_px(&corners, &[[0, 2, 1], [1, 2, 3]], SIZE);
    let whole = Picture::new::<T>(&quad)?;
    let (mut error, mut wrong) = (0.0_f64, whole.wrong);
    // Back faces by flag.
    for (cull, is_drawn) in [(Cull::Back, true), (Cull::Front, false)] {
        let options = options(SIZE).cull(cull);
        let found = Picture::with::<T>(&quad, quad.mesh()?, options, |k| motley(3 * k + 1))?;
        wrong += usize::from((found.culled == 0) != is_drawn);
        wrong += usize::from(is_drawn && found != whole);
        wrong += found.covered().iter().filter(|&&covered| !is_drawn && covered != 0.0).count();
    }
    // Vertices of their own at the inner edge; a third face at it, behind the others.
    let mut split = quad.clone();
    split.clip.extend([quad.clip[1], quad.clip[2]]);
    split.faces = vec![[0, 2, 1], [4, 5, 3]];
    let mut three = quad.clone();
    let [x, y, ..] = at_px(SIZE, 3.5, 2.5);
    three.clip.push([x, y, 0.5, 1.0]);
    three.faces.push([1, 2, 4]);
    for scene in [split, three] {
        let found = Picture::new::<T>(&scene)?;
        error = error.maximum_or_nan(difference(&found.covered(), &whole.covered()));
        error = error.maximum_or_nan(found.parts);
        wrong += found.wrong;
    }
    Ok(Verdict::within(
        "by flag; edges of one or three faces hide nothing",
        error,
        parts_bound::<T>(),
    )
    .and(wrong == 0, format!("{wrong} things are wrong")))
}
