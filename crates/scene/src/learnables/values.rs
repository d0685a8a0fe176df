//! The numbers of a scene in a step: what is learnt is a variable, all else a constant.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::{FitError, Variables};

use super::learnable::Learnable;
use crate::scene::Scene;

/// The variables of a step, over the numbers that the scene has.
#[derive(Clone, Copy)]
pub struct Values<'t, 'a> {
    /// The step's tape.
    pub tape: &'t Tape<f32>,
    /// What is learnt.
    pub learnt: Option<&'a Variables<'t, f32>>,
}

impl<'t> Values<'t, '_> {
    /// What is learnt of the subject `name`; `None` where that stays as it is.
    pub(crate) fn learnt(&self, row: &Learnable, name: &str) -> Option<Var<'t, f32>> {
        self.learnt?.get(&row.parameter_name(name)).ok()
    }

    /// Whether the row is learnt of any subject.
    pub(crate) fn learns(&self, row: &Learnable, scene: &Scene) -> bool {
        let is_learnt = |variables: &Variables<'t, f32>| {
            row.parameter_names(scene).iter().any(|name| variables.get(name).is_ok())
        };
        self.learnt.is_some_and(is_learnt)
    }

    /// What is learnt of the subject `name`, or else the scene's tensor.
    pub(crate) fn tensor(&self, row: &Learnable, name: &str, fixed: &Tensor<f32>) -> Var<'t, f32> {
        self.learnt(row, name).unwrap_or_else(|| self.tape.constant(fixed))
    }

    /// What is learnt of the subject `name`, or else the scene's number.
    pub(crate) fn number(&self, row: &Learnable, name: &str, fixed: f64) -> Var<'t, f32> {
        self.learnt(row, name).unwrap_or_else(|| self.tape.constant_scalar(fixed as f32))
    }

    /// What is learnt of the subject `name`, or else the scene's three numbers.
    pub(crate) fn triple(&self, row: &Learnable, name: &str, fixed: [f32; 3]) -> Var<'t, f32> {
        self.learnt(row, name).unwrap_or_else(|| self.tape.constant(&Tensor::from(fixed)))
    }
}

/// The end of what a step must not do without.
pub(crate) type Recorded<'t> = Result<Var<'t, f32>, FitError>;
