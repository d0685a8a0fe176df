//! The blurs of all rungs, which are made as they are used.

use super::blur::Blur;
use super::iris::{Iris, Weights};
use super::rungs::Rungs;
use crate::size::Size;

/// The blurs of all rungs.
#[derive(Debug, Default)]
pub(crate) struct Blurs {
    pub(crate) rungs: Rungs,
    iris: Iris,
    /// Per rung: how often its image is halved, and the weights of the iris, also upside down, once they are used.
    pub(crate) halvings: Vec<usize>,
    weights: Vec<Option<[Weights; 2]>>,
}

impl Blurs {
    /// Makes ready for circles of at most `largest` pixels; whether anything is new.
    pub(crate) fn reach(&mut self, largest: f64, iris: Iris) -> bool {
        self.rungs.reach(largest);
        let count = self.rungs.count();
        if self.weights.len() == count && self.iris == iris {
            return false;
        }
        self.iris = iris;
        self.halvings = (0..count).map(|rung| self.rungs.halvings(rung).0).collect();
        self.weights = vec![None; count];
        true
    }

    /// Makes the weights of a rung, unless there are some.
    pub(crate) fn use_rung(&mut self, rung: usize) {
        if self.weights[rung].is_none() {
            let (_, variance) = self.rungs.halvings(rung);
            let is_in_front = self.rungs.radius(rung) < 0.0;
            let mut weights = Weights::pair(self.iris, variance);
            if is_in_front {
                weights.reverse();
            }
            self.weights[rung] = Some(weights);
        }
    }

    /// The blur of a rung, where it is used; and its adjoint.
    pub(crate) fn blur(&self, rung: usize, size: Size) -> Option<[Blur<'_>; 2]> {
        let halvings = self.halvings[rung];
        let weights = self.weights[rung].as_ref()?;
        Some([0, 1].map(|k| Blur { rung, size, halvings, weights: &weights[k] }))
    }
}
