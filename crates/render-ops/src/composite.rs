//! From fragments to a picture.
//!
//! # Forward
//! Where one fragment covers a pixel, at its centre, the pixel has the fragment's value: nothing is
//! computed. A boundary pixel of exact coverage, with pieces of values `v_n` and weights `w_n` before a
//! background b, has `x = b + sum_n w_n (v_n - b)`. Sums are taken in [`Scalar::Wide`]. Values are
//! halved first, so that their differences cannot overflow.
//!
//! # Backward
//! `v_bar_n = w_n x_bar`, `w_bar_n = x_bar . (v_n - b)`, `b_bar = (1 - sum_n w_n) x_bar`.

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::background::{Background, Kind};
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::fragments::Fragments;
use crate::picture::{Composite, Picture, checked_channels, with_channels};

const NAME: &str = "composite";

/// The picture of fragment values `[N, C]` before a background.
///
/// With fragments at pixel centres it costs nothing. Pieces of exact coverage are added up, each with
/// its weight.
///
/// # Errors
/// - [`RenderError::Shape`] unless the values are `[N, C]`, C > 0, with N the number of fragments,
///   and for fragments that are not whole.
/// - [`RenderError::Shape`] unless the background has as many channels and, if it is an image, the
///   image's size.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn composite<'t, T: Scalar>(
    values: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    background: Background<'t, T>,
) -> Result<Composite<'t, T>, RenderError> {
    Composite::from_values(values, fragments, background)
}

impl<'t, T: Scalar> Composite<'t, T> {
    /// [`composite`], for other operations.
    ///
    /// # Errors
    /// As [`composite`].
    pub(crate) fn from_values(
        values: Var<'t, T>,
        fragments: &Fragments<'t, T>,
        background: Background<'t, T>,
    ) -> Result<Self, RenderError> {
        let tape = values.tape();
        let coverage = fragments.checked_coverage(NAME, tape)?;
        let channels = checked_channels(NAME, values, coverage.count())?;
        let backdrop = background.behind(NAME, tape, coverage.size(), channels)?;
        let (mut values, mut blended) = (values, None);
        if let Some(weight) = fragments.weight {
            let op = MixPieces { coverage: Arc::clone(&coverage), kind: backdrop.kind };
            values = tape.apply(op, &[values, weight, backdrop.values])?;
            blended = Some(Arc::clone(&coverage.boundary.pixels));
        }
        Ok(Self(Picture { values, backdrop, clip: fragments.clip, coverage, blended }))
    }
}

/// Inputs: values `[N, C]`, weights `[K]` of the pieces, a background `[C]` or `[H, W, C]`.
struct MixPieces {
    coverage: Arc<Coverage>,
    kind: Kind,
}

