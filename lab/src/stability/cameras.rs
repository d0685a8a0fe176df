//! Cameras at their limits: intrinsics, motions, lenses, instances.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::camera::{
    distortion_radius, fisheye_limit, look_at, perspective, to_tensor,
};
use bokashi_render_ops::glam::{DMat4, DQuat, DVec3};
use bokashi_render_ops::{
    Assembly, Mesh, Size, affine_inverse, distort, fisheye, orthographic, pinhole, project,
    project_instances, rasterize, rigid, se3, transform_points,
};

use super::row::{Failure, Found, Outcome, told};
use super::scene::{difference, largest, motley, numbers, rounding};

const SIZE: Size = Size { width: 40, height: 30 };

fn vector<'t, T: Scalar>(tape: &'t Tape<T>, entries: &[f64]) -> Var<'t, T> {
    tape.leaf(&Tensor::from_flat_fn([entries.len()], |k| T::from_f64(entries[k])))
}

/// Rows of three.
fn points<'t, T: Scalar>(tape: &'t Tape<T>, rows: &[[f64; 3]]) -> Var<'t, T> {
    tape.leaf(&Tensor::from_flat_fn([rows.len(), 3], |k| T::from_f64(rows[k / 3][k % 3])))
}

/// Whether a motley gradient of `out` gives finite gradients of `leaves`.
fn has_finite_slopes<T: Scalar>(out: Var<'_, T>, leaves: &[Var<'_, T>]) -> Result<bool, Failure> {
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(motley(5 * k + 2)));
    let gradients = out.tape().vjp(&[(out, &upstream)])?;
    Ok(leaves.iter().all(|&leaf| gradients.get_or_zeros(leaf).is_finite()))
}

pub(super) fn impossible_intrinsics<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let good = [30.0, 30.0, 19.5, 14.5];
    let with = |at: usize, entry: f64| {
        let mut entries = good;
        entries[at] = entry;
        vector(&tape, &entries)
    };
    let mut results = Vec::new();
    for bad in [0.0, f64::NAN, f64::INFINITY] {
        let rule = "pinhole needs a finite focal length other than 0";
        results.push((told(pinhole(with(1, bad), SIZE, 0.1, 9.0)), format!("{rule}, got {bad}")));
        let rule = "orthographic needs a finite scale other than 0";
        let said = told(orthographic(with(0, bad), SIZE, 0.1, 9.0));
        results.push((said, format!("{rule}, got {bad}")));
    }
    for bad in [f64::NAN, f64::NEG_INFINITY] {
        let rule = "pinhole needs a finite principal point";
        results.push((told(pinhole(with(2, bad), SIZE, 0.1, 9.0)), format!("{rule}, got {bad}")));
        let rule = "orthographic needs a finite centre";
        let said = told(orthographic(with(3, bad), SIZE, 0.1, 9.0));
        results.push((said, format!("{rule}, got {bad}")));
    }
    let good = vector(&tape, &good);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let rule = "pinhole needs a near plane at a finite distance above 0";
        results.push((told(pinhole(good, SIZE, bad, 9.0)), format!("{rule}, got {bad}")));
    }
    for bad in [0.5, 0.25, f64::NAN] {
        let rule = "a far plane beyond the near plane at 0.5";
        let said = told(pinhole(good, SIZE, 0.5, bad));
        results.push((said, format!("pinhole needs {rule}, got {bad}")));
        let said = told(orthographic(good, SIZE, 0.5, bad));
        let rule = "a finite far plane beyond the near plane at 0.5";
        results.push((said, format!("orthographic needs {rule}, got {bad}")));
    }
    let none = Size { width: 0, height: 3 };
    let rule = "an image needs at least one pixel and fewer than 2^32 - 1, got 0 x 3";
    results.push((told(pinhole(good, none, 0.1, 9.0)), rule.to_owned()));
    let three = vector(&tape, &[1.0; 3]);
    let rule = "pinhole needs intrinsics of shape [4], got shape [3]";
    results.push((told(pinhole(three, SIZE, 0.1, 9.0)), rule.to_owned()));
    Ok(Found::refused(results))
}

