//! Alignment and scores of held-out views.

use bokashi_core::{Tensor, parallel};
use bokashi_fit::{FitError, Parameters, agree, block, psnr};

use super::alignment::{Aligned, AlignedView, Alignment, Own};
use super::fit::SceneFit;
use crate::error::SceneError;
use crate::learnables::TABLE;

/// The largest PSNR that counts, in decibels: errors are then below a 256th of the last of 8 bits.
const MOST_DECIBELS: f64 = 100.0;

impl SceneFit {
    /// Aligns each held-out view with its image: fits its parameters, such as its camera, if the fit has learnt those
    /// of other views. All other parameters stay as they are. Scores, pictures and [`SceneFit::learnt`] then have the
    /// aligned numbers, up to the next step. All ranks make this call.
    ///
    /// It takes 100 steps on each of these views, on images of at most 320 pixels along the shorter side.
    ///
    /// # Errors
    /// Those of a step on the views.
    pub fn align(&mut self) -> Result<(), SceneError> {
        self.aligned = None;
        let views = self.scene().views_with_image(true).map(|view| (view, self.own(view)));
        let views: Vec<_> = views.filter(|(_, own)| !own.is_empty()).collect();
        if views.is_empty() {
            return Ok(());
        }
        let range = block(views.len(), self.ranks.rank(), self.ranks.size());
        let bytes = agree(&*self.ranks, self.aligned_bytes(&views[range]))?.concat();
        let mut parameters = self.fit.parameters().clone();
        let (mut words, mut aligned) = (bytes.as_chunks::<8>().0.iter(), Vec::new());
        let mut next = || words.next().map_or(f64::NAN, |&word| f64::from_le_bytes(word));
        for (view, own) in &views {
            let psnr = next();
            aligned
                .push(AlignedView { view: *view, psnr_before: (!psnr.is_nan()).then_some(psnr) });
            for Own { name, numbers, .. } in own {
                let raw = parameters.get(name)?.raw().clone();
                let mut data = raw.data().to_vec();
                data[numbers.clone()].fill_with(|| next() as f32);
                parameters.set_raw(name, Tensor::from_flat_fn(raw.shape(), |k| data[k]))?;
            }
        }
        self.aligned = Some(Aligned { parameters, views: aligned });
        Ok(())
    }

    /// The indices of the views that are aligned.
    pub fn aligned_views(&self) -> impl Iterator<Item = usize> + '_ {
        self.aligned.iter().flat_map(|aligned| aligned.views.iter().map(|aligned| aligned.view))
    }

    /// The parameters that pictures and scores show: those of the fit, with the aligned numbers of held-out views.
    pub(super) fn shown(&self) -> &Parameters<f32> {
        self.aligned.as_ref().map_or(self.fit.parameters(), |aligned| &aligned.parameters)
    }

    /// The numbers of a view that steps so far have learnt for other views.
    fn own(&self, view: usize) -> Vec<Own> {
        let begun = self.stage + usize::from(self.fit.steps_done() > 0);
        let was_learnt = |key: &str| {
            let mut stages = self.stages[..begun].iter();
            stages.any(|stage| {
                stage.learn.as_ref().is_none_or(|keys| keys.iter().any(|learnt| learnt == key))
            })
        };
        let count = self.scene().views.len();
        let own = TABLE.iter().filter_map(|row| {
            let name = row.own_name(self.scene(), view)?;
            let rate = self.rates.iter().find(|rate| rate.name == name)?.rate;
            let size = self.fit.parameters().get(&name).ok()?.raw().size();
            let numbers = match row.has_rows_of_views {
                true => size / count * view..size / count * (view + 1),
                false => 0..size,
            };
            was_learnt(row.key).then_some(Own { name, rate, numbers })
        });
        own.collect()
    }

    /// The bytes of each view's PSNR before its alignment, NaN without one, and of its aligned numbers.
    fn aligned_bytes(&self, views: &[(usize, Vec<Own>)]) -> Result<Vec<u8>, SceneError> {
        let parameters = self.fit.parameters();
        let constants = parameters.iter().map(|of| (of.name().to_owned(), of.value())).collect();
        let Self { renderer, targets, .. } = self;
        let alignment = Alignment { renderer, targets, parameters, constants };
        let mut results: Vec<_> = views.iter().map(|_| None).collect();
        parallel::write_each(&mut results, 1, |k| {
            let (view, own) = &views[k];
            Some(parallel::alone(|| alignment.numbers(*view, own)))
        });
        let mut bytes = Vec::new();
        for ((view, _), numbers) in views.iter().zip(results.into_iter().flatten()) {
            let psnr = self.score(*view)?.psnr.unwrap_or(f64::NAN);
            let numbers = numbers?.into_iter().map(f64::from);
            bytes.extend(std::iter::once(psnr).chain(numbers).flat_map(f64::to_le_bytes));
        }
        Ok(bytes)
    }

    /// The mean PSNR in decibels of the held-out views, aligned, with images `reduce` times smaller along each axis.
    /// All ranks make this call.
    ///
    /// # Errors
    /// As [`SceneFit::align`] and [`SceneFit::score`].
    pub(super) fn held_out_psnr(&mut self, reduce: usize) -> Result<f64, SceneError> {
        self.align()?;
        let views: Vec<_> = self.scene().views_with_image(true).collect();
        let range = block(views.len(), self.ranks.rank(), self.ranks.size());
        let ratio = |&view: &usize| {
            let (picture, target) = (self.picture(view, reduce)?, self.target(view, reduce)?);
            let ratio = psnr(&picture, &target, 1.0).map_err(FitError::from)?;
            // One that is right to the bit would hide all others.
            Ok(if ratio.is_nan() { 0.0 } else { ratio.min(MOST_DECIBELS) })
        };
        let ratios: Result<Vec<f64>, SceneError> = views[range].iter().map(ratio).collect();
        let bytes = ratios.map(|all| all.into_iter().flat_map(f64::to_le_bytes).collect());
        let all = agree(&*self.ranks, bytes);
        self.aligned = None;
        let all = all?.concat();
        let sum: f64 = all.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes)).sum();
        Ok(sum / views.len() as f64)
    }
}