impl<T: Scalar> Op<T> for MixPieces {
    /// Memory for the sums of a pixel.
    type Saved = Vec<T::Wide>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        sums: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (values, weights, background) = (inputs.data(0), inputs.data(1), inputs.data(2));
        let (coverage, channels) = (&*self.coverage, inputs.shape(0)[1]);
        if coverage.boundary.pixels.is_empty() {
            outputs.pass(0, "no discontinuities");
            return Ok(());
        }
        let centers = coverage.centers();
        let out = outputs.push([centers + coverage.boundary.pixels.len(), channels]);
        let (centered, mixed) = out.split_at_mut(centers * channels);
        centered.copy_from_slice(&values[..centers * channels]);
        // Sums begin with -0, which leaves what is added to it as it is.
        let zero = -T::Wide::ZERO;
        sums.resize(channels, zero);
        with_channels(
            channels,
            #[inline(always)]
            |channels| {
                // Of a length that the compiler knows.
                let sums = &mut sums[..channels];
                let pixels = coverage.boundary().zip(mixed.chunks_exact_mut(channels));
                for ((pixel, fragments), mixed) in pixels {
                    self.kind.fill(mixed, background, channels, pixel);
                    sums.fill(zero);
                    for &fragment in fragments {
                        let value = &values[fragment as usize * channels..][..channels];
                        let weight = weights[fragment as usize - centers].widen();
                        for c in 0..channels {
                            sums[c] += weight * (half(value[c]) - half(mixed[c]));
                        }
                    }
                    for (mixed, &sum) in mixed.iter_mut().zip(&*sums) {
                        let sum = half(*mixed) + sum;
                        *mixed = T::narrow(sum + sum);
                    }
                }
            },
        );
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let needs = inputs.needs(1);
        Keep::NOTHING.input(1).input_if(0, needs).input_if(2, needs)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        _: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (out_bar, weights) = (kept.only_upstream(), kept.input(1));
        let (coverage, channels) = (&*self.coverage, kept.input_shape(0)[1]);
        let centers = coverage.centers();
        let (own_bar, mixed_bar) = out_bar.split_at(centers * channels);
        let pixels = |channels| coverage.boundary().zip(mixed_bar.chunks_exact(channels));
        if let Some(values_bar) = gradients.get(0) {
            let (entries, is_fresh) = values_bar.entries_or_fresh();
            let (centered, pieces) = entries.split_at_mut(own_bar.len());
            if is_fresh {
                centered.copy_from_slice(own_bar);
                pieces.fill(T::ZERO);
            } else {
                centered.iter_mut().zip(own_bar).for_each(|(centered, &bar)| *centered += bar);
            }
            with_channels(
                channels,
                #[inline(always)]
                |channels| {
                    for ((_, fragments), bar) in pixels(channels) {
                        for &fragment in fragments {
                            let piece = fragment as usize - centers;
                            let row = &mut pieces[piece * channels..][..channels];
                            add_scaled(row, weights[piece], bar);
                        }
                    }
                },
            );
        }
        if let Some(weights_bar) = gradients.get(1) {
            let (values, background) = (kept.input(0), kept.input(2));
            let weights_bar = weights_bar.entries();
            with_channels(
                channels,
                #[inline(always)]
                |channels| {
                    for ((pixel, fragments), bar) in pixels(channels) {
                        let behind = &background[self.kind.entry(channels, pixel)..][..channels];
                        for &fragment in fragments {
                            let value = &values[fragment as usize * channels..][..channels];
                            weights_bar[fragment as usize - centers] +=
                                weight_bar(bar, value, behind);
                        }
                    }
                },
            );
        }
        let Some(background_bar) = gradients.get(2) else { return };
        let background_bar = background_bar.entries();
        for ((pixel, fragments), bar) in pixels(channels) {
            let weights = fragments.iter().map(|&fragment| weights[fragment as usize - centers]);
            let entries = &mut background_bar[self.kind.entry(channels, pixel)..][..channels];
            add_background_bar(entries, weights, bar);
        }
    }

    fn saved_bytes(&self, sums: &Self::Saved) -> usize {
        size_of_val(&sums[..])
    }
}

/// Adds `w_n x_bar`.
#[inline(always)]
fn add_scaled<T: Scalar>(entries: &mut [T], weight: T, bar: &[T]) {
    for (entry, &bar) in entries.iter_mut().zip(bar) {
        *entry += weight * bar;
    }
}

/// Adds `(1 - sum_n w_n) x_bar`.
#[inline(always)]
fn add_background_bar<T: Scalar>(entries: &mut [T], weights: impl Iterator<Item = T>, bar: &[T]) {
    let left = T::Wide::ONE - weights.map(T::widen).sum();
    for (entry, &bar) in entries.iter_mut().zip(bar) {
        *entry += T::narrow(left * bar.widen());
    }
}

/// The gradient of the weight of a piece: `x_bar . (v_n - b)`.
#[inline(always)]
fn weight_bar<T: Scalar>(bar: &[T], value: &[T], behind: &[T]) -> T {
    let mut sum = -T::Wide::ZERO;
    for ((bar, &value), &behind) in bar.iter().zip(value).zip(behind) {
        sum += bar.widen() * (half(value) - half(behind));
    }
    T::narrow(sum + sum)
}

#[inline(always)]
fn half<T: Scalar>(value: T) -> T::Wide {
    T::Wide::from_f64(0.5) * value.widen()
}
