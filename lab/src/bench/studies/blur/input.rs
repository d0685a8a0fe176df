//! What is blurred, and what is asked of the blur.

use std::hint::black_box;

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::{Blur, Kernel, gaussian_blur};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::ThreadPool;

use super::algorithm::{Algorithm, EXACT, by_tolerance};
use crate::bench::difference::relative_error;
use crate::bench::sampling::Contestant;

const CHANNELS: usize = 3;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Values,
    ImageGradient,
    SigmaGradient,
    /// Both gradients: what a fit asks for.
    Both,
}

impl Quantity {
    pub(super) const APART: [Self; 3] = [Self::Values, Self::ImageGradient, Self::SigmaGradient];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Values => "values",
            Self::ImageGradient => "image gradient",
            Self::SigmaGradient => "sigma gradient",
            Self::Both => "both gradients",
        }
    }
}

/// An image to blur, and the upstream gradient of the blurred one; both exact in f32.
pub(super) struct Input {
    image: Tensor<f64>,
    upstream: Tensor<f64>,
    pub(super) sigma: f64,
}

/// Values, image gradient, sigma gradient, as far as they were asked for.
pub(super) type Results<T> = [Option<Tensor<T>>; 3];

/// One blur of `image`; `look` is shown what is asked for, before the tape takes its memory back.
fn run<T: Scalar, R>(
    tape: &mut Tape<T>,
    [image, upstream]: [&Tensor<T>; 2],
    sigma: f64,
    blur: &Blur,
    quantity: Quantity,
    look: impl FnOnce([Option<&Tensor<T>>; 3]) -> R,
) -> Result<R, FitError> {
    let result = {
        let sigma = Tensor::scalar(T::from_f64(sigma));
        let leaf = |wanted: bool, tensor| match wanted {
            true => tape.leaf(tensor),
            false => tape.constant(tensor),
        };
        let wants = |one: Quantity| quantity == one || quantity == Quantity::Both;
        let x = leaf(wants(Quantity::ImageGradient), image);
        let sigma = leaf(wants(Quantity::SigmaGradient), &sigma);
        let blurred = gaussian_blur(x, sigma, blur)?;
        match quantity {
            Quantity::Values => look([Some(&blurred.value()), None, None]),
            _ => {
                let gradients = tape.vjp(&[(blurred, upstream)])?;
                look([None, gradients.get(x), gradients.get(sigma)])
            }
        }
    };
    tape.reset();
    Ok(result)
}

impl Input {
    pub(super) fn new(pixels: usize, sigma: f64) -> Result<Self, FitError> {
        let mut generator = ChaCha8Rng::seed_from_u64(pixels as u64);
        let shape = [pixels, pixels, CHANNELS];
        let image =
            Tensor::from_flat_fn(shape, |_| f64::from(generator.next_u32() >> 8) / 16_777_216.0);
        let mut input = Self { image, upstream: Tensor::zeros(shape), sigma };
        // What is a good upstream gradient does not take an exact blur, but one that takes something
        // away at any sigma: the discrete one.
        let [blurred, ..] =
            input.results::<f32>(&by_tolerance(Kernel::Discrete, 1e-3), Quantity::Values)?;
        let blurred: Tensor<f32> = blurred.unwrap_or(Tensor::zeros(shape));
        let taken = |k: usize| input.image.data()[k] as f32 - blurred.data()[k];
        input.upstream = Tensor::from_flat_fn(shape, |k| f64::from(taken(k)));
        Ok(input)
    }

    pub(super) fn results<T: Scalar>(
        &self,
        blur: &Blur,
        quantity: Quantity,
    ) -> Result<Results<T>, FitError> {
        let (image, upstream) = (self.image.cast(), self.upstream.cast());
        let keep = |results: [Option<&Tensor<T>>; 3]| results.map(Option::<&Tensor<T>>::cloned);
        run(&mut Tape::<T>::new(), [&image, &upstream], self.sigma, blur, quantity, keep)
    }

    /// The same blur on the threads of `pool`, over and over.
    pub(super) fn contestant<'a, T: Scalar>(
        &self,
        blur: Blur,
        quantity: Quantity,
        pool: &'a ThreadPool,
    ) -> Contestant<'a> {
        let (image, upstream, sigma) = (self.image.cast(), self.upstream.cast(), self.sigma);
        let mut tape = Tape::<T>::new();
        Contestant::new(pool, move || {
            // Not kept: what is held cannot be written over by the next blur.
            let look = |results: [Option<&Tensor<T>>; 3]| {
                black_box(results);
            };
            run(&mut tape, [&image, &upstream], sigma, &blur, quantity, look)
        })
    }

    /// The largest relative errors of what `quantity` asks for; `None` for what it does not.
    pub(super) fn errors(
        &self,
        algorithm: &Algorithm,
        blur: &Blur,
        quantity: Quantity,
        exact: &Results<f64>,
    ) -> Result<[Option<f64>; 3], FitError> {
        fn errors_of<T: Scalar>(results: Results<T>, exact: &Results<f64>) -> [Option<f64>; 3] {
            std::array::from_fn(|k| Some(relative_error(results[k].as_ref()?, exact[k].as_ref()?)))
        }
        Ok(match algorithm.is_double {
            true => errors_of(self.results::<f64>(blur, quantity)?, exact),
            false => errors_of(self.results::<f32>(blur, quantity)?, exact),
        })
    }

    /// The largest relative error of the one thing that `quantity` asks for.
    pub(super) fn error(
        &self,
        algorithm: &Algorithm,
        blur: &Blur,
        quantity: Quantity,
        exact: &Results<f64>,
    ) -> Result<f64, FitError> {
        let errors = self.errors(algorithm, blur, quantity, exact)?;
        Ok(errors.into_iter().flatten().fold(0.0, f64::max))
    }

    /// The exact results of a kernel.
    pub(super) fn exact(&self, kernel: Kernel) -> Result<Results<f64>, FitError> {
        // No rational approximation is as close: it is a window.
        let exact = by_tolerance(kernel, EXACT);
        let [values, ..] = self.results(&exact, Quantity::Values)?;
        let [_, image, sigma] = self.results(&exact, Quantity::Both)?;
        Ok([values, image, sigma])
    }
}
