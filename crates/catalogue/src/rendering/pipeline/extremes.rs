//! Colours, targets and upstream gradients; and what a fit makes of numbers that are none.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::{
    Fit, FitError, FitSettings, Optimizer, Parameter, Parameters, from_fn, squared_error,
};
use bokashi_render_ops::{
    Background, Blur, Size, antialias, composite, gaussian_blur, interpolate, rasterize,
};

use crate::clip_scene::{BACKGROUND, ClipScene, orders};
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, numbers, rounding};
use crate::oracle::{GridScene, STEPS};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    1 "no faces", "the background, zero gradients", no_faces;
    36 "images of 1 x N and 1 x 1", "defined", strips_and_single_pixels;
    37 "upstream that cancels", "exactly 0", upstream_that_cancels;
    38 "upstream NaN", "an error, or propagated", upstream_nan;
    39 "target equals render", "loss 0, gradients exactly 0", target_equals_render;
    50 "colours of 1e30 and 1e-30", "finite, or an error", huge_and_tiny_colors;
    60 "colours whose difference overflows", "an error", colors_that_overflow;
    61 "gradient of 1e30 under Adam", "a step, or an error", gradient_spike;
    62 "division by zero, ln 0, 0 / 0", "an error", division_by_zero;
};

const CORNERS: [[f64; 4]; 3] =
    [[-0.8, -0.9, 0.0, 1.0], [0.9, -0.7, 0.0, 1.0], [0.1, 0.8, 0.0, 1.0]];

fn no_faces<T: Scalar>() -> Outcome {
    let size = Size { width: 5, height: 4 };
    let rendered = ClipScene::new(&CORNERS, &[], size).rendered::<T>(Some(1.3))?;
    let sharp = ClipScene::new(&CORNERS, &[], size).rendered_with::<T>(None, |_| 1.0)?;
    let background: Vec<_> = (0..40).map(|k| BACKGROUND[k % 2]).collect();
    let bars = rendered.clip_bar.iter().chain(&rendered.color_bar);
    let error = difference(&sharp.image, &background)
        .max(largest(bars.copied()))
        .max(difference(&sharp.background_bar, &[20.0, 20.0]));
    Ok(Verdict::within("the background, zero gradients, the background's gradient 20", error, 0.0))
}

const CLIP: [[f64; 4]; 4] =
    [[-0.8, -0.9, 0.0, 1.0], [0.9, -0.7, 0.1, 1.1], [0.15, 0.8, 0.2, 1.0], [-0.9, 0.7, -0.1, 0.9]];

fn scene() -> ClipScene {
    ClipScene::new(&CLIP, &[[0, 1, 2], [0, 2, 3]], Size { width: 12, height: 9 })
}

/// Leaves of a whole pipeline, and its image.
struct Pipeline<'t, T: Scalar> {
    leaves: [Var<'t, T>; 3],
    image: Var<'t, T>,
}

/// The scene's image with vertex colours `color(k)`, antialiased and blurred.
fn pipeline<'t, T: Scalar>(
    tape: &'t Tape<T>,
    color: impl Fn(usize) -> f64,
) -> Result<Pipeline<'t, T>, Failure> {
    let scene = scene();
    let clip = scene.leaf(tape);
    let colors = tape.leaf(&Tensor::from_flat_fn([4, 3], |k| T::from_f64(color(k))));
    let sigma = tape.leaf_scalar(T::from_f64(1.1));
    let fragments = rasterize(clip, &scene.mesh()?, scene.size)?;
    let surface = interpolate(colors, &fragments)?;
    let picture = antialias(composite(surface, &fragments, Background::Zero)?)?;
    let image = picture.image()?;
    let image = gaussian_blur(image, sigma, &Blur::default())?;
    Ok(Pipeline { leaves: [clip, colors, sigma], image })
}

