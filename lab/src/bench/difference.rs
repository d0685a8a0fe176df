//! How far results are from a reference.

use bokashi_core::{Scalar, Tensor};

/// The largest difference of an entry from the reference's, as a share of the reference's largest
/// entry; infinite where an entry is not finite, 0 where both are all zeros.
pub(crate) fn relative_error<T: Scalar>(found: &Tensor<T>, reference: &Tensor<f64>) -> f64 {
    debug_assert_eq!(found.shape(), reference.shape());
    let largest = reference.data().iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
    let entries = found.data().iter().zip(reference.data());
    let differences = entries.map(|(found, reference)| (found.to_f64() - reference).abs());
    let difference = differences.fold(0.0_f64, |worst, difference| match difference.is_finite() {
        true => worst.max(difference),
        false => f64::INFINITY,
    });
    if difference == 0.0 { 0.0 } else { difference / largest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_a_share_of_the_largest_entry_and_a_nan_is_infinitely_far() {
        let reference = Tensor::new([2], vec![-4.0, 1.0]).unwrap();
        let of = |entries: [f32; 2]| {
            relative_error(&Tensor::new([2], entries.to_vec()).unwrap(), &reference)
        };
        assert_eq!(of([-4.0, 1.0]), 0.0);
        assert_eq!(of([-3.0, 1.5]), 0.25);
        assert_eq!(of([-4.0, f32::NAN]), f64::INFINITY);
        let zeros = Tensor::zeros([2]);
        assert_eq!(relative_error(&zeros, &zeros), 0.0);
    }
}
