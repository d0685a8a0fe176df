//! Losses and regularizers of what is empty, flat, masked, degenerate, huge or tiny.

use bokashi_core::{Mask, Scalar, Tape, Tensor, TensorError, Var};
use bokashi_fit::{
    DepthAlignment, Penalty, RigidWeights, Rigidity, Topology, depth_error, edge_length_error,
    halved, laplacian_error, masked_error, mean_error, multiscale_ssim_error, normal_error,
    silhouette_error, ssim_error, total_variation, weighted_error,
};

use super::row::{Failure, Found, Outcome, told};
use super::scene::{largest, motley, numbers, rounding};

const PENALTIES: [Penalty; 5] = [
    Penalty::Squared,
    Penalty::Absolute,
    Penalty::Huber { delta: 0.5 },
    Penalty::Charbonnier { scale: 0.5 },
    Penalty::Relative { epsilon: 0.01 },
];

const ALIGNMENTS: [DepthAlignment; 3] =
    [DepthAlignment::None, DepthAlignment::Scale, DepthAlignment::ScaleAndShift];

/// A tensor of these numbers.
fn tensor<T: Scalar>(shape: &[usize], entry: impl Fn(usize) -> f64) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| T::from_f64(entry(k)))
}

/// A loss, and its gradients by these variables.
fn run<T: Scalar>(loss: Var<'_, T>, by: &[Var<'_, T>]) -> Result<(f64, Vec<f64>), Failure> {
    let gradients = loss.backward()?;
    let all = by.iter().flat_map(|&x| numbers(&gradients.get_or_zeros(x)));
    Ok((loss.item().to_f64(), all.collect()))
}

pub(super) fn without_a_pixel<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut results = Vec::new();
    let shape = "got shape [0, 4, 3]";
    let none = tape.leaf(&tensor(&[0, 4, 3], |_| 0.0));
    results.push((
        told(mean_error(none, none, Penalty::Absolute)),
        format!("mean_absolute_error needs at least one entry, {shape}"),
    ));
    let windows = "images [H, W, C] of at least 11 x 11 pixels";
    results.push((
        told(ssim_error(none, none, 1.0)),
        format!("ssim_error needs {windows}, C > 0, {shape}"),
    ));
    results.push((
        told(multiscale_ssim_error(none, none, 1.0, None)),
        format!("multiscale_ssim_error needs {windows} for 1 level, {shape}"),
    ));
    results.push((
        told(total_variation(none, Penalty::Absolute)),
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
        wrong += usize::from(run(loss, &[none])? != (0.0, vec![]));
    }
    Ok(Found::refused(results).and(wrong == 0, "a mean over nothing that is not 0"))
}

pub(super) fn constant_images<T: Scalar>() -> Outcome {
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
            let (loss, gradients) = run(loss, &[x, y])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
        // Against another constant: the luminance alone.
        let other = tape.constant(&tensor(&[41, 43, 2], |_| 0.5));
        let (found, gradients) = run(ssim_error(x, other, 1.0)?, &[x])?;
        let level = T::from_f64(level).to_f64();
        let expected = 1.0 - (2.0 * level * 0.5 + 1e-4) / (level * level + 0.25 + 1e-4);
        error = error.maximum_or_nan((found - expected).abs());
        wrong += usize::from(!gradients.iter().all(|g| g.is_finite()));
    }
    // The result's rounding, and that of sums over 66 windows in a row and 31 rows.
    let bound = 4.0 * rounding::<T>() + 97.0 * f64::EPSILON;
    let found = Found::within("no error, no slope; the luminance", error, bound);
    Ok(found.and(wrong == 0, "an error or a slope of equal images"))
}

pub(super) fn nothing_shown<T: Scalar>() -> Outcome {
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
            let (loss, gradients) = run(loss, &[x, y, weights])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
        // Empty silhouettes agree.
        if is_number {
            let empty = tape.leaf(&tensor(&[6, 5], |_| 0.0));
            let (loss, gradients) = run(silhouette_error(empty, weights)?, &[empty, weights])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
    }
    Ok(Found::exactly("0, without a gradient", wrong))
}

pub(super) fn hidden_numbers<T: Scalar>() -> Outcome {
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
                run(masked_error(x, y, &shown, penalty)?, &[x, y])
            };
            wrong += usize::from(of(bad)? != of(0.25)?);
        }
    }
    Ok(Found::exactly("as if they were any number", wrong))
}

pub(super) fn any_size<T: Scalar>() -> Outcome {
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
            let (loss, gradients) = run(loss, &[x, y])?;
            wrong += usize::from(!gradients.iter().all(|g| g.is_finite()));
            if at == 0 {
                references.push(loss);
            }
            error = error.maximum_or_nan((loss / unit / references[k] - 1.0).abs());
        }
    }
    let found = Found::within("the losses of 2^0, scaled", error, 16.0 * rounding::<T>());
    Ok(found.and(wrong == 0, "a gradient is not finite"))
}

