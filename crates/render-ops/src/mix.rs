//! Boundary pixels: what their pieces add up to.
//!
//! # Forward
//! With the pieces' values `v_n` and weights `w_n`, and the background b:
//! `x = b + sum_n w_n (v_n - b)`. In [`Scalar::Wide`], and of halves, whose differences are within the
//! range of the numbers where the values are. Fragments at pixel centres stay as they are.
//!
//! # Backward
//! `v_bar_n = w_n x_bar`, `w_bar_n = x_bar . (v_n - b)`, `b_bar = (1 - sum_n w_n) x_bar`.

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::background::{Background, Behind};
use crate::coverage::Coverage;
use crate::error::RenderError;

/// The values `[P, C]` of the fragments at pixel centres and of the boundary pixels, from values
/// `[N, C]` of all fragments and the weights of the pieces, before a background.
pub(crate) fn mix<'t, T: Scalar>(
    values: Var<'t, T>,
    weight: Var<'t, T>,
    coverage: &Arc<Coverage>,
    background: Background<'t, T>,
    operation: &'static str,
) -> Result<Var<'t, T>, RenderError> {
    let op = Mix { coverage: Arc::clone(coverage), behind: background.behind(), operation };
    let tape = values.tape();
    match background.variable() {
        Some(background) => tape.apply(op, &[values, weight, background]),
        None => tape.apply(op, &[values, weight]),
    }
}

/// Inputs: values `[N, C]`, weights of the pieces, and perhaps a background `[C]` or `[H, W, C]`.
struct Mix {
    coverage: Arc<Coverage>,
    behind: Behind,
    /// On whose behalf.
    operation: &'static str,
}

impl<T: Scalar> Op<T> for Mix {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "mix"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let (values, weights) = (inputs.data(0), inputs.data(1));
        let (coverage, channels) = (&*self.coverage, inputs.shape(0)[1]);
        let background = if inputs.len() == 3 { inputs.data(2) } else { &[] };
        if inputs.len() == 3 {
            self.behind.check(self.operation, inputs.shape(2), coverage.size(), channels)?;
        }
        if coverage.boundary.pixels.is_empty() {
            outputs.pass(0, "no discontinuities");
            return Ok(());
        }
        let centers = coverage.centers();
        let out = outputs.push([centers + coverage.boundary.pixels.len(), channels]);
        let (own, mixed) = out.split_at_mut(centers * channels);
        own.copy_from_slice(&values[..centers * channels]);
        for ((pixel, fragments), mixed) in coverage.boundary().zip(mixed.chunks_exact_mut(channels))
        {
            self.behind.fill(mixed, background, channels, pixel);
            for (c, mixed) in mixed.iter_mut().enumerate() {
                let behind = half(*mixed);
                let parts = fragments.iter().map(|&fragment| {
                    let (value, weight) = piece(values, weights, fragment, centers, channels);
                    weight * (half(value[c]) - behind)
                });
                let sum: T::Wide = behind + parts.sum();
                *mixed = T::narrow(sum + sum);
            }
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let keep = Keep::NOTHING.input(1);
        if !inputs.needs(1) {
            return keep;
        }
        if inputs.len() == 3 { keep.input(0).input(2) } else { keep.input(0) }
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let (out_bar, weights) = (kept.only_upstream(), kept.input(1));
        let (coverage, channels) = (&*self.coverage, kept.input_shape(0)[1]);
        let centers = coverage.centers();
        let (own_bar, mixed_bar) = out_bar.split_at(centers * channels);
        let pixels = || coverage.boundary().zip(mixed_bar.chunks_exact(channels));
        if let Some(values_bar) = gradients.get(0) {
            let (own, pieces) = values_bar.entries().split_at_mut(own_bar.len());
            own.iter_mut().zip(own_bar).for_each(|(own, &bar)| *own += bar);
            for ((_, fragments), bar) in pixels() {
                for &fragment in fragments {
                    let at = fragment as usize - centers;
                    let row = &mut pieces[at * channels..][..channels];
                    row.iter_mut().zip(bar).for_each(|(row, &bar)| *row += weights[at] * bar);
                }
            }
        }
        if let Some(weights_bar) = gradients.get(1) {
            let values = kept.input(0);
            let background = if kept.input_count() == 3 { kept.input(2) } else { &[] };
            let weights_bar = weights_bar.entries();
            for ((pixel, fragments), bar) in pixels() {
                for &fragment in fragments {
                    let value = &values[fragment as usize * channels..][..channels];
                    let terms = (0..channels).map(|c| {
                        let behind = self.behind.at(background, channels, pixel, c);
                        bar[c].widen() * (half(value[c]) - half(behind))
                    });
                    let sum: T::Wide = terms.sum();
                    weights_bar[fragment as usize - centers] += T::narrow(sum + sum);
                }
            }
        }
        if kept.input_count() < 3 {
            return;
        }
        let Some(background_bar) = gradients.get(2) else { return };
        let background_bar = background_bar.entries();
        for ((pixel, fragments), bar) in pixels() {
            let parts = fragments.iter().map(|&fragment| weights[fragment as usize - centers]);
            let left = T::Wide::ONE - parts.map(T::widen).sum();
            let at = self.behind.entry(channels, pixel);
            let entries = &mut background_bar[at..at + channels];
            for (entry, &bar) in entries.iter_mut().zip(bar) {
                *entry += T::narrow(left * bar.widen());
            }
        }
    }
}

#[inline(always)]
fn half<T: Scalar>(value: T) -> T::Wide {
    T::Wide::from_f64(0.5) * value.widen()
}

/// The value and the weight of a piece.
#[inline(always)]
fn piece<'a, T: Scalar>(
    values: &'a [T],
    weights: &[T],
    fragment: u32,
    centers: usize,
    channels: usize,
) -> (&'a [T], T::Wide) {
    let fragment = fragment as usize;
    (&values[fragment * channels..][..channels], weights[fragment - centers].widen())
}
