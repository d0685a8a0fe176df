//! The numbers of a scene by name: what is learnt is a variable, all else a constant.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::{FitError, Variables};

/// The variables of a step, over the scene's own numbers.
#[derive(Clone, Copy)]
pub struct Values<'t, 'a> {
    /// The step's tape.
    pub tape: &'t Tape<f32>,
    /// What is learnt.
    pub learnt: Option<&'a Variables<'t, f32>>,
}

impl<'t> Values<'t, '_> {
    /// What is learnt under this name.
    pub fn learnt(&self, name: &str) -> Option<Var<'t, f32>> {
        self.learnt?.get(name).ok()
    }

    /// What is learnt under this name, or else the scene's own number.
    pub fn tensor(&self, name: &str, own: &Tensor<f32>) -> Var<'t, f32> {
        self.learnt(name).unwrap_or_else(|| self.tape.constant(own))
    }

    /// What is learnt under this name, or else a single number.
    pub fn number(&self, name: &str, own: f64) -> Var<'t, f32> {
        self.learnt(name).unwrap_or_else(|| self.tape.constant_scalar(own as f32))
    }

    /// What is learnt under this name, or else three numbers.
    pub fn triple(&self, name: &str, own: [f32; 3]) -> Var<'t, f32> {
        self.learnt(name).unwrap_or_else(|| self.tape.constant(&Tensor::from(own)))
    }
}

/// The name of an object's parameter.
pub(crate) fn of_object(kind: &str, object: &str) -> String {
    format!("{kind}/{object}")
}

/// The end of what a step must not do without.
pub(crate) type Recorded<'t> = Result<Var<'t, f32>, FitError>;
