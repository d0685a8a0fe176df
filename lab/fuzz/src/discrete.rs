//! Blurs by the discrete kernel, by windows and by tridiagonal systems.

use arbitrary::{Result, Unstructured};
use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};

use super::number::{Range, in_either_precision};
use super::step::check;

/// Runs the image and the blur that `bytes` stand for; returns the number of entries of what came out.
pub fn discrete(bytes: &[u8]) -> usize {
    in_either_precision(bytes, run::<f32>, run::<f64>)
}

fn run<T: Scalar>(bytes: &mut Unstructured<'_>) -> Result<usize> {
    let range = Range::choose::<T>(bytes)?;
    // Long enough lines for tridiagonal systems among them.
    let mut extent = || bytes.int_in_range(1..=96_usize);
    let [height, width] = [extent()?, extent()?];
    let channels = bytes.int_in_range(1..=3)?;
    let radius = match bytes.int_in_range(0..=7)? {
        0 => Radius::Fixed(bytes.int_in_range(0..=200)?),
        1 => Radius::Tolerance(range.number(bytes)?),
        _ => Radius::Tolerance(0.5_f64.powi(bytes.int_in_range(1..=60)?)),
    };
    let border = *bytes.choose(&[Border::Zero, Border::Mirror, Border::Clamp])?;
    let sigma = range.number(bytes)?;
    let sigma = if bytes.ratio(7, 8)? { sigma.abs() } else { sigma };
    // A few numbers all over the image: there are not enough bytes for all of it.
    let numbers = range.tensor::<T>(bytes, &[31])?;
    let image =
        Tensor::from_flat_fn([height, width, channels], |k| numbers.data()[(k + k * k / 97) % 31]);
    let blur = Blur { kernel: Kernel::Discrete, border, radius };
    let upstream = |k: usize| T::from_f64(0.5 - (k % 3) as f64);
    let inputs = [image, Tensor::scalar(T::from_f64(sigma))];
    let reached = check(&inputs, range.is_stated(), upstream, |_, inputs| {
        gaussian_blur(inputs[0], inputs[1], &blur)
    });
    Ok(reached)
}