pub(super) fn known_pixels<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for focal in [1e-3, 1.0, 700.0, -30.0, 1e6] {
        for center in [[19.5, 14.5], [0.0, 0.0], [-1e4, 3e5]] {
            for (z, is_pinhole) in [(0.5, true), (4.0, true), (4.0, false)] {
                let tape = Tape::<T>::new();
                let intrinsics = vector(&tape, &[focal, 2.0 * focal, center[0], center[1]]);
                let camera = match is_pinhole {
                    true => pinhole(intrinsics, SIZE, 0.25, f64::INFINITY)?,
                    false => orthographic(intrinsics, SIZE, 0.25, 8.0)?,
                };
                let point = [0.25, -0.125, z];
                let clip = numbers(&project(points(&tape, &[point]), camera, None)?.value());
                // OpenCV's pixels, half a pixel before ours.
                let w = if is_pinhole { z } else { 1.0 };
                let place = |k: usize, scale: f64| scale * focal * point[k] / w + center[k];
                let [u, v] = [place(0, 1.0), place(1, 2.0)];
                let [width, height] = [SIZE.width, SIZE.height].map(|extent| extent as f64);
                let x = 0.5 * (clip[0] / clip[3] + 1.0) * width - 0.5;
                let y = 0.5 * (1.0 - clip[1] / clip[3]) * height - 0.5;
                let size = (focal.abs() + largest(center)).max(100.0);
                error = error.maximum_or_nan(largest([x - u, y - v, clip[3] - w]) / size);
            }
        }
    }
    let outcome = "each point at its pixel, by OpenCV's formula";
    Ok(Found::within(outcome, error, 8.0 * rounding::<T>()))
}

pub(super) fn impossible_matrices<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut results = Vec::new();
    let unit = to_tensor::<T>(&DMat4::IDENTITY);
    let with = |at: usize, entry: f64| {
        let mut matrix = unit.clone();
        matrix.data_mut()[at] = T::from_f64(entry);
        tape.leaf(&matrix)
    };
    let some = points(&tape, &[[0.5, 0.25, 1.0]]);
    for bad in [f64::NAN, f64::INFINITY] {
        let message = format!("a camera matrix needs finite entries, got {bad} in row 1, column 2");
        results.push((told(project(some, with(6, bad), None)), message.clone()));
        results.push((told(transform_points(some, with(6, bad))), message.clone()));
        results.push((told(affine_inverse(with(6, bad))), message));
        let rule = "rigid needs a finite translation";
        let moved = rigid(vector(&tape, &[0.0, 0.0, 0.0, 1.0]), vector(&tape, &[0.0, bad, 0.0]));
        results.push((told(moved), format!("{rule}, got {bad}")));
        let increment = vector(&tape, &[0.0, 0.0, 0.0, bad, 0.0, 0.0]);
        let rule = "se3 needs an increment within -1e50 and 1e50";
        results.push((told(se3(increment, &DMat4::IDENTITY)), format!("{rule}, got {bad}")));
        let matrices = with(6, bad).reshape([1, 4, 4])?;
        let rule = "project_instances needs finite entries of matrix 0";
        let said = told(project_instances(some, matrices, &DMat4::IDENTITY));
        results.push((said, format!("{rule}, got {bad}")));
    }
    for (at, bad) in [(12, 0.5), (15, 0.0)] {
        let rule = "a matrix with the last row (0, 0, 0, 1)";
        let said = told(affine_inverse(with(at, bad)));
        results.push((said, format!("affine_inverse needs {rule}, got {bad}")));
        let said = told(transform_points(some, with(at, bad)));
        results.push((said, format!("transform_points needs {rule}, got {bad}")));
    }
    let rule =
        "affine_inverse needs a linear part whose determinant is not 0 within rounding, got 0";
    results.push((told(affine_inverse(with(5, 0.0))), rule.to_owned()));
    let nowhere = rigid(vector(&tape, &[0.0; 4]), vector(&tape, &[0.0; 3]));
    let rule = "a rotation needs a finite quaternion other than zero, got (0, 0, 0, 0)";
    results.push((told(nowhere), rule.to_owned()));
    Ok(Found::refused(results))
}