fn strips_and_single_pixels<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    let mut error = 0.0_f64;
    for (width, height) in [(1, 1), (16, 1), (1, 16), (2, 1), (64, 1), (1, 64)] {
        let size = Size { width, height };
        let (w, h) = (width as i64 * STEPS, height as i64 * STEPS);
        for order in orders([0, 1, 2]) {
            let points = vec![[-w / 2, -h], [2 * w, h / 4], [w / 4, 3 * h]];
            let grid = GridScene { points, faces: vec![order], size };
            let scene = grid.scene();
            wrong += scene.draw::<T>()?.differs_from(&grid.covered());
            wrong += usize::from(!scene.rendered::<T>(Some(2.0))?.is_finite());
        }
        // The mean of an image survives any blur under a mirror.
        let tape = Tape::<T>::new();
        let image =
            tape.leaf(&Tensor::from_flat_fn([height, width, 1], |k| T::from_f64(motley(k))));
        let out = gaussian_blur(image, tape.leaf_scalar(T::from_f64(2.5)), &Blur::default())?;
        let sum =
            |tensor: &Tensor<T>| numbers(tensor).iter().sum::<f64>() / (width * height) as f64;
        error = error.maximum_or_nan((sum(&out.value()) - sum(&image.value())).abs());
    }
    Ok(Verdict::within("coverage exact; a blur keeps the mean", error, 8.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pixels are wrong, or gradients not finite")))
}

fn upstream_that_cancels<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let Pipeline { leaves, image } = pipeline(&tape, motley)?;
    let up = Tensor::from_flat_fn(image.shape(), |k| T::from_f64(motley(7 * k)));
    let down = up.map(|entry| -entry);
    let by_seeds = tape.vjp(&[(image, &up), (image, &down)])?;
    let by_loss = (image.sum() - image.sum()).backward()?;
    let bars = leaves.iter().flat_map(|&leaf| {
        let both = [by_seeds.get_or_zeros(leaf), by_loss.get_or_zeros(leaf)];
        both.map(|bar| largest(numbers(&bar)))
    });
    Ok(Verdict::within("every gradient exactly 0", largest(bars), 0.0))
}

fn upstream_nan<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let Pipeline { leaves, image } = pipeline(&tape, motley)?;
    let middle = 3 * (4 * 12 + 6);
    let entry = |k: usize| T::from_f64(if k == middle { f64::NAN } else { 0.0 });
    let upstream = Tensor::from_flat_fn(image.shape(), entry);
    let gradients = tape.vjp(&[(image, &upstream)])?;
    let masked = leaves.iter().filter(|&&leaf| gradients.get_or_zeros(leaf).is_finite()).count();
    // A fit stops there, and changes nothing.
    let start = Parameters::new().with(Parameter::new("x", Tensor::scalar(T::ONE)))?;
    let mut fit = Fit::new(start, FitSettings::default())?;
    let said = fit.step(&mut from_fn(|_: &Tape<T>, variables| {
        // sqrt(0) has no slope: the loss is 1, its gradient NaN.
        let x = variables.get("x")?;
        Ok(x + ((x - T::ONE) * T::ZERO).sqrt())
    }));
    let message = "the gradient of \"x\" needs to be finite, got NaN at step 0, \
                   first in the backward pass of sqrt";
    let value = fit.parameters().value("x")?.item();
    Ok(Verdict::exactly(format!("propagated to every leaf; a fit: error: {message}"), masked)
        .and(
            said.map_err(|error| error.to_string()).err().as_deref() == Some(message),
            "the fit says something else",
        )
        .and(value == T::ONE, "the fit moved its parameter"))
}

fn target_equals_render<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let Pipeline { leaves, image } = pipeline(&tape, motley)?;
    let loss = squared_error(image, tape.constant(&image.value()))?;
    let gradients = loss.backward()?;
    let missing = leaves.iter().filter(|&&leaf| gradients.get(leaf).is_none()).count();
    let bars = leaves.iter().map(|&leaf| largest(numbers(&gradients.get_or_zeros(leaf))));
    let error = loss.item().to_f64().maximum_or_nan(largest(bars));
    Ok(Verdict::within("loss 0, gradients exactly 0", error, 0.0)
        .and(missing == 0, "a leaf has no gradient"))
}

