//! What is measured of a case at one size.

use bokashi_core::Tensor;

use super::truth::Truth;
use crate::bench::sampling::Timing;

/// What a method got wrong over the seeds of a case at one size.
#[derive(Debug, Clone, Default)]
pub(super) struct Errors {
    /// Of the gradient, as a share of it.
    pub(super) gradient: Vec<f64>,
    /// Of the picture's worst pixel, at most.
    pub(super) pixel: f64,
}

impl Errors {
    pub(super) fn add(&mut self, truth: &Truth, [image, gradient]: &[Tensor<f32>; 2]) {
        let wide = |tensor: &Tensor<f32>| tensor.cast::<f64>();
        self.gradient.push(truth.error(wide(gradient).data()));
        self.gradient.sort_by(f64::total_cmp);
        self.pixel = self.pixel.max(truth.pixel_error(wide(image).data()));
    }

    /// Least, median and largest.
    pub(super) fn of_gradient(&self) -> [f64; 3] {
        let all = &self.gradient;
        [all[0], all[all.len() / 2], all[all.len() - 1]]
    }
}

/// Everything measured of a case at one size: per method its errors, and its times where there are
/// any.
pub(super) struct Row {
    pub(super) case: String,
    pub(super) pixels: usize,
    pub(super) errors: Vec<Errors>,
    pub(super) timings: Vec<Option<Timing>>,
    /// The truth's own, at most.
    pub(super) noise: f64,
    pub(super) pixel_noise: f64,
}
