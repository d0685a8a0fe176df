//! Faces over one another.

use bokashi_core::{Scalar, Tape};
use bokashi_render_ops::{Size, depth, rasterize};

use super::{Checked, Picture, SIZE, options, parts_bound};
use crate::areas::visible_areas;
use crate::clip_scene::{ClipScene, at_px, many_faces, orders};
use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    77 "exact: faces in one plane", "the lower index, once", coplanar;
    78 "exact: faces through one line", "each up to the line", crossing_faces;
    79 "exact: 2,100 faces in one pixel", "exact but for what is sampled there", crowded;
    80 "exact: 1e6 faces in one pixel", "the nearest, sampled within the bound", many_faces_in_a_pixel;
};

/// Faces in pixels with a depth each.
fn at_depths(faces: &[([[f64; 2]; 3], f64)], size: Size) -> ClipScene {
    let points: Vec<_> = faces.iter().flat_map(|(corners, _)| *corners).collect();
    let indices: Vec<_> = (0..faces.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let mut scene = ClipScene::from_px(&points, &indices, size);
    for (vertex, place) in scene.clip.iter_mut().enumerate() {
        place[2] = faces[vertex / 3].1;
    }
    scene
}

fn coplanar<T: Scalar>() -> Outcome {
    // Tilted planes, faces in all orders of their corners, over one another and side by side.
    let corners = [[0.9, 0.8], [6.2, 1.3], [3.1, 5.4], [5.7, 5.1]];
    let place = |[x, y]: [f64; 2]| {
        let [a, b, ..] = at_px(SIZE, x, y);
        let w = 1.0 + 0.25 * a - 0.125 * b;
        [a * w, b * w, 0.3 * a * w + 0.2 * b * w + 0.125 * w, w]
    };
    let clip = corners.map(place);
    let alone = Picture::new::<T>(&ClipScene::new(&clip, &[[0, 1, 2]], SIZE))?.covered();
    let both = Picture::new::<T>(&ClipScene::new(&clip, &[[0, 1, 2], [1, 3, 2]], SIZE))?.covered();
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for first in orders([0, 1, 2]) {
        for second in orders([0, 1, 2]) {
            let scene = ClipScene::new(&clip, &[first, second, first], SIZE);
            let picture = Picture::new::<T>(&scene)?;
            error = error.maximum_or_nan(difference(&picture.covered(), &alone));
            // In one plane to within rounding, which f32 positions are not.
            let later = picture.areas.chunks_exact(3).map(|areas| areas[1] + areas[2]);
            error = error.maximum_or_nan(largest(later));
            let scene = ClipScene::new(&clip, &[first, second, [1, 3, 2], [0, 3, 2], first], SIZE);
            let more = Picture::new::<T>(&scene)?;
            error = error.maximum_or_nan(difference(&more.covered(), &both));
            parts = parts.maximum_or_nan(picture.parts).maximum_or_nan(more.parts);
            wrong += picture.wrong + more.wrong;
        }
    }
    Ok(Verdict::within("the lower index; what is covered, once", error, 8.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, "a number is not finite"))
}

/// Faces over the whole image with the depths `planes`: of 1, x and y in clip space.
fn planes(planes: &[[f64; 3]], size: Size) -> ClipScene {
    let corners = [[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]];
    let clip: Vec<_> = planes
        .iter()
        .flat_map(|[one, x, y]| corners.map(|[a, b]| [a, b, one + x * a + y * b, 1.0]))
        .collect();
    let faces: Vec<_> = (0..planes.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    ClipScene::new(&clip, &faces, size)
}

fn crossing_faces<T: Scalar>() -> Outcome {
    let size = Size::square(4);
    let mut checked = Checked::default();
    // Along the diagonal through pixels' corners; along their borders; through one line, in fives and
    // threes; anywhere.
    for (scene, smooth) in [
        (planes(&[[0.0, 0.125, 0.125], [0.0, -0.125, -0.125]], size), false),
        (planes(&[[0.0, 0.125, 0.0], [0.0, -0.125, 0.0]], size), false),
        (planes(&[[0.0, 0.125, 0.0625], [0.0; 3], [0.0, -0.125, -0.0625]], size), false),
        (
            planes(&[[0.1, 0.05, 0.02], [0.0; 3], [-0.1, -0.05, -0.02], [0.2, 0.1, 0.04]], size),
            false,
        ),
        (planes(&[[0.011, 0.07, 0.03], [-0.02, 0.013, -0.06], [0.005, -0.06, 0.02]], size), true),
    ] {
        checked.add::<T>(&scene, smooth)?;
    }
    Ok(checked.verdict::<T>("each face up to the line, with its slope", 1e-9))
}

fn crowded<T: Scalar>() -> Outcome {
    // Strips behind one another within a pixel, each a little wider, and a face over its neighbours.
    let size = Size { width: 4, height: 3 };
    const STRIPS: usize = 2_100;
    let mut faces: Vec<_> = (0..STRIPS)
        .map(|k| {
            let share = k as f64 / STRIPS as f64;
            let right = 1.05 + 0.9 * share;
            let corners = [[1.02, 1.1], [right, 1.1], [1.02, 1.9]];
            (corners, -0.5 + share)
        })
        .collect();
    faces.push(([[0.3, 0.2], [3.8, 0.4], [2.9, 2.7]], 0.75));
    let scene = at_depths(&faces, size);
    let picture = Picture::new::<T>(&scene)?;
    let (mut beside, mut inside) = (0.0_f64, 0.0_f64);
    for (pixel, found) in picture.covered().into_iter().enumerate() {
        let swept =
            visible_areas(&scene.clip, &scene.faces[STRIPS - 1..], size, [pixel % 4, pixel / 4]);
        let error = if pixel == 5 { &mut inside } else { &mut beside };
        *error = error.maximum_or_nan((found - swept.iter().sum::<f64>()).abs());
    }
    // They share an edge: around it no cell has few of them.
    let sampled = picture.sampled;
    Ok(Verdict::within("exact but for what is sampled there", beside, 16.0 * rounding::<T>())
        .and(sampled < 0.1, format!("{sampled:e} of a pixel is sampled"))
        .and(inside <= 0.1 * sampled, format!("the pixel is off by {inside:.1e} of {sampled:.1e}"))
        .and(picture.parts <= parts_bound::<T>(), "parts are off 1")
        .and(picture.wrong == 0, "a number is not finite"))
}

fn many_faces_in_a_pixel<T: Scalar>() -> Outcome {
    // As without exact coverage.
    let (clip, mesh, nearest, _) = many_faces::<T>()?;
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&clip);
    let fragments = rasterize(positions, &mesh, options(Size::square(3)).creases(&[]))?;
    let weight = fragments.weight.ok_or("exact coverage has weights")?;
    let coverage = &fragments.coverage;
    let wrong = coverage.faces().filter(|&face| face != nearest).count();
    // 3/4 by 3/4 of the pixel, halved.
    let error = (numbers(&weight.value()).iter().sum::<f64>() - 0.28125).abs();
    let seen = depth(&fragments)?;
    let bars = (seen.sum() + weight.sum()).backward()?.get_or_zeros(positions);
    Ok(Verdict::within("the nearest alone, sampled; finite gradients", error, 0.04)
        .and(wrong == 0 && coverage.count() == 1, format!("{wrong} other faces are seen"))
        .and(error <= coverage.boundary_counts().sampled, "it is farther off than was sampled")
        .and(bars.is_finite(), "a gradient is not finite"))
}
