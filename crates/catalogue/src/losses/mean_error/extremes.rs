//! Losses of images that are empty, flat, masked, huge or tiny.

use bokashi_core::{Mask, Scalar, Tape, Tensor};
use bokashi_fit::{
    DepthAlignment, Penalty, depth_error, halved, masked_error, mean_error, multiscale_ssim_error,
    silhouette_error, ssim_error, total_variation, weighted_error,
};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes, keep_error};
use crate::measures::{largest, loss_and_gradients, motley, rounding, tensor};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    181 "losses: images without a pixel", "an error; 0 under a mask", without_a_pixel;
    182 "losses: constant images", "0 and no slope; luminance", constant_images;
    183 "losses: nothing shown", "0, no gradient", nothing_shown;
    184 "losses: NaN where nothing is shown", "not read", hidden_numbers;
    185 "losses: images times 2^k", "scaled, finite gradients", any_size;
};

const PENALTIES: [Penalty; 5] = [
    Penalty::Squared,
    Penalty::Absolute,
    Penalty::Huber { delta: 0.5 },
    Penalty::Charbonnier { scale: 0.5 },
    Penalty::Relative { epsilon: 0.01 },
];

const ALIGNMENTS: [DepthAlignment; 3] =
    [DepthAlignment::None, DepthAlignment::Scale, DepthAlignment::ScaleAndShift];

fn without_a_pixel<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut results = Vec::new();
    let shape = "got shape [0, 4, 3]";
    let none = tape.leaf(&tensor(&[0, 4, 3], |_| 0.0));
    results.push((
        keep_error(mean_error(none, none, Penalty::Absolute)),
        format!("mean_absolute_error needs at least one entry, {shape}"),
    ));
    let windows = "images [H, W, C] of at least 11 x 11 pixels";
    results.push((
        keep_error(ssim_error(none, none, 1.0)),
        format!("ssim_error needs {windows}, C > 0, {shape}"),
    ));
    results.push((
        keep_error(multiscale_ssim_error(none, none, 1.0, None)),
        format!("multiscale_ssim_error needs {windows} for 1 level, {shape}"),
    ));
    results.push((
        keep_error(total_variation(none, Penalty::Absolute)),
        format!("total_variation needs a texture [H, W, C] of at least one entry, {shape}"),
    ));
    let mut wrong = usize::from(*halved(none)?.shape() != [0, 2, 3]);
    let mask = Mask::full([0, 4], true);
    let weights = tape.leaf(&tensor(&[0, 4], |_| 1.0));
    for loss in [
        masked_error(none, none, &mask, Penalty::Squared)?,
        weighted_error(none, none, weights, Penalty::Squared)?,
        silhouette_error(none, none)?,
        depth_error(none, none, None, DepthAlignment::ScaleAndShift)?,
    ] {
        wrong += usize::from(loss_and_gradients(loss, &[none])? != (0.0, vec![]));
    }
    Ok(Verdict::refused(results).and(wrong == 0, "a mean over nothing that is not 0"))
}

fn constant_images<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    let mut wrong = 0;
    for level in [0.0, 1e-20, 0.7, 1e6] {
        let tape = Tape::<T>::new();
        let [x, y] = [level, level].map(|level| tape.leaf(&tensor(&[41, 43, 2], |_| level)));
        for loss in [
            ssim_error(x, y, 1.0)?,
            multiscale_ssim_error(x, y, 1.0, None)?,
            total_variation(x, Penalty::Absolute)?,
            total_variation(x, Penalty::Charbonnier { scale: 1e-3 })?,
        ] {
            let (loss, gradients) = loss_and_gradients(loss, &[x, y])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
        // Against another constant: the luminance alone.
        let other = tape.constant(&tensor(&[41, 43, 2], |_| 0.5));
        let (found, gradients) = loss_and_gradients(ssim_error(x, other, 1.0)?, &[x])?;
        let level = T::from_f64(level).to_f64();
        let expected = 1.0 - (2.0 * level * 0.5 + 1e-4) / (level * level + 0.25 + 1e-4);
        error = error.maximum_or_nan((found - expected).abs());
        wrong += usize::from(!gradients.iter().all(|g| g.is_finite()));
    }
    // The result's rounding, and that of sums over 66 windows in a row and 31 rows.
    let bound = 4.0 * rounding::<T>() + 97.0 * f64::EPSILON;
    let found = Verdict::within("no error, no slope; the luminance", error, bound);
    Ok(found.and(wrong == 0, "an error or a slope of equal images"))
}

