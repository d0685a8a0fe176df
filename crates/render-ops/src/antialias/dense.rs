//! Antialiasing of a dense image.

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use super::blends::SavedBlends;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::fragments::Fragments;

const NAME: &str = "antialias_image";

/// `image: [H, W, C]` with the silhouettes of the fragments' faces antialiased: [`antialias`](crate::antialias()) for
/// whoever has made a dense image of what they see. A picture costs less.
///
/// # Errors
/// - [`RenderError::Shape`] unless the image has the size of the fragments' image and C > 0.
/// - [`RenderError::ExactCoverage`] for fragments with exact coverage; [`RenderError::NoOrientations`] for coverage of
///   ids alone.
/// - As for all fragments that are not whole.
pub fn antialias_image<'t, T: Scalar>(
    image: Var<'t, T>,
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let coverage = fragments.checked_coverage(NAME, image.tape())?;
    coverage.check_silhouettes(NAME)?;
    let (size, shape) = (coverage.size(), image.shape());
    match *shape {
        [height, width, channels]
            if [height, width] == [size.height, size.width] && channels > 0 => {}
        _ => {
            let rule = format!("an image of shape [{}, {}, C], C > 0", size.height, size.width);
            return Err(RenderError::shape(NAME, rule, &shape));
        }
    }
    image.tape().apply(AntialiasImage { coverage }, &[fragments.clip, image])
}

/// Inputs: clip `[V, 4]`, image `[H, W, C]`. Output: the image.
struct AntialiasImage {
    coverage: Arc<Coverage>,
}

impl<T: Scalar> Op<T> for AntialiasImage {
    type Saved = SavedBlends<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        saved.find(&self.coverage, inputs.data(0));
        if saved.blends.is_empty() {
            outputs.pass(1, "no discontinuities");
            return Ok(());
        }
        let size = self.coverage.size();
        saved.rows.clear();
        saved.rows.extend(saved.blends.iter().map(|blend| blend.pixels(size)));
        let out = outputs.push(inputs.shape(1).clone());
        saved.divide_and_copy(out, inputs.data(1));
        saved.blend(out, inputs.shape(1)[2]);
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
        let channels = kept.input_shape(1)[2];
        if let Some(clip_bar) = gradients.get(0) {
            let (clip, size) = (kept.input(0), self.coverage.size());
            saved.add_clip_bars(out_bar, channels, (clip, size), clip_bar.entries());
        }
        let all = out_bar.len();
        saved.pull_back_values(taken, channels, all, kept, gradients);
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.bytes()
    }
}
