//! What depends on what, and where numbers stop being finite: questions that a caller asks once
//! something went wrong. None of them costs a step that does not ask.

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::tape::{Inner, Tape};
use crate::value::Parting;
use crate::var::Var;

/// How one variable depends on another, by the operations between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Dependence {
    /// Operations lead from one to the other, so a backward pass can too, even where the gradient
    /// is zero.
    Recorded,
    /// An operation that would lead there was the identity of another input in this step, as its
    /// values happened to be. The gradient is zero, and may be another one in the next step.
    Idle {
        /// The operation.
        operation: &'static str,
    },
    /// Nothing leads there.
    None {
        /// The last operation that depends on the lower variable; `None` where none does.
        end: Option<&'static str>,
        /// Whether the way ends because a value was detached ([`Var::detach`]).
        is_detached: bool,
    },
}

impl<'t, T: Scalar> Var<'t, T> {
    /// How this variable depends on `below`, a leaf or an operation's output.
    ///
    /// # Errors
    /// [`TensorError::ForeignVariable`] where `below` belongs to another tape.
    pub fn dependence_on(self, below: Self) -> Result<Dependence, TensorError> {
        if !std::ptr::eq(self.tape, below.tape) {
            return Err(TensorError::ForeignVariable { operation: "dependence" });
        }
        let inner = &*self.tape.inner.borrow();
        let Inner { values, live, links, nodes, tally, .. } = inner;
        let mut depends = vec![false; *live];
        depends[below.index as usize] = true;
        let mut end = None;
        for node in nodes {
            if links[node.links()].iter().any(|&input| depends[input as usize]) {
                depends[node.outputs()].fill(true);
                end = Some(tally.name(node.entry));
            }
        }
        if depends[self.index as usize] {
            return Ok(Dependence::Recorded);
        }
        let partings = || values[..*live].iter().zip(&depends).filter(|(_, depends)| **depends);
        let idle = partings().find_map(|(value, _)| match value.parting {
            Parting::Idle(entry) => Some(tally.name(entry)),
            Parting::None | Parting::Detached => None,
        });
        if let Some(operation) = idle {
            return Ok(Dependence::Idle { operation });
        }
        let detached = partings().rev().find(|(value, _)| value.parting == Parting::Detached);
        if let Some((value, _)) = detached {
            // What was detached ends the way, whatever else was computed of it.
            end = value.entry.map(|entry| tally.name(entry));
        }
        Ok(Dependence::None { end, is_detached: detached.is_some() })
    }

    /// What the operation that computed the value took in: nothing for a leaf or a constant, nor
    /// where no input needs a gradient, since the operation was not recorded then.
    pub fn inputs(self) -> SmallVec<[Self; 4]> {
        let inner = &*self.tape.inner.borrow();
        let at = self.index as usize;
        let node = inner.nodes.iter().find(|node| node.outputs().contains(&at));
        let links = node.map_or(&[][..], |node| &inner.links[node.links()]);
        links.iter().map(|&index| Var { tape: self.tape, index }).collect()
    }

    /// Whether both are handles to one value of one tape.
    pub fn is(self, other: Self) -> bool {
        std::ptr::eq(self.tape, other.tape) && self.index == other.index
    }

    /// The operation that, in a backward pass from this scalar, first makes a gradient infinite or
    /// NaN of upstream gradients that are not; its first output. `None` where all gradients are
    /// finite.
    ///
    /// # Errors
    /// [`TensorError::NotScalar`] unless the variable has exactly one entry.
    pub fn first_gradient_not_finite(self) -> Result<Option<Self>, TensorError> {
        let all: Vec<_> = self.tape.variables().collect();
        let gradients = self.backward_to(&all)?;
        let is_broken = |&&value: &&Self| gradients.get(value).is_some_and(|g| !g.is_finite());
        // The last such value: the gradients of all that was computed from it are finite.
        let Some(&value) = all.iter().rev().find(is_broken) else { return Ok(None) };
        let users: Vec<_> = {
            let Inner { nodes, links, .. } = &*self.tape.inner.borrow();
            let uses = nodes.iter().filter(|node| links[node.links()].contains(&value.index));
            uses.map(|node| node.outputs()).collect()
        };
        let mut last = None;
        // In the order of recording: what lies between a user and the value was asked before.
        for outputs in users {
            let outputs = &all[outputs];
            let upstream = outputs.iter().filter_map(|&of| Some((of, gradients.get(of)?)));
            let upstream: Vec<_> = upstream.collect();
            if upstream.is_empty() {
                continue;
            }
            last = Some(outputs[0]);
            let gradients = self.tape.vjp_to(&upstream, &[value])?;
            if gradients.get(value).is_some_and(|gradient| !gradient.is_finite()) {
                break;
            }
        }
        // Where each share is finite and their sum is not, the last user stands for all.
        Ok(last)
    }
}