fn nothing_shown<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut wrong = 0;
    for bad in [0.5, f64::NAN, f64::INFINITY] {
        let x = tape.leaf(&tensor(&[6, 5, 2], |_| bad));
        let y = tape.leaf(&tensor(&[6, 5, 2], motley));
        let hidden = Mask::full([6, 5], false);
        let weights = tape.leaf(&tensor(&[6, 5], |_| 0.0));
        let is_number = bad == 0.5;
        let mut losses = Vec::new();
        for penalty in PENALTIES {
            losses.push(masked_error(x, y, &hidden, penalty)?);
            losses.push(weighted_error(x, y, weights, penalty)?);
        }
        let hidden = Mask::full([6, 5, 2], false);
        for alignment in ALIGNMENTS {
            losses.push(depth_error(x, y, Some(&hidden), alignment)?);
        }
        for loss in losses {
            let (loss, gradients) = loss_and_gradients(loss, &[x, y, weights])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
        // Empty silhouettes agree.
        if is_number {
            let empty = tape.leaf(&tensor(&[6, 5], |_| 0.0));
            let (loss, gradients) =
                loss_and_gradients(silhouette_error(empty, weights)?, &[empty, weights])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
    }
    Ok(Verdict::exactly("0, without a gradient", wrong))
}

fn hidden_numbers<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let shown = Mask::from_flat_fn([6, 5], |p| p % 3 > 0);
        let is_shown = |k: usize| shown.data()[k / 2];
        for penalty in PENALTIES {
            let of = |bad: f64| -> Result<_, Failure> {
                let tape = Tape::<T>::new();
                let x = |k| if is_shown(k) { motley(k) } else { bad };
                let x = tape.leaf(&tensor(&[6, 5, 2], x));
                let y = tape.leaf(&tensor(&[6, 5, 2], |k| motley(7 * k)));
                loss_and_gradients(masked_error(x, y, &shown, penalty)?, &[x, y])
            };
            wrong += usize::from(of(bad)? != of(0.25)?);
        }
    }
    Ok(Verdict::exactly("as if they were any number", wrong))
}

fn any_size<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    let mut wrong = 0;
    let exponents: &[i32] =
        if rounding::<T>() > 1e-10 { &[-60, -30, 0, 30, 60] } else { &[-250, -60, 0, 60, 250] };
    let image = |of: usize, factor: f64| -> Tensor<T> {
        tensor(&[24, 25, 2], move |k| factor * (0.5 + motley(of * k)))
    };
    let mut references: Vec<f64> = Vec::new();
    for (at, &exponent) in [0].iter().chain(exponents).enumerate() {
        let factor = f64::powi(2.0, exponent);
        let tape = Tape::<T>::new();
        let [x, y] = [3, 7].map(|of| tape.leaf(&image(of, factor)));
        let relative = Penalty::Relative { epsilon: factor * factor * 0.01 };
        let losses = [
            (mean_error(x, y, Penalty::Squared)?, factor * factor),
            (mean_error(x, y, Penalty::Absolute)?, factor),
            (mean_error(x, y, Penalty::Huber { delta: 0.25 * factor })?, factor * factor),
            (mean_error(x, y, Penalty::Charbonnier { scale: 0.25 * factor })?, factor),
            (mean_error(x, y, relative)?, 1.0),
            (total_variation(x, Penalty::Absolute)?, factor),
            (total_variation(x, Penalty::Charbonnier { scale: 0.1 * factor })?, factor),
            (depth_error(x, y, None, DepthAlignment::None)?, factor),
            (depth_error(x, y, None, DepthAlignment::ScaleAndShift)?, factor),
            (ssim_error(x, y, factor)?, 1.0),
        ];
        for (k, (loss, unit)) in losses.into_iter().enumerate() {
            let (loss, gradients) = loss_and_gradients(loss, &[x, y])?;
            wrong += usize::from(!gradients.iter().all(|g| g.is_finite()));
            if at == 0 {
                references.push(loss);
            }
            error = error.maximum_or_nan((loss / unit / references[k] - 1.0).abs());
        }
    }
    let found = Verdict::within("the losses of 2^0, scaled", error, 16.0 * rounding::<T>());
    Ok(found.and(wrong == 0, "a gradient is not finite"))
}
