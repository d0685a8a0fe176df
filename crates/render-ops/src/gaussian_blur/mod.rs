//! Blur of an image by a Gaussian or by a disc, with a standard deviation that can be learnt.
//!
//! # Forward
//! `b = K_x K_y c`: along the columns, then along the rows, channel by channel, with the window
//! `w_k` of `taps` and the border rule of `border`. Where sigma's gradient could be asked for, the
//! forward pass also computes `db/dsigma = K'_x K_y c + K_x K'_y c`, `K' = dK/dsigma`, from the
//! same loads, and keeps it. Else nothing is kept.
//!
//! # Backward
//! `c_bar = K_x^T K_y^T b_bar`, which is the forward pass again, except for a clamp border;
//! `sigma_bar = <b_bar, db/dsigma>`.
//!
//! # A disc
//! It is no product of two windows: `disc` has its formulas. What follows is about Gaussians.
//!
//! # Two ways
//! `convolution` sums over a window: its cost grows with sigma, and is least where sigma is small.
//! `rational` solves tridiagonal systems: its cost does not depend on sigma. It serves the discrete
//! kernel with a zero or a mirror border. Where a tolerance allows both ways, sigma and the extents
//! of the image decide which takes less time: `rational` from a sigma of 9 to 15 on.
//!
//! # Cost and error
//! `lab/docs/performance.md` has the times, `lab/docs/benchmarks.md` times beside errors.
//!
//! The share of the weight that a window misses is not the error of its slopes. Summed over taps,
//! the slopes of a wide window are off by 3e-3 with a tolerance of 1e-4, and by some 5e-5 with
//! 1e-6. The slopes of the systems are off by 6e-5 and 1e-6 with these tolerances.
//!
//! # Where it is not smooth
//! A radius that follows from a tolerance steps with sigma; the jump is below that tolerance. A fit
//! whose true sigma lies on a step keeps an error of that size, so fix the radius there. There is
//! also a jump at the sigma where one way takes over from the other.
//!
//! # Source
//! Kitabayashi and Iwasaki, on parameter estimation of Gaussian filtering by differentiable
//! rendering, equations (1) to (5): the unnormalized kernel. Image libraries use the sampled
//! kernel.

mod disc;
mod of_picture;
pub use self::of_picture::Blurred;
mod rational;

use bokashi_core::parallel::for_each_item_mut;
use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, Var};

use self::disc::Disc;
use self::rational::{Block, Line, Order, Rational};
use crate::border::Border;
use crate::convolution::{Band, Convolution};
use crate::error::RenderError;
use crate::scratch::Workbench;
use crate::taps::{Blur, Kernel, LARGEST_RADIUS, Radius, Taps, check_radius};

/// `image: [H, W, C]` blurred with standard deviation `sigma: []`, in pixels; returns `[H, W, C]`.
///
/// Sigma 0 is the identity, except for the unnormalized kernel: the image itself is returned. As
/// sigma grows beyond the image, the result approaches a constant: the mean of the image (mirror
/// border), the mean of its corners (clamp), or zero.
///
/// # Errors
/// - [`RenderError::BadSigma`] unless sigma is finite and positive (or 0, except for the unnormalized
///   kernel); for a disc above 1024, or one that reaches beyond a fixed radius.
/// - [`RenderError::Shape`] unless the image is `[H, W, C]` with at least one entry and sigma a
///   single number.
/// - [`RenderError::BadRadius`] for a tolerance outside (0, 1) or a radius above 16384.
#[inline(never)]
pub fn gaussian_blur<'t, T: Scalar>(
    image: Var<'t, T>,
    sigma: Var<'t, T>,
    blur: &Blur,
) -> Result<Var<'t, T>, RenderError> {
    let shape = sigma.shape();
    if shape.size() != 1 {
        let rule = "a single number for sigma".to_owned();
        return Err(RenderError::Shape { operation: "gaussian_blur", rule, shape });
    }
    check_image(&image.shape())?;
    check_radius(blur.radius)?;
    image.tape().apply(GaussianBlur { blur: *blur }, &[image, sigma])
}

/// Inputs: image `[H, W, C]`, sigma `[]`.
struct GaussianBlur {
    blur: Blur,
}

