//! From a picture to an image.
//!
//! # Forward
//! A pixel of the picture has its value, any other pixel the background.
//!
//! # Backward
//! `values_bar_p = image_bar` at the value's pixel; the background's gradient is `image_bar` at the
//! other pixels, summed over them where the background is one colour. It is linear.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, Var};

use crate::background::Kind;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::picture::Picture;
use crate::picture_rows::PictureRows;

impl<'t, T: Scalar> Picture<'t, T> {
    /// The dense image, `[H, W, C]`, with the background where the picture has no pixel.
    ///
    /// # Errors
    /// None that a picture can cause.
    #[inline(never)]
    pub fn image(&self) -> Result<Var<'t, T>, RenderError> {
        let (coverage, blended) = (Arc::clone(&self.coverage), self.blended.clone());
        let op = Image { coverage, blended, kind: self.backdrop.kind };
        self.values.tape().apply(op, &[self.values, self.backdrop.values])
    }
}

/// Inputs: values `[P, C]`, a background `[C]` or `[H, W, C]`.
struct Image {
    coverage: Arc<Coverage>,
    blended: Option<Arc<Vec<u32>>>,
    kind: Kind,
}

impl Image {
    fn blended(&self) -> &[u32] {
        self.blended.as_deref().map_or(&[], Vec::as_slice)
    }
}

impl<T: Scalar> Op<T> for Image {
    /// Memory for the sums over the pixels that show a background of one colour.
    type Saved = Vec<T::Wide>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "image"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (size, channels) = (self.coverage.size(), inputs.shape(0)[1]);
        let (values, background) = (inputs.data(0), inputs.data(1));
        let image = outputs.try_push("image", [size.height, size.width, channels])?;
        self.coverage.for_each_gap(self.blended(), |gap| {
            let first = gap.start;
            let entries = gap.start * channels..gap.end * channels;
            self.kind.fill(&mut image[entries], background, channels, first);
        });
        let entries = |rows: Range<usize>| rows.start * channels..rows.end * channels;
        for run in &self.coverage.centers.runs {
            image[entries(run.pixels())].copy_from_slice(&values[entries(run.fragments())]);
        }
        let blended_values = values[self.coverage.centers() * channels..].chunks_exact(channels);
        for (&pixel, value) in self.blended().iter().zip(blended_values) {
            image[pixel as usize * channels..][..channels].copy_from_slice(value);
        }
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        sums: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let image_bar = kept.only_upstream();
        let channels = kept.input_shape(0)[1];
        if let Some(values_bar) = gradients.get(0) {
            let rows = 0..self.coverage.size().height;
            let picture =
                PictureRows { coverage: &self.coverage, blended: self.blended(), channels };
            picture.pull_back(image_bar, rows, values_bar.entries());
        }
        let Some(background_bar) = gradients.get(1) else { return };
        if self.kind == Kind::Color {
            sums.clear();
            sums.resize(channels, T::Wide::ZERO);
            self.coverage.for_each_gap(self.blended(), |gap| {
                for row in
                    image_bar[gap.start * channels..gap.end * channels].chunks_exact(channels)
                {
                    sums.iter_mut().zip(row).for_each(|(sum, bar)| *sum += bar.widen());
                }
            });
            background_bar.add_each(|c| T::narrow(sums[c]));
        } else {
            let entries = background_bar.entries();
            self.coverage.for_each_gap(self.blended(), |gap| {
                for index in gap.start * channels..gap.end * channels {
                    entries[index] += image_bar[index];
                }
            });
        }
    }
}
