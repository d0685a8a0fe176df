//! Scores of views: how well they match their images.

use bokashi_core::{Mask, Tape, Tensor};
use bokashi_fit::{FitError, agree, block, iou, psnr, ssim};

use super::fit::SceneFit;
use crate::error::SceneError;
use crate::learnables::Values;
use crate::learning::LearntRate;

/// The scores of a view against its image.
#[derive(Debug, Clone, Copy)]
pub struct ViewScore {
    /// The index of the view.
    pub view: usize,
    /// The peak signal-to-noise ratio, in decibels.
    pub psnr: Option<f64>,
    /// The structural similarity.
    pub ssim: Option<f64>,
    /// The intersection over union of the silhouettes, where the view has a mask.
    pub silhouette_iou: Option<f64>,
    /// The PSNR before the view was aligned, if it was: see [`SceneFit::align`].
    pub psnr_before: Option<f64>,
}

impl ViewScore {
    /// The bytes of four numbers, each after a byte that says whether it is there.
    const BYTES: usize = 4 * 9;

    fn to_bytes(self) -> Vec<u8> {
        let Self { view: _, psnr, ssim, silhouette_iou, psnr_before } = self;
        let numbers = [psnr, ssim, silhouette_iou, psnr_before].into_iter();
        let flagged = |number: Option<f64>| {
            [u8::from(number.is_some())].into_iter().chain(number.unwrap_or(0.0).to_le_bytes())
        };
        numbers.flat_map(flagged).collect()
    }

    fn from_bytes(view: usize, bytes: &[u8]) -> Self {
        let number = |k: usize| match bytes.get(9 * k..)?.split_first()? {
            (1, bytes) => bytes.first_chunk().map(|&bytes| f64::from_le_bytes(bytes)),
            _ => None,
        };
        let [psnr, ssim, silhouette_iou, psnr_before] = [0, 1, 2, 3].map(number);
        Self { view, psnr, ssim, silhouette_iou, psnr_before }
    }
}

/// A picture of a view, and its scores.
#[derive(Debug, Clone)]
pub struct ViewComparison {
    /// The scores.
    pub score: ViewScore,
    /// The picture, `[H, W, 3]`, in the colour space of images.
    pub image: Tensor<f32>,
    /// The image it was compared with, if the view has one.
    pub target: Option<Tensor<f32>>,
}

impl SceneFit {
    /// Draws a view and compares it with its image, if it has one.
    ///
    /// # Errors
    /// Those of the operations and of the image.
    pub fn score(&self, view: usize) -> Result<ViewScore, SceneError> {
        Ok(self.compare(view)?.score)
    }

    /// The scores of some views. All ranks make this call: each draws some of the views, and all return all scores.
    ///
    /// # Errors
    /// As [`SceneFit::score`].
    pub fn scores(&self, views: &[usize]) -> Result<Vec<ViewScore>, SceneError> {
        self.scores_with(views, |_| Ok(()))
    }

    /// As [`SceneFit::scores`], and calls `each` with the pictures, on the rank that drew them.
    ///
    /// # Errors
    /// As [`SceneFit::score`], and those of `each`.
    pub fn scores_with(
        &self,
        views: &[usize],
        mut each: impl FnMut(&ViewComparison) -> Result<(), SceneError>,
    ) -> Result<Vec<ViewScore>, SceneError> {
        let range = block(views.len(), self.ranks.rank(), self.ranks.size());
        let score = |&view: &usize| {
            let compared = self.compare(view)?;
            each(&compared)?;
            Ok(compared.score)
        };
        let scores: Result<Vec<_>, SceneError> = views[range].iter().map(score).collect();
        let bytes =
            scores.map(|scores| scores.iter().copied().flat_map(ViewScore::to_bytes).collect());
        let all = agree(&*self.ranks, bytes)?.concat();
        let pairs = views.iter().zip(all.chunks(ViewScore::BYTES));
        Ok(pairs.map(|(&view, bytes)| ViewScore::from_bytes(view, bytes)).collect())
    }

    /// Draws a view and compares it with its image: [`SceneFit::score`], with both pictures. They have 24 bytes for each
    /// pixel.
    ///
    /// # Errors
    /// As [`SceneFit::score`].
    pub fn compare(&self, view: usize) -> Result<ViewComparison, SceneError> {
        let all = self.drawn(view, 1)?;
        let image = colors(&all);
        let psnr_before = self.aligned.as_ref().and_then(|aligned| aligned.psnr_before(view));
        let mut score =
            ViewScore { view, psnr: None, ssim: None, silhouette_iou: None, psnr_before };
        if self.scene().views[view].image.is_none() {
            return Ok(ViewComparison { score, image, target: None });
        }
        let target = self.target(view, 1)?;
        score.psnr = Some(psnr(&image, &target, 1.0).map_err(FitError::from)?);
        // Images smaller than a window have none.
        score.ssim = ssim(&image, &target, 1.0).ok();
        if let Some(mask) = self.targets.mask(view)? {
            let shape = mask.shape().clone();
            let target_mask = mask.data();
            let covered = Mask::from_flat_fn(&shape, |k| all.data()[4 * k + 3] > 0.5);
            let expected = Mask::from_flat_fn(&shape, |k| target_mask[k] > 0.5);
            score.silhouette_iou = Some(iou(&covered, &expected).map_err(FitError::from)?);
        }
        Ok(ViewComparison { score, image, target: Some(target) })
    }

    /// A picture of a view, `reduce` times smaller along each axis: `[H, W, 3]`, in the colour space of images.
    ///
    /// # Errors
    /// Those of the operations.
    pub fn picture(&self, view: usize, reduce: usize) -> Result<Tensor<f32>, SceneError> {
        Ok(colors(&self.drawn(view, reduce)?))
    }

    /// The image that [`SceneFit::picture`] of a view should match.
    ///
    /// # Errors
    /// Those of the image; also for a view without one.
    pub fn target(&self, view: usize, reduce: usize) -> Result<Tensor<f32>, SceneError> {
        Ok(colors(&self.targets.get(view, reduce)?.image))
    }

    /// A picture of a view, with a fourth channel that is 1 where the objects are.
    fn drawn(&self, view: usize, reduce: usize) -> Result<Tensor<f32>, SceneError> {
        let tape = Tape::new();
        let mut constant = self.shown().clone();
        for LearntRate { name, .. } in &self.rates {
            constant.set_rate(name, 0.0)?;
        }
        let variables = constant.record(&tape);
        let values = Values { tape: &tape, learnt: Some(&variables) };
        let drawn = self.renderer.draw(&values, view, reduce, true)?;
        Ok(self.renderer.image(&values, &drawn, reduce)?.value())
    }
}

/// The first three channels.
fn colors(image: &Tensor<f32>) -> Tensor<f32> {
    let [height, width, channels] = [0, 1, 2].map(|axis| image.shape()[axis]);
    let entry = |k: usize| image.data()[k / 3 * channels + k % 3];
    Tensor::from_flat_fn([height, width, 3], entry)
}
