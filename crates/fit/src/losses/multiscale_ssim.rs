//! Structural similarity at several scales.
//!
//! # Forward
//! With the mean `m_j` of `cs` (see `ssim`) of both images halved j times, and of `l cs` at the last of M
//! levels: the error is `1 - prod_j m_j^(w_j)`. Five levels have the paper's weights as they are printed: 0.0448,
//! 0.2856, 0.3001, 0.2363 and 0.1333, which add up to 1.0001. Fewer levels have the first M over their sum.
//!
//! # Where it is not smooth
//! A power of a negative mean is no number, and near 0 its slope is infinite. So below 0.01 the power
//! goes on along its tangent: the error has a gradient even for an image that is turned inside out.
//!
//! # Source
//! Wang, Simoncelli and Bovik, *Multi-scale structural similarity for image quality assessment*, Asilomar
//! Conference on Signals, Systems and Computers 2003. As in their program, the low-pass filter is the
//! mean of 2 x 2 pixels.

use bokashi_core::{Scalar, TensorError, Var};

use super::halved::halved;
use super::ssim::{Ssim, WINDOW};

/// The weights of the levels, from the finest.
const WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];
/// Where a power goes over to its tangent.
const LOWEST: f64 = 0.01;

/// `mean^weight`, along its tangent below [`LOWEST`].
fn power<T: Scalar>(mean: Var<'_, T>, weight: f64) -> Result<Var<'_, T>, TensorError> {
    let held = mean.clamp(T::from_f64(LOWEST), T::from_f64(f64::INFINITY))?;
    let slope = T::from_f64(weight * LOWEST.powf(weight - 1.0));
    held.powf(T::from_f64(weight)).try_add((mean.try_sub(held)?) * slope)
}

/// The exponents of so many levels.
fn weights(levels: usize) -> Vec<f64> {
    let chosen = &WEIGHTS[..levels];
    // All five are what others' programs have: as printed, and not divided by their sum.
    let total = if levels == WEIGHTS.len() { 1.0 } else { chosen.iter().sum() };
    chosen.iter().map(|weight| weight / total).collect()
}

/// How many levels images of `extent` pixels along their shorter side allow.
fn most_levels(extent: usize) -> usize {
    (0..WEIGHTS.len()).take_while(|level| extent.div_ceil(1 << level) >= WINDOW).count()
}

/// The shortest side of images that `levels` levels take.
fn least_extent(levels: usize) -> usize {
    ((WINDOW - 1) << (levels - 1)) + 1
}

/// The structural dissimilarity of `image` and `reference`, both `[H, W, C]`, at several scales: 1 minus
/// MS-SSIM; returns `[]`. `peak` is the largest value that images may have.
///
/// Each of the `levels`, from 1 to 5, has half the size of the one before; `None` takes as many as fit.
/// All five take images of at least 161 x 161 pixels.
///
/// # Errors
/// [`TensorError::Value`] for no levels or more than five; [`TensorError::Shape`] for images whose
/// smallest level is smaller than 11 x 11 pixels; as [`ssim_error`](crate::ssim_error).
pub fn multiscale_ssim_error<'t, T: Scalar>(
    image: Var<'t, T>,
    reference: Var<'t, T>,
    peak: f64,
    levels: Option<usize>,
) -> Result<Var<'t, T>, TensorError> {
    let operation = "multiscale_ssim_error";
    if let Some(levels) = levels.filter(|levels| !(1..=WEIGHTS.len()).contains(levels)) {
        let (rule, value) = ("from 1 to 5 levels".into(), levels as f64);
        return Err(TensorError::Value { operation, rule, value });
    }
    let shape = image.shape();
    let most = match *shape {
        [height, width, _] => most_levels(height.min(width)),
        _ => 0,
    };
    let levels = levels.unwrap_or(most.max(1));
    if levels > most {
        let least = least_extent(levels);
        let rule = format!("images [H, W, C] of at least {least} x {least} pixels for {levels}");
        let rule = format!("{rule} level{}", if levels == 1 { "" } else { "s" }).into();
        return Err(TensorError::Shape { operation, rule, shape });
    }
    let weights = weights(levels);
    let (mut image, mut reference) = (image, reference);
    let mut product: Option<Var<'t, T>> = None;
    for (level, weight) in weights.into_iter().enumerate() {
        if level > 0 {
            (image, reference) = (halved(image)?, halved(reference)?);
        }
        let luminance = level + 1 == levels;
        let error = image.tape().apply(Ssim { luminance, peak }, &[image, reference])?;
        let factor = power(error.affine(-T::ONE, T::ONE), weight)?;
        product = Some(match product {
            None => factor,
            Some(product) => product.try_mul(factor)?,
        });
    }
    let product = product.expect("there is at least one level");
    Ok(product.affine(-T::ONE, T::ONE))
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::super::ssim::ssim_error;
    use super::*;

    fn image(extent: usize, seed: usize) -> Tensor<f64> {
        Tensor::from_flat_fn([extent, extent + 3, 2], |k| {
            let [row, column] = [k / 2 / (extent + 3), k / 2 % (extent + 3)].map(|at| at as f64);
            let noise = ((k * 7919 + seed * 104_729) % 1009) as f64 / 1009.0;
            0.5 + 0.2 * (0.1 * row).sin() * (0.07 * column).cos() + 0.3 * (noise - 0.5)
        })
    }

    fn loss(x: &Tensor<f64>, y: &Tensor<f64>, levels: Option<usize>) -> f64 {
        let tape = Tape::new();
        multiscale_ssim_error(tape.leaf(x), tape.leaf(y), 1.0, levels).unwrap().item()
    }

    #[test]
    fn the_error_is_1_minus_the_product_of_powers_of_the_levels() {
        let (x, y) = (image(161, 1), image(161, 2));
        let tape = Tape::new();
        let [mut a, mut b] = [tape.leaf(&x), tape.leaf(&y)];
        let mut means = Vec::new();
        for _ in 0..5 {
            let of = |luminance| {
                1.0 - tape.apply(Ssim { luminance, peak: 1.0 }, &[a, b]).unwrap().item()
            };
            means.push([of(false), of(true)]);
            (a, b) = (halved(a).unwrap(), halved(b).unwrap());
        }
        // By hand, in ten-thousandths: as printed, and the first four over 8668, three over 6305, ...
        let totals = [448.0, 3304.0, 6305.0, 8668.0, 10000.0];
        let printed = [448.0, 2856.0, 3001.0, 2363.0, 1333.0];
        for levels in 1..=5 {
            let product = (0..levels).map(|level| {
                let mean = means[level][usize::from(level + 1 == levels)];
                assert!(mean > LOWEST, "{mean}");
                mean.powf(printed[level] / totals[levels - 1])
            });
            let expected = 1.0 - product.product::<f64>();
            let error = loss(&x, &y, Some(levels));
            approx::assert_relative_eq!(error, expected, max_relative = 1e-12);
        }
        assert_eq!(loss(&x, &y, None), loss(&x, &y, Some(5)));
    }

    #[test]
    fn a_single_level_is_ssim_and_as_many_fit_as_the_coarsest_has_a_window() {
        let (x, y) = (image(20, 1), image(20, 2));
        let tape = Tape::new();
        let single = ssim_error(tape.leaf(&x), tape.leaf(&y), 1.0).unwrap().item();
        approx::assert_relative_eq!(loss(&x, &y, Some(1)), single, max_relative = 1e-12);
        approx::assert_relative_eq!(loss(&x, &y, None), single, max_relative = 1e-12);
        let extents = [10, 11, 20, 21, 40, 41, 80, 81, 160, 161, 9000];
        assert_eq!(extents.map(most_levels), [0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]);
    }

    #[test]
    fn an_image_turned_inside_out_has_a_finite_error_and_gradient() {
        let x = image(161, 1);
        let tape = Tape::new();
        let negative = tape.leaf(&x.map(|entry| 1.0 - entry));
        let error = multiscale_ssim_error(negative, tape.constant(&x), 1.0, None).unwrap();
        assert!(error.item() > 1.0 && error.item().is_finite());
        let gradient = error.backward().unwrap().get_or_zeros(negative);
        assert!(gradient.is_finite() && gradient.data().iter().any(|g| *g != 0.0));
    }

    #[test]
    fn a_power_and_its_tangent_meet_with_one_slope() {
        let at = |mean: f64| {
            let tape = Tape::new();
            let mean = tape.leaf_scalar(mean);
            let y = power(mean, 0.3).unwrap();
            [y.item(), y.backward().unwrap().get(mean).unwrap().item()]
        };
        let (above, below) = (at(LOWEST * (1.0 + 1e-12)), at(LOWEST * (1.0 - 1e-12)));
        for k in 0..2 {
            approx::assert_relative_eq!(above[k], below[k], max_relative = 1e-11);
        }
        assert_eq!(at(-1.0)[1], at(0.0)[1]);
        approx::assert_relative_eq!(at(0.5)[0], 0.5_f64.powf(0.3), max_relative = 1e-15);
    }
}
