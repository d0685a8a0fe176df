//! Making a failure small: first the shapes, then the upstream gradient, then the values.

use bokashi_core::{Shape, Tensor};

use crate::failure::{Broken, Law};
use crate::laws;
use crate::run::caught;
use crate::subject::{Case, Input};
use crate::trial::{Trial, Unfit};

/// Trials that are spent on making one failure small.
const MOST_TRIALS: usize = 600;

/// How `case` breaks `law`, if it does, and for which upstream gradients. A refusal is no failure.
fn breaks(
    law: Law,
    case: &Case,
    upstream: Option<Vec<Tensor<f64>>>,
) -> Option<(Broken, Vec<Tensor<f64>>)> {
    let tried = caught(|| match Trial::new(case.clone(), upstream.clone()) {
        Ok(trial) => match caught(|| laws::check(law, &trial)) {
            Ok(result) => result.err().map(|broken| (broken, trial.upstream)),
            Err(panic) => Some((panicked(&panic), trial.upstream)),
        },
        // What breaks before the law is looked at breaks another law.
        Err(Unfit::Broken(broken)) => {
            (law == Law::Defined).then(|| (broken, upstream.clone().unwrap_or_default()))
        }
        Err(Unfit::Refused(_)) => None,
    });
    tried.unwrap_or_else(|panic| {
        (law == Law::Defined).then(|| (panicked(&panic), upstream.unwrap_or_default()))
    })
}

fn panicked(panic: &str) -> Broken {
    Broken::from_message(format!("it panicked: {panic}"))
}

/// A failure and what leads to it.
#[derive(Debug, Clone)]
pub(crate) struct Counterexample {
    pub(crate) case: Case,
    pub(crate) upstream: Vec<Tensor<f64>>,
    pub(crate) broken: Broken,
}

/// Makes `counterexample` smaller for as long as it still breaks `law`.
pub(crate) fn shrink(law: Law, counterexample: Counterexample) -> Counterexample {
    let mut search = Search { law, counterexample, trials: 0 };
    while search.shorten() {}
    search.single_out();
    search.simplify();
    search.counterexample
}

struct Search {
    law: Law,
    counterexample: Counterexample,
    trials: usize,
}

impl Search {
    /// Takes a candidate if it breaks the law.
    fn accept(&mut self, case: Case, upstream: Option<Vec<Tensor<f64>>>) -> bool {
        if self.trials == MOST_TRIALS {
            return false;
        }
        self.trials += 1;
        let Some((broken, upstream)) = breaks(self.law, &case, upstream) else {
            return false;
        };
        self.counterexample = Counterexample { case, upstream, broken };
        true
    }

    /// Cuts every axis of one extent to fewer entries, in all inputs at once, since axes of one
    /// extent often belong together; or in one input alone.
    fn shorten(&mut self) -> bool {
        let inputs = self.counterexample.case.inputs.clone();
        let mut extents: Vec<usize> =
            inputs.iter().flat_map(|input| input.tensor.shape().iter().copied()).collect();
        extents.sort_unstable_by(|a, b| b.cmp(a));
        extents.dedup();
        for extent in extents {
            let mut shorter = vec![1, extent / 2, extent.saturating_sub(1)];
            shorter.retain(|&new| new > 0 && new < extent);
            shorter.dedup();
            for new in shorter {
                let holders = (0..inputs.len()).map(Some).chain([None]);
                // All at once first.
                let holders: Vec<_> =
                    [None].into_iter().chain(holders.flatten().map(Some)).collect();
                for only in holders {
                    let cut = |(i, input): (usize, &Input)| {
                        let chosen = only.is_none_or(|only| only == i);
                        let tensor = if chosen {
                            shortened(&input.tensor, extent, new)
                        } else {
                            input.tensor.clone()
                        };
                        Input { tensor, ..*input }
                    };
                    let inputs: Vec<_> = inputs.iter().enumerate().map(cut).collect();
                    let case = Case { inputs, ..self.counterexample.case.clone() };
                    if case.inputs != self.counterexample.case.inputs && self.accept(case, None) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Leaves one entry of the upstream gradients, by halves.
    fn single_out(&mut self) {
        loop {
            let all: Vec<(usize, usize)> = entries(&self.counterexample.upstream);
            if all.len() < 2 {
                break;
            }
            let (low, high) = all.split_at(all.len() / 2);
            let halves = [low, high].map(|kept| masked(&self.counterexample.upstream, kept));
            let case = self.counterexample.case.clone();
            if !halves.into_iter().any(|half| self.accept(case.clone(), Some(half))) {
                break;
            }
        }
        let mut upstream = self.counterexample.upstream.clone();
        if let [(j, k)] = entries(&upstream)[..] {
            upstream[j].data_mut()[k] = 1.0;
            self.accept(self.counterexample.case.clone(), Some(upstream));
        }
    }

    /// Tries simpler numbers for every entry.
    fn simplify(&mut self) {
        for i in 0..self.counterexample.case.inputs.len() {
            for k in 0..self.counterexample.case.inputs[i].tensor.size() {
                let x = self.counterexample.case.inputs[i].tensor.data()[k];
                let rounded = |unit: f64| (x / unit).round() * unit;
                let simpler = [0.0, 1.0, rounded(1.0), rounded(0.5), rounded(0.125)];
                for simple in simpler {
                    if simple.to_bits() == x.to_bits() || (simple == 0.0 && x == 0.0) {
                        break;
                    }
                    let mut case = self.counterexample.case.clone();
                    case.inputs[i].tensor.data_mut()[k] = simple;
                    if self.accept(case, Some(self.counterexample.upstream.clone())) {
                        break;
                    }
                }
            }
        }
    }
}

/// The places of entries other than 0.
fn entries(upstream: &[Tensor<f64>]) -> Vec<(usize, usize)> {
    let entries = upstream.iter().enumerate().flat_map(|(j, u)| {
        let entries = u.data().iter().enumerate().filter(|&(_, &u)| u != 0.0);
        entries.map(move |(k, _)| (j, k))
    });
    entries.collect()
}

/// `upstream` with 0 everywhere but at `kept`.
fn masked(upstream: &[Tensor<f64>], kept: &[(usize, usize)]) -> Vec<Tensor<f64>> {
    let mut masked: Vec<_> = upstream.iter().map(|u| u.map(|_| 0.0)).collect();
    for &(j, k) in kept {
        masked[j].data_mut()[k] = upstream[j].data()[k];
    }
    masked
}

/// The first `new` entries along every axis of the given extent.
fn shortened(tensor: &Tensor<f64>, extent: usize, new: usize) -> Tensor<f64> {
    let shape = tensor.shape();
    let axes: Vec<usize> = shape.iter().map(|&n| if n == extent { new } else { n }).collect();
    let cut = Shape::from(&axes[..]);
    Tensor::from_flat_fn(&cut, |mut k| {
        let (mut entry, mut stride) = (0, 1);
        for (&new, &old) in axes.iter().zip(shape.iter()).rev() {
            entry += k % new * stride;
            stride *= old;
            k /= new;
        }
        tensor.data()[entry]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shorter_tensor_keeps_the_first_entries() {
        let tensor = Tensor::from_flat_fn([2, 3, 3], |k| k as f64);
        let short = shortened(&tensor, 3, 2);
        assert_eq!(short.shape(), &Shape::from([2, 2, 2]));
        assert_eq!(short.data(), [0.0, 1.0, 3.0, 4.0, 9.0, 10.0, 12.0, 13.0]);
    }
}