fn huge_and_tiny_colors<T: Scalar>() -> Outcome {
    // Each is linear in the colours: at 2^100 and 2^-100 the image is that at 1, times that.
    let image = |factor: f64| -> Result<(Vec<f64>, bool), Failure> {
        let tape = Tape::<T>::new();
        let Pipeline { leaves, image } = pipeline(&tape, |k| factor * motley(k))?;
        let gradients = image.sum().backward()?;
        let finite = leaves.iter().all(|&leaf| gradients.get_or_zeros(leaf).is_finite());
        Ok((numbers(&image.value()).iter().map(|entry| entry / factor).collect(), finite))
    };
    let (plain, _) = image(1.0)?;
    let mut error = 0.0_f64;
    let mut finite = true;
    for power in [100, -100] {
        let (scaled, is_finite) = image(f64::powi(2.0, power))?;
        error = error.maximum_or_nan(difference(&scaled, &plain));
        finite &= is_finite;
    }
    // Their squares are beyond f32: an error, not an infinite loss.
    let start = Tensor::full([4], T::from_f64(1e30));
    let parameters = Parameters::new().with(Parameter::new("colours", start))?;
    let mut fit = Fit::new(parameters, FitSettings::default())?;
    let said = fit.step(&mut from_fn(|tape: &Tape<T>, variables| {
        let target = tape.constant_full([4], T::from_f64(1e-30));
        Ok(squared_error(variables.get("colours")?, target)?)
    }));
    let said = said.map(drop).map_err(|error| error.to_string());
    let expected = match rounding::<T>() > 1e-10 {
        true => Err("the loss needs to be finite, got inf at step 0, \
                     first in the output of squared_error of \"colours\""
            .to_owned()),
        false => Ok(()),
    };
    let outcome = match &expected {
        Err(message) => format!("finite, the image times 2^100; squared: error: {message}"),
        Ok(()) => "finite, the image times 2^100; squared: finite".to_owned(),
    };
    Ok(Verdict::within(outcome, error, rounding::<T>())
        .and(finite, "a gradient is not finite")
        .and(said == expected, "the squared error came to something else"))
}

fn colors_that_overflow<T: Scalar>() -> Outcome {
    // The largest number beside its negative: their difference is no number.
    let most = if rounding::<T>() > 1e-10 { f64::from(f32::MAX) } else { f64::MAX };
    let start =
        Tensor::from_flat_fn([4, 1], |k| T::from_f64(if k % 2 == 0 { most } else { -most }));
    let parameters = Parameters::new().with(Parameter::new("colours", start.clone()))?;
    let mut fit = Fit::new(parameters, FitSettings::default())?;
    let scene = scene();
    let mesh = scene.mesh()?;
    let said = fit.step(&mut from_fn(|tape: &Tape<T>, variables| {
        let clip = scene.leaf(tape);
        let fragments = rasterize(clip, &mesh, scene.size)?;
        let surface = interpolate(variables.get("colours")?, &fragments)?;
        Ok(composite(surface, &fragments, Background::Zero)?.image()?.sum())
    }));
    let message = said.map_err(|error| error.to_string()).err().unwrap_or_default();
    let rule = "the loss needs to be finite, got ";
    let kept = fit.parameters().value("colours")? == start;
    let origin = " at step 0, first in the output of interpolate of \"colours\"";
    let right = message.starts_with(rule) && message.ends_with(origin);
    let outcome = format!("error: {message}");
    Ok(Verdict { outcome, pass: right, error: None, bound: None }
        .and(kept, "the fit moved its parameters"))
}

fn gradient_spike<T: Scalar>() -> Outcome {
    // The square of 1e30 is no number of f32: Adam would never move that entry again.
    let start = Parameters::new().with(Parameter::new("x", Tensor::scalar(T::ONE)).rate(0.5))?;
    let settings = FitSettings { optimizer: Optimizer::default(), ..FitSettings::default() };
    let mut fit = Fit::new(start, settings)?;
    let said = fit
        .step(&mut from_fn(|_: &Tape<T>, variables| Ok(variables.get("x")? * T::from_f64(1e30))));
    let moved = 1.0 - fit.parameters().value("x")?.item().to_f64();
    if rounding::<T>() < 1e-10 {
        said?;
        return Ok(Verdict::within("a step of the learning rate", (moved - 0.5).abs(), 1e-15));
    }
    let message = "the squared gradient of \"x\" needs to be finite, got inf at step 0";
    let results = vec![(said.map(drop).map_err(|error| error.to_string()), message.to_owned())];
    Ok(Verdict::refused(results).and(moved == 0.0, "the fit moved its parameter"))
}

fn division_by_zero<T: Scalar>() -> Outcome {
    let mut results = Vec::new();
    for (value, operation) in [("inf", "powi"), ("-inf", "ln"), ("NaN", "div")] {
        let start = Parameters::new().with(Parameter::new("x", Tensor::scalar(T::ZERO)))?;
        let mut fit = Fit::new(start, FitSettings::default())?;
        let said: Result<_, FitError> = fit.step(&mut from_fn(|_: &Tape<T>, variables| {
            let x = variables.get("x")?;
            Ok(match value {
                "inf" => x.powi(-1),
                "-inf" => x.ln(),
                _ => (x + x) / x,
            })
        }));
        let origin = format!("first in the output of {operation} of \"x\"");
        let message = format!("the loss needs to be finite, got {value} at step 0, {origin}");
        results.push((said.map(drop).map_err(|error| error.to_string()), message));
    }
    Ok(Verdict::refused(results))
}
