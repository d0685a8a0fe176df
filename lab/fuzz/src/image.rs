//! Arbitrary images and blurs.

use arbitrary::{Result, Unstructured};
use bokashi_core::Scalar;
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};

use super::number::{Range, in_either_precision};
use super::step::check;

/// Runs the image and the blur that `bytes` stand for; returns the number of entries of what came out.
pub fn image(bytes: &[u8]) -> usize {
    in_either_precision(bytes, run::<f32>, run::<f64>)
}

fn run<T: Scalar>(bytes: &mut Unstructured<'_>) -> Result<usize> {
    let range = Range::choose::<T>(bytes)?;
    let shape: [usize; 3] =
        [bytes.int_in_range(0..=12)?, bytes.int_in_range(0..=12)?, bytes.int_in_range(0..=3)?];
    // Now and then an image of another rank, which has to be refused.
    let rank = if bytes.ratio(1, 32)? { 2 } else { 3 };
    let radius = match bytes.int_in_range(0..=3)? {
        0 => Radius::Fixed(bytes.int_in_range(0..=16)?),
        // Up to and beyond the largest allowed, and far beyond.
        1 => Radius::Fixed(bytes.int_in_range(0..=(1 << 15))?),
        2 => Radius::Fixed(bytes.arbitrary()?),
        _ => Radius::Tolerance(range.number(bytes)?),
    };
    let blur = Blur {
        kernel: *bytes.choose(&[Kernel::Unnormalized, Kernel::Sampled, Kernel::Disc])?,
        border: *bytes.choose(&[Border::Zero, Border::Mirror, Border::Clamp])?,
        radius,
    };
    let sigma = range.tensor::<T>(bytes, &[])?;
    let image = range.tensor(bytes, &shape[..rank])?;
    let upstream = |k: usize| T::from_f64(0.5 - (k % 3) as f64);
    let reached = check(&[image, sigma], range.is_stated(), upstream, |_, inputs| {
        gaussian_blur(inputs[0], inputs[1], &blur)
    });
    Ok(reached)
}
