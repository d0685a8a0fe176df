//! Distances along the view axis where they are hard to tell, and fragments that outlive their step.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{
    Background, Fragments, Mesh, RasterOptions, RenderError, Sampling, Size, depth, eye_depth,
    interpolate, rasterize,
};

use crate::extreme::{Extreme, Outcome, Verdict, extremes, keep_error};
use crate::measures::{difference, largest, motley, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    130 "distances: w from 1e-6 to 1e6", "where the ray meets the face", wide_range_of_w;
    131 "distances: w = 1 everywhere", "1", flat_w;
    132 "distances: background far away", "infinite, or an error", backgrounds_far_away;
    133 "fragments of an earlier step", "the same bits", fragments_of_an_earlier_step;
};

const SIZE: Size = Size { width: 12, height: 9 };

/// A face that fills much of the image, with vertices of these w.
fn face<T: Scalar>(
    tape: &Tape<T>,
    w: [f64; 3],
    sampling: Sampling,
) -> Result<Fragments<'_, T>, RenderError> {
    let places = [[-0.9, -0.8], [0.95, -0.7], [0.1, 0.9]];
    let clip = Tensor::from_flat_fn([3, 4], |k| {
        let (w, [x, y]) = (w[k / 4], places[k / 4]);
        T::from_f64([x * w, y * w, 0.0, w][k % 4])
    });
    let options = RasterOptions::new(SIZE).sampling(sampling);
    rasterize(tape.leaf(&clip), &Mesh::new(vec![[0, 1, 2]], 3)?, options.creases(&[]))
}

/// The distance of the face at a pixel's centre: 1 / w is linear between the corners on the screen.
fn expected(clip: &[f64], pixel: usize) -> f64 {
    let corner = |k: usize| [clip[4 * k] / clip[4 * k + 3], clip[4 * k + 1] / clip[4 * k + 3]];
    let [width, height] = [SIZE.width, SIZE.height].map(|extent| extent as f64);
    let x = 2.0 * ((pixel % SIZE.width) as f64 + 0.5) / width - 1.0;
    let y = 1.0 - 2.0 * ((pixel / SIZE.width) as f64 + 0.5) / height;
    let area = |p: [f64; 2], q: [f64; 2]| (p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x);
    let [a, b, c] = [corner(0), corner(1), corner(2)];
    let weights = [area(b, c), area(c, a), area(a, b)];
    let sum: f64 = weights.iter().sum();
    let inverse: f64 = (0..3).map(|k| weights[k] / clip[4 * k + 3]).sum();
    sum / inverse
}

fn wide_range_of_w<T: Scalar>() -> Outcome {
    let (mut error, mut finite) = (0.0_f64, true);
    for w in [
        [1.0, 1.0, 1.0],
        [1e-6, 1.0, 1e6],
        [1e6, 1e-6, 1e6],
        [1e-30, 1e-30, 2e-30],
        [3e5, 1.0, 1.0],
    ] {
        let tape = Tape::<T>::new();
        let fragments = face(&tape, w, Sampling::Center)?;
        let values = eye_depth(&fragments)?.values();
        let clip = numbers(&fragments.clip.value());
        for (pixel, found) in fragments.coverage.pixels().zip(numbers(&values.value())) {
            let expected = expected(&clip, pixel);
            error = error.maximum_or_nan((found - expected).abs() / expected);
        }
        let gradients = values.sum().backward()?;
        finite &= gradients.get_or_zeros(fragments.clip).is_finite();
    }
    let outcome = "the distance at which each pixel's ray meets the face, finite gradients";
    Ok(Verdict::within(outcome, error, 2.0 * rounding::<T>() + 1e-14)
        .and(finite, "a gradient is not finite"))
}

fn flat_w<T: Scalar>() -> Outcome {
    // As an orthographic camera has it.
    let tape = Tape::<T>::new();
    let mut error = 0.0_f64;
    for sampling in [Sampling::Center, Sampling::Exact] {
        let fragments = face(&tape, [1.0; 3], sampling)?;
        let values = numbers(&eye_depth(&fragments)?.values().value());
        error = error.maximum_or_nan(largest(values.iter().map(|value| value - 1.0)));
    }
    Ok(Verdict::within("1 everywhere", error, 4.0 * rounding::<T>()))
}

fn backgrounds_far_away<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let [centers, exact] =
        [Sampling::Center, Sampling::Exact].map(|s| face(&tape, [1.0, 2.0, 3.0], s));
    let (centers, exact) = (centers?, exact?);
    let mut results = Vec::new();
    for far in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY] {
        let rule = "eye_depth needs a background at a distance above 0";
        let said = keep_error(eye_depth(&centers)?.image(&centers, far));
        results.push((said, format!("{rule}, got {far}")));
    }
    for far in [0.0, f64::INFINITY, f64::NAN] {
        let rule = "eye_depth needs a background at a finite distance above 0";
        let said = keep_error(eye_depth(&exact)?.image(&exact, far));
        results.push((said, format!("{rule}, got {far}")));
    }
    let endless = eye_depth(&centers)?.image(&centers, f64::INFINITY)?.distances();
    let seen = numbers(&endless.value()).iter().filter(|distance| distance.is_finite()).count();
    let is_right = seen == centers.coverage.count();
    Ok(Verdict::refused(results).and(is_right, "infinitely far is elsewhere than where nothing is"))
}

fn fragments_of_an_earlier_step<T: Scalar>() -> Outcome {
    let (mut error, mut bars) = (0.0_f64, 0);
    for sampling in [Sampling::Center, Sampling::Exact] {
        let mut tape = Tape::<T>::new();
        let draw = |fragments: &Fragments<'_, T>| -> Result<(Vec<f64>, usize), RenderError> {
            let tape = fragments.clip.tape();
            let colors = tape.leaf(&Tensor::from_flat_fn([3, 2], |k| T::from_f64(motley(k))));
            let surface = interpolate(colors, fragments)?;
            let image = fragments.picture(surface, Background::Zero)?.image()?;
            let distances = eye_depth(fragments)?.image(fragments, 9.0)?.distances();
            let all = [image.value(), distances.value(), depth(fragments)?.value()];
            let gradients = (image.sum() + distances.sum()).backward()?;
            let moves =
                gradients.get_or_zeros(fragments.clip).data().iter().any(|&bar| bar != T::ZERO);
            Ok((all.iter().flat_map(numbers).collect(), usize::from(moves)))
        };
        let (constant, (expected, moves)) = {
            let fragments = face(&tape, [1.0, 2.0, 3.0], sampling)?;
            (fragments.constant(), draw(&fragments)?)
        };
        bars += 1 - moves;
        for _ in 0..2 {
            tape.reset();
            face(&tape, [2.0, 1.0, 1.5], sampling)?;
            let (found, moves) = draw(&constant.on(&tape))?;
            error = error.maximum_or_nan(difference(&found, &expected));
            bars += moves;
        }
    }
    let outcome = "the same bits two steps later, without a gradient of the geometry";
    Ok(Verdict::within(outcome, error, 0.0)
        .and(bars == 0, "a gradient is where there should be none"))
}