/// What the backward pass reads, and memory.
#[derive(Debug, Default)]
struct Saved<T: Scalar> {
    /// The windows along the rows and along the columns.
    taps: [Taps<T>; 2],
    /// `db/dsigma`; empty unless sigma's gradient could be asked for.
    slope: Vec<T>,
    /// The blur as tridiagonal systems; `Some` where they are used.
    lines: [Line<T>; 2],
    order: Option<&'static Order>,
    disc: Disc<T>,
    /// Memory: for pieces of work, for what is blurred along its columns, for sums by piece, for a
    /// gradient.
    bands: Workbench<Band<T>>,
    blocks: Workbench<Block<T>>,
    columns: [Vec<T>; 2],
    sums: Vec<T::Wide>,
    image_bar: Vec<T>,
}

impl<T: Scalar> Op<T> for GaussianBlur {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "gaussian_blur"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (shape, image, sigma) = (inputs.shape(0), inputs.data(0), inputs.data(1)[0]);
        if self.blur.kernel != Kernel::Unnormalized && sigma == T::ZERO {
            outputs.pass(0, "sigma is 0");
            return Ok(());
        }
        if self.blur.kernel == Kernel::Disc {
            saved.disc.fill(sigma, &self.blur, shape)?;
            saved.disc.blur(image, outputs.push(shape), inputs.needs(1));
            return Ok(());
        }
        let extents = [shape[1], shape[0]];
        let Saved { taps, slope, lines, order, bands, blocks, columns, .. } = saved;
        *order = self.order(sigma.to_f64(), extents);
        let out = outputs.push(shape);
        slope.resize(if inputs.needs(1) { image.len() } else { 0 }, T::ZERO);
        let border = self.blur.border;
        if let Some(order) = order {
            for (line, extent) in lines.iter_mut().zip(extents) {
                line.fill(order, sigma, border, extent);
            }
            Rational::new(shape, lines).apply(image, columns, blocks, out, slope);
        } else {
            Taps::fill(taps, sigma, &self.blur, extents)?;
            Convolution::new(shape, border, taps).apply(image, bands, out, slope);
        }
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (b_bar, is_disc) = (kept.only_upstream(), self.blur.kernel == Kernel::Disc);
        let Saved {
            taps,
            slope,
            lines,
            order,
            disc,
            bands,
            blocks,
            columns,
            sums,
            image_bar: memory,
        } = saved;
        if is_disc {
            disc.take_gradient(b_bar);
        }
        if let Some(sigma_bar) = gradients.get(1) {
            let [slope, b_bar] = match is_disc {
                true => disc.sigma_factors(b_bar),
                false => [slope, b_bar],
            };
            let sum = dot(slope, b_bar, sums);
            sigma_bar.add_each(|_| T::narrow(sum));
        }
        if let Some(image_bar) = gradients.get(0) {
            let (shape, border) = (kept.input_shape(0), self.blur.border);
            let mut adjoint = |out: &mut [T]| match order {
                _ if is_disc => disc.image_gradient(b_bar, out),
                // With a zero or a mirror border it is its own adjoint.
                Some(_) => {
                    Rational::new(shape, lines).apply(b_bar, columns, blocks, out, &mut []);
                }
                None => {
                    let adjoint = Convolution::new(shape, border, taps).adjoint();
                    adjoint.apply(b_bar, bands, out, &mut []);
                }
            };
            match image_bar.entries_or_fresh() {
                (entries, true) => adjoint(entries),
                (_, false) => {
                    memory.resize(b_bar.len(), T::ZERO);
                    adjoint(memory);
                    image_bar.add(memory);
                }
            }
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let Saved { slope, bands, blocks, columns, sums, image_bar, .. } = saved;
        let entries = slope.len() + image_bar.len() + columns.iter().map(Vec::len).sum::<usize>();
        let memory = bands.total(Band::len) + blocks.total(Block::len) + saved.disc.len();
        size_of::<T>() * (entries + memory) + size_of_val(&sums[..])
    }
}

impl GaussianBlur {
    /// The rational approximation that blurs an image of these extents within the tolerance, where
    /// it takes less time than a window does.
    fn order(&self, sigma: f64, extents: [usize; 2]) -> Option<&'static Order> {
        let Blur { kernel: Kernel::Discrete, radius: Radius::Tolerance(tolerance), .. } = self.blur
        else {
            return None;
        };
        if self.blur.border == Border::Clamp {
            return None;
        }
        let order = Order::within(tolerance)?;
        // The share of a Gaussian beyond r is `exp(-r^2 / (2 sigma^2))`, or a little less.
        let radius = sigma * (-2.0 * tolerance.ln()).sqrt();
        let taps: f64 = extents.map(|extent| radius.min(extent as f64)).iter().sum();
        let cost = TAPS_OF_SYSTEMS + TAPS_PER_POLE * order.poles.len() as f64;
        (sigma > 0.0 && radius <= LARGEST_RADIUS as f64 && taps > 2.0 * cost).then_some(order)
    }
}

