//! Parameters on a tape, for one step.

use std::sync::Arc;

use bokashi_core::{Scalar, Tape, Var};
use smallvec::SmallVec;

use crate::error::{FitError, Origin};

/// A parameter on a tape.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Variable<'t, T: Scalar> {
    pub(crate) raw: Var<'t, T>,
    pub(crate) value: Var<'t, T>,
}

/// The parameters on a tape, for one step.
#[derive(Debug, Clone)]
pub struct Variables<'t, T: Scalar> {
    /// The variables. Up to eight need no allocation.
    pub(crate) list: SmallVec<[Variable<'t, T>; 8]>,
    pub(crate) names: Arc<[String]>,
}

impl<'t, T: Scalar> Variables<'t, T> {
    /// The value of the parameter `name`.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`].
    pub fn get(&self, name: &str) -> Result<Var<'t, T>, FitError> {
        Ok(self.list[position(&self.names, name)?].value)
    }

    /// The values of all parameters, in the order of the list.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Var<'t, T>> + '_ {
        self.list.iter().map(|variable| variable.value)
    }

    /// The variables with one more, `name`. A pipeline computes its value from the others once, for all of its views.
    #[must_use]
    pub fn with(mut self, name: String, value: Var<'t, T>) -> Self {
        self.names = self.names.iter().cloned().chain([name]).collect();
        self.list.push(Variable { raw: value, value });
        self
    }

    /// The variables without `name`. A loss of the others has no gradient by it.
    #[must_use]
    pub fn without(mut self, name: &str) -> Self {
        if let Ok(index) = position(&self.names, name) {
            self.list.remove(index);
            self.names = self.names.iter().filter(|known| *known != name).cloned().collect();
        }
        self
    }

    /// The parameters `names` with leaves of a tape for values.
    pub(crate) fn from_leaves(names: &Arc<[String]>, leaves: &[Var<'t, T>]) -> Self {
        let list = leaves.iter().map(|&leaf| Variable { raw: leaf, value: leaf }).collect();
        Self { list, names: Arc::clone(names) }
    }

    /// The first place on `tape` with a number that is not finite.
    pub(crate) fn origin_on(&self, tape: &'t Tape<T>) -> Option<Box<Origin>> {
        tape.first_not_finite().map(|first| {
            Box::new(match first.operation() {
                Some(operation) => {
                    Origin::Output { operation, parameters: self.names_among(&first.inputs()) }
                }
                None => Origin::Input { shape: first.shape() },
            })
        })
    }

    /// The names of the parameters that are among `inputs`.
    fn names_among(&self, inputs: &[Var<'t, T>]) -> Vec<String> {
        let is_among = |variable: &Variable<'t, T>| {
            inputs.iter().any(|input| input.is(variable.raw) || input.is(variable.value))
        };
        let named = self.list.iter().zip(&*self.names);
        named.filter(|(variable, _)| is_among(variable)).map(|(_, name)| name.clone()).collect()
    }

    /// The raw numbers of the parameter `name`, the leaf by which gradients are taken.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`].
    pub fn raw(&self, name: &str) -> Result<Var<'t, T>, FitError> {
        Ok(self.list[position(&self.names, name)?].raw)
    }
}

/// The value of the parameter with an index in the list.
impl<'t, T: Scalar> std::ops::Index<usize> for Variables<'t, T> {
    type Output = Var<'t, T>;

    fn index(&self, index: usize) -> &Var<'t, T> {
        &self.list[index].value
    }
}

/// The index of a name in `names`.
pub(super) fn position(names: &[String], name: &str) -> Result<usize, FitError> {
    let index = names.iter().position(|known| known == name);
    index.ok_or_else(|| FitError::UnknownParameter { name: name.into(), known: names.to_vec() })
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use crate::parameter::{Parameter, Parameters};

    #[test]
    fn what_follows_from_variables_stands_among_them_and_hands_gradients_on() {
        let one = |name: &str, value: f64| Parameter::new(name, Tensor::scalar(value));
        let list = Parameters::<f64>::new().with(one("a", 2.0)).unwrap();
        let list = list.with(one("b", 3.0)).unwrap();
        let tape = Tape::new();
        let variables = list.record(&tape);
        let square = variables.get("a").unwrap().square();
        let others = variables.clone().without("a").without("c").with("square".into(), square);
        assert!(others.get("a").is_err());
        let loss = others.get("square").unwrap() * others.get("b").unwrap();
        let gradients = loss.backward().unwrap();
        assert_eq!(gradients.get_or_zeros(variables.raw("a").unwrap()).item(), 12.0);
        // Those that they were made of are as they were.
        assert_eq!(variables.iter().count(), 2);
        assert!(variables.get("square").is_err());
    }
}
