//! Measures of how alike images and masks are, without a gradient.

use bokashi_core::{Mask, Scalar, Tape, Tensor, TensorError, mean_squared_error};

use super::ssim::ssim_error;

/// The peak signal-to-noise ratio of `image` against `reference`, of any one shape, in decibels:
/// `10 log10(peak^2 / mean squared error)`; infinite for equal images. `peak` is the largest value that
/// images may have: 1, or 255.
///
/// # Errors
/// [`TensorError::Mismatch`] unless both have one shape; [`TensorError::Shape`] for images without an
/// entry; [`TensorError::Value`] for a peak that is not finite and above 0.
pub fn psnr<T: Scalar>(
    image: &Tensor<T>,
    reference: &Tensor<T>,
    peak: f64,
) -> Result<f64, TensorError> {
    if !(peak > 0.0 && peak.is_finite()) {
        let (operation, rule) = ("psnr", "a finite peak above 0".into());
        return Err(TensorError::Value { operation, rule, value: peak });
    }
    let tape = Tape::<f64>::new();
    let [image, reference] = [image, reference].map(|image| tape.constant(&image.cast()));
    let error = mean_squared_error(image, reference)?.item();
    Ok(20.0 * peak.log10() - 10.0 * error.log10())
}

/// The structural similarity (SSIM) of two images `[H, W, C]`, from -1 to 1, and 1 for equal ones: 1 minus
/// [`ssim_error`](crate::ssim_error).
///
/// # Errors
/// As [`ssim_error`](crate::ssim_error).
pub fn ssim<T: Scalar>(
    image: &Tensor<T>,
    reference: &Tensor<T>,
    peak: f64,
) -> Result<f64, TensorError> {
    let tape = Tape::<f64>::new();
    let [image, reference] = [image, reference].map(|image| tape.constant(&image.cast()));
    Ok(1.0 - ssim_error(image, reference, peak)?.item())
}

/// The intersection over union of two masks of one shape: 1 for equal ones, also where both are empty.
///
/// # Errors
/// [`TensorError::Mismatch`] unless both have one shape.
pub fn iou(a: &Mask, b: &Mask) -> Result<f64, TensorError> {
    if a.shape() != b.shape() {
        let (operation, rule) = ("iou", "two masks of one shape".into());
        let shapes = Box::new([a.shape().clone(), b.shape().clone()]);
        return Err(TensorError::Mismatch { operation, rule, shapes });
    }
    let [both, either] = [a.and(b)?.count(), a.or(b)?.count()];
    Ok(if either == 0 { 1.0 } else { both as f64 / either as f64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_is_20_decibels_per_digit_of_the_error() {
        let x = Tensor::<f32>::zeros([4, 5, 3]);
        for (error, peak, expected) in [(0.125, 1.25, 20.0), (1.0, 1000.0, 60.0), (2.0, 2.0, 0.0)] {
            let found = psnr(&x, &Tensor::full([4, 5, 3], error), peak).unwrap();
            approx::assert_relative_eq!(found, expected, epsilon = 1e-12);
        }
        assert_eq!(psnr(&x, &x, 1.0), Ok(f64::INFINITY));
        let error = psnr(&x, &x, 0.0).unwrap_err().to_string();
        assert_eq!(error, "psnr needs a finite peak above 0, got 0");
        assert!(psnr(&x, &Tensor::zeros([4, 5]), 1.0).is_err());
    }

    #[test]
    fn ssim_of_flat_images_is_their_luminance() {
        let of = |value: f64| Tensor::full([12, 13, 2], value);
        // Without any structure: (2 mx my + c1) / (mx^2 + my^2 + c1), and cs = 1.
        let expected = (2.0 * 0.25 * 0.5 + 1e-4) / (0.25 * 0.25 + 0.5 * 0.5 + 1e-4);
        approx::assert_relative_eq!(
            ssim(&of(0.25), &of(0.5), 1.0).unwrap(),
            expected,
            max_relative = 1e-12
        );
        assert_eq!(ssim(&of(0.3), &of(0.3), 1.0), Ok(1.0));
    }

    #[test]
    fn iou_counts_what_is_in_both_over_what_is_in_either() {
        let mask = |truth: &[bool]| Mask::new([truth.len()], truth).unwrap();
        let (a, b) = (mask(&[true, true, false, true]), mask(&[true, false, false, true]));
        assert_eq!(iou(&a, &b), Ok(2.0 / 3.0));
        assert_eq!(iou(&a, &a), Ok(1.0));
        assert_eq!(iou(&a, &!&a), Ok(0.0));
        assert_eq!(iou(&mask(&[false; 3]), &mask(&[false; 3])), Ok(1.0));
        let error = iou(&a, &mask(&[true])).unwrap_err().to_string();
        assert_eq!(error, "iou needs two masks of one shape, got shapes [4] and [1]");
    }
}
