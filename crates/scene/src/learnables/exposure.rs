//! Exposures: one of all views, and how those of single views differ from it.
//!
//! Light times `2^(E + e_v)` is what view v shows, with the pipeline's `E`. A mean of the `e_v` can't be told from `E`,
//! nor from colours. So where they are learnt, `E` stays, and so does their mean over the views that are learnt from:
//! with learnt numbers `x_v` and starts `s_v`, `e_v = x_v + mean(s) - mean(x)`. A view that is held out has `e_v = x_v`.

use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};

use super::learnable::{Entry, Learnable, Subjects};
use super::values::Values;
use crate::description::Finite;
use crate::scene::Scene;

/// The exposure of all views in stops, a number.
pub(crate) static EXPOSURE: Learnable = Learnable {
    start: |scene, _| match is_per_view(scene) {
        true => None,
        false => Some(Tensor::scalar(pipeline_exposure(scene) as f32)),
    },
    apply: |scene, _, stops, _| {
        scene.description.pipeline.exposure = Some(Finite(stops.item().into()));
        Ok(())
    },
    ..STOPS
};

/// How the exposures of views differ from it, in stops, `[views]`.
pub(crate) static EXPOSURES: Learnable = Learnable {
    name: "exposures",
    has_rows_of_views: true,
    refusal: |scene, _, _| {
        let rule =
            "`learn.exposure.per_view` compares two views that are learnt from, and there is 1";
        (is_per_view(scene) && scene.views_with_image(false).count() == 1).then(|| rule.to_owned())
    },
    start: |scene, _| is_per_view(scene).then(|| view_exposures(scene).map(|stops| stops as f32)),
    apply: |scene, _, learnt, _| {
        let tape = Tape::<f64>::new();
        let learnt = tape.constant(&learnt.map(f64::from));
        let all = centred(scene, learnt)?.value();
        for (view, &stops) in scene.views.iter_mut().zip(all.data()) {
            view.exposure = stops;
        }
        Ok(())
    },
    ..STOPS
};

/// What both have in common.
const STOPS: Learnable = Learnable {
    entry: |learn| learn.exposure.as_ref().map(Entry::from),
    unit: "stops",
    ..Learnable::new("exposure", Subjects::Scene, 0.02)
};

fn is_per_view(scene: &Scene) -> bool {
    scene.description.learn.exposure.as_ref().is_some_and(|exposure| exposure.per_view)
}

fn pipeline_exposure(scene: &Scene) -> f64 {
    scene.description.pipeline.exposure.map_or(0.0, |stops| stops.0)
}

fn view_exposures(scene: &Scene) -> Tensor<f64> {
    Tensor::from_flat_fn([scene.views.len()], |view| scene.views[view].exposure)
}

/// The exposures of views, `[views]`, that learnt numbers make in a scene with these starts.
fn centred<'t, T: Scalar>(scene: &Scene, learnt: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
    let tape = learnt.tape();
    let mut share = vec![0.0; scene.views.len()];
    let learnt_from: Vec<_> = scene.views_with_image(false).collect();
    learnt_from.iter().for_each(|&view| share[view] = 1.0 / learnt_from.len() as f64);
    let mean: f64 = scene.views.iter().zip(&share).map(|(view, share)| view.exposure * share).sum();
    let row = |of: &dyn Fn(f64) -> f64| {
        tape.constant(&Tensor::from_flat_fn([share.len()], |view| T::from_f64(of(share[view]))))
    };
    let off = tape.constant_scalar(T::from_f64(mean)).try_sub(learnt.dot(row(&|share| share))?)?;
    learnt.try_add(off.try_mul(row(&|share| f64::from(u8::from(share > 0.0))))?)
}

impl<'t> Values<'t, '_> {
    /// By how many stops the light of a view is multiplied; `None` where it stays as it is.
    pub(crate) fn stops(
        &self,
        scene: &Scene,
        view: usize,
    ) -> Result<Option<Var<'t, f32>>, TensorError> {
        let own = match self.learnt(&EXPOSURES, "") {
            Some(learnt) => Some(centred(scene, learnt)?.slice(0, view..view + 1)?.reshape([])?),
            None => match scene.views[view].exposure {
                0.0 => None,
                stops => Some(self.tape.constant_scalar(stops as f32)),
            },
        };
        let all = match scene.description.pipeline.exposure {
            None if self.learnt(&EXPOSURE, "").is_none() => None,
            _ => Some(self.number(&EXPOSURE, "", pipeline_exposure(scene))),
        };
        Ok(match (all, own) {
            (Some(all), Some(own)) => Some(all.try_add(own)?),
            (all, own) => all.or(own),
        })
    }
}