/// How many taps on one side of a window take as long as the systems without a pole, and as long as
/// each pole. Measured at the sigmas where both ways take the same time: `lab/docs/performance.md`.
const TAPS_OF_SYSTEMS: f64 = 34.0;
const TAPS_PER_POLE: f64 = 5.0;

/// Entries of a product that are summed on their own.
const PRODUCTS: usize = 1 << 14;

/// Partial sums of products, so that additions overlap.
const LANES: usize = 16;

/// `sum_k a_k b_k` in wide numbers, with `sums` as memory.
fn dot<T: Scalar>(a: &[T], b: &[T], sums: &mut Vec<T::Wide>) -> T::Wide {
    sums.clear();
    sums.resize(a.len().div_ceil(PRODUCTS), T::Wide::ZERO);
    for_each_item_mut(sums, |k, sum| {
        let range = k * PRODUCTS..a.len().min((k + 1) * PRODUCTS);
        *sum = crate::dispatch::dispatch::<T, _>(Dot(&a[range.clone()], &b[range]));
    });
    sums.iter().copied().sum()
}

/// `sum_k a_k b_k`, compiled for the vectors that the processor has.
struct Dot<'a, T>(&'a [T], &'a [T]);

impl<T: Scalar> pulp::WithSimd for Dot<'_, T> {
    type Output = T::Wide;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> T::Wide {
        let mut lanes = [T::Wide::ZERO; LANES];
        let (a, a_rest) = self.0.as_chunks::<LANES>();
        let (b, b_rest) = self.1.as_chunks::<LANES>();
        for (a, b) in a.iter().zip(b) {
            for k in 0..LANES {
                lanes[k] += a[k].widen() * b[k].widen();
            }
        }
        for (k, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
            lanes[k] += a.widen() * b.widen();
        }
        lanes.into_iter().sum()
    }
}

fn check_image(shape: &bokashi_core::Shape) -> Result<(), RenderError> {
    if shape.rank() == 3 && shape.size() > 0 {
        return Ok(());
    }
    Err(RenderError::Shape {
        operation: "gaussian_blur",
        rule: "an image of shape [H, W, C] with at least one entry".to_owned(),
        shape: shape.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::border::Border;
    use crate::taps::{Blur, Kernel, Radius};

    #[test]
    fn systems_are_solved_where_a_discrete_kernel_is_wide_and_a_tolerance_allows_it() {
        let wide = Blur { kernel: Kernel::Discrete, ..Blur::default() };
        let poles = |blur: Blur, sigma, extents| {
            GaussianBlur { blur }.order(sigma, extents).map_or(0, |order| order.poles.len())
        };
        let coarse = Blur { radius: Radius::Tolerance(1e-3), ..wide };
        assert_eq!(poles(wide, 30.0, [200, 300]), 4);
        assert_eq!(poles(coarse, 14.0, [46, 43]), 2);
        assert_eq!(poles(Blur { border: Border::Zero, ..coarse }, 14.0, [46, 43]), 2);
        // The systems take less time from a radius of 34 + 5 taps for each of four poles on.
        assert_eq!([10.2, 10.3].map(|sigma| poles(wide, sigma, [1024, 1024])), [0, 4]);
        for (blur, sigma, extents) in [
            (wide, 1.0, [200, 300]),
            (wide, 30.0, [10, 10]),
            (coarse, 14.0, [45, 43]),
            (wide, 1e9, [200, 300]),
            (Blur { border: Border::Clamp, ..wide }, 30.0, [200, 300]),
            (Blur { radius: Radius::Fixed(99), ..wide }, 30.0, [200, 300]),
            (Blur { radius: Radius::Tolerance(1e-14), ..wide }, 30.0, [200, 300]),
            (Blur { kernel: Kernel::Sampled, ..wide }, 30.0, [200, 300]),
        ] {
            assert_eq!(poles(blur, sigma, extents), 0, "{blur:?} {sigma}");
        }
    }
}
