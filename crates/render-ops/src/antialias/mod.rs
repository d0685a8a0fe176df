//! Analytic antialiasing of silhouettes: it blends neighbouring pixels by where a silhouette edge
//! passes between their centres, and so gives silhouettes a gradient.
//!
//! # Forward
//! Take each pixel with its right and its lower neighbour, of colours `c_0` and `c_1`, where triangle
//! ids differ. The edge between them belongs to the triangle that covers a pixel; where both are
//! covered, to the nearer triangle. Of its edges that cross the line through the two centres take the
//! edge that lies farthest towards the other pixel. Use it only if it is a silhouette, runs more
//! across the line than along it, and crosses between the two centres. A silhouette has no face on its
//! other side, or a face seen edge-on, or both faces lie on the same side of it in the image.
//!
//! Let d be the distance of the crossing from the covered centre, and `s = 1` where the triangle
//! covers the first pixel, -1 where it covers the second. Then `alpha = s (1/2 - d)`: where positive
//! `out_0 += alpha (c_1 - c_0)`, else `out_1 += alpha (c_1 - c_0)`. All reads are from the aliased
//! picture, so up to four blends add at a pixel, each with a share `a_k = |alpha_k|` of at most 1/2.
//! Where `s = sum a_k` is above 1, at specks around a centre, the shares are divided by s. So a pixel
//! is always a mean of its neighbours and itself, and never leaves their range: where several blends add,
//! their sum is held within it, against rounding.
//!
//! # Backward
//! `alpha_bar = out_bar . (c_1 - c_0)` at the blended pixel; `c_bar_0 -= alpha out_bar`,
//! `c_bar_1 += alpha out_bar`, beside `c_bar = out_bar`; from alpha to the edge's vertices as in
//! `discontinuity`. Where shares were divided, `out = c + m` with `m = sum a_k d_k / s`, `d_k` the steps
//! to the neighbours: then `(d_k - m) / s` stands in the place of `d_k`.
//!
//! # Where it is not smooth
//! Where a crossing reaches a pixel centre, an edge passes through 45 degrees, shares begin to add up to
//! more than 1, or an edge starts or stops being a silhouette. An intersection of two faces is no edge of either: it gets no
//! gradient. The gradient is that of this image; from that of the true area coverage it differs
//! in first order of the pixel size.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020, section 3.5.

mod blends;
mod dense;
mod discontinuity;
mod pairs;
mod search;
mod sorting;

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar};

use self::blends::SavedBlends;
pub use self::dense::antialias_image;
use crate::background::Kind;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::picture::{Composite, Picture};

/// The picture with the silhouettes of its faces antialiased, for pictures of one fragment per pixel,
/// as [`rasterize`](crate::rasterize()) gives them unless it is asked for exact coverage.
///
/// Uncovered pixels beside a silhouette become part of the picture. The cost is that of the pixels
/// along silhouettes, and of a copy of the values; where no silhouette is in sight there is none.
///
/// # Errors
/// [`RenderError::ExactCoverage`] for fragments with exact coverage; [`RenderError::NoOrientations`] for coverage of ids
/// alone.
#[inline(never)]
pub fn antialias<'t, T: Scalar>(
    composite: Composite<'t, T>,
) -> Result<Picture<'t, T>, RenderError> {
    let Composite(picture) = composite;
    let Picture { values, backdrop, clip, coverage, .. } = &picture;
    coverage.check_silhouettes("antialias")?;
    let op = Antialias { coverage: Arc::clone(coverage), kind: backdrop.kind };
    let inputs = [*clip, *values, backdrop.values];
    let (outputs, blended) = values
        .tape()
        .record_with(op, &inputs, |saved: &SavedBlends<T>| saved.background_pixels.clone())?;
    Ok(Picture { values: outputs[0], blended, ..picture })
}

/// Inputs: clip `[V, 4]`, values `[N, C]`, a background `[C]` or `[H, W, C]`. Output: values `[P, C]`
/// of the fragments and of the blended background pixels.
struct Antialias {
    coverage: Arc<Coverage>,
    kind: Kind,
}

impl<T: Scalar> Op<T> for Antialias {
    type Saved = SavedBlends<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "antialias"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let coverage = &*self.coverage;
        saved.find(coverage, inputs.data(0));
        if saved.blends.is_empty() {
            saved.background_pixels = None;
            outputs.pass(1, "no discontinuities");
            return Ok(());
        }
        saved.find_rows(coverage);
        let (input, background) = (inputs.data(1), inputs.data(2));
        let channels = inputs.shape(1)[1];
        let pixels = saved.background_pixels.clone().expect("it was just found");
        let out = outputs.push([coverage.count() + pixels.len(), channels]);
        let (values, background_values) = out.split_at_mut(input.len());
        saved.divide_and_copy(values, input);
        for (value, &pixel) in background_values.chunks_exact_mut(channels).zip(&*pixels) {
            self.kind.fill(value, background, channels, pixel as usize);
        }
        saved.blend(out, channels);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(0, inputs.needs(0)).upstream()
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let taken = gradients.take_upstream();
        let out_bar = taken.as_deref().unwrap_or_else(|| kept.only_upstream());
        let channels = kept.input_shape(1)[1];
        let covered = self.coverage.count() * channels;
        if let Some(clip_bar) = gradients.get(0) {
            let (clip, size) = (kept.input(0), self.coverage.size());
            saved.add_clip_bars(out_bar, channels, (clip, size), clip_bar.entries());
        }
        if let (Some(pixels), Some(background_bar)) = (&saved.background_pixels, gradients.get(2)) {
            let start_of = |k: usize| self.kind.entry(channels, pixels[k] as usize);
            saved.add_background_bars(
                out_bar,
                [covered, channels],
                start_of,
                background_bar.entries(),
            );
        }
        saved.pull_back_values(taken, channels, covered, kept, gradients);
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.bytes()
            + saved.background_pixels.as_ref().map_or(0, |pixels| size_of_val(pixels.as_slice()))
    }
}
