//! An image over another.
//!
//! # Forward
//! `x = f + (1 - f_a) b`, with the last channel of each image its alpha, and the other channels colours
//! times their alpha (premultiplied). The alpha of x follows by the same rule.
//!
//! # Backward
//! `f_bar = x_bar`, `f_a_bar -= x_bar . b`, `b_bar = (1 - f_a) x_bar`.
//!
//! # Source
//! Porter and Duff, *Compositing digital images*, SIGGRAPH 1984.

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;

const NAME: &str = "over";

/// The image `front` over the image `behind`, both `[.., C]`: premultiplied colours, and alpha last. For
/// layers in depth that were antialiased one by one.
///
/// # Errors
/// [`RenderError::Shape`] unless both images have one shape, with at least one channel;
/// `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn over<'t, T: Scalar>(
    front: Var<'t, T>,
    behind: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let refused = |rule: &str, variable: Var<'t, T>| {
        let (rule, shape) = (rule.to_owned(), variable.shape());
        Err(RenderError::Shape { operation: NAME, rule, shape })
    };
    match front.shape().last() {
        None | Some(0) => return refused("images of shape [.., C], C > 0", front),
        _ if behind.shape() != front.shape() => {
            return refused(&format!("an image behind of shape {}", front.shape()), behind);
        }
        _ => {}
    }
    front.tape().apply(Over, &[front, behind])
}

/// Inputs: two images `[.., C]`, the front image first.
struct Over;

impl<T: Scalar> Op<T> for Over {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let channels = *inputs.shape(0).last().expect("it was checked");
        let (front, behind) = (inputs.data(0), inputs.data(1));
        for_each_pixel(outputs.push(inputs.shape(0)), channels, |entries, out| {
            let (front, behind) = (&front[entries.clone()], &behind[entries]);
            let left = T::ONE - front[channels - 1];
            for (out, (&front, &behind)) in out.iter_mut().zip(front.iter().zip(behind)) {
                *out = front + left * behind;
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(1, inputs.needs(0)).input_if(0, inputs.needs(1))
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let channels = *kept.input_shape(0).last().expect("it was checked");
        let bars = kept.only_upstream();
        if let Some(front_bar) = gradients.get(0) {
            let behind = kept.input(1);
            for_each_pixel(front_bar.entries(), channels, |entries, pixel| {
                let (bars, behind) = (&bars[entries.clone()], &behind[entries]);
                pixel.iter_mut().zip(bars).for_each(|(pixel, &bar)| *pixel += bar);
                let pairs = bars.iter().zip(behind);
                let dot: T::Wide = pairs.map(|(a, b)| a.widen() * b.widen()).sum();
                pixel[channels - 1] -= T::narrow(dot);
            });
        }
        if let Some(behind_bar) = gradients.get(1) {
            let front = kept.input(0);
            for_each_pixel(behind_bar.entries(), channels, |entries, pixel| {
                let left = T::ONE - front[entries.end - 1];
                pixel.iter_mut().zip(&bars[entries]).for_each(|(pixel, &bar)| *pixel += left * bar);
            });
        }
    }
}

/// Calls `work(entries, own)` for each pixel: which entries of an image it has, and its own of `image`.
fn for_each_pixel<T: Scalar>(
    image: &mut [T],
    channels: usize,
    work: impl Fn(std::ops::Range<usize>, &mut [T]) + Sync,
) {
    let pixels = (ENTRIES_PER_PIECE / channels).max(1);
    for_each_piece_mut(image, pixels * channels, |piece, image| {
        let starts = (piece * pixels * channels..).step_by(channels);
        for (start, pixel) in starts.zip(image.chunks_exact_mut(channels)) {
            work(start..start + channels, pixel);
        }
    });
}
