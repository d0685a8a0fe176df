//! The numbers of lenses: each is that of the pipeline, which views share, or a view's own.

use bokashi_core::{Tensor, Var};
use bokashi_fit::Mapping;

use super::learnable::{Entry, Learnable, Subjects};
use super::values::Values;
use crate::description::{LensNumber, NotNegative, Opening, Positive};
use crate::scene::Scene;

/// Radii of circles of confusion at infinite distance, in pixels.
pub(crate) static APERTURE: Learnable = Learnable {
    name: "aperture",
    start: |scene, subject| start(scene, subject, LensNumber::Aperture),
    apply: |scene, subject, learnt, _| {
        set(scene, subject, LensNumber::Aperture, learnt);
        Ok(())
    },
    ..LENS
};

/// Radii of lenses, in units of the scene.
pub(crate) static RADIUS: Learnable = Learnable {
    name: "radius",
    margin: f32::MIN_POSITIVE,
    start: |scene, subject| start(scene, subject, LensNumber::Radius),
    apply: |scene, subject, learnt, _| {
        set(scene, subject, LensNumber::Radius, learnt);
        Ok(())
    },
    ..LENS
};

/// Distances that are sharp, in units of the scene.
pub(crate) static FOCUS: Learnable = Learnable {
    name: "focus",
    margin: f32::MIN_POSITIVE,
    start: |scene, subject| start(scene, subject, LensNumber::Focus),
    apply: |scene, subject, learnt, _| {
        set(scene, subject, LensNumber::Focus, learnt);
        Ok(())
    },
    ..LENS
};

/// What the numbers of a lens have in common.
const LENS: Learnable = Learnable {
    entry: |learn| learn.lens.as_ref().map(Entry::from),
    mapping: Mapping::Exp,
    unit: "logarithms",
    refusal: |scene, _, _| refusal(scene),
    ..Learnable::new("lens", Subjects::Views, 0.02)
};

fn refusal(scene: &Scene) -> Option<String> {
    let Some(lens) = scene.description.pipeline.lens else {
        return Some("a lens that is learnt is in the pipeline".to_owned());
    };
    let learnt = scene.description.learn.lens.as_ref()?;
    let lacks = |number: &&LensNumber| shared(scene, **number).is_none();
    if learnt.per_view.iter().any(|number| lacks(&number)) {
        let (key, rule) = (lens.opening.key(), "`learn.lens.per_view` lists what the lens has");
        return Some(format!("{rule}, and that is \"{key}\" and \"focus\""));
    }
    let radii = (0..=scene.views.len()).filter_map(|k| start(scene, k, LensNumber::Radius));
    let is_zero = |radius: Tensor<f32>| radius.item() == 0.0;
    radii.into_iter().any(is_zero).then(|| "a `radius` that is learnt is above 0".to_owned())
}

/// The number that views share.
fn shared(scene: &Scene, which: LensNumber) -> Option<f64> {
    let lens = scene.description.pipeline.lens?;
    picked(which, Some(lens.opening), Some(lens.focus))
}

/// The number that a view has of its own.
fn view_number(scene: &Scene, view: usize, which: LensNumber) -> Option<f64> {
    let shared = shared(scene, which)?;
    let lens = scene.views[view].lens;
    let learnt = scene.description.learn.lens.as_ref();
    let is_own = learnt.is_some_and(|learnt| learnt.per_view.contains(&which));
    picked(which, lens.opening, lens.focus).or(is_own.then_some(shared))
}

fn picked(which: LensNumber, opening: Option<Opening>, focus: Option<Positive>) -> Option<f64> {
    match (which, opening) {
        (LensNumber::Focus, _) => focus.map(|focus| focus.0),
        (LensNumber::Aperture, Some(Opening::Aperture(number)))
        | (LensNumber::Radius, Some(Opening::Radius(number))) => Some(number.0),
        _ => None,
    }
}

/// Subject 0 is what views share, where some view does; the others are views with a number of their own.
fn start(scene: &Scene, subject: usize, which: LensNumber) -> Option<Tensor<f32>> {
    let number = match subject.checked_sub(1) {
        Some(view) => view_number(scene, view, which),
        None => {
            let mut views = 0..scene.views.len();
            let is_used =
                views.is_empty() || views.any(|view| view_number(scene, view, which).is_none());
            shared(scene, which).filter(|_| is_used)
        }
    };
    number.map(|number| Tensor::scalar(number as f32))
}

fn set(scene: &mut Scene, subject: usize, which: LensNumber, learnt: &Tensor<f32>) {
    let number = f64::from(learnt.item());
    let opening = match which {
        LensNumber::Aperture => Some(Opening::Aperture(NotNegative(number))),
        LensNumber::Radius => Some(Opening::Radius(NotNegative(number))),
        LensNumber::Focus => None,
    };
    let focus = Positive(number);
    match (subject.checked_sub(1), &mut scene.description.pipeline.lens) {
        (Some(view), _) => match opening {
            Some(opening) => scene.views[view].lens.opening = Some(opening),
            None => scene.views[view].lens.focus = Some(focus),
        },
        (None, Some(lens)) => match opening {
            Some(opening) => lens.opening = opening,
            None => lens.focus = focus,
        },
        (None, None) => {}
    }
}

impl<'t> Values<'t, '_> {
    /// A number of a view's lens; `None` where its lens has none.
    pub(crate) fn lens_number(
        &self,
        scene: &Scene,
        view: usize,
        which: LensNumber,
    ) -> Option<Var<'t, f32>> {
        let row = match which {
            LensNumber::Aperture => &APERTURE,
            LensNumber::Radius => &RADIUS,
            LensNumber::Focus => &FOCUS,
        };
        Some(match view_number(scene, view, which) {
            Some(number) => self.number(row, &scene.views[view].name, number),
            None => self.number(row, "", shared(scene, which)?),
        })
    }
}
