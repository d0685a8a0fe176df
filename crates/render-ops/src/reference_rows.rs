//! What a loss by a rule of one's own needs of a reference image: its rows at the pixels of a picture, and the
//! loss of all others, which see the background.
//!
//! There is no input, and so no backward pass.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, TensorError, Var};

use crate::coverage::Coverage;
use crate::picture::Picture;
use crate::pixel_loss::PixelLoss;

impl<'t, T: Scalar> Picture<'t, T> {
    /// The reference of `loss` at the picture's pixels, `[P, R]`, and the loss of all others, `[]`.
    pub(crate) fn reference_rows(
        &self,
        loss: &PixelLoss<T>,
    ) -> Result<[Var<'t, T>; 2], TensorError> {
        let op = ReferenceRows {
            coverage: Arc::clone(&self.coverage),
            blended: self.blended.clone(),
            loss: loss.clone(),
        };
        let tape = self.values.tape();
        let outputs = tape.record(op, &[])?;
        tape.leave_out("pixel_loss", "pixels of the background: summed with the reference");
        Ok([outputs[0], outputs[1]])
    }
}

/// No inputs. Outputs: the reference `[P, R]`, and the loss of all other pixels, `[]`.
struct ReferenceRows<T: Scalar> {
    coverage: Arc<Coverage>,
    blended: Option<Arc<Vec<u32>>>,
    loss: PixelLoss<T>,
}

impl<T: Scalar> Op<T> for ReferenceRows<T> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "pixel_loss"
    }

    fn forward(
        &self,
        _inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let reference = self.loss.reference();
        let (coverage, channels) = (&*self.coverage, reference.shape()[2]);
        let blended = self.blended.as_deref().map_or(&[][..], Vec::as_slice);
        let entries = |pixels: Range<usize>| pixels.start * channels..pixels.end * channels;
        let rows = outputs.push([coverage.centers() + blended.len(), channels]);
        let (centers, blended_rows) = rows.split_at_mut(coverage.centers() * channels);
        for run in &coverage.centers.runs {
            let from = &reference.data()[entries(run.pixels())];
            centers[entries(run.fragments())].copy_from_slice(from);
        }
        for (row, &pixel) in blended_rows.chunks_exact_mut(channels).zip(blended) {
            row.copy_from_slice(&reference.data()[pixel as usize * channels..][..channels]);
        }
        let mut total = T::Wide::ZERO;
        coverage.for_each_gap(blended, |gap| total += self.loss.behind(gap));
        outputs.push([])[0] = T::narrow(total);
        Ok(())
    }

    fn backward(&self, _: &Kept<'_, T>, _: &mut (), _: &mut Accumulators<'_, T>) {
        // It has no input.
    }
}
