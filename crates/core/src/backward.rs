//! Backward passes over the tape.
//!
//! A pass starts from upstream gradients at some variables and walks the operations in reverse.
//! An operation runs where one of its outputs has an upstream gradient and one of its inputs leads
//! to a requested variable; all others are skipped. The gradient of an inner value lives until the
//! operation that made the value has used it; then its buffer serves the operations further down.

use std::any::type_name;
use std::fmt;
use std::ops::Range;
use std::time::Instant;

use smallvec::SmallVec;

use crate::entries::Entries;
use crate::error::TensorError;
use crate::gradient::{Accumulator, Accumulators, Wanted};
use crate::op::{Inputs, Kept};
use crate::report::Count;
use crate::scalar::Scalar;
use crate::tape::{Inner, Results, Tape};
use crate::tensor::Tensor;
use crate::var::Var;

/// The gradients that a backward pass was asked for.
pub struct Gradients<'t, T: Scalar> {
    pub(crate) tape: &'t Tape<T>,
    pub(crate) results: Results<T>,
}

impl<'t, T: Scalar> Gradients<'t, T> {
    /// The gradient with respect to `variable`, in its shape. It is `None` in three cases:
    /// - it was not asked for;
    /// - it is zero, because nothing that the pass started from depends on the variable;
    /// - it is not known, because the variable is a constant: what was recorded without a gradient
    ///   has none.
    ///
    /// # Panics
    /// For a variable of another tape, whose gradient is none of these.
    #[track_caller]
    pub fn get(&self, variable: Var<'t, T>) -> Option<&Tensor<T>> {
        self.results[self.place_of(variable)?].1.as_ref()
    }

    /// [`Gradients::get`], given up: unless somebody has cloned it, its entries can be taken without a copy (`Vec::from`).
    /// The tape has no use of this memory any more, and the next step takes new. Afterwards it counts as not asked for.
    ///
    /// # Panics
    /// As [`Gradients::get`].
    #[track_caller]
    pub fn take(&mut self, variable: Var<'t, T>) -> Option<Tensor<T>> {
        let place = self.place_of(variable)?;
        self.results[place].1.take()
    }

    /// Where the gradient of `variable` is, if it was asked for.
    #[track_caller]
    fn place_of(&self, variable: Var<'t, T>) -> Option<usize> {
        assert!(
            std::ptr::eq(variable.tape, self.tape),
            "gradients need a variable of their own tape, got one of another tape"
        );
        self.results.binary_search_by_key(&variable.index, |&(index, _)| index).ok()
    }

    /// The gradient with respect to `variable`, in its shape, zeros where [`Gradients::get`] has
    /// none.
    ///
    /// # Panics
    /// As [`Gradients::get`].
    #[track_caller]
    pub fn get_or_zeros(&self, variable: Var<'t, T>) -> Tensor<T> {
        let zeros = || Tensor::zeros(variable.shape());
        self.get(variable).cloned().unwrap_or_else(zeros)
    }
}

impl<T: Scalar> Drop for Gradients<'_, T> {
    fn drop(&mut self) {
        // Not while a panic inside the tape unwinds past this value.
        let Ok(mut inner) = self.tape.inner.try_borrow_mut() else { return };
        for (_, tensor) in self.results.drain(..) {
            let Some(tensor) = tensor else { continue };
            let (_, data) = tensor.into_parts();
            inner.pool.give_shared(data);
        }
        inner.results.push(std::mem::take(&mut self.results));
    }
}

impl<T: Scalar> fmt::Debug for Gradients<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(self.results.iter().map(|(index, tensor)| (index, tensor))).finish()
    }
}