pub(super) fn motions_of_any_angle<T: Scalar>() -> Outcome {
    let (axis, fixed) = (DVec3::new(0.6, -0.48, 0.64), look_at(DVec3::ONE, DVec3::ZERO, DVec3::Y));
    let (mut error, mut finite) = (0.0_f64, true);
    // At 0, far below it, where half a turn is not single-valued, and many turns on.
    for angle in [0.0, 1e-30, 1e-9, 1e-4, 0.5, 2.0, std::f64::consts::PI, 6.5, 100.0] {
        let tape = Tape::<T>::new();
        let entries = [0.5, -1.25, 0.75, axis.x * angle, axis.y * angle, axis.z * angle];
        let increment = vector(&tape, &entries);
        let moved = se3(increment, &fixed)?;
        // The angle as the precision has it.
        let seen: Vec<_> = numbers(&increment.value());
        let turn = DVec3::new(seen[3], seen[4], seen[5]);
        let expected = DMat4::from_quat(DQuat::from_scaled_axis(turn)) * fixed;
        let (found, expected) = (numbers(&moved.value()), numbers(&to_tensor::<f64>(&expected)));
        for row in 0..3 {
            let columns = 4 * row..4 * row + 3;
            error = error.maximum_or_nan(difference(&found[columns.clone()], &expected[columns]));
        }
        finite &= has_finite_slopes(moved, &[increment])?;
    }
    let outcome = "the rotation of that axis and angle, finite gradients";
    Ok(Found::within(outcome, error, 16.0 * rounding::<T>())
        .and(finite, "a gradient is not finite"))
}

pub(super) fn inverses_of_any_size<T: Scalar>() -> Outcome {
    let (mut error, mut finite) = (0.0_f64, true);
    let turn = DMat4::from_quat(DQuat::from_xyzw(0.1, 0.7, -0.5, 0.3).normalize());
    for scale in [1e-12, 1e-6, 1.0, 1e6, 1e12] {
        let tape = Tape::<T>::new();
        let matrix = tape.leaf(&to_tensor::<T>(&(turn * DMat4::from_scale(DVec3::splat(scale)))));
        let inverse = affine_inverse(matrix)?;
        let product = numbers(&inverse.matmul(matrix)?.value());
        error = error
            .maximum_or_nan(difference(&product, &numbers(&to_tensor::<f64>(&DMat4::IDENTITY))));
        finite &= has_finite_slopes(inverse, &[matrix])?;
    }
    let outcome = "times the matrix it is the identity, finite gradients";
    Ok(Found::within(outcome, error, 8.0 * rounding::<T>()).and(finite, "a gradient is not finite"))
}

/// A lens whose polynomial turns round at a radius of about 1, a lens whose does not, and none.
const LENSES: [[f64; 5]; 3] = [
    [-0.35, 0.03, 0.003, -0.002, -0.002],
    [0.02, 1e-4, -0.01, 0.02, 3e-5],
    [0.0, 0.0, 0.0, 0.0, 0.0],
];

pub(super) fn beyond_the_lens<T: Scalar>() -> Outcome {
    let (mut wrong, mut finite) = (0, true);
    for lens in LENSES {
        let rim = distortion_radius(lens);
        // Before the camera ever farther out, in the plane of the eye, and behind it.
        let along = |k: usize| [0.1 * rim * k as f64, 0.05 * rim * k as f64, 1.0];
        let outward: Vec<_> = (1..200).map(along).collect();
        let across = [1e-30, 0.0, -0.0, -1e-30, -1.0].map(|z| [0.5, 0.25, z]);
        let axis = [0.0, -1.0].map(|z| [0.0, 0.0, z]);
        let tape = Tape::<T>::new();
        let all = points(&tape, &[&outward[..], &across, &axis].concat());
        let coefficients = vector(&tape, &lens);
        let out = distort(all, coefficients)?;
        let found = numbers(&out.value());
        let radius = |k: usize| found[3 * k].hypot(found[3 * k + 1]);
        wrong += (1..outward.len()).filter(|&k| radius(k) <= radius(k - 1)).count();
        let beside = outward.len()..outward.len() + across.len();
        let at_eye = |k: usize| [found[3 * k], found[3 * k + 1]];
        wrong += beside.clone().filter(|&k| at_eye(k) != at_eye(beside.start)).count();
        wrong += found[3 * beside.end..].chunks(3).filter(|p| p[..2] != [0.0, 0.0]).count();
        finite &= out.value().is_finite() && has_finite_slopes(out, &[all, coefficients])?;
    }
    let outcome = "what lies farther out is shown farther out; no leap at the eye; finite";
    Ok(Found::exactly(outcome, wrong).and(finite, "a number is not finite"))
}

