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
        let index = self.index as usize;
        let node = inner.nodes.iter().find(|node| node.outputs().contains(&index));
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
            let upstream =
                outputs.iter().filter_map(|&output| Some((output, gradients.get(output)?)));
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
        let index = inner.values[..inner.live].iter().position(|value| !is_finite(value.data()))?;
        Some(Var { tape: self, index: index as u32 })
    }
}