/// All regularizers of positions.
fn regularizers<'t, T: Scalar>(
    positions: Var<'t, T>,
    rest: &Tensor<T>,
    topology: &Topology,
) -> Result<Vec<Var<'t, T>>, TensorError> {
    let rigid = |weights| Rigidity::new(topology, rest, weights)?.error(positions);
    Ok(vec![
        laplacian_error(positions, &topology.uniform_laplacian())?,
        laplacian_error(positions, &topology.combinatorial_laplacian())?,
        laplacian_error(positions, &topology.cotangent_laplacian(rest)?)?,
        edge_length_error(positions, topology, 0.0)?,
        edge_length_error(positions, topology, 0.5)?,
        normal_error(positions, topology)?,
        rigid(RigidWeights::Uniform)?,
        rigid(RigidWeights::Cotangent)?,
    ])
}

pub(super) fn degenerate_faces<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    // A proper face, beside faces on a line, in a point, and with a vertex twice.
    let faces = [[0, 1, 2], [1, 2, 3], [3, 4, 5], [4, 4, 5], [6, 7, 8], [2, 1, 0]];
    let topology = Topology::new(&faces, 9)?;
    for size in [1e-12, 1.0, 1e12] {
        for shape in [
            // On a line beyond the first face; all in one place; a needle.
            |k: usize| [0.0, 1.0, 0.5, 0.75, 1.0, 1.5, 3.0, 3.0, 3.0][k],
            |_| 2.0,
            |k: usize| k as f64 + if k == 4 { 1e-9 } else { 0.0 },
        ] {
            let at = |k: usize| {
                let along = shape(k / 3);
                size * [along, if k / 3 == 2 { 1.0 } else { 0.0 }, 2.0 * along][k % 3]
            };
            let positions = tensor::<T>(&[9, 3], at);
            let tape = Tape::<T>::new();
            let x = tape.leaf(&positions);
            for loss in regularizers(x, &positions, &topology)? {
                let (loss, gradients) = run(loss, &[x])?;
                let is_finite = loss.is_finite() && gradients.iter().all(|g| g.is_finite());
                wrong += usize::from(!is_finite || loss < 0.0);
            }
        }
    }
    Ok(Found::exactly("finite, and so is the gradient", wrong))
}

pub(super) fn meshes_of_nothing<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for count in [0, 1, 4] {
        let topology = Topology::new(&[], count)?;
        let tape = Tape::<T>::new();
        let positions = tensor(&[count, 3], motley);
        let x = tape.leaf(&positions);
        for loss in regularizers(x, &positions, &topology)? {
            let (loss, gradients) = run(loss, &[x])?;
            wrong += usize::from(loss != 0.0 || largest(gradients) != 0.0);
        }
    }
    Ok(Found::exactly("0, without a gradient", wrong))
}

pub(super) fn refused<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let x = tape.leaf(&tensor(&[12, 12, 1], motley));
    let topology = Topology::new(&[[0, 1, 2]], 3)?;
    let points = tape.leaf(&tensor(&[4, 3], motley));
    let lost = tensor::<T>(&[3, 3], |k| if k == 4 { f64::NAN } else { 1.0 });
    let negative = tape.leaf(&tensor(&[12, 12], |k| k as f64 - 1.0));
    let three = "positions of shape [3, 3], got shape [4, 3]";
    let weights = weighted_error(x, x, negative, Penalty::Squared);
    Ok(Found::refused(vec![
        (
            told(Topology::new(&[[0, 1, 3]], 3)),
            "topology needs indices within an axis of extent 3, got 3".into(),
        ),
        (told(edge_length_error(points, &topology, 1.0)), format!("edge_length_error needs {three}")),
        (told(normal_error(points, &topology)), format!("normal_error needs {three}")),
        (
            told(topology.cotangent_laplacian(&lost)),
            "cotangent_laplacian needs finite positions, got NaN".into(),
        ),
        (
            told(Rigidity::new(&topology, &lost, RigidWeights::Uniform)),
            "cotangent_laplacian needs finite positions, got NaN".into(),
        ),
        (
            told(weights),
            "mean_squared_error needs finite weights from 0 up, got -1".into(),
        ),
        (
            told(ssim_error(x, x, 0.0)),
            "ssim_error needs a peak above 0 whose square is a number, got 0".into(),
        ),
        (
            told(multiscale_ssim_error(x, x, 1.0, Some(2))),
            "multiscale_ssim_error needs images [H, W, C] of at least 21 x 21 pixels for 2 levels, \
             got shape [12, 12, 1]"
                .into(),
        ),
    ]))
}