/// Fisheyes that turn round before 90 degrees, go on to 150 degrees, and show angles as radii.
const FISHEYES: [[f64; 4]; 3] =
    [[-0.15, -0.01, 0.003, -0.002], [0.05, -0.01, 0.003, -0.0001], [0.0; 4]];

pub(super) fn beyond_the_fisheye<T: Scalar>() -> Outcome {
    let (mut wrong, mut finite) = (0, true);
    for lens in FISHEYES {
        let limit = fisheye_limit(lens);
        let at = |angle: f64| [0.8 * angle.sin(), 0.6 * angle.sin(), angle.cos()];
        // All the way round to the axis behind the camera.
        let outward: Vec<_> =
            (1..200).map(|k| at(std::f64::consts::PI * k as f64 / 200.0)).collect();
        let beside = [1.0 - 1e-9, 1.0 + 1e-9].map(|share| at(share * limit));
        let axis = [1.0, -1.0, 0.0].map(|z| [0.0, 0.0, z]);
        let tape = Tape::<T>::new();
        let all = points(&tape, &[&outward[..], &beside, &axis].concat());
        let coefficients = vector(&tape, &lens);
        let out = fisheye(all, coefficients)?;
        let found = numbers(&out.value());
        // The angle at which a pinhole would see it.
        let seen = |k: usize| found[3 * k].hypot(found[3 * k + 1]).atan2(found[3 * k + 2]);
        wrong += (1..outward.len()).filter(|&k| seen(k) <= seen(k - 1)).count();
        let rim = outward.len();
        wrong += usize::from((seen(rim) - seen(rim + 1)).abs() > 1e-6);
        let ends = found[3 * (rim + 2)..].chunks(3);
        wrong += ends.filter(|p| p[..2] != [0.0, 0.0]).count();
        finite &= out.value().is_finite() && has_finite_slopes(out, &[all, coefficients])?;
    }
    let outcome = "what lies farther out is shown farther out, up to the axis behind; finite";
    Ok(Found::exactly(outcome, wrong).and(finite, "a number is not finite"))
}

pub(super) fn extreme_lenses<T: Scalar>() -> Outcome {
    let mut results = Vec::new();
    let tape = Tape::<T>::new();
    let some = points(&tape, &[[0.5, 0.25, 1.0]]);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let rule = "distort needs coefficients within -1e100 and 1e100";
        let said = told(distort(some, vector(&tape, &[0.0, 0.0, bad, 0.0, 0.0])));
        results.push((said, format!("{rule}, got {bad}")));
        let said = told(distort(some, vector(&tape, &[0.0, 0.0, 0.0, 0.0, 0.0, bad, 0.0, 0.0])));
        results.push((said, format!("{rule}, got {bad}")));
        let rule = "fisheye needs coefficients within -1e100 and 1e100";
        let said = told(fisheye(some, vector(&tape, &[0.0, bad, 0.0, 0.0])));
        results.push((said, format!("{rule}, got {bad}")));
    }
    let refused = Found::refused(results);
    // Of either sign, where the polynomial turns round at once, or never.
    let mut finite = true;
    for size in [-1e30, -1e6, -1e-30, 1e-30, 1e6] {
        for at in [0, 1, 4] {
            let mut lens = [0.0; 5];
            lens[at] = size;
            let coefficients = vector(&tape, &lens);
            let rows = [[1e-3, 2e-3, 1.0], [0.5, 0.25, 1.0], [1e6, 1.0, 1.0], [1.0, 1.0, -1.0]];
            let all = points(&tape, &rows);
            let out = distort(all, coefficients)?;
            finite &=
                out.value().is_finite() && out.sum().backward()?.get_or_zeros(all).is_finite();
        }
        let rows = [[1e-3, 2e-3, 1.0], [0.5, 0.25, 1.0], [1.0, 1.0, -1.0], [0.0, 0.0, -1.0]];
        let all = points(&tape, &[&rows[..], &[[0.0; 3], [1e-30, 0.0, 1e-30]]].concat());
        for at in 0..4 {
            let mut lens = [0.0; 4];
            lens[at] = size;
            let out = fisheye(all, vector(&tape, &lens))?;
            finite &=
                out.value().is_finite() && out.sum().backward()?.get_or_zeros(all).is_finite();
        }
        for at in 5..8 {
            let mut lens = [0.0; 8];
            lens[at] = size;
            let out = distort(all, vector(&tape, &lens))?;
            finite &=
                out.value().is_finite() && out.sum().backward()?.get_or_zeros(all).is_finite();
        }
    }
    let outcome = format!("{}; finite for lenses of any size", refused.outcome);
    Ok(Found { outcome, ..refused }.and(finite, "a number is not finite"))
}

