//! Input that there is nothing to compute from, and input that breaks a rule.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::mean_squared_error;
use bokashi_render_ops::{
    Background, Blur, Fragments, Mesh, Pose, Radius, Size, composite, gaussian_blur, interpolate,
    project, rasterize,
};
use glam::DMat4;

use super::row::{Found, Outcome, told};
use super::scene::{BACKGROUND, Scene, difference, largest};

const CORNERS: [[f64; 4]; 3] =
    [[-0.8, -0.9, 0.0, 1.0], [0.9, -0.7, 0.0, 1.0], [0.1, 0.8, 0.0, 1.0]];

pub(super) fn no_faces<T: Scalar>() -> Outcome {
    let size = Size { width: 5, height: 4 };
    let rendered = Scene::new(&CORNERS, &[], size).rendered::<T>(Some(1.3))?;
    let sharp = Scene::new(&CORNERS, &[], size).rendered_with::<T>(None, |_| 1.0)?;
    let background: Vec<_> = (0..40).map(|k| BACKGROUND[k % 2]).collect();
    let bars = rendered.clip_bar.iter().chain(&rendered.color_bar);
    let error = difference(&sharp.image, &background)
        .max(largest(bars.copied()))
        .max(difference(&sharp.background_bar, &[20.0, 20.0]));
    Ok(Found::within("the background, zero gradients, the background's gradient 20", error, 0.0))
}

pub(super) fn empty_image<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let scene = Scene::new(&CORNERS, &[[0, 1, 2]], Size::square(1));
    let (clip, mesh) = (scene.leaf(&tape), scene.mesh()?);
    let mut results = Vec::new();
    for (width, height) in [(0, 0), (0, 5), (5, 0), (1 << 16, 1 << 16), (usize::MAX, 2)] {
        let said = told(rasterize(clip, &mesh, Size { width, height }));
        let message = format!(
            "an image needs at least one pixel and fewer than 2^32 - 1, got {width} x {height}"
        );
        results.push((said, message));
    }
    for shape in [[0, 3, 1], [3, 0, 1], [3, 3, 0]] {
        let image = tape.leaf(&Tensor::zeros(shape));
        let said = told(gaussian_blur(image, tape.leaf_scalar(T::ONE), &Blur::default()));
        let rule = "gaussian_blur needs an image of shape [H, W, C] with at least one entry";
        results.push((said, format!("{rule}, got shape {shape:?}")));
    }
    let (none, rule) =
        (tape.leaf(&Tensor::zeros([0])), "mean_squared_error needs at least one entry");
    results.push((told(mean_squared_error(none, none)), format!("{rule}, got shape [0]")));
    Ok(Found::refused(results))
}

pub(super) fn index_out_of_range<T: Scalar>() -> Outcome {
    let mesh = |faces: &[[u32; 3]], count| told(Mesh::new(faces.to_vec(), count));
    let said = |count: usize, index: u32, face: usize| {
        format!("a face needs vertex indices below {count}, got {index} in face {face}")
    };
    let tape = Tape::<T>::new();
    let few = tape.leaf(&Tensor::zeros([2, 4]));
    let whole = Mesh::new(vec![[0, 1, 2]], 3)?;
    Ok(Found::refused(vec![
        (mesh(&[[0, 1, 2], [0, 3, 1]], 3), said(3, 3, 1)),
        (mesh(&[[0, 0, 0]], 0), said(0, 0, 0)),
        (mesh(&[[0, 1, u32::MAX]], 3), said(3, u32::MAX, 0)),
        (
            told(rasterize(few, &whole, Size::square(2))),
            "rasterize needs clip positions of shape [3, 4], got shape [2, 4]".to_owned(),
        ),
    ]))
}

pub(super) fn not_finite_position<T: Scalar>() -> Outcome {
    let mut results = Vec::new();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for k in 0..12 {
            let mut scene = Scene::new(&CORNERS, &[[0, 1, 2]], Size::square(4));
            scene.clip[k / 4][k % 4] = bad;
            let [x, y, z, w] = scene.clip[k / 4].map(|c| T::from_f64(c).to_f64());
            let rule = "clip positions need to be finite";
            let message = format!("{rule}, got ({x}, {y}, {z}, {w}) at vertex {}", k / 4);
            results.push((told(scene.draw::<T>()), message));
        }
    }
    Ok(Found::refused(results))
}

fn fragments<'t, T: Scalar>(
    tape: &'t Tape<T>,
) -> Result<(Var<'t, T>, Fragments<'t, T>), bokashi_render_ops::RenderError> {
    let scene = Scene::new(&CORNERS, &[[0, 1, 2]], Size::square(6));
    let clip = scene.leaf(tape);
    Ok((clip, rasterize(clip, &scene.mesh()?, scene.size)?))
}

/// What each operation on fragments says to some that it cannot take.
fn on_fragments<'t, T: Scalar>(
    tape: &'t Tape<T>,
    fragments: &Fragments<'t, T>,
    said: impl Fn(&str) -> String,
) -> Vec<(Result<(), String>, String)> {
    let count = fragments.coverage.count();
    let colors = tape.leaf(&Tensor::full([3, 1], T::ONE));
    let values = tape.leaf(&Tensor::full([count, 1], T::ONE));
    vec![
        (told(interpolate(colors, fragments)), said("interpolate")),
        (told(composite(values, fragments, Background::Zero)), said("composite")),
    ]
}