impl<T: Scalar> Tape<T> {
    /// The first value of the step, in the order of recording, with an entry that is infinite or
    /// NaN.
    pub fn first_not_finite(&self) -> Option<Var<'_, T>> {
        let inner = &*self.inner.borrow();
        let is_finite = |entries: &[T]| entries.iter().all(|entry| entry.is_finite());
        let at = inner.values[..inner.live].iter().position(|value| !is_finite(value.data()))?;
        Some(Var { tape: self, index: at as u32 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gradient::Accumulators;
    use crate::op::{Inputs, Kept, Op, Outputs};
    use crate::tensor::Tensor;

    /// `image`, whatever `rim` is, as an operation gives it where nothing is to be done.
    struct Rims;

    impl Op<f64> for Rims {
        type Saved = ();
        type Error = TensorError;

        fn name(&self) -> &'static str {
            "rims"
        }
        fn forward(
            &self,
            _inputs: &Inputs<'_, f64>,
            outputs: &mut Outputs<'_, f64>,
            _saved: &mut (),
        ) -> Result<(), TensorError> {
            outputs.pass(0, "there is no rim");
            Ok(())
        }
        fn backward(&self, _: &Kept<'_, f64>, _saved: &mut (), _: &mut Accumulators<'_, f64>) {}
    }

    fn none(end: Option<&'static str>, is_detached: bool) -> Dependence {
        Dependence::None { end, is_detached }
    }

    #[test]
    fn a_way_is_what_was_recorded_even_where_the_gradient_is_zero() {
        let tape = Tape::new();
        let [x, y] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
        let loss = (x.sin() * 0.0).exp() + y;
        for variable in [x, y, loss] {
            assert_eq!(loss.dependence_on(variable), Ok(Dependence::Recorded));
        }
        assert_eq!(x.dependence_on(loss), Ok(none(None, false)));
        assert_eq!(y.dependence_on(x), Ok(none(Some("add"), false)));
        assert!(loss.dependence_on(Tape::new().leaf_scalar(1.0)).is_err());
    }

    #[test]
    fn a_way_that_ends_is_named_by_its_last_operation() {
        let tape = Tape::new();
        let [x, y] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
        let loss = y.square();
        assert_eq!(loss.dependence_on(x), Ok(none(None, false)));
        let (side, _) = (x.exp().sin(), y + 1.0);
        assert_eq!(loss.dependence_on(x), Ok(none(Some("sin"), false)));
        let loss = loss + side.detach();
        assert_eq!(loss.dependence_on(x), Ok(none(Some("sin"), true)));
        // What is computed beside it, to be shown perhaps, does not hide it.
        let _ = x.tanh();
        assert_eq!(loss.dependence_on(x), Ok(none(Some("sin"), true)));
        let raw = tape.leaf_scalar(1.0);
        let loss = loss + raw.detach();
        assert_eq!(loss.dependence_on(raw), Ok(none(None, true)));
        // The only way counts: another one that ends does not matter.
        let loss = loss + raw;
        assert_eq!(loss.dependence_on(raw), Ok(Dependence::Recorded));
    }

    #[test]
    fn an_operation_that_was_the_identity_in_this_step_is_a_way_that_rests() {
        let mut tape = Tape::new();
        for _ in 0..2 {
            let [image, rim] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
            let loss = tape.apply(Rims, &[image, rim.exp()]).unwrap().square();
            assert_eq!(loss.dependence_on(image), Ok(Dependence::Recorded));
            assert_eq!(loss.dependence_on(rim), Ok(Dependence::Idle { operation: "rims" }));
            // Its mark goes with the step.
            tape.reset();
            let [image, rim] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
            let (loss, _) = (image.square(), rim.exp());
            assert_eq!(loss.dependence_on(rim), Ok(none(Some("exp"), false)));
            tape.reset();
        }
    }

    #[test]
    fn inputs_are_those_of_the_operation_that_computed_the_value() {
        let tape = Tape::new();
        let (x, frozen) = (tape.leaf_scalar(2.0), tape.constant_scalar(1.0));
        let y = frozen * x;
        let inputs = y.inputs();
        assert!(inputs.len() == 2 && inputs[0].is(frozen) && inputs[1].is(x) && !y.is(x));
        assert!(x.inputs().is_empty() && frozen.exp().inputs().is_empty());
        assert!(!x.is(Tape::new().leaf_scalar(2.0)));
    }

    #[test]
    fn the_first_value_that_is_not_finite_is_found_wherever_it_stands() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::new([2], vec![1.0, -1.0]).unwrap());
        assert!(tape.first_not_finite().is_none());
        let logarithm = (x * 2.0).ln();
        let _ = (logarithm.exp() / 0.0).sum();
        assert!(tape.first_not_finite().unwrap().is(logarithm));
        let tape = Tape::new();
        let frozen = tape.constant_full([3], f64::INFINITY);
        assert!((frozen.tape().first_not_finite().unwrap()).is(frozen));
    }

    #[test]
    fn the_first_gradient_that_is_not_finite_is_laid_to_the_operation_that_made_it() {
        let tape = Tape::new();
        let [x, y] = [0.0, 3.0].map(|number| tape.leaf_scalar(number));
        let root = x.sqrt();
        // `x` collects a finite gradient of the sine, recorded later, and an infinite one.
        let loss = (root + y).exp() + x.sin();
        assert!(loss.first_gradient_not_finite().unwrap().unwrap().is(root));
        assert!(y.square().first_gradient_not_finite().unwrap().is_none());
        // An input of the sum lies below the other one.
        let root = (x * 0.0).sqrt();
        assert!((x + root).first_gradient_not_finite().unwrap().unwrap().is(root));
        // Each share is finite.
        let (left, right) = (y * 1e308, y * 1e308);
        assert!((left + right).first_gradient_not_finite().unwrap().unwrap().is(right));
        assert!(tape.constant_full([2], 1.0).first_gradient_not_finite().is_err());
    }
}