pub(super) fn instances_of_nothing<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let camera = vector(&tape, &[0.5; 16]).reshape([4, 4])?;
    let mut wrong = 0;
    for (instances, vertices) in [(0, 3), (3, 0), (0, 0)] {
        let positions = tape.leaf(&Tensor::zeros([vertices, 3]));
        let matrices = tape.leaf(&Tensor::zeros([instances, 4, 4]));
        let clip = project_instances(positions, matrices, camera)?;
        let gradients = clip.sum().backward()?;
        let bars = [positions, matrices, camera].map(|leaf| numbers(&gradients.get_or_zeros(leaf)));
        wrong += usize::from(clip.shape() != [0, 4].into());
        wrong += bars.iter().flatten().filter(|&&bar| bar != 0.0).count();
        // An assembly of nothing is nothing.
        let empty = Mesh::new(Vec::new(), vertices)?;
        let assembly = Assembly::new(&[(&empty, instances), (&Mesh::new(vec![[0; 3]], 1)?, 0)])?;
        let rows = assembly.mesh().vertex_count();
        let clip = tape.leaf(&Tensor::zeros([rows, 4]));
        let seen = rasterize(clip, assembly.mesh(), SIZE)?;
        wrong += seen.coverage.count() + usize::from(assembly.place(0).is_some());
    }
    Ok(Found::exactly("an empty clip space, no fragments, gradients of 0", wrong))
}

pub(super) fn too_many_instances<T: Scalar>() -> Outcome {
    let mesh = Mesh::new(vec![[0, 1, 2]], 3)?;
    let rule = "a mesh needs fewer than 2^31 faces and vertices";
    let mut results = Vec::new();
    for (times, given) in [(1_usize << 31, 3_usize << 31), (usize::MAX, usize::MAX)] {
        let given = if times == usize::MAX { given } else { times };
        results.push((told(Assembly::new(&[(&mesh, times)])), format!("{rule}, got {given}")));
    }
    let assembly = Assembly::new(&[(&mesh, 2)])?;
    let said = told(assembly.attributes(&[]));
    let message = "attributes needs an index buffer for each of 1 parts, got 0 inputs";
    results.push((said, message.to_owned()));
    let two = Mesh::new(vec![[0, 1, 2]; 2], 3)?;
    let message = "indices need one face per face of the mesh, 1, got 2";
    results.push((told(assembly.attributes(&[&two])), message.to_owned()));
    let tape = Tape::<T>::new();
    let wide = tape.leaf(&Tensor::zeros([1 << 20, 3]));
    let many = tape.leaf(&Tensor::zeros([1 << 11, 4, 4]));
    let camera = perspective(0.7, 1.0, 0.1, 10.0);
    let message = format!("{rule}, got {}", 1_usize << 31);
    results.push((told(project_instances(wide, many, &camera)), message));
    Ok(Found::refused(results))
}
