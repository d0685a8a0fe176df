//! Sides that lie on the borders of pixels.

use bokashi_core::Scalar;
use bokashi_render_ops::Size;

use super::{Picture, area_gradient, parts_bound};
use crate::areas::visible_areas;
use crate::clip_scene::ClipScene;
use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    87 "exact: sides on pixel borders", "the mean slope of both sides", sides_on_borders;
};

/// Each is a kink of the areas in its two pixels: its gradient is the mean of the slopes to both sides,
/// as a central difference quotient of the sweep has it.
fn sides_on_borders<T: Scalar>() -> Outcome {
    let triangles = [
        // Alone; at the image's own border; before others, whose sides end at it or pass it.
        vec![[[2.0, 1.0], [6.0, 1.0], [2.0, 5.0]]],
        vec![[[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]]],
        vec![[[1.0, 4.0], [5.0, 4.0], [5.0, 1.0]], [[3.0, 0.0], [3.0, 5.0], [6.0, 5.0]]],
        vec![[[2.0, 2.0], [4.0, 2.0], [2.0, 4.0]], [[-9.0, -9.0], [30.0, -9.0], [-9.0, 30.0]]],
        vec![[[1.5, 2.0], [5.5, 2.0], [3.25, 5.0]], [[0.5, 1.0], [6.0, 3.5], [0.5, 5.5]]],
    ];
    let mut sizes = vec![Size::square(8), Size { width: 16, height: 8 }];
    if rounding::<T>() < 1e-10 {
        // Places that are rounded: in f32 they are further from the border than rounding in f64.
        sizes.extend([Size { width: 7, height: 6 }, Size { width: 10, height: 9 }]);
    }
    let (mut error, mut slope, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0.0_f64, 0);
    for size in sizes {
        for (faces, ws) in triangles.iter().flat_map(|faces| [(faces, 1.0), (faces, 2.0)]) {
            let points: Vec<_> = faces.as_flattened().to_vec();
            let indices: Vec<_> =
                (0..faces.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
            let mut scene = ClipScene::from_px(&points, &indices, size);
            for (k, vertex) in scene.clip.iter_mut().enumerate() {
                vertex[2] = 0.25 * (k / 3) as f64;
                // Of all vertices alike, or of each another one.
                let w = if ws == 1.0 { 1.0 } else { [1.0, 2.0, 0.5][k % 3] };
                *vertex = vertex.map(|c| c * w);
            }
            let swept = |clip: &[[f64; 4]]| -> Vec<f64> {
                let place = |pixel: usize| [pixel % size.width, pixel / size.width];
                let areas = |pixel| visible_areas(clip, &scene.faces, size, place(pixel));
                (0..size.pixels()).flat_map(areas).collect()
            };
            let picture = Picture::new::<T>(&scene)?;
            error = error.maximum_or_nan(difference(&picture.areas, &swept(&scene.clip)));
            parts = parts.maximum_or_nan(picture.parts);
            wrong += picture.wrong + usize::from(picture.sampled > 0.0);
            let found = area_gradient::<T>(&scene)?;
            let most = largest(found.iter().copied());
            for (k, found) in found.into_iter().enumerate() {
                let loss = |step: f64| -> f64 {
                    let mut clip = scene.clip.clone();
                    clip[k / 4][k % 4] += step;
                    let areas = swept(&clip);
                    // Of pixels and faces as the gradient has them.
                    areas.iter().enumerate().map(|(at, area)| motley(at) * area).sum()
                };
                let quotient = |step: f64| (loss(step) - loss(-step)) / (2.0 * step);
                // The second derivative leaps, so the error goes with the step.
                let quotient = 2.0 * quotient(1e-5) - quotient(2e-5);
                slope = slope.maximum_or_nan((found - quotient).abs() / most);
            }
        }
    }
    let steep = 64.0 * rounding::<T>() + 1e-5;
    let bound = 2.0 * rounding::<T>().max(1e-14);
    Ok(Verdict::within("areas, and the mean slope of both sides", error, bound)
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(slope <= steep, format!("a gradient is off by {slope:.1e} of the largest"))
        .and(wrong == 0, format!("{wrong} numbers not finite, or pixels sampled")))
}
