//! Lenses of any strength, and points beyond what they show.

use bokashi_core::{Scalar, Tape};
use bokashi_render_ops::camera::{distortion_radius, fisheye_limit};
use bokashi_render_ops::{distort, fisheye};

use crate::extreme::{Extreme, Outcome, Verdict, extremes, keep_error};
use crate::measures::{has_finite_gradients, numbers, rows, vector};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    126 "lens: far outside, behind the eye", "outside stays outside", beyond_the_lens;
    127 "lens: coefficients of any size", "finite, or an error", extreme_lenses;
    189 "fisheye: outside, behind the eye", "outside stays outside", beyond_the_fisheye;
};

/// A lens whose polynomial turns round at a radius of about 1, a lens whose does not, and none.
const LENSES: [[f64; 5]; 3] = [
    [-0.35, 0.03, 0.003, -0.002, -0.002],
    [0.02, 1e-4, -0.01, 0.02, 3e-5],
    [0.0, 0.0, 0.0, 0.0, 0.0],
];

fn beyond_the_lens<T: Scalar>() -> Outcome {
    let (mut wrong, mut finite) = (0, true);
    for lens in LENSES {
        let limit = distortion_radius(lens);
        // Before the camera ever farther out, in the plane of the eye, and behind it.
        let along = |k: usize| [0.1 * limit * k as f64, 0.05 * limit * k as f64, 1.0];
        let outward: Vec<_> = (1..200).map(along).collect();
        let across = [1e-30, 0.0, -0.0, -1e-30, -1.0].map(|z| [0.5, 0.25, z]);
        let axis = [0.0, -1.0].map(|z| [0.0, 0.0, z]);
        let tape = Tape::<T>::new();
        let all = rows(&tape, &[&outward[..], &across, &axis].concat());
        let coefficients = vector(&tape, lens);
        let out = distort(all, coefficients)?;
        let found = numbers(&out.value());
        let radius = |k: usize| found[3 * k].hypot(found[3 * k + 1]);
        wrong += (1..outward.len()).filter(|&k| radius(k) <= radius(k - 1)).count();
        let beside = outward.len()..outward.len() + across.len();
        let at_eye = |k: usize| [found[3 * k], found[3 * k + 1]];
        wrong += beside.clone().filter(|&k| at_eye(k) != at_eye(beside.start)).count();
        wrong += found[3 * beside.end..].chunks(3).filter(|p| p[..2] != [0.0, 0.0]).count();
        finite &= out.value().is_finite() && has_finite_gradients(out, &[all, coefficients])?;
    }
    let outcome = "what lies farther out is shown farther out; no leap at the eye; finite";
    Ok(Verdict::exactly(outcome, wrong).and(finite, "a number is not finite"))
}

/// Fisheyes that turn round before 90 degrees, go on to 150 degrees, and show angles as radii.
const FISHEYES: [[f64; 4]; 3] =
    [[-0.15, -0.01, 0.003, -0.002], [0.05, -0.01, 0.003, -0.0001], [0.0; 4]];

fn beyond_the_fisheye<T: Scalar>() -> Outcome {
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
        let all = rows(&tape, &[&outward[..], &beside, &axis].concat());
        let coefficients = vector(&tape, lens);
        let out = fisheye(all, coefficients)?;
        let found = numbers(&out.value());
        // The angle at which a pinhole would see it.
        let seen = |k: usize| found[3 * k].hypot(found[3 * k + 1]).atan2(found[3 * k + 2]);
        wrong += (1..outward.len()).filter(|&k| seen(k) <= seen(k - 1)).count();
        let first = outward.len();
        wrong += usize::from((seen(first) - seen(first + 1)).abs() > 1e-6);
        let ends = found[3 * (first + 2)..].chunks(3);
        wrong += ends.filter(|p| p[..2] != [0.0, 0.0]).count();
        finite &= out.value().is_finite() && has_finite_gradients(out, &[all, coefficients])?;
    }
    let outcome = "what lies farther out is shown farther out, up to the axis behind; finite";
    Ok(Verdict::exactly(outcome, wrong).and(finite, "a number is not finite"))
}

fn extreme_lenses<T: Scalar>() -> Outcome {
    let mut results = Vec::new();
    let tape = Tape::<T>::new();
    let some = rows(&tape, &[[0.5, 0.25, 1.0]]);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let rule = "distort needs coefficients within -1e100 and 1e100";
        let said = keep_error(distort(some, vector(&tape, [0.0, 0.0, bad, 0.0, 0.0])));
        results.push((said, format!("{rule}, got {bad}")));
        let said =
            keep_error(distort(some, vector(&tape, [0.0, 0.0, 0.0, 0.0, 0.0, bad, 0.0, 0.0])));
        results.push((said, format!("{rule}, got {bad}")));
        let rule = "fisheye needs coefficients within -1e100 and 1e100";
        let said = keep_error(fisheye(some, vector(&tape, [0.0, bad, 0.0, 0.0])));
        results.push((said, format!("{rule}, got {bad}")));
    }
    let refused = Verdict::refused(results);
    // Of either sign, where the polynomial turns round at once, or never.
    let mut finite = true;
    for size in [-1e30, -1e6, -1e-30, 1e-30, 1e6] {
        for at in [0, 1, 4] {
            let mut lens = [0.0; 5];
            lens[at] = size;
            let coefficients = vector(&tape, lens);
            let some = [[1e-3, 2e-3, 1.0], [0.5, 0.25, 1.0], [1e6, 1.0, 1.0], [1.0, 1.0, -1.0]];
            let all = rows(&tape, &some);
            let out = distort(all, coefficients)?;
            finite &=
                out.value().is_finite() && out.sum().backward()?.get_or_zeros(all).is_finite();
        }
        let some = [[1e-3, 2e-3, 1.0], [0.5, 0.25, 1.0], [1.0, 1.0, -1.0], [0.0, 0.0, -1.0]];
        let all = rows(&tape, &[&some[..], &[[0.0; 3], [1e-30, 0.0, 1e-30]]].concat());
        for at in 0..4 {
            let mut lens = [0.0; 4];
            lens[at] = size;
            let out = fisheye(all, vector(&tape, lens))?;
            finite &=
                out.value().is_finite() && out.sum().backward()?.get_or_zeros(all).is_finite();
        }
        for at in 5..8 {
            let mut lens = [0.0; 8];
            lens[at] = size;
            let out = distort(all, vector(&tape, lens))?;
            finite &=
                out.value().is_finite() && out.sum().backward()?.get_or_zeros(all).is_finite();
        }
    }
    let outcome = format!("{}; finite for lenses of any size", refused.outcome);
    Ok(Verdict { outcome, ..refused }.and(finite, "a number is not finite"))
}
