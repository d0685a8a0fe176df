//! What a lens sees, the slow way.

use std::f64::consts::PI;

use bokashi::prelude::*;

/// The mean of what `count` points of a lens see: from each of them, what is out of focus lies elsewhere in the
/// picture. `clip: [V, 4]` are positions in a picture of `size`, and `seen` makes that picture of other ones. The lens
/// has a circle of confusion with a radius of `aperture` pixels at infinity.
///
/// # Errors
/// Those of `seen`.
pub fn mean_through_lens(
    clip: &Tensor<f32>,
    size: Size,
    [aperture, focus]: [f32; 2],
    count: usize,
    seen: impl for<'t> Fn(Var<'t, f32>) -> Result<Var<'t, f32>, FitError>,
) -> Result<Tensor<f32>, FitError> {
    let mut mean = Tensor::<f32>::zeros([0]);
    for k in 0..count {
        // Points on a spiral share the disc evenly.
        let radius = ((k as f64 + 0.5) / count as f64).sqrt();
        let (sin, cos) = (k as f64 * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
        let [x, y] = [cos / size.width as f64, sin / size.height as f64];
        let aside = [x, y, 0.0, 0.0].map(|share| aperture * (2.0 * radius * share) as f32);
        let tape = Tape::new();
        let clip = tape.constant(clip);
        let shift = (clip.slice(1, 3..4)? - focus) * tape.constant(&Tensor::from([aside]));
        let image = seen(clip - shift)?.value();
        let before = |k: usize| mean.data().get(k).copied().unwrap_or(0.0);
        let sum = |at: usize| before(at) + image.data()[at] / count as f32;
        mean = Tensor::from_flat_fn(image.shape(), sum);
    }
    Ok(mean)
}