pub(super) fn foreign_fragments<T: Scalar>() -> Outcome {
    let (tape, other) = (Tape::<T>::new(), Tape::new());
    let (_, foreign) = fragments(&other)?;
    let said =
        |operation: &str| format!("{operation} needs variables of one tape, got one of another");
    Ok(Found::refused(on_fragments(&tape, &foreign, said)))
}

pub(super) fn fragments_of_another_length<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let (_, whole) = fragments(&tape)?;
    let count = whole.coverage.count();
    let mut results = Vec::new();
    for rows in [0, count - 1, count + 1] {
        let barycentrics = tape.leaf(&Tensor::zeros([rows, 2]));
        let few = Fragments { barycentrics, ..whole.clone() };
        results.extend(on_fragments(&tape, &few, |operation| {
            format!("{operation} needs barycentrics of shape [{count}, 2], got shape [{rows}, 2]")
        }));
        let few = Fragments { clip: tape.leaf(&Tensor::zeros([rows, 4])), ..whole.clone() };
        results.extend(on_fragments(&tape, &few, |operation| {
            format!("{operation} needs clip positions of shape [3, 4], got shape [{rows}, 4]")
        }));
    }
    Ok(Found::refused(results))
}

pub(super) fn background_of_another_shape<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let (_, fragments) = fragments(&tape)?;
    let values = tape.leaf(&Tensor::zeros([fragments.coverage.count(), 2]));
    let behind = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let mut results = Vec::new();
    for shape in [&[6, 6, 2][..], &[1], &[3], &[]] {
        let said = told(composite(values, &fragments, Background::Color(behind(shape))));
        let rule = "composite needs a background colour of shape [2]";
        results.push((said, format!("{rule}, got shape {shape:?}")));
    }
    for shape in [&[2][..], &[6, 6, 1], &[6, 6], &[72]] {
        let said = told(composite(values, &fragments, Background::Image(behind(shape))));
        let rule = "composite needs a background image of shape [6, 6, 2]";
        results.push((said, format!("{rule}, got shape {shape:?}")));
    }
    Ok(Found::refused(results))
}

pub(super) fn bad_camera_or_pose<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let points = tape.leaf(&Tensor::zeros([2, 3]));
    let pose = |q: [f64; 4]| Pose {
        rotation: tape.leaf(&Tensor::from_flat_fn([4], |k| T::from_f64(q[k]))),
        translation: tape.leaf(&Tensor::zeros([3])),
    };
    let mut results = Vec::new();
    for q in [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [0.0, f64::INFINITY, 0.0, 0.0]] {
        let said = told(project(points, &DMat4::IDENTITY, Some(pose(q))));
        let rule = "a rotation needs a finite quaternion other than zero";
        results.push((said, format!("{rule}, got ({}, {}, {}, {})", q[0], q[1], q[2], q[3])));
    }
    for bad in [f64::NAN, f64::INFINITY] {
        let mut camera = DMat4::IDENTITY;
        camera.col_mut(2).y = bad;
        let rule = "a camera matrix needs finite entries";
        let message = format!("{rule}, got {bad} in row 1, column 2");
        results.push((told(project(points, &camera, None)), message));
    }
    Ok(Found::refused(results))
}

pub(super) fn radius_out_of_range<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::full([3, 3, 1], T::ONE));
    let blurred = |radius| {
        told(gaussian_blur(image, tape.leaf_scalar(T::ONE), &Blur { radius, ..Blur::default() }))
    };
    let mut results = Vec::new();
    for radius in [16_385, usize::MAX] {
        let rule = "gaussian_blur needs a window radius of at most 16384 pixels";
        results.push((blurred(Radius::Fixed(radius)), format!("{rule}, got {}", radius as f64)));
    }
    for tolerance in [0.0, -1.0, 1.0, f64::NAN] {
        let rule = "gaussian_blur needs a tolerance between 0 and 1";
        results.push((blurred(Radius::Tolerance(tolerance)), format!("{rule}, got {tolerance}")));
    }
    Ok(Found::refused(results))
}

pub(super) fn impossible_shapes<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let pair = tape.leaf(&Tensor::zeros([2]));
    let none = tape.leaf(&Tensor::zeros([0, 3]));
    let huge = [1_usize << 33, 1 << 31];
    let rule = "needs more entries than fit an index";
    Ok(Found::refused(vec![
        (told(Tensor::<T>::new(huge, vec![])), format!("shape {huge:?} {rule}, got 0")),
        (told(pair.reshape(huge)), format!("shape {huge:?} {rule}, got 2")),
        (
            told(none.mean()),
            "mean needs at least one entry to take the mean of, got shape [0, 3]".to_owned(),
        ),
        (
            told(pair.try_add(none)),
            "add needs shapes that broadcast, got [2] and [0, 3]".to_owned(),
        ),
        (
            told(pair.sum_axis(3)),
            "sum needs an axis below the rank 1, got axis 3 of shape [2]".to_owned(),
        ),
    ]))
}
