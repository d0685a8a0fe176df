//! The ways to blur.

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::{Blur, Border, Kernel, Radius, gaussian_blur};
use bokashi_report::Stroke;

/// The reference's window misses this share.
pub(super) const EXACT: f64 = 1e-15;

/// A way to blur, at a tolerance.
pub(super) struct Algorithm {
    pub(super) name: &'static str,
    /// Its reference is this kernel, exactly.
    pub(super) kernel: Kernel,
    /// Whether it is a window in any case, not what takes less time.
    is_window: bool,
    /// Whether it computes in f64.
    pub(super) is_double: bool,
    /// Index into the palette.
    pub(super) color: usize,
}

const SAMPLED: Algorithm = Algorithm {
    name: "sampled, f32",
    kernel: Kernel::Sampled,
    is_window: false,
    is_double: false,
    color: 0,
};
const DISCRETE: Algorithm =
    Algorithm { name: "discrete, f32", kernel: Kernel::Discrete, color: 1, ..SAMPLED };

/// The kernels that algorithms have.
pub(super) const KERNELS: [Kernel; 2] = [Kernel::Sampled, Kernel::Discrete];

/// All algorithms; another one is another row.
pub(super) const ALGORITHMS: [Algorithm; 5] = [
    SAMPLED,
    Algorithm { name: "sampled, f64", is_double: true, ..SAMPLED },
    DISCRETE,
    Algorithm { name: "discrete, f64", is_double: true, ..DISCRETE },
    Algorithm { name: "discrete, window in any case, f32", is_window: true, color: 2, ..DISCRETE },
];
/// Those that a fit takes: a kernel in f32, the way chosen by tolerance.
pub(super) const USED: [&Algorithm; 2] = [&ALGORITHMS[0], &ALGORITHMS[2]];

/// A blur of `kernel` within `tolerance`.
pub(super) fn by_tolerance(kernel: Kernel, tolerance: f64) -> Blur {
    Blur { kernel, border: Border::Mirror, radius: Radius::Tolerance(tolerance) }
}

impl Algorithm {
    /// What it does at a tolerance.
    pub(super) fn blur(&self, tolerance: f64, sigma: f64) -> Result<Blur, FitError> {
        let blur = by_tolerance(self.kernel, tolerance);
        Ok(match self.is_window {
            false => blur,
            true => Blur { radius: Radius::Fixed(discrete_radius(sigma, tolerance)?), ..blur },
        })
    }

    /// The line of its curve.
    pub(super) fn stroke(&self) -> Stroke {
        if self.is_double { Stroke::Dashed } else { Stroke::Solid }
    }
}

/// The least radius at which a window of the discrete kernel misses at most `tolerance`.
fn discrete_radius(sigma: f64, tolerance: f64) -> Result<usize, FitError> {
    // An impulse that is farther from the border than its blur reaches.
    let end = (10.0 * sigma).ceil() as usize + 20;
    let mut impulse = Tensor::zeros([1, 2 * end + 1, 1]);
    impulse.data_mut()[end] = 1.0;
    let tape = Tape::<f64>::new();
    let (impulse, sigma) = (tape.constant(&impulse), tape.constant_scalar(sigma));
    let weights = gaussian_blur(impulse, sigma, &by_tolerance(Kernel::Discrete, EXACT))?.value();
    let mut missing = 0.0;
    let is_needed = |k: &usize| {
        missing += 2.0 * weights.data()[end + k];
        missing > tolerance
    };
    Ok((1..=end).rev().find(is_needed).unwrap_or(1))
}
