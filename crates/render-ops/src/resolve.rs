//! From fragments to an image.
//!
//! # Forward
//! A covered pixel is the value of its fragment, any other one the background.
//!
//! # Backward
//! `values_bar_n = image_bar` at the fragment's pixel; the background's gradient is `image_bar` at
//! the pixels without a fragment, summed over them where the background is one colour. It is
//! linear.

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var};

use crate::error::RenderError;
use crate::fragments::{Coverage, Fragments};

/// What is seen where nothing covers a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub enum Background<'t, T: Scalar> {
    /// Zeros.
    #[default]
    Zero,
    /// One colour, `[C]`.
    Color(Var<'t, T>),
    /// An image, `[H, W, C]`.
    Image(Var<'t, T>),
}

/// The image `[H, W, C]` of fragment values `[N, C]` before a background.
///
/// # Errors
/// [`RenderError::Shape`] unless the values are `[N, C]`, C > 0, with N the number of fragments, and
/// the background has as many channels and, if it is an image, the image's size.
pub fn resolve<'t, T: Scalar>(
    values: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    background: Background<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let op = Resolve { coverage: Arc::clone(&fragments.coverage) };
    match background {
        Background::Zero => values.tape().apply(op, &[values]),
        Background::Color(behind) | Background::Image(behind) => {
            values.tape().apply(op, &[values, behind])
        }
    }
}

/// Inputs: values `[N, C]`, and perhaps a background `[C]` or `[H, W, C]`.
struct Resolve {
    coverage: Arc<Coverage>,
}

impl Resolve {
    /// The first entries of the pixels without a fragment.
    fn uncovered(&self, channels: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.coverage.size().pixels())
            .filter(|&pixel| self.coverage.fragment_at(pixel).is_none())
            .map(move |pixel| pixel * channels)
    }

    /// The first entry of each fragment's pixel.
    fn covered(&self, channels: usize) -> impl Iterator<Item = usize> + '_ {
        self.coverage.pixels().iter().map(move |&pixel| pixel as usize * channels)
    }
}

impl<T: Scalar> Op<T> for Resolve {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "resolve"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let count = self.coverage.count();
        let refused = |rule: String, shape: &Shape| {
            Err(RenderError::Shape { operation: "resolve", rule, shape: shape.clone() })
        };
        let channels = match **inputs.shape(0) {
            [rows, channels] if rows == count && channels > 0 => channels,
            _ => return refused(format!("values of shape [{count}, C], C > 0"), inputs.shape(0)),
        };
        let size = self.coverage.size();
        let shape = [size.height, size.width, channels];
        if inputs.len() == 2 {
            let background = inputs.shape(1);
            if **background != [channels] && **background != shape {
                let rule = format!("a background of shape [{channels}] or {shape:?}");
                return refused(rule, background);
            }
        }

        let values = inputs.data(0).chunks_exact(channels);
        let image = outputs.push(shape);
        if inputs.len() == 1 {
            image.fill(T::ZERO);
        } else {
            let behind = inputs.data(1);
            for at in self.uncovered(channels) {
                let from = if behind.len() == channels { 0 } else { at };
                image[at..at + channels].copy_from_slice(&behind[from..from + channels]);
            }
        }
        for (value, at) in values.zip(self.covered(channels)) {
            image[at..at + channels].copy_from_slice(value);
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let image_bar = kept.only_upstream();
        let channels = kept.input_shape(0)[1];
        if let Some(values_bar) = gradients.get(0) {
            let pixels = self.coverage.pixels();
            values_bar
                .add_each(|k| image_bar[pixels[k / channels] as usize * channels + k % channels]);
        }
        if kept.input_count() == 1 {
            return;
        }
        if let Some(background_bar) = gradients.get(1) {
            let is_color = kept.input_shape(1).rank() == 1;
            if is_color {
                let mut sums = vec![T::Wide::ZERO; channels];
                for at in self.uncovered(channels) {
                    let row = &image_bar[at..at + channels];
                    sums.iter_mut().zip(row).for_each(|(sum, bar)| *sum += bar.widen());
                }
                background_bar.add_each(|c| T::narrow(sums[c]));
            } else {
                let entries = background_bar.entries();
                for at in self.uncovered(channels) {
                    for c in at..at + channels {
                        entries[c] += image_bar[c];
                    }
                }
            }
        }
    }
}