impl<'t, T: Scalar> Var<'t, T> {
    /// The gradients of this scalar with respect to every leaf.
    ///
    /// # Errors
    /// [`TensorError::NotScalar`] unless the variable has exactly one entry;
    /// [`TensorError::ForwardOnly`] for numbers without backward passes.
    pub fn backward(self) -> Result<Gradients<'t, T>, TensorError> {
        self.tape.run_backward(&[(self, None)], None)
    }

    /// The gradients of this scalar with respect to `wrt` alone, leaves or not; what leads to
    /// none of them is not computed.
    ///
    /// # Errors
    /// As [`Var::backward`]; [`TensorError::ForeignVariable`] where one of `wrt` belongs to another tape.
    pub fn backward_to(self, wrt: &[Var<'t, T>]) -> Result<Gradients<'t, T>, TensorError> {
        self.tape.run_backward(&[(self, None)], Some(wrt))
    }
}

impl<T: Scalar> Tape<T> {
    /// The gradients of `sum_k <upstream_k, variable_k>` with respect to every leaf: the
    /// vector-Jacobian product for the given upstream gradients.
    ///
    /// # Errors
    /// [`TensorError::Mismatch`] unless each upstream gradient has the shape of its variable;
    /// [`TensorError::ForeignVariable`] where a variable belongs to another tape;
    /// [`TensorError::ForwardOnly`] for numbers without backward passes.
    pub fn vjp<'t>(
        &'t self,
        seeds: &[(Var<'t, T>, &Tensor<T>)],
    ) -> Result<Gradients<'t, T>, TensorError> {
        let seeds: SmallVec<[_; 4]> =
            seeds.iter().map(|&(var, tensor)| (var, Some(tensor))).collect();
        self.run_backward(&seeds, None)
    }

    /// [`Tape::vjp`] with respect to `wrt` alone, leaves or not; what leads to none of them is not
    /// computed.
    ///
    /// # Errors
    /// As [`Tape::vjp`].
    pub fn vjp_to<'t>(
        &'t self,
        seeds: &[(Var<'t, T>, &Tensor<T>)],
        wrt: &[Var<'t, T>],
    ) -> Result<Gradients<'t, T>, TensorError> {
        let seeds: SmallVec<[_; 4]> =
            seeds.iter().map(|&(var, tensor)| (var, Some(tensor))).collect();
        self.run_backward(&seeds, Some(wrt))
    }

    /// A pass from `seeds` (`None`: a gradient of 1 at a scalar) to `wrt` (`None`: all leaves).
    #[inline(never)]
    fn run_backward<'t>(
        &'t self,
        seeds: &[(Var<'t, T>, Option<&Tensor<T>>)],
        wrt: Option<&[Var<'t, T>]>,
    ) -> Result<Gradients<'t, T>, TensorError> {
        if !T::HAS_BACKWARD {
            return Err(TensorError::ForwardOnly { numbers: type_name::<T>() });
        }
        let all = seeds.iter().map(|&(var, _)| var).chain(wrt.unwrap_or_default().iter().copied());
        if all.into_iter().any(|var| !std::ptr::eq(var.tape, self)) {
            return Err(TensorError::ForeignVariable { operation: "backward" });
        }
        let mut inner = self.inner.borrow_mut();
        inner.check_seeds(seeds)?;
        inner.begin_call();
        let mut results = inner.results.pop().unwrap_or_default();
        inner.mark_wanted(wrt, &mut results);
        inner.seed(seeds);
        inner.walk();
        inner.collect_results(&mut results);
        inner.is_call_under_way = false;
        Ok(Gradients { tape: self, results })
    }
}

impl<T: Scalar> Inner<T> {
    fn check_seeds(&self, seeds: &[(Var<'_, T>, Option<&Tensor<T>>)]) -> Result<(), TensorError> {
        for (var, upstream) in seeds {
            let shape = &self.values[var.index as usize].shape;
            match upstream {
                None if shape.size() != 1 => {
                    return Err(TensorError::NotScalar { shape: shape.clone() });
                }
                Some(upstream) if upstream.shape() != shape => {
                    return Err(TensorError::Mismatch {
                        operation: "backward",
                        rule: "an upstream gradient of its variable's shape".into(),
                        shapes: Box::new([upstream.shape().clone(), shape.clone()]),
                    });
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Marks the values whose gradients a pass computes, and lists the results it returns.
    fn mark_wanted(&mut self, wrt: Option<&[Var<'_, T>]>, results: &mut Results<T>) {
        let Self { values, live, links, nodes, wanted, gradients, .. } = self;
        let values = &values[..*live];
        gradients.clear();
        gradients.resize_with(values.len(), Accumulator::vacant);
        wanted.clear();
        let Some(wrt) = wrt else {
            // Every value that needs a gradient leads to some leaf.
            wanted.extend(values.iter().map(|value| match (value.needs, value.entry) {
                (false, _) => Wanted::Nothing,
                (true, Some(_)) => Wanted::Through,
                (true, None) => Wanted::Result,
            }));
            let leaves = (0..).zip(&*wanted).filter(|&(_, &wanted)| wanted == Wanted::Result);
            results.extend(leaves.map(|(index, _)| (index, None)));
            return;
        };
        wanted.resize(values.len(), Wanted::Nothing);
        for var in wrt.iter().filter(|var| values[var.index as usize].needs) {
            wanted[var.index as usize] = Wanted::Result;
            results.push((var.index, None));
        }
        results.sort_unstable_by_key(|&(index, _)| index);
        results.dedup_by_key(|&mut (index, _)| index);
        // Inputs were recorded before outputs, so one walk forward finds all that leads to a result.
        for node in &*nodes {
            let mut inputs = links[node.links()].iter();
            if inputs.any(|&input| wanted[input as usize] != Wanted::Nothing) {
                for wanted in &mut wanted[node.outputs()] {
                    if *wanted == Wanted::Nothing {
                        *wanted = Wanted::Through;
                    }
                }
            }
        }
    }

    /// Puts the upstream gradients of the seeds in place. Those of the caller are not copied.
    fn seed(&mut self, seeds: &[(Var<'_, T>, Option<&Tensor<T>>)]) {
        let Self { values, pool, gradients, wanted, .. } = self;
        for (var, upstream) in seeds {
            let index = var.index as usize;
            if wanted[index] == Wanted::Nothing {
                continue;
            }
            let gradient = &mut gradients[index];
            match upstream {
                Some(upstream) => gradient.lend((*upstream).clone().into_parts().1, pool),
                None => {
                    gradient.prepare(values[index].data().len(), pool);
                    gradient.add(&[T::ONE]);
                }
            }
        }
    }

    /// Runs the backward passes of the operations, last to first. Gradients that nobody asked for
    /// go back to the pool once the operation that made the value has used them.
    fn walk(&mut self) {
        let Self { values, links, nodes, places, pool, tally, gradients, wanted, .. } = self;
        for node in nodes.iter().rev() {
            let Range { start, end } = node.outputs();
            // A comparison: there is nothing that a gradient could come from.
            if start == end {
                continue;
            }
            let inputs = &links[node.links()];
            // Inputs were recorded before outputs.
            let (below, above) = gradients.split_at_mut(start);
            let upstream = &mut above[..end - start];
            let count = tally.count(node.entry);
            if upstream.iter().all(|gradient| gradient.sum().is_none()) {
                count.unused += 1;
                continue;
            }
            if inputs.iter().all(|&input| wanted[input as usize] == Wanted::Nothing) {
                count.unwanted += 1;
                continue;
            }
            count_what_is_left_out(count, (inputs, wanted), upstream);
            let clock = self.timed.then(Instant::now);
            // Nobody reads it after this operation, which can have the memory then.
            let taken = match upstream {
                [only] if node.keep.takes_upstream() && wanted[start] != Wanted::Result => {
                    only.take_own()
                }
                _ => None,
            };
            let kept = Kept {
                operation: count.operation.name,
                keep: node.keep,
                inputs: Inputs { values, indices: inputs },
                outputs: &values[start..end],
                upstream,
            };
            let (indices, gradients) = (inputs, below);
            let mut sums =
                Accumulators { values, indices, wanted, gradients, upstream: taken, pool };
            places[node.place as usize].recorded.backward(&kept, &mut sums);
            if let Some(left) = sums.upstream {
                pool.give(left);
            }
            // All that used these outputs has run before: their gradients have done their work.
            for (gradient, wanted) in upstream.iter_mut().zip(&wanted[start..]) {
                if *wanted != Wanted::Result {
                    gradient.release(pool);
                }
            }
            count.operation.backward_calls += 1;
            if let Some(clock) = clock {
                count.operation.backward += clock.elapsed();
            }
        }
    }

    /// Moves the gradients that were asked for into `results`, and any others back to the pool:
    /// a pass may have started at a value that nobody asked for and no operation computed.
    fn collect_results(&mut self, results: &mut Results<T>) {
        let Self { values, pool, gradients, .. } = self;
        for (index, result) in results.iter_mut() {
            let index = *index as usize;
            *result = gradients[index].take(pool).map(|gradient| {
                let entries = Entries::Own(pool.share(gradient));
                Tensor::from_parts(values[index].shape.clone(), entries)
            });
        }
        gradients.drain(..).for_each(|mut gradient| gradient.release(pool));
    }
}

/// Counts the gradients of inputs that nobody wants, and the outputs that have no upstream gradient.
#[inline]
fn count_what_is_left_out<T: Scalar>(
    count: &mut Count,
    (inputs, wanted): (&[u32], &[Wanted]),
    upstream: &[Accumulator<T>],
) {
    for (i, &input) in inputs.iter().enumerate() {
        if wanted[input as usize] == Wanted::Nothing {
            count.leave_out_input(i);
        }
    }
    for (j, gradient) in upstream.iter().enumerate() {
        if gradient.sum().is_none() {
            count.leave_out_output(j);
        }
    }
}
